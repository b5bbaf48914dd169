#include "slicecorr/even_dead_zone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "flow/image_light.hpp"
#include "parallel/silent.hpp"
#include "pipeline/even_cells.hpp"
#include "pipeline/planned_images.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

using detail::EvenSections;

namespace {

constexpr double kFull = 255;

FlowPattern pattern_of(EvenDeadZone even) {
  switch (even) {
    case EvenDeadZone::blue:
      return FlowPattern::blue;
    case EvenDeadZone::uv:
      return FlowPattern::uv;
    case EvenDeadZone::both:
      return FlowPattern::both;
    default:
      return FlowPattern::constant;
  }
}

/// A value rounded up to a ladder, each step `kStep` below the one before, down from `greatest`: so
/// few that each can have tables of its own.
double on_ladder(double value, double greatest, double least) {
  constexpr double kStep = 1.02;
  if (value >= greatest) return greatest;
  const double steps =
      std::floor(std::log(greatest / std::max(value, 1e-9)) / std::log(kStep) + 1e-9);
  return std::clamp(greatest * std::pow(kStep, -steps), least, greatest);
}

/// Sections of neighbouring slices that differ by more than this share of the greater get slices looked
/// at between them, while there are not `kMostSlices` times as many.
constexpr double kChanged = 0.2;
constexpr std::size_t kMostSlices = 3;
/// Times that light is sought: what is dark before edges depends a little on how bright it is.
constexpr int kRounds = 2;
constexpr int kFirstIterations = 40;

/// Light of a section, cells beside it among it.
struct SectionLight {
  SectionOptimum best;
  double mean_uv_mw_cm2 = 0;  ///< over the section
};
using SharedLight = std::shared_ptr<const SectionLight>;

/// Light that is found, slice by slice.
struct Found {
  std::vector<int> slices;
  std::vector<SharedLight> lights;
};

/// Everything that one run of find_even_light shares.
class Finder {
 public:
  Finder(const SliceSource& target, const Setup& setup, const ExecutionContext& context, int every)
      : target_(target),
        setup_(setup),
        context_(context),
        alone_(detail::silent(context)),
        every_(every),
        design_(target, setup, {setup.gap_um, 0}, context) {
    goal_.pattern = pattern_of(setup.process.even_dead_zone);
    goal_.max_blue_mw_cm2 = detail::even_blue_cap(target, setup);
    goal_.max_uv_mw_cm2 = setup.printer.uv->max_mw_cm2();
  }

  Process find() {
    const std::vector<int> first = design_.slices_of(every_);
    if (first.empty()) {
      throw InputError(fmt::format(
          "an even dead zone is found on cells of {:g} um; no slice of the part has a section of "
          "three and more of them across",
          design_.part().grid().pitch_um));
    }
    Process process = process_of(starting_light(first));
    for (int round = 1; round <= kRounds; ++round) {
      const Setup planned{setup_.printer, setup_.resin, process, setup_.gap_um};
      process = process_of(light_for(planned, round < kRounds));
    }
    return kept_where_better(std::move(process));
  }

  void tell(const Process& process) const {
    context_.tell(fmt::format(
        "light for an even dead zone of {:.4g} um ({}): {} of {} slices looked at, {} sections",
        process.even_light->gap_um, name_of(process.even_dead_zone), found_.slices.size(),
        design_.part().slices(), sections_));
    if (gap_at_limit_) {
      context_.tell(
          fmt::format("the best dead zone lies at the end of what is tried, {:g} to {:g} um",
                      SectionGoal{}.min_gap_um, SectionGoal{}.max_gap_um));
    }
    if (at_cap_ > 0) {
      context_.tell(
          fmt::format("in {} of {} sections the best light is more than the lamps give somewhere",
                      at_cap_, sections_));
    }
    if (constant_ > 0) {
      context_.tell(fmt::format(
          "in {} of {} slices light that is the same everywhere does better and is taken: what edges "
          "leave dark, and what changes from slice to slice, costs more there than a pattern wins",
          constant_, found_.slices.size()));
    }
  }

 private:
  /// Lamps that show images show them whatever the pattern.
  bool patterned() const { return setup_.printer.uv->patterned; }

  /// The best constant light of the largest section, for all slices: bright enough to tell what stays
  /// dark. The gap of all slices is that which suits this section.
  Found starting_light(const std::vector<int>& slices) {
    const std::size_t largest = design_.largest(slices);
    const FlowSection section = design_.section(largest);
    const GapPressure pressure = design_.pressure(largest, context_);
    const auto optimum = [&](const SectionGoal& goal) {
      return optimise_section(section, pressure, design_.resin(), setup_.process.speed_mm_h, goal,
                              context_);
    };
    if (setup_.gap_um > 0) {
      goal_.min_gap_um = goal_.max_gap_um = setup_.gap_um;
    } else {
      const SectionOptimum best = optimum(goal_);
      gap_at_limit_ = best.gap_at_limit;
      goal_.min_gap_um = goal_.max_gap_um = best.gap_um;
    }
    SectionGoal constant = goal_;
    constant.pattern = FlowPattern::constant;
    return {{slices.front()}, {light_of(section, nullptr, optimum(constant))}};
  }

  /// The best light of each slice for what of it `planned` leaves lit.
  Found light_for(const Setup& planned, bool rough) {
    const detail::PlannedImages images(target_, planned, alone_);
    const EvenSections sections(detail::LitPart(target_, images), planned, cells(), context_);
    Found found{chosen_slices(sections), {}};
    // Nothing is lit that is wide enough: light stays as it is.
    if (found.slices.empty()) return found_;
    Sought sought;
    for (const auto& some : detail::in_parts(found.slices, sections.part().grid())) {
      const auto shown =
          detail::shown_cells(images, target_, sections.part().grid(), some, planned, alone_);
      std::vector<SectionGoal> goals;
      for (const detail::CellLight& light : shown) {
        goals.push_back(goal_);
        goals.back().image = light.image;
        if (rough) goals.back().iterations = kFirstIterations;
      }
      seek(sections, some, goals, sought, "even dead zone");
    }
    sections_ = sought.lights.size();
    at_cap_ = static_cast<std::size_t>(
        std::count_if(sought.lights.begin(), sought.lights.end(),
                      [](const auto& l) { return l->best.blue_at_cap || l->best.uv_at_cap; }));
    found.lights = sought.of_slice;
    return found;
  }

  /// Light that was sought, and of what.
  struct Sought {
    std::map<std::string, std::size_t> known;
    std::vector<SharedLight> lights;
    std::vector<SharedLight> of_slice;
  };

  /// Each that differs is sought once: a section, and what is shown of light on it.
  void seek(const EvenSections& sections, const std::vector<int>& slices,
            const std::vector<SectionGoal>& goals, Sought& sought, const char* stage) {
    const std::size_t before = sought.lights.size();
    std::vector<std::size_t> index, first;
    for (std::size_t i = 0; i < slices.size(); ++i) {
      const auto [at, fresh] = sought.known.try_emplace(
          key_of(sections.mask_of(slices[i]), *goals[i].image), before + first.size());
      if (fresh) first.push_back(i);
      index.push_back(at->second);
    }
    sought.lights.resize(before + first.size());
    parallel_for(context_, stage, first.size(), [&](std::size_t k) {
      const std::size_t i = first[k], mask = sections.mask_of(slices[i]);
      const FlowSection section = sections.section(mask);
      sought.lights[before + k] =
          light_of(section, goals[i].image.get(),
                   optimise_section(section, sections.pressure(mask, alone_), sections.resin(),
                                    setup_.process.speed_mm_h, goals[i], alone_));
    });
    for (const std::size_t k : index) sought.of_slice.push_back(sought.lights[k]);
  }

  /// Equal for what differs by less than the light's own steps.
  static std::string key_of(std::size_t mask, const ImageLight& image) {
    constexpr double kShares = 64, kLight = 2;
    std::string key(reinterpret_cast<const char*>(&mask), sizeof mask);
    const auto add = [&](double steps) {
      key.push_back(static_cast<char>(static_cast<unsigned>(std::lround(steps)) & 255U));
    };
    for (std::size_t c = 0; c < image.shares.size(); ++c) {
      for (const float share : image.shares[c]) add(static_cast<double>(share) * kShares);
      add(image.blue_mw_cm2[c] * kLight);
      add(image.uv_mw_cm2[c] * kLight);
    }
    return key;
  }

  /// Where a pattern as it will be shown does no better than light that is the same everywhere, slices
  /// get that.
  Process kept_where_better(Process process) {
    if (goal_.pattern == FlowPattern::constant) return process;
    const Setup planned{setup_.printer, setup_.resin, process, setup_.gap_um};
    const detail::PlannedImages images(target_, planned, alone_);
    const EvenSections sections(detail::LitPart(target_, images), planned, cells(), alone_);
    Found kept = found_;
    std::size_t at = 0;
    for (const auto& some : detail::in_parts(found_.slices, sections.part().grid())) {
      const auto shown =
          detail::shown_cells(images, target_, sections.part().grid(), some, planned, alone_);
      const FlowDoses doses =
          detail::judge_light(sections, some, shown, target_, planned, context_);
      std::vector<int> worse;
      std::vector<SectionGoal> goals;
      for (const FlowDoses::Slice& s : doses.slices) {
        const bool sticks = s.even.max_window >= 1 && s.without.max_window < 1;
        if (s.even.within_10 >= s.without.within_10 && !sticks) continue;
        const auto i = std::lower_bound(some.begin(), some.end(), s.slice) - some.begin();
        worse.push_back(s.slice);
        goals.push_back(goal_);
        goals.back().pattern = FlowPattern::constant;
        goals.back().image = shown[static_cast<std::size_t>(i)].image;
      }
      Sought constant;
      seek(sections, worse, goals, constant, "even light");
      for (std::size_t k = 0; k < worse.size(); ++k) {
        const auto i = std::lower_bound(some.begin(), some.end(), worse[k]) - some.begin();
        kept.lights[at + static_cast<std::size_t>(i)] = constant.of_slice[k];
      }
      constant_ += worse.size();
      at += some.size();
    }
    return constant_ > 0 ? process_of(std::move(kept)) : process;
  }

  EvenSections::Cells cells() const { return {goal_.min_gap_um, design_.part().grid().pitch_um}; }

  /// Slices 0, every, ..., and more where sections change.
  std::vector<int> chosen_slices(const EvenSections& sections) const {
    std::vector<int> slices = sections.slices_of(every_);
    const std::size_t most = kMostSlices * std::max<std::size_t>(slices.size(), 2);
    for (bool more = true; more && slices.size() < most;) {
      more = false;
      for (std::size_t i = slices.size(); i-- > 1 && slices.size() < most;) {
        const int middle = (slices[i - 1] + slices[i]) / 2;
        if (middle == slices[i - 1] || !sections.can_be_solved(middle)) continue;
        if (sections.changed(slices[i - 1], slices[i]) <= kChanged) continue;
        slices.insert(slices.begin() + static_cast<std::ptrdiff_t>(i), middle);
        more = true;
      }
    }
    return slices;
  }

  /// Cells beside the section get what the nearest ones have, smoothly.
  static SharedLight light_of(const FlowSection& section, const ImageLight* image,
                              SectionOptimum optimum) {
    const double mean_uv = detail::mean_over_part(section, optimum.uv_mw_cm2);
    std::vector<std::uint8_t> known(section.size(), 0);
    for (const std::size_t i : detail::asked_cells(section, image)) known[i] = 1;
    for (auto* light : {&optimum.blue_mw_cm2, &optimum.uv_mw_cm2}) {
      extend_outwards(*light, known, section.width, section.height);
    }
    return std::make_shared<const SectionLight>(SectionLight{std::move(optimum), mean_uv});
  }

  Process process_of(Found found) {
    found_ = std::move(found);
    Process process = setup_.process;
    process.even_light = light();
    process.uv = schedule();
    if (patterned()) process.even_light->uv = uv_bytes();
    return process;
  }

  /// Bytes of all slices from one of the lights of each.
  template <class CellsOf, class ByteOf>
  std::shared_ptr<const std::vector<std::uint8_t>> bytes(const CellsOf& cells_of,
                                                         const ByteOf& byte_of) const {
    std::vector<std::uint8_t> all;
    for (const SharedLight& light : found_.lights) {
      for (const double v : cells_of(light->best)) {
        all.push_back(static_cast<std::uint8_t>(std::clamp(byte_of(v), 1.0, kFull)));
      }
    }
    return std::make_shared<const std::vector<std::uint8_t>>(std::move(all));
  }

  EvenLight light() const {
    const FlowGrid& grid = design_.part().grid();
    EvenLight light;
    light.columns = grid.columns;
    light.rows = grid.rows;
    light.pitch_um = grid.pitch_um;
    light.left_um = grid.left_um;
    light.top_um = grid.top_um;
    light.gap_um = goal_.min_gap_um;
    light.slices = found_.slices;
    const double full = setup_.printer.calibration.back().intensity_mw_cm2;
    light.blue = bytes([](const SectionOptimum& o) { return o.blue_mw_cm2; },
                       [&](double mw_cm2) { return std::round(mw_cm2 / full * kFull); });
    return light;
  }

  std::shared_ptr<const std::vector<std::uint8_t>> uv_bytes() const {
    return bytes(
        [](const SectionOptimum& o) { return o.uv_mw_cm2; },
        [&](double mw_cm2) { return std::ceil(mw_cm2 / goal_.max_uv_mw_cm2 * kFull - 1e-9); });
  }

  /// One intensity for each slice: what its section needs at most in the mean, as a slow lamp can.
  UvSchedule schedule() const {
    const double most = goal_.max_uv_mw_cm2, least = setup_.printer.uv->min_mw_cm2();
    const std::vector<int>& slices = found_.slices;
    std::vector<double> at;
    for (const SharedLight& light : found_.lights) at.push_back(light->mean_uv_mw_cm2);
    if (!patterned()) at = slowed(std::move(at), slices, kLampStep * most);
    UvSchedule uv;
    uv.kind = patterned() ? UvKind::patterned : UvKind::per_slice;
    std::size_t i = 0;
    for (int n = 0; n <= slices.back(); ++n) {
      while (i + 1 < slices.size() && slices[i + 1] <= n) ++i;
      const bool between = i + 1 < slices.size() && n > slices[i];
      const double share =
          between ? static_cast<double>(n - slices[i]) / (slices[i + 1] - slices[i]) : 0.0;
      const double value = between ? at[i] + share * (at[i + 1] - at[i]) : at[i];
      uv.slice_mw_cm2.push_back(on_ladder(value, most, least));
    }
    return uv;
  }

  /// Share of its greatest light by which a UV lamp may change from slice to slice.
  static constexpr double kLampStep = 0.02;

  const SliceSource& target_;
  const Setup& setup_;
  const ExecutionContext& context_;
  const ExecutionContext alone_;
  int every_;
  EvenSections design_;  ///< all that is part, dark or not
  SectionGoal goal_;
  Found found_;
  bool gap_at_limit_ = false;
  std::size_t sections_ = 0, at_cap_ = 0, constant_ = 0;
};

void check_setup(const Setup& setup) {
  const Resin& resin = setup.resin;
  if (setup.process.mode != ExposureMode::continuous) {
    throw InputError(
        "an even dead zone is for continuous exposure: layer by layer resin comes to rest");
  }
  if (!resin.inhibition) {
    throw InputError(resin.name, "inhibition",
                     "is missing; an even dead zone needs a resin that UV light inhibits");
  }
  if (!setup.printer.uv) {
    throw InputError(setup.printer.name, "uv", "is missing; an even dead zone needs a UV lamp");
  }
  const bool by_place = setup.process.even_dead_zone == EvenDeadZone::uv ||
                        setup.process.even_dead_zone == EvenDeadZone::both;
  if (by_place && !setup.printer.uv->patterned) {
    throw InputError(setup.printer.name, "uv.kind",
                     fmt::format("is a flood; an even dead zone by \"{}\" needs \"patterned\"",
                                 name_of(setup.process.even_dead_zone)));
  }
  const double m = flow_resin(resin).kinetics.m;
  if (m != 1) {
    throw InputError(
        resin.name, "inhibition.m",
        fmt::format("is {:g}; an even dead zone needs light that acts in proportion, 1", m));
  }
}

std::shared_ptr<const EvenLight> with_blue_as_uv(EvenLight light) {
  light.uv = light.blue;
  return std::make_shared<const EvenLight>(std::move(light));
}

}  // namespace

Process find_even_light(const SliceSource& target, const Setup& setup,
                        const ExecutionContext& context, int every) {
  if (setup.process.even_dead_zone == EvenDeadZone::off || setup.process.even_light) {
    return setup.process;
  }
  check_setup(setup);
  Finder finder(target, setup, context, every);
  Process process = finder.find();
  finder.tell(process);
  judge_suction(target, {setup.printer, setup.resin, process, setup.gap_um}, context);
  return process;
}

EvenUvImages::EvenUvImages(const Printer& printer, const Resin& resin, const Process& process,
                           const Grid& images)
    : blue_light_(with_blue_as_uv(*process.even_light)),
      pixels_(*process.even_light, images),
      blue_(*blue_light_, images) {
  const LevelTable lamp(uv_level_intensities(printer));
  const int levels = printer.levels();
  const auto pixel = [&](double mw_cm2) {
    return static_cast<std::uint8_t>(pixel_of_level(lamp.at_least(mw_cm2 * (1 - 1e-12)), levels));
  };
  const double most = printer.uv->max_mw_cm2();
  for (int s = 0; s <= 255 * kSteps; ++s) of_share_.push_back(pixel(s * most / (255 * kSteps)));
  const std::vector<double> blue = level_intensities(printer);
  for (int p = 0; p < 256; ++p) {
    const int level = level_of_pixel(static_cast<std::uint8_t>(p), levels);
    share_of_[static_cast<std::size_t>(p)] =
        255 * blue[static_cast<std::size_t>(level)] / blue.back();
  }
  // Twice what holds black's own light off the window.
  const double black = level_intensities(printer).front();
  const double beta = flow_resin(resin).kinetics.beta;
  of_black_ = black > 0 ? pixel(std::min(most, 2 * black / beta)) : pixel(0);
}

void EvenUvImages::make_row(int slice, int y, std::span<std::uint8_t> pixels) const {
  const auto lit =
      std::find_if(pixels.begin(), pixels.end(), [](std::uint8_t p) { return p != 0; });
  const auto first = lit - pixels.begin();
  std::fill(pixels.begin(), lit, of_black_);
  if (lit == pixels.end()) return;
  std::vector<double> shares(static_cast<std::size_t>(pixels.end() - lit)), even(shares.size());
  pixels_.uv_of_row(slice, static_cast<int>(first), y, shares);
  blue_.uv_of_row(slice, static_cast<int>(first), y, even);
  for (std::size_t i = 0; i < shares.size(); ++i) {
    std::uint8_t& p = pixels[static_cast<std::size_t>(first) + i];
    if (p == 0) {
      p = of_black_;
      continue;
    }
    // Dimmer pixels, as beside edges, get less of both lights alike: else inhibitor would be left over
    // and flow to where the part is to gel.
    const double less = even[i] > 0 ? std::min(1.0, share_of_[p] / even[i]) : 1.0;
    p = of_share_[static_cast<std::size_t>(std::ceil(shares[i] * less * kSteps - 1e-9))];
  }
}

}  // namespace slicecorr
