#include "slicecorr/even_dead_zone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "parallel/silent.hpp"
#include "pipeline/even_cells.hpp"
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

/// Everything that one run of find_even_light shares.
class Finder {
 public:
  Finder(const SliceSource& target, const Setup& setup, const ExecutionContext& context, int every)
      : target_(target),
        setup_(setup),
        context_(context),
        sections_(target, setup, {setup.gap_um, 0}, context),
        solved_(sections_.slices_of(every)) {
    if (solved_.empty()) {
      throw InputError(fmt::format(
          "an even dead zone is found on cells of {:g} um; no slice of the part has a section of "
          "three and more of them across",
          sections_.part().grid().pitch_um));
    }
    goal_.pattern = pattern_of(setup.process.even_dead_zone);
    goal_.max_blue_mw_cm2 = detail::even_blue_cap(target, setup);
    goal_.max_uv_mw_cm2 = setup.printer.uv->max_mw_cm2();
  }

  Process find() {
    choose_gap();
    optimise();
    Process process = setup_.process;
    process.even_light = light();
    process.uv = schedule();
    if (patterned()) process.even_light->uv = uv_bytes();
    return process;
  }

  void tell(const Process& process) const {
    context_.tell(fmt::format(
        "light for an even dead zone of {:.4g} um ({}): {} of {} slices looked at, {} sections",
        process.even_light->gap_um, name_of(process.even_dead_zone), solved_.size(),
        sections_.part().slices(), optima_.size()));
    if (gap_at_limit_) {
      context_.tell(
          fmt::format("the best dead zone lies at the end of what is tried, {:g} to {:g} um",
                      SectionGoal{}.min_gap_um, SectionGoal{}.max_gap_um));
    }
    if (at_cap_ > 0) {
      context_.tell(
          fmt::format("in {} of {} sections the best light is more than the lamps give somewhere",
                      at_cap_, optima_.size()));
    }
  }

 private:
  /// Lamps that show images show them whatever the pattern.
  bool patterned() const { return setup_.printer.uv->patterned; }

  /// The gap of all slices is that which suits the largest section.
  void choose_gap() {
    if (setup_.gap_um > 0) {
      goal_.min_gap_um = goal_.max_gap_um = setup_.gap_um;
      return;
    }
    const std::size_t largest = sections_.largest(solved_);
    const SectionOptimum best =
        optimise_section(sections_.section(largest), sections_.pressure(largest, context_),
                         sections_.resin(), setup_.process.speed_mm_h, goal_, context_);
    gap_at_limit_ = best.gap_at_limit;
    goal_.min_gap_um = goal_.max_gap_um = best.gap_um;
  }

  void optimise() {
    for (const int n : solved_) optima_.try_emplace(sections_.mask_of(n));
    std::vector<std::size_t> masks;
    for (const auto& [mask, optimum] : optima_) masks.push_back(mask);
    std::vector<SectionOptimum> found(masks.size());
    const ExecutionContext alone = detail::silent(context_);
    parallel_for(context_, "even dead zone", masks.size(), [&](std::size_t i) {
      found[i] = optimise_section(sections_.section(masks[i]), sections_.pressure(masks[i], alone),
                                  sections_.resin(), setup_.process.speed_mm_h, goal_, alone);
    });
    for (std::size_t i = 0; i < masks.size(); ++i) {
      at_cap_ += static_cast<std::size_t>(found[i].blue_at_cap || found[i].uv_at_cap);
      optima_[masks[i]] = std::move(found[i]);
    }
  }

  std::vector<double> extended(std::size_t mask, const std::vector<double>& values) const {
    const FlowSection section = sections_.section(mask);
    std::vector<std::uint8_t> known(section.size());
    for (std::size_t i = 0; i < known.size(); ++i) {
      known[i] = static_cast<std::uint8_t>(section.cells[i] == FlowCell::part);
    }
    std::vector<double> filled = values;
    extend_outwards(filled, known, section.width, section.height);
    return filled;
  }

  /// Bytes of all solved slices from one of the lights of each.
  template <class LightOf, class ByteOf>
  std::shared_ptr<const std::vector<std::uint8_t>> bytes(const LightOf& light_of,
                                                         const ByteOf& byte_of) const {
    std::vector<std::uint8_t> all;
    std::map<std::size_t, std::vector<std::uint8_t>> made;
    for (const int n : solved_) {
      const std::size_t mask = sections_.mask_of(n);
      std::vector<std::uint8_t>& of_mask = made[mask];
      if (of_mask.empty()) {
        for (const double v : extended(mask, light_of(optima_.at(mask)))) {
          of_mask.push_back(static_cast<std::uint8_t>(std::clamp(byte_of(v), 1.0, kFull)));
        }
      }
      all.insert(all.end(), of_mask.begin(), of_mask.end());
    }
    return std::make_shared<const std::vector<std::uint8_t>>(std::move(all));
  }

  EvenLight light() const {
    const FlowGrid& grid = sections_.part().grid();
    EvenLight light;
    light.columns = grid.columns;
    light.rows = grid.rows;
    light.pitch_um = grid.pitch_um;
    light.left_um = grid.left_um;
    light.top_um = grid.top_um;
    light.gap_um = goal_.min_gap_um;
    light.slices = solved_;
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
    std::vector<double> at;
    for (const int n : solved_) {
      const std::size_t mask = sections_.mask_of(n);
      at.push_back(detail::mean_over_part(sections_.section(mask), optima_.at(mask).uv_mw_cm2));
    }
    if (!patterned()) at = slowed(std::move(at), solved_, kLampStep * most);
    UvSchedule uv;
    uv.kind = patterned() ? UvKind::patterned : UvKind::per_slice;
    std::size_t i = 0;
    for (int n = 0; n <= solved_.back(); ++n) {
      while (i + 1 < solved_.size() && solved_[i + 1] <= n) ++i;
      const bool between = i + 1 < solved_.size() && n > solved_[i];
      const double share =
          between ? static_cast<double>(n - solved_[i]) / (solved_[i + 1] - solved_[i]) : 0.0;
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
  EvenSections sections_;
  std::vector<int> solved_;
  SectionGoal goal_;
  std::map<std::size_t, SectionOptimum> optima_;  ///< by mask
  bool gap_at_limit_ = false;
  std::size_t at_cap_ = 0;
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
