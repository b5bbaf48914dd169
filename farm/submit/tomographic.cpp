// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/tomographic.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "programs/common/tomo_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/vial.hpp"
#include "submit/fields.hpp"
#include "work/make_result.hpp"

namespace slicecorr::farm::detail {

namespace {

/// Bytes.
constexpr double kMb = 1 << 20;
/// Of any worker that prints tomographically.
constexpr double kTomoProgramMb = 20;

/// The page and the figures: seen were 0.3 to 0.9 MB.
constexpr std::int64_t kPageBytes = 1'000'000;

/// What a job's direct sums cost beside the solve, in steps of OSMO.
constexpr double kStepsOfJudging = 4;

/// The grid computes with all lanes of a block, used or not.
double computed_voxels(const tomo::TomoGrid& grid) {
  return static_cast<double>(grid.blocks() * grid.voxels_of_block());
}

/// The side of a voxel: what the job says comes before defaults, and voxel_mm before layer_um.
double voxel_mm_of(const JobRequest& r, bool volume, const Printer& printer) {
  const std::string voxel = r.as_options ? "--voxel-mm" : "voxel_mm";
  const std::string layer = r.as_options ? "--layer-um" : "layer_um";
  const auto own = [&](const char* key) {
    const auto said = r.said.find(key);
    return said != r.said.end() && !said->second.default_;
  };
  if (volume) {
    if (r.voxel_mm > 0) return r.voxel_mm;
    throw InputError(voxel + " is missing: a volume does not say how large its voxels are");
  }
  if (own("voxel_mm") && own("layer_um")) {
    throw InputError(fmt::format(
        "{} and {} are two ways to say how large voxels are; expected one of them", voxel, layer));
  }
  if (r.voxel_mm > 0 && !own("layer_um")) return r.voxel_mm;
  cli::TomoPrintOptions o;
  o.mesh.layer_um = r.layer_um;
  return o.side_of_voxel_mm(printer);
}

int usual_steps(const tomo::SolveOptions& o) {
  switch (o.method) {
    case tomo::Method::osmo:
      return 20;
    case tomo::Method::kelly:
      return 10;
    case tomo::Method::fbp:
      return 1;
    case tomo::Method::ladder:
      break;
  }
  return 60;
}

}  // namespace

std::pair<Printer, Resin> resolve_tomographic(const JobRequest& r, WorkSpec& spec) {
  for (const auto& [text, name] :
       {std::pair{r.setup.printer, "printer"}, std::pair{r.setup.resin, "resin"}}) {
    if (!text.empty()) continue;
    throw InputError(r.as_options ? fmt::format("--{} is required", name)
                                  : fmt::format("{} is missing", name));
  }
  if ((r.clip_sigma > 0 || r.stop_error > 0) && r.method != "osmo") {
    throw InputError(r.as_options
                         ? "--clip-sigma and --stop-error are of OSMO; expected --method osmo"
                         : "clip_sigma and stop_error are of OSMO; expected method osmo with them");
  }
  std::pair<Printer, Resin> definitions{load_printer(r.setup.printer), load_resin(r.setup.resin)};
  require_tomographic(definitions.first);
  check_chosen_light(definitions.first, definitions.second, false, r.setup,
                     r.as_options ? ChoiceNames::options : ChoiceNames::fields);
  spec.kind = "tomo";
  TomoWork& t = spec.tomo.emplace();
  t.volume = kind_of(r) == JobKind::tomographic_volume;
  t.inserts = static_cast<int>(r.inserts.size());
  t.voxel_mm = voxel_mm_of(r, t.volume, definitions.first);
  if (!r.method.empty()) t.method = r.method;
  if (!r.window.empty()) t.window = r.window;
  t.angles = r.angles;
  t.iterations = r.iterations;
  t.clip_sigma = r.clip_sigma;
  t.stop_error = r.stop_error;
  t.max_time_s = r.max_time_s;
  t.beyond_reach = r.beyond_reach;
  if (!t.volume) {
    spec.units = r.units;
    spec.scale = r.scale;
    spec.rotate_deg = r.rotate_deg;
  }
  return definitions;
}

MemoryNeeds tomo_memory_needs(const tomo::Bench& bench, tomo::Method method) {
  const tomo::TomoGrid& grid = bench.grid;
  const auto blocks = static_cast<double>(grid.blocks());
  const double light = 4.0 * static_cast<double>(grid.light_of_block()) / kMb;   // of a block
  const double field = 4.0 * static_cast<double>(grid.voxels_of_block()) / kMb;  // of a block
  // Light and dose as they are, the best of both, and what the next step makes of them; then part and
  // target, a byte each; grey levels are half as large as light.
  // Weights of traced light are kept for pixels and for groups of them.
  const double all = blocks * (4 * light + 5 * field) + kTomoProgramMb +
                     2 * tomo::bytes_of_weights(bench) / (1024 * 1024);
  const double thread =
      method == tomo::Method::ladder ? 16 * light + 4 * field : 2 * light + 2 * field;
  return {static_cast<std::int64_t>(1.5 * (all + thread)) + 1,
          static_cast<std::int64_t>(1.5 * thread) + 1};
}

std::int64_t voxel_angle_steps(const tomo::TomoGrid& grid, const tomo::SolveOptions& o) {
  const int steps = o.steps > 0 ? o.steps : usual_steps(o);
  const double rungs = o.method == tomo::Method::ladder ? static_cast<double>(o.rungs.size()) : 1.0;
  return static_cast<std::int64_t>(computed_voxels(grid) * grid.angles *
                                   (steps * rungs + kStepsOfJudging));
}

// Rays are followed one by one, and judged one by one: so many times what level light takes, for each ray of a pixel.
constexpr std::int64_t kTimesOfRays = 3;
// Light for dose that spreads is found up to three times, for all slices together; seen were 3 to 8 times.
constexpr std::int64_t kTimesOfSpread = 5;

// A few slices are solved one by one, or leave vector lanes idle; more of them lie side by side.
constexpr int kFewSlices = 7;

std::string tomo_rate_class(const TomoWork& tomo, int slices) {
  return fmt::format("tomo {}{}", tomo.method, slices <= kFewSlices ? " slice by slice" : "");
}

double guessed_units_per_s(int slices) { return slices <= kFewSlices ? 1.2e8 : 5e8; }

TomoNeeds look_at_tomographic(const WorkSpec& spec, const std::vector<std::string>& paths,
                              const Printer& printer, const Resin& resin,
                              const ExecutionContext& context) {
  const cli::TomoPrint wanted = cli::read_tomo_print(tomo_options(spec, paths), printer, context);
  const tomo::Bench bench =
      tomo::check_print(wanted.part, wanted.voxel_mm, printer, resin, wanted.options);
  TomoNeeds needs;
  needs.slices = wanted.part.nz;
  needs.angles = bench.grid.angles;
  needs.voxels = static_cast<std::int64_t>(wanted.part.values.size());
  needs.voxel_angle_steps = voxel_angle_steps(bench.grid, wanted.options.solve);
  if (bench.lab) needs.voxel_angle_steps *= kTimesOfRays * bench.lab->per_pixel;
  const bool spreads = resin.dose_diffusion_m2_s > 0;
  if (spreads) needs.voxel_angle_steps *= kTimesOfSpread;
  // A third of a byte for each pixel that is lit: seen were 0.09 to 0.32.
  std::int64_t rows = 0;
  if (bench.grid.coupled()) {
    rows = std::int64_t{bench.window.rows} * bench.window.high;
  } else {
    for (int row = 0; row < bench.frame_height; ++row) {
      rows += bench.places.lit_by(0, bench.window.first_column, row).any();
    }
  }
  needs.bytes = std::int64_t{bench.grid.angles} *
                    (std::int64_t{bench.grid.pixels} * bench.window.wide * rows / 3 + 1024) +
                kPageBytes;
  needs.memory = tomo_memory_needs(bench, wanted.options.solve.method);
  if (spreads) {
    // Dose before and after it has spread, and on its way.
    const double fields = 3 * 4.0 * static_cast<double>(bench.grid.voxels_of_block()) *
                          static_cast<double>(bench.grid.blocks()) / kMb;
    needs.memory.base_mb += static_cast<std::int64_t>(1.5 * fields) + 1;
  }
  return needs;
}

}  // namespace slicecorr::farm::detail
