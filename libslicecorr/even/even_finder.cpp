// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "even/even_finder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "bands/bands.hpp"
#include "bands/uv_of_slices.hpp"
#include "even/kept_images.hpp"
#include "even/lit_setup.hpp"
#include "even/planned_images.hpp"
#include "flow/image_light.hpp"
#include "flow/optimise_from.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kMostLevel = 255;
/// Sections of neighbouring slices that differ by more than this share of the greater get slices looked
/// at between them.
constexpr double kChanged = 0.2;
/// Cells whose light is sought in all slices together, about: a quarter of a minute of one core. Half of them for
/// slices chosen beforehand, the rest for those that turn out badly. Slices asked for go before it.
constexpr double kMostCells = 8e4;
constexpr int kFirstIterations = 40;
/// Rounds of a look at what comes out, and the voxels of all images that they are solved for, about: one
/// core solves some five million in a second. Patterns are sought in all rounds but the last ones.
constexpr int kMostRounds = 7, kLeastRounds = 2, kLastRounds = 2;
constexpr double kMostVoxels = 2.5e8;
/// Light that is rougher fits its own slice better and the next ones worse (`SectionGoal::smooth_um`): with
/// 40 um 3DBenchy at a fifth of its size got 40 %, with 150 um 51 %, and nothing stuck to the window.
constexpr double kSmoothUm = 150;
/// Most dose at the window that light is sought with, at each try: what images show of it, and what lies
/// between two slices, comes to more here and there, and must stay below 1.
constexpr std::array kWindows{0.9, 0.7, 0.4, 0.4};
/// As which try the light of a slice is sought that had none of its own.
constexpr std::size_t kSafeTry = 2;
/// Share of the section by which light by place may do worse than light that is the same everywhere
/// before it is given up, and the latter before it is sought anew: its own changes between slices, and
/// levels, cost as much.
constexpr double kWorse = 0.005, kWorseConstant = 0.03;
/// The same of the greatest dose at the window, where resin sticks with both.
constexpr double kSticksMore = 0.02;
/// Where in the end resin sticks in at most one in so many slices, these and their neighbours get light
/// that is the same everywhere; where in more, all do.
constexpr std::size_t kFew = 5;

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

/// Steps of the UV light of slices.
constexpr double kLadderStep = 1.02;

/// Whether resin sticks to the window with one light, and not, or less, with the other.
bool sticks_more(const FrontDose& light, const FrontDose& other) {
  return light.max_window >= 1 && light.max_window > other.max_window + kSticksMore;
}

/// How much worse one light is than the other, as a share of the section; where it makes resin stick, all
/// of it.
double worse_by(const FrontDose& light, const FrontDose& other) {
  return sticks_more(light, other) ? 1 : other.within_10 - light.within_10;
}

}  // namespace

EvenFinder::EvenFinder(const SliceSource& target, const Setup& setup,
                       const ExecutionContext& context, int every, double hold_off)
    : target_(target),
      whole_(target),
      setup_(setup),
      context_(context),
      alone_(silent(context)),
      every_(every),
      hold_off_(hold_off),
      design_(target, setup, {setup.gap_um, 0}, context) {
  goal_.pattern = pattern_of(setup.process.even_dead_zone);
  goal_.max_blue_mw_cm2 = even_blue_cap(target, setup);
  goal_.max_uv_mw_cm2 = even_uv_cap(setup);
  goal_.max_window = kWindows.front();
  goal_.smooth_um = kSmoothUm;
  const double voxels = static_cast<double>(columns_of(target.bounds())) * target.grid().layers;
  rounds_ = std::clamp(static_cast<int>(std::min(100.0, kMostVoxels / std::max(1.0, voxels))),
                       kLeastRounds, kMostRounds);
  if (goal_.pattern == FlowPattern::constant) rounds_ = 1;
}

Process EvenFinder::guess() {
  const std::vector<int> first = design_.slices_of(every_);
  if (first.empty()) {
    throw InputError(fmt::format(
        "an even dead zone is found on cells of {:g} um; no slice of the part has a section of "
        "three and more of them across",
        design_.part().grid().pitch_um));
  }
  set_most_slices(first);
  Process process = process_of(starting_light(first));
  return process_of(guessed_light(planned(process)));
}

Process EvenFinder::find(Process process) {
  // Where resin sticks with the light of `process`, as far as that was looked at.
  std::vector<int> last;
  for (int round = 0; round < rounds_; ++round) {
    Look look = mend(planned(process), round);
    if (!look.sought) {
      last = std::move(look.sticks);
      break;
    }
    process = process_of(std::move(found_));
  }
  if (goal_.pattern == FlowPattern::constant) return process;
  for (std::size_t most = found_.slices.size() / kFew;;) {
    const Setup setup = planned(process);
    // That it sticks nowhere is believed of the images alone that will be shown.
    const std::vector<int> sticks = last.empty() ? sticking(setup) : std::exchange(last, {});
    if (sticks.empty()) return process;
    const bool few = sticks.size() <= most;
    if (!few) given_up_ = sticks.size();
    process = process_of(with_constant(few ? sticks : found_.slices, setup));
    undercured_.reset();
    if (!few) return process;
    most = sticks.size() - 1;
  }
}

/// Slices in which resin sticks to the window, where with light that is the same everywhere it does not.
std::vector<int> EvenFinder::sticking(const Setup& setup) {
  const std::vector<int> slices = judged_slices(*setup.process.even_light);
  Undercured left;
  const bool gap_is_open = setup_.gap_um <= 0;
  const KeptImages images =
      solved_images(target_, setup, slices, gap_is_open ? &left : nullptr, alone_);
  if (gap_is_open) undercured_ = left;
  const EvenSections sections(LitPart(target_, images), setup, cells(), alone_);
  const FlowGrid& grid = sections.part().grid();
  std::vector<int> found;
  for (const auto& some : in_parts(slices, grid)) {
    const auto shown = shown_cells(images, whole_, grid, some, setup, alone_);
    const FlowDoses doses = judge_light(sections, some, shown, target_, setup, alone_);
    for (const FlowDoses::Slice& s : doses.slices) {
      if (sticks_more(s.even, s.without)) found.push_back(s.slice);
    }
  }
  return found;
}

/// The light that was found, with light that is the same everywhere in some slices and in those beside them.
EvenFinder::Found EvenFinder::with_constant(const std::vector<int>& slices,
                                            const Setup& setup) const {
  const PlannedImages images(target_, setup, alone_);
  const EvenSections sections(LitPart(target_, images), setup, cells(), alone_);
  std::set<std::size_t> chosen;
  for (const int n : slices) {
    const auto past = std::upper_bound(found_.slices.begin(), found_.slices.end(), n);
    const auto next = static_cast<std::size_t>(past - found_.slices.begin());
    if (next < found_.slices.size()) chosen.insert(next);
    if (next > 0) chosen.insert(next - 1);
  }
  std::vector<int> asked;
  asked.reserve(chosen.size());
  for (const std::size_t i : chosen) asked.push_back(found_.slices[i]);
  Found found = found_;
  for (const auto& some : in_parts(asked, sections.part().grid())) {
    const auto shown = shown_cells(images, whole_, sections.part().grid(), some, setup, alone_);
    std::vector<Task> tasks;
    for (std::size_t i = 0; i < some.size(); ++i) {
      tasks.push_back({some[i], How::constant, 0, shown[i].image, nullptr});
    }
    std::vector<SharedLight> lights = seek(sections, tasks, "even light");
    for (std::size_t i = 0; i < some.size(); ++i) {
      const auto at = std::lower_bound(found.slices.begin(), found.slices.end(), some[i]);
      const auto k = static_cast<std::size_t>(at - found.slices.begin());
      found.lights[k] = std::move(lights[i]);
      found.how[k] = How::constant;
    }
  }
  return found;
}

void EvenFinder::tell(const Process& process) const {
  const std::set<SharedLight> lights(found_.lights.begin(), found_.lights.end());
  const auto at_cap = std::count_if(lights.begin(), lights.end(), [](const auto& l) {
    return l->best.blue_at_cap || l->best.uv_at_cap;
  });
  const auto constant = std::count(found_.how.begin(), found_.how.end(), How::constant);
  context_.tell(fmt::format(
      "light for an even dead zone of {:.4g} um ({}): {} of {} slices looked at; sections with light "
      "of their own: {}",
      process.even_light->gap_um, name_of(process.even_dead_zone), found_.slices.size(),
      design_.part().slices(), lights.size()));
  if (gap_at_limit_) {
    context_.tell(
        fmt::format("the best dead zone lies at the end of what is tried, {:g} to {:g} um",
                    SectionGoal{}.min_gap_um, SectionGoal{}.max_gap_um));
  }
  if (at_cap > 0) {
    context_.tell(fmt::format("lamps give all they can somewhere in {} of {} sections", at_cap,
                              lights.size()));
  }
  if (given_up_ > 0) {
    context_.tell(fmt::format(
        "patterns make resin stick to the window in {} slices, where light that is the same "
        "everywhere does not: all slices get the latter",
        given_up_));
  } else if (constant > 0) {
    context_.tell(fmt::format(
        "in {} of {} slices light that is the same everywhere does better and is taken: what edges "
        "leave dark, and what changes from slice to slice, costs more there than a pattern wins",
        constant, found_.slices.size()));
  }
}

void EvenFinder::set_most_slices(const std::vector<int>& first) {
  double cells = 0;
  const double pitch_mm = design_.part().grid().pitch_um * 1e-3;
  for (const int n : first) {
    cells += part_area_mm2(design_.section(design_.mask_of(n))) / (pitch_mm * pitch_mm);
  }
  const double each = cells / static_cast<double>(first.size());
  most_slices_ = std::max(first.size(), static_cast<std::size_t>(kMostCells / std::max(1.0, each)));
}

/// The best constant light of the largest section, for all slices: bright enough to tell what stays
/// dark. The gap of all slices is that which suits this section.
EvenFinder::Found EvenFinder::starting_light(const std::vector<int>& slices) {
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
  return {{slices.front()}, {light_of(section, nullptr, optimum(constant))}, {How::roughly}, {0}};
}

/// The light of each slice that is looked at, for what of it will be lit as far as that is known without
/// a solve.
EvenFinder::Found EvenFinder::guessed_light(const Setup& setup) {
  const PlannedImages images(target_, setup, alone_);
  const EvenSections sections(LitPart(target_, images), setup, cells(), context_);
  Found found{chosen_slices(sections), {}, {}, {}};
  // Nothing is lit that is wide enough: light stays as it is.
  if (found.slices.empty()) return std::move(found_);
  for (const auto& some : in_parts(found.slices, sections.part().grid())) {
    const auto shown = shown_cells(images, whole_, sections.part().grid(), some, setup, alone_);
    std::vector<Task> tasks;
    for (std::size_t i = 0; i < some.size(); ++i) {
      tasks.push_back({some[i], How::roughly, 0, shown[i].image, nullptr});
    }
    for (SharedLight& light : seek(sections, tasks, "even dead zone")) {
      found.lights.push_back(std::move(light));
    }
  }
  found.how.assign(found.slices.size(), How::roughly);
  found.tries.assign(found.slices.size(), 0);
  return found;
}

/// Looks at what comes out with the light of `setup`, and seeks light anew where that is not good.
EvenFinder::Look EvenFinder::mend(const Setup& setup, int round) {
  const bool all = round == 0;
  const std::vector<int> slices = all ? found_.slices : judged_slices(*setup.process.even_light);
  const KeptImages images = nearly_solved_images(target_, setup, slices, alone_);
  const EvenSections sections(LitPart(target_, images), setup, cells(), alone_);
  const FlowGrid& grid = sections.part().grid();
  struct Mended {
    How how;
    std::size_t tries;
    SharedLight light;
  };
  std::map<int, Mended> mended;
  Look look;
  std::size_t room = most_slices_ - std::min(most_slices_, found_.slices.size());
  for (const auto& some : in_parts(slices, grid)) {
    const auto shown = shown_cells(images, whole_, grid, some, setup, alone_);
    std::vector<Task> tasks;
    const auto add = [&](int slice, How how) {
      const auto at = std::lower_bound(some.begin(), some.end(), slice) - some.begin();
      tasks.push_back({slice, how, tries_of(slice), shown[static_cast<std::size_t>(at)].image,
                       light_near(slice)});
    };
    if (all) {
      for (const int n : some) {
        if (sections.can_be_solved(n)) add(n, How::sought);
      }
    } else {
      const FlowDoses doses = judge_light(sections, some, shown, target_, setup, alone_);
      for (const FlowDoses::Slice& s : doses.slices) {
        if (sticks_more(s.even, s.without)) look.sticks.push_back(s.slice);
        if (const std::optional<How> how = next_try(s, round, room)) add(s.slice, *how);
      }
    }
    std::vector<SharedLight> lights = seek(sections, tasks, "even light");
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      mended[tasks[k].slice] = {tasks[k].how, tasks[k].tries + 1, std::move(lights[k])};
    }
  }
  for (auto& [slice, found] : mended) {
    const auto at = std::lower_bound(found_.slices.begin(), found_.slices.end(), slice);
    const auto i = at - found_.slices.begin();
    if (at == found_.slices.end() || *at != slice) {
      found_.slices.insert(at, slice);
      found_.how.insert(found_.how.begin() + i, found.how);
      found_.tries.insert(found_.tries.begin() + i, found.tries);
      found_.lights.insert(found_.lights.begin() + i, std::move(found.light));
      continue;
    }
    found_.how[static_cast<std::size_t>(i)] = found.how;
    found_.tries[static_cast<std::size_t>(i)] = found.tries;
    found_.lights[static_cast<std::size_t>(i)] = std::move(found.light);
  }
  look.sought = !mended.empty();
  return look;
}

/// What is to be tried with a slice that was judged; nothing where it is good.
std::optional<EvenFinder::How> EvenFinder::next_try(const FlowDoses::Slice& judged, int round,
                                                    std::size_t& room) const {
  const double worse = worse_by(judged.even, judged.without);
  if (worse <= kWorse) return std::nullopt;
  const auto at = std::lower_bound(found_.slices.begin(), found_.slices.end(), judged.slice);
  if (at == found_.slices.end() || *at != judged.slice) {
    // Light between two slices does not fit: it gets its own.
    if (room == 0 || worse <= kWorseConstant) return std::nullopt;
    --room;
    return How::sought;
  }
  const auto i = static_cast<std::size_t>(at - found_.slices.begin());
  if (found_.how[i] != How::constant) {
    const bool again = found_.tries[i] < kWindows.size() && round < rounds_ - kLastRounds;
    return again ? How::sought : How::constant;
  }
  if (worse <= kWorseConstant) return std::nullopt;
  return How::constant;
}

/// How often the light of a slice was sought for what came out. One that has none yet lies where light
/// changes fast, and is to be safe.
std::size_t EvenFinder::tries_of(int slice) const {
  const auto at = std::lower_bound(found_.slices.begin(), found_.slices.end(), slice);
  if (at == found_.slices.end() || *at != slice) return kSafeTry;
  return found_.tries[static_cast<std::size_t>(at - found_.slices.begin())];
}

/// The light of a slice, or of the one before it that has some.
EvenFinder::SharedLight EvenFinder::light_near(int slice) const {
  const auto past = std::upper_bound(found_.slices.begin(), found_.slices.end(), slice);
  const auto i = std::max<std::ptrdiff_t>(1, past - found_.slices.begin()) - 1;
  return found_.lights[static_cast<std::size_t>(i)];
}

/// The light of each task; of those that are alike it is sought once.
std::vector<EvenFinder::SharedLight> EvenFinder::seek(const EvenSections& sections,
                                                      const std::vector<Task>& tasks,
                                                      const char* stage) const {
  std::map<std::string, std::size_t> known;
  std::vector<std::size_t> index, first;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const auto [at, fresh] =
        known.try_emplace(key_of(sections.mask_of(tasks[i].slice), tasks[i]), first.size());
    if (fresh) first.push_back(i);
    index.push_back(at->second);
  }
  std::vector<SharedLight> lights(first.size());
  parallel_for(context_, stage, first.size(), [&](std::size_t k) {
    const Task& task = tasks[first[k]];
    SectionGoal goal = goal_;
    goal.image = task.image;
    if (task.how == How::constant) goal.pattern = FlowPattern::constant;
    if (task.how == How::roughly) goal.iterations = kFirstIterations;
    if (task.how == How::sought) {
      goal.max_window = kWindows[std::min(task.tries, kWindows.size() - 1)];
    }
    const std::size_t mask = sections.mask_of(task.slice);
    const FlowSection section = sections.section(mask);
    const GapPressure pressure = sections.pressure(mask, alone_);
    const double speed_mm_h = setup_.process.speed_mm_h;
    SectionOptimum best =
        task.start && goal.pattern != FlowPattern::constant
            ? optimise_section_from(
                  {task.start->best.blue_mw_cm2, task.start->best.uv_mw_cm2, hold_off_}, section,
                  pressure, sections.resin(), speed_mm_h, goal, alone_)
            : optimise_section(section, pressure, sections.resin(), speed_mm_h, goal, alone_);
    lights[k] = light_of(section, goal.image.get(), std::move(best));
  });
  std::vector<SharedLight> of_task;
  of_task.reserve(index.size());
  for (const std::size_t k : index) of_task.push_back(lights[k]);
  return of_task;
}

/// Equal for what differs by less than the light's own steps.
std::string EvenFinder::key_of(std::size_t mask, const Task& task) {
  constexpr double kShares = 64, kLight = 2;
  std::string key(reinterpret_cast<const char*>(&mask), sizeof mask);
  const auto add = [&](double steps) {
    key.push_back(static_cast<char>(static_cast<unsigned>(std::lround(steps)) & 255U));
  };
  add(static_cast<double>(task.how));
  const ImageLight& image = *task.image;
  for (std::size_t c = 0; c < image.shares.size(); ++c) {
    for (const float share : image.shares[c]) add(static_cast<double>(share) * kShares);
    add(image.blue_mw_cm2[c] * kLight);
    add(image.uv_mw_cm2[c] * kLight);
  }
  return key;
}

/// Slices 0, every, ..., and more where sections change.
std::vector<int> EvenFinder::chosen_slices(const EvenSections& sections) const {
  std::vector<int> slices = sections.slices_of(every_);
  const std::size_t most = std::max(slices.size(), most_slices_ / 2);
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
EvenFinder::SharedLight EvenFinder::light_of(const FlowSection& section, const ImageLight* image,
                                             SectionOptimum optimum) {
  const double mean_uv = mean_over_part(section, optimum.uv_mw_cm2);
  std::vector<std::uint8_t> known(section.size(), 0);
  for (const std::size_t i : asked_cells(section, image)) known[i] = 1;
  for (auto* light : {&optimum.blue_mw_cm2, &optimum.uv_mw_cm2}) {
    extend_outwards(*light, known, section.width, section.height);
  }
  return std::make_shared<const SectionLight>(SectionLight{std::move(optimum), mean_uv});
}

Process EvenFinder::process_of(Found found) {
  found_ = std::move(found);
  Process process = setup_.process;
  process.even_light = light();
  process.uv = schedule();
  Process full = process;
  full.uv.slice_mw_cm2 = {goal_.max_uv_mw_cm2};
  const PlaceModels models(setup_.printer, setup_.resin, full, target_.grid(), target_.frame());
  UvLadder{goal_.max_uv_mw_cm2, setup_.printer.uv->min_mw_cm2(), kLadderStep}.put(
      models, process.uv.slice_mw_cm2);
  // So much more is asked of a lamp that fades that this comes.
  process.uv.slice_mw_cm2.resize(
      std::max(process.uv.slice_mw_cm2.size(), setup_.process.uv_lamp_share.size()),
      process.uv.slice_mw_cm2.back());
  for (std::size_t n = 0; n < process.uv.slice_mw_cm2.size(); ++n) {
    double& asked = process.uv.slice_mw_cm2[n];
    asked = std::min(asked / LampShares{setup_.process}.uv(static_cast<int>(n)),
                     setup_.printer.uv->max_mw_cm2());
  }
  if (patterned()) process.even_light->uv = uv_bytes();
  return process;
}

EvenLight EvenFinder::light() const {
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
  light.blue = bytes([](const SectionOptimum& o) { return &o.blue_mw_cm2; },
                     [&](double mw_cm2) { return std::round(mw_cm2 / full * kMostLevel); });
  return light;
}

std::shared_ptr<const std::vector<std::uint8_t>> EvenFinder::uv_bytes() const {
  const double full = setup_.printer.uv->max_mw_cm2();
  return bytes([](const SectionOptimum& o) { return &o.uv_mw_cm2; },
               [&](double mw_cm2) { return std::ceil(mw_cm2 / full * kMostLevel - 1e-9); });
}

/// Bytes of all slices from one of the lights of each.
template <class CellsOf, class ByteOf>
std::shared_ptr<const std::vector<std::uint8_t>> EvenFinder::bytes(const CellsOf& cells_of,
                                                                   const ByteOf& byte_of) const {
  std::vector<std::uint8_t> all;
  for (const SharedLight& light : found_.lights) {
    for (const double v : *cells_of(light->best)) {
      all.push_back(static_cast<std::uint8_t>(std::clamp(byte_of(v), 1.0, kMostLevel)));
    }
  }
  return std::make_shared<const std::vector<std::uint8_t>>(std::move(all));
}

/// One intensity for each slice: what its section needs at most in the mean, as a slow lamp can.
UvSchedule EvenFinder::schedule() const {
  const double most = goal_.max_uv_mw_cm2;
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
    uv.slice_mw_cm2.push_back(value);
  }
  return uv;
}

}  // namespace slicecorr::detail
