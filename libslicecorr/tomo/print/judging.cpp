// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/judging.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "slicecorr/tomo/shown_light.hpp"
#include "slicecorr/tomo/surface.hpp"

namespace slicecorr::tomo {

namespace detail {
namespace {

Field field_of(const TomoGrid& grid, const Box<float>& dose) {
  Field field(grid);
  for (int z = 0; z < dose.nz; ++z) {
    for (int y = 0; y < dose.ny; ++y) {
      for (int x = 0; x < dose.nx; ++x) {
        field.values[grid.voxel(x, y, z)] = dose.values[dose.at(z, y, x)];
      }
    }
  }
  return field;
}

/// Share of the part that has less than this.
double below_gel(const Target& target, const Array<float>& dose, double gel_mj_cm3) {
  std::size_t below = 0;
  for (std::size_t i = 0; i < target.kinds.size(); ++i) {
    below += target.kinds[i] == Kind::gel && dose[i] < gel_mj_cm3 ? 1 : 0;
  }
  return static_cast<double>(below) / static_cast<double>(target.gel);
}

}  // namespace

Volume volume_of(const TomoGrid& grid, const Box<std::uint8_t>& part) {
  Volume volume(grid);
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        volume.coverage[grid.voxel(x, y, z)] = part.values[part.at(z, y, x)];
      }
    }
  }
  return volume;
}

Target target_of(const Bench& bench, const Box<std::uint8_t>& part,
                 const Box<std::uint8_t>& insert) {
  const Volume volume = volume_of(bench.grid, part);
  if (insert.values.empty()) return Target(volume);
  const Volume opaque = volume_of(bench.grid, insert);
  return Target(volume, &opaque);
}
Scene scene_of(const Bench& bench, const Box<std::uint8_t>& part, const Box<std::uint8_t>& insert) {
  Target target = target_of(bench, part, insert);
  if (insert.values.empty()) return {std::move(target), make_projector(bench)};
  const Volume opaque = volume_of(bench.grid, insert);
  return {std::move(target), make_projector(bench, &opaque)};
}

double floor_of_turn(const Bench& bench, const Projector& projector,
                     const ExecutionContext& context) {
  const std::vector<std::uint16_t> black(bench.grid.blocks() * bench.grid.light_of_block(), 0);
  const Field floor = adjoint(projector, context, shown_light(bench, black));
  return *std::max_element(floor.values.begin(), floor.values.end()) *
         dose_of_turn(bench.grid, bench.exposure);
}

PrintFigures judge(const TomoJob& job, const Bench& bench, const Target& target,
                   const Box<float>& dose, double floor_of_turn_mj_cm3) {
  const Field field = field_of(bench.grid, dose);
  PrintFigures f;
  f.turns = job.turns;
  f.print_time_s = job.turns * bench.exposure.turn_s;
  f.gel_dose_mj_cm3 = bench.exposure.critical_mj_cm3;
  f.metrics = measure(target, field.values);
  f.jaccard_at_dose = jaccard(target, field.values, f.gel_dose_mj_cm3);
  f.gel_below_dose = below_gel(target, field.values, f.gel_dose_mj_cm3);
  if (job.wanted.any()) f.wanted = judge_wanted(dose, job.wanted, job.insert);
  f.efficiency = efficiency(shown_light(bench, job.levels));
  f.alpha_r = bench.alpha_r;
  f.floor_mj_cm3 =
      std::max(0.0, floor_of_turn_mj_cm3 * job.turns - bench.resupply_mj_cm3_s * f.print_time_s);
  return f;
}

}  // namespace detail

PrintFigures figures_of(const TomoJob& job, const Box<float>& dose, const Box<std::uint8_t>& part,
                        const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const detail::Scene scene = detail::scene_of(bench, part, job.insert);
  PrintFigures f = detail::judge(job, bench, scene.target, dose,
                                 detail::floor_of_turn(bench, *scene.projector, context));
  if (!f.wanted) {
    f.surface = surface_of(dose, part, job.insert, job.sampling.voxel_mm, f.gel_dose_mj_cm3);
  }
  return f;
}

double share_below_gel(const TomoJob& job, const Box<float>& dose, const Box<std::uint8_t>& part) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  return detail::below_gel(detail::target_of(bench, part, job.insert),
                           detail::field_of(bench.grid, dose).values,
                           bench.exposure.critical_mj_cm3);
}

std::string_view PrintFigures::fault() const {
  if (wanted && !wanted->all()) return "some doses are not within their tolerance";
  if (metrics.contrast < 1) return "void gels before all of the part does";
  if (metrics.min_gel < gel_dose_mj_cm3) return "some of the part gets less than what gels";
  if (metrics.max_void >= gel_dose_mj_cm3) {
    return "some void gels, too, by the end of the print: its light is too bright, or shown for too long";
  }
  return {};
}

std::string PrintFigures::to_json() const {
  const auto finite = [](double v) {
    return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr);
  };
  nlohmann::ordered_json j;
  j["feasible"] = feasible();
  j["ver"] = metrics.ver;
  j["pw"] = metrics.pw;
  j["trimmed_pw"] = metrics.trimmed_pw;
  j["ipdr"] = metrics.ipdr;
  j["jaccard"] = {{"best", metrics.best_jaccard}, {"dose", jaccard_at_dose}};
  j["contrast"] = finite(metrics.contrast);
  j["contrast_bound"] = finite(contrast_bound);
  j["efficiency"] = efficiency;
  j["turns"] = turns;
  j["print_time_s"] = print_time_s;
  j["alpha_r"] = alpha_r;
  j["gel_voxels"] = metrics.gel;
  j["void_voxels"] = metrics.empty;
  j["gel_below_dose"] = {
      {"centres", gel_centres_below_dose ? nlohmann::ordered_json(*gel_centres_below_dose)
                                         : nlohmann::ordered_json(nullptr)},
      {"means", gel_below_dose}};
  j["dose_mj_cm3"] = {{"to_gel", gel_dose_mj_cm3},
                      {"min_gel", metrics.min_gel},
                      {"max_gel", metrics.max_gel},
                      {"max_void", metrics.max_void},
                      {"floor", floor_mj_cm3}};
  if (surface.voxels > 0) {
    j["surface"] = {
        {"voxels", surface.voxels}, {"mean_um", surface.mean_um}, {"rms_um", surface.rms_um}};
  }
  if (wanted) {
    j["wanted"] = {{"voxels", wanted->voxels},
                   {"within", wanted->within},
                   {"share_within", wanted->share_within},
                   {"rms_off_mj_cm3", wanted->rms_off_mj_cm3},
                   {"worst_off_mj_cm3", wanted->worst_off_mj_cm3},
                   {"worst_voxel", wanted->worst},
                   {"slack", finite(wanted->slack)},
                   {"slack_bound", finite(wanted->slack_bound)}};
  }
  return j.dump(2);
}

}  // namespace slicecorr::tomo
