// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/print.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/shown_light.hpp"
#include "slicecorr/version.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "stack/formats/definition_json.hpp"
#include "tomo/operators/spread_projector.hpp"
#include "tomo/print/bands.hpp"
#include "tomo/print/changing_resin.hpp"
#include "tomo/print/judging.hpp"
#include "tomo/print/light_goal.hpp"
#include "tomo/print/rounding.hpp"
#include "tomo/print/voxels.hpp"
#include "tomo/solve/checkpoint.hpp"
#include "tomo/solve/told_projector.hpp"

namespace slicecorr::tomo {

namespace {

/// Throws for an insert of another grid, or one that reaches over the resin.
void check_insert(const Box<std::uint8_t>& insert, const Box<std::uint8_t>& part,
                  const Printer& printer, double voxel_mm) {
  if (insert.values.empty()) return;
  if (insert.nx != part.nx || insert.ny != part.ny || insert.nz != part.nz) {
    throw InputError(
        fmt::format("the insert has {} x {} x {} voxels, the part {} x {} x {}; "
                    "expected the same",
                    insert.nx, insert.ny, insert.nz, part.nx, part.ny, part.nz));
  }
  for (int z = 0; z < insert.nz; ++z) {
    for (int y = 0; y < insert.ny; ++y) {
      for (int x = 0; x < insert.nx; ++x) {
        if (insert.values[insert.at(z, y, x)] == 0) continue;
        detail::check_in_vial(insert.nx, x, y, z, voxel_mm, printer);
      }
    }
  }
}

detail::Fingerprint fingerprint_of(const Box<std::uint8_t>& part, const Box<std::uint8_t>& insert,
                                   const TomoJob& job, const SolveOptions& options) {
  const auto of_box = [](const Box<std::uint8_t>& box) {
    const std::array<int, 3> size{box.nz, box.ny, box.nx};
    return detail::hash_of(box.values.data(), box.values.size(),
                           detail::hash_of(size.data(), sizeof size));
  };
  const std::string machine =
      fmt::format("{} {} {} {} {} {}", version, job.sampling.voxel_mm, job.sampling.angles,
                  job.sampling.middle_z_mm, slicecorr::detail::printer_json(job.printer).dump(),
                  slicecorr::detail::resin_json(job.resin).dump());
  std::uint64_t of_part = of_box(part);
  for (const Box<float>* box : {&job.wanted.least, &job.wanted.most, &job.wanted.weight}) {
    of_part = detail::hash_of(box->values.data(), box->values.size() * sizeof(float), of_part);
  }
  return {of_part, of_box(insert), detail::hash_of(machine.data(), machine.size()),
          detail::hash_of(options)};
}

/// Whole turns in the time; 0: as many as it takes.
int turns_allowed(const Bench& bench, double most_time_s) {
  if (most_time_s <= 0) return 0;
  const double turns = std::floor(most_time_s / bench.exposure.turn_s * (1 + 1e-9));
  if (!(turns >= 1)) {
    throw InfeasibleError(
        fmt::format("printing takes a turn of {:g} s at "
                    "least, longer than the {:g} s allowed",
                    bench.exposure.turn_s, most_time_s));
  }
  return static_cast<int>(std::min(turns, 1e9));
}

/// What is computed on, with all that is refused of it.
struct Place {
  Bench bench;   ///< of pixels
  Bench groups;  ///< of the same, in groups where they are finer than voxels
  double part_radius_mm = 0;
  int most_turns = 0;  ///< 0: as many as it takes
};
Place place_of(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
               const Resin& resin, const PrintOptions& options) {
  require_tomographic(printer);
  if (printer.height_px < 2 && slices_share_light(printer, resin)) {
    throw InputError(
        "the projector's image has one row, whose light rises and "
        "spreads; expected two rows or more to look for "
        "light for. Images of one row can be judged (tomo "
        "convert, tomo verify)");
  }
  Place place;
  place.part_radius_mm = part_radius_mm(part, voxel_mm);
  const double radius_mm = place.part_radius_mm;
  Sampling sampling{
      voxel_mm, part.nz,
      options.angles > 0 ? options.angles : usual_angles(printer, radius_mm, voxel_mm)};
  sampling.middle_z_mm = options.middle_z_mm;
  place.bench = make_bench(printer, resin, sampling);
  sampling.grouped = true;
  place.groups = make_bench(printer, resin, sampling);
  const double resin_mm = place.bench.radius_mm;
  const double limit_mm =
      options.beyond_reach ? resin_mm : std::min(place.bench.reach_mm, resin_mm);
  if (radius_mm > limit_mm) {
    throw InputError(
        fmt::format("the part reaches {:.3f} mm from the axis, light from all directions "
                    "{:.3f} mm; expected a "
                    "part scaled by at most {:.4f}{}",
                    radius_mm, limit_mm, std::floor(1e4 * limit_mm / radius_mm) * 1e-4,
                    radius_mm <= resin_mm ? ", or leave to print beyond that reach" : ""));
  }
  check_insert(options.insert, part, printer, voxel_mm);
  detail::check_wanted(options.wanted, part, resin);
  detail::check_wanted_in_resin(options.wanted, {}, voxel_mm);
  detail::check_hold(printer, place.bench.grid.angles, options.hold);
  if (options.wanted.any() && options.solve.method != Method::ladder) {
    throw InputError(
        "doses are wanted, which the ladder alone looks for; "
        "expected that method");
  }
  place.most_turns = turns_allowed(place.bench, options.most_time_s);
  return place;
}

/// What the solver sees: the part, and how light gives it dose.
struct Asked {
  std::shared_ptr<const Target> target;  // shared: a number for each voxel is much

  std::shared_ptr<const Projector> projector;
  RayTables rays;
};

/// The part in light of groups of pixels, as it is looked for.
Asked searched(const Bench& groups, const Box<std::uint8_t>& part, const PrintOptions& options,
               Search search) {
  const Box<std::uint8_t>& insert = options.insert;
  Target target = detail::target_of(groups, part, insert);
  detail::add_bands(options.wanted, insert, groups.exposure.critical_mj_cm3, target);
  if (insert.values.empty()) {
    return {std::make_shared<const Target>(std::move(target)),
            make_search_projector(groups, search), groups.rays};
  }
  const Volume opaque = detail::volume_of(groups.grid, insert);
  return {std::make_shared<const Target>(std::move(target)),
          make_search_projector(groups, search, &opaque), groups.rays};
}

/// The same with the weights of voxels.
Asked weighed(const Asked& asked) {
  if (asked.target->weight.empty()) return asked;
  return {std::make_shared<const Target>(detail::weighed(*asked.target)),
          detail::weighed(asked.projector, *asked.target), asked.rays};
}

/// What rough operators find: where to go on from, and a bound, which all of
/// the proof's steps go to.
Solution rough_solution(const Asked& rough, const SolveOptions& options,
                        const ExecutionContext& context) {
  constexpr int kSteps = 30, kMostSteps = 60, kProofSteps = 80;
  SolveOptions how = options;
  how.steps = how.steps == 0 ? kSteps : std::min(how.steps, kSteps);
  how.most_steps = std::min(how.most_steps, kMostSteps);
  how.proof_steps = std::min(how.proof_steps, kProofSteps);
  how.resume = nullptr;
  how.checkpoint = nullptr;
  return solve(context, *rough.projector, *rough.target, rough.rays, how);
}

/// Solves are repeated until the dose has spread for as many turns as the light
/// needs, to this share of them; so often at most.
constexpr double kSameTurns = 0.1;
constexpr int kMostPasses = 3;

/// The bound of effective doses, of one of light: void gets at least 1 /
/// `of_light` of what the part does, of which inhibitors take as much as there.
/// What a voxel has while a turn lasts may be more than averages say, by what
/// comes back in that turn.
double bound_of_print(double of_light, const Bench& bench, const PrintFigures& figures) {
  const double back = bench.resupply_mj_cm3_s * figures.print_time_s;
  const double in_turn = bench.resupply_mj_cm3_s * bench.exposure.turn_s;
  const double part = figures.metrics.min_gel;
  const double empty = (part - in_turn + back) / of_light - back;
  return empty > 0 ? part / empty : std::numeric_limits<double>::infinity();
}

/// About how many turns light for a part takes: that of filtered back
/// projection, for the mean dose of the part.
int likely_turns(const Asked& asked, const Bench& bench, Window window, int most_turns,
                 const ExecutionContext& context) {
  const Light light = filtered_start(context, *asked.target, asked.rays, window);
  const Field dose = adjoint(*asked.projector, context, light);
  double sum = 0;
  for (std::size_t i = 0; i < asked.target->kinds.size(); ++i) {
    if (asked.target->kinds[i] == Kind::gel) sum += dose.values[i];
  }
  const double turn = sum / static_cast<double>(asked.target->gel) * bench.mw_cm2.back() *
                          dose_of_turn(bench.grid, bench.exposure) -
                      bench.resupply_mj_cm3_s * bench.exposure.turn_s;
  const double most = most_turns > 0 ? most_turns : 1e6;
  const double turns = turn > 0 ? std::ceil(bench.exposure.critical_mj_cm3 / turn) : most;
  return static_cast<int>(std::clamp(turns, 1.0, most));
}

/// The same where dose spreads for so many turns.
Asked spread_for_turns(const Asked& asked, const Bench& bench, const Resin& resin,
                       const Box<std::uint8_t>& insert, int turns) {
  if (detail::spread_mm(bench, resin, turns) > bench.radius_mm) {
    throw InfeasibleError(fmt::format(
        "the part needs {} turns of {:g} s, in which its dose "
        "spreads by {:.3g} mm, and the resin "
        "has a radius of {:g} mm; expected more light",
        turns, bench.exposure.turn_s, detail::spread_mm(bench, resin, turns), bench.radius_mm));
  }
  const TomoGrid& grid = asked.target->grid;
  auto spread =
      std::make_shared<detail::DoseSpread>(grid, insert, detail::spread_mm(bench, resin, turns));
  const double kappa = detail::kappa_of_turn(bench, resin);
  detail::SpreadSeries series =
      spread->series([&](double lambda) { return detail::spread_of_turns(turns, kappa, lambda); });
  Asked with{
      std::make_shared<const Target>(detail::spread_target(*asked.target)),
      detail::make_spread_projector(asked.projector, grid, std::move(spread), std::move(series)),
      asked.rays};
  if (with.target->grid.coupled() && !grid.coupled()) {
    for (int z = 0; z < grid.slices; ++z) {
      with.rays.row_mm.push_back(with.target->grid.lowest_mm +
                                 z * with.target->grid.slice_height_mm());
    }
  }
  return with;
}

Evidence evidence_of(const Solution& solution, const Target& target, const Box<std::uint8_t>& part,
                     const PrintOptions& options, const Sampling& sampling) {
  Evidence e;
  e.slice = solution.bound_slice;
  e.z_mm = sampling.z_mm(e.slice);
  e.voxel_mm = sampling.voxel_mm;
  e.bound = solution.contrast_bound;
  e.dose = {1, part.ny, part.nx, {}};
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (int y = 0; y < part.ny; ++y) {
    for (int x = 0; x < part.nx; ++x) {
      const std::size_t v = target.grid.voxel(x, y, e.slice);
      const float d = solution.dose[v];
      e.dose.values.push_back(d);
      if (target.kinds[v] == Kind::gel) least = std::min<double>(least, d);
      if (target.kinds[v] == Kind::empty) most = std::max<double>(most, d);
    }
  }
  const double gels = std::sqrt(least * most);
  for (float& d : e.dose.values) d = static_cast<float>(d / gels);
  const auto slice_of = [&](const Box<std::uint8_t>& box) {
    if (box.values.empty()) return Box<std::uint8_t>{};
    const auto first = box.values.begin() + static_cast<std::ptrdiff_t>(box.at(e.slice, 0, 0));
    return Box<std::uint8_t>{
        1, box.ny, box.nx, {first, first + static_cast<std::ptrdiff_t>(box.at(1, 0, 0))}};
  };
  e.part = slice_of(part);
  e.insert = slice_of(options.insert);
  return e;
}

/// The same with what walls that are not round and rods leave of the resin.
PrintOptions in_vial(const PrintOptions& options, const Box<std::uint8_t>& part,
                     const Printer& printer, double voxel_mm) {
  require_tomographic(printer);
  PrintOptions with = options;
  if (!printer.vial->traced()) return with;
  if (!options.insert.values.empty()) {
    throw InputError("printer '" + printer.name +
                     "': light through its vial is traced, which inserts of any form do not "
                     "stand in "
                     "yet; expected none, or rods in its file (glass_rods, metal_rods)");
  }
  with.insert = detail::beside_resin(part, printer, voxel_mm);
  detail::check_wanted_in_resin(options.wanted, with.insert, voxel_mm);
  return with;
}

Print solve_in(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
               const Resin& resin, const PrintOptions& options, const ExecutionContext& context) {
  const Place place = place_of(part, voxel_mm, printer, resin, options);
  const Bench& bench = place.bench;
  TomoJob job;
  job.printer = printer;
  job.resin = resin;
  job.sampling = {voxel_mm, part.nz, bench.grid.angles};
  job.sampling.middle_z_mm = options.middle_z_mm;
  job.wanted = options.wanted;
  detail::Scene scene = detail::scene_of(bench, part, options.insert);
  const bool banded = options.wanted.any();
  detail::add_bands(options.wanted, options.insert, bench.exposure.critical_mj_cm3, scene.target);
  const Target& target = scene.target;
  // Light is looked for in groups of pixels, and with operators that are
  // quicker; bounds are proven for that of all pixels, with those that follow
  // their squares.
  const Asked every{std::shared_ptr<const Target>(std::shared_ptr<const Target>(), &target),
                    scene.projector, bench.rays};
  const Asked flat = searched(place.groups, part, options, Search::close);
  std::optional<Asked> rough;
  if (options.solve.method == Method::ladder && has_rough_search(place.groups)) {
    rough = searched(place.groups, part, options, Search::rough);
  }
  // The solve is told of as a whole, none of its sums over angles by itself.
  const ExecutionContext quiet = slicecorr::detail::silent(context);
  if (const std::string doubt = doubt_of_turbidity(printer, resin); !doubt.empty()) {
    context.tell(doubt);
  }
  const int wanted = resolving_angles(place.part_radius_mm, voxel_mm);
  if (bench.grid.angles < wanted) {
    const int shown = most_frames_per_turn(*printer.rotation);
    context.tell(fmt::format(
        "{} angles are too few for voxels of {:g} mm at {:.3g} mm "
        "from the axis: {} would resolve "
        "them{}",
        bench.grid.angles, voxel_mm, place.part_radius_mm, wanted,
        shown > 0 && shown < wanted ? fmt::format(", of which the projector shows {} in a "
                                                  "turn; a slower turn has more",
                                                  shown)
                                    : std::string()));
  }
  SolveOptions how = options.solve;
  const int most_turns = place.most_turns;
  const bool spreads = resin.dose_diffusion_m2_s > 0;
  if (most_turns > 0) {
    const double cap = detail::cap_of_turns(bench, most_turns);
    how.cap = how.cap > 0 ? std::min(how.cap, cap) : cap;
  }
  detail::CheckpointFile file(options.checkpoint, options.checkpoint_s,
                              fingerprint_of(part, options.insert, job, how));
  // Nothing prints in less: where inhibitor comes back too fast that is the
  // proof.
  const double least = detail::least_turns(bench, *every.projector, target, spreads, quiet);
  if (most_turns > 0 && !spreads) detail::check_turns(bench, least, most_turns);
  std::optional<detail::LightGoal> goal;
  if (how.method == Method::ladder && how.cap == 0) goal.emplace(bench, least);
  const double per_unit = dose_of_turn(bench.grid, bench.exposure);
  // Light takes as much as all frames: it is handed on, but where it is a start once more.
  const auto light_of = [&](Solution& found, const Asked& asked) {
    Light light{asked.target->grid, spreads ? found.light : std::move(found.light)};
    light = detail::light_of_slices(std::move(light), flat.target->grid);
    return asked_light(bench, light_of_groups(place.groups, std::move(light), bench));
  };
  // The light as bright as the projector can show it gives the number of turns;
  // then as bright as they need.
  const auto turns_of = [&](const Solution& found, const Asked& asked, double brightest) {
    return detail::turns_for(bench,
                             per_unit * brightest * weakest_voxel(*asked.target, found.dose).dose,
                             goal             ? goal->turns()
                             : most_turns > 0 ? most_turns
                                              : detail::LightGoal(bench, least).turns());
  };
  std::optional<SolverState> state;
  if (options.resume) {
    const TomoGrid& grid = flat.target->grid;
    state = file.read((spreads ? detail::spread_grid(grid) : grid).shape());
  }
  if (state) {
    context.tell(
        fmt::format("{}: goes on after {} steps", options.checkpoint, state->best.history.size()));
    how.resume = &*state;
    if (goal) goal->resume(file.attempt());
  }
  how.checkpoint = [&](const SolverPlace& at) {
    if (options.solve.checkpoint) options.solve.checkpoint(at);
    file.keep(at);
    if (at.rung > 0 && at.missed.empty()) {
      context.tell(fmt::format("next: void below {:g} of the gel dose", at.rung));
    }
  };
  // How far dose spreads depends on the number of turns, and that on the light.
  std::vector<int> passes = file.passes();
  if (spreads && passes.empty()) {
    passes.push_back(likely_turns(flat, bench, how.window, most_turns, quiet));
  }
  Asked asked = flat, provable = every;
  std::optional<Solution> found;
  Array<float> start;
  // Not before it is found: it takes as much as all frames.
  Light light(bench.grid, {});
  double brightest = 0;
  detail::Turns turns;
  // What was found within a few turns, while more is looked for in many: that
  // need not be better.
  struct FoundSooner {
    Solution found;
    Light light;
    Asked asked;
    double brightest;
    detail::Turns turns;
  };
  std::optional<FoundSooner> quick;
  for (;;) {
    ExecutionContext told = context;
    const double of_pass = spreads ? 1.0 / kMostPasses : 1, of_attempt = goal ? 0.5 : 1;
    const double done_before = of_attempt * (goal ? goal->attempt() : 0) +
                               (spreads ? of_attempt * of_pass * (passes.size() - 1.0) : 0);
    told.progress = [&context, done_before, share = of_pass * of_attempt](std::string_view stage,
                                                                          double done) {
      context.report(stage, std::min(done_before + share * done, 0.99));
    };
    if (spreads) {
      asked = spread_for_turns(flat, bench, resin, options.insert, passes.back());
      provable = spread_for_turns(every, bench, resin, options.insert, passes.back());
      file.of_passes(passes);
      context.tell(fmt::format("light for dose that spreads by {:.3g} um in {} turns",
                               1e3 * detail::spread_mm(bench, resin, passes.back()),
                               passes.back()));
    }
    const Asked weights = weighed(asked), proof = weighed(provable);
    const detail::ToldProjector projector(*weights.projector, told,
                                          detail::expected_calls(how, asked.target->grid.blocks()));
    how.prover = proof.projector.get();
    if (goal) {
      // Where a turn is more than enough for any light, time is none; and the
      // last time it is a goal only where inhibitors come back, since what has
      // too little contrast within a few turns needs its freedom.
      const bool free = goal->last() && !(bench.resupply_mj_cm3_s > 0);
      how.cap = goal->needs_cap() && !free ? detail::likely_cap(bench, goal->turns()) : 0;
      file.of_attempt(goal->attempt());
    }
    std::optional<Solution> before;
    SolveOptions closer = how;
    if (rough) {
      before = rough_solution(
          weighed(spreads ? spread_for_turns(*rough, bench, resin, options.insert, passes.back())
                          : *rough),
          how, quiet);
      if (closer.start == nullptr) closer.start = &before->light;
      closer.proof_steps = 0;
    }
    if (before && before->contrast_bound < 1 && !banded) {
      found = std::move(before);
    } else {
      found = solve(quiet, projector, *weights.target, asked.rays, closer);
      if (before && before->contrast_bound < found->contrast_bound) {
        found->contrast_bound = before->contrast_bound;
        found->bound_slice = before->bound_slice;
      }
    }
    if (banded) detail::without_weights(quiet, *asked.projector, *asked.target, *found);
    if (found->contrast_bound < 1 && !banded) {
      if (options.evidence) {
        Evidence evidence = evidence_of(*found, *asked.target, part, options, job.sampling);
        evidence.beyond = beyond_walls(*printer.vial, part.nx, voxel_mm);
        options.evidence(evidence);
      }
      throw InfeasibleError(fmt::format(
          "no light prints this part{}: where it is hardest, in slice {} "
          "({:.3f} mm above the "
          "optical axis), void gets at least 1/{:.4f} of the part's least "
          "dose, whatever is shown; "
          "expected less absorption (alpha R is {:.3g}), or a part with more "
          "room",
          spreads ? fmt::format(", of which the dose spreads by {:.3g} um in {} turns",
                                1e3 * detail::spread_mm(bench, resin, passes.back()), passes.back())
                  : std::string(),
          found->bound_slice, job.sampling.z_mm(found->bound_slice), found->contrast_bound,
          bench.alpha_r));
    }
    light = light_of(*found, asked);
    brightest = bench.mw_cm2.back() / *std::max_element(light.values.begin(), light.values.end());
    turns = turns_of(*found, asked, brightest);
    const int counted = spreads ? passes.back() : turns.count;
    if (std::abs(turns.count - counted) <= kSameTurns * counted) {
      if (!goal || goal->last()) break;
      const bool enough = banded ? found->metrics.contrast >= 1
                                 : goal->enough(*found, found->metrics.contrast, turns.count);
      if (!turns.never && enough) break;
      goal->next();
      if (!turns.never) quick.emplace(FoundSooner{*found, light, asked, brightest, turns});
      context.tell(fmt::format("a {} of {:.4g} in {} turns: more is looked for in {}",
                               banded ? "slack" : "contrast", found->metrics.contrast, turns.count,
                               goal->turns()));
      how.start = options.solve.start;
      how.resume = nullptr;
      if (spreads) passes.assign(1, likely_turns(flat, bench, how.window, most_turns, quiet));
      continue;
    }
    if (passes.size() == kMostPasses) {
      context.tell(
          fmt::format("the light needs {} turns, and was found for {}", turns.count, counted));
      break;
    }
    passes.push_back(most_turns > 0 ? std::min(turns.count, most_turns) : turns.count);
    start = std::move(found->light);
    how.start = &start;
    how.resume = nullptr;
  }
  context.report("solving", 1);
  if (quick && (turns.never || quick->found.metrics.contrast >= found->metrics.contrast)) {
    quick->found.contrast_bound = std::max(quick->found.contrast_bound, found->contrast_bound);
    found = std::move(quick->found);
    light = std::move(quick->light);
    asked = std::move(quick->asked);
    brightest = quick->brightest;
    turns = quick->turns;
  }
  Solution& solution = *found;
  job.turns = turns.count;
  Exposure exposure = bench.exposure;
  exposure.critical_mj_cm3 = turns.dose_mj_cm3;
  exposure.most_time_s = options.most_time_s;
  Array<float> full = std::move(solution.dose);
  for (float& d : full) d = static_cast<float>(d * brightest);
  const PrintTime time = plan_time(quiet, *asked.projector, *asked.target, full, exposure);
  full = Array<float>();  // "= {}" would keep its memory

  job.part = part;
  job.insert = options.insert;
  const detail::RoundedPrint rounded =
      detail::show_light({.bench = bench,
                          .target = target,
                          .light = light,
                          .scale = brightest * time.scale,
                          .brightest = brightest,
                          .turns = turns.count,
                          .most_turns = turns.never ? turns.count : most_turns,
                          .black_mj_cm3 = detail::floor_of_turn(bench, *scene.projector, quiet),
                          .hold = options.hold == 0 && options.angles > 0 ? 1 : options.hold},
                         context, job);
  PrintFigures figures = rounded.figures;
  if (!banded) detail::tell_levels(context, bench, solution.metrics.contrast, figures, rounded.top);
  context.report("judging", 1);

  job.history = std::move(solution.history);
  if (banded) {
    job.wanted.slack_bound = figures.wanted->slack_bound = solution.contrast_bound;
  } else {
    job.contrast_bound = bound_of_print(solution.contrast_bound, bench, figures);
  }
  Print print;
  print.job = std::move(job);
  print.figures = figures;
  print.figures.contrast_bound = print.job.contrast_bound;
  return print;
}

}  // namespace

Bench check_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options) {
  const PrintOptions with = in_vial(options, part, printer, voxel_mm);
  Bench bench = place_of(part, voxel_mm, printer, resin, with).bench;
  detail::target_of(bench, part, with.insert);
  return bench;
}

Print solve_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options,
                  const ExecutionContext& context) {
  return solve_in(part, voxel_mm, printer, resin, in_vial(options, part, printer, voxel_mm),
                  context);
}

}  // namespace slicecorr::tomo
