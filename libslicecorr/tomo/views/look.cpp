// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/look.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "stack/container/container.hpp"
#include "stack/png/png.hpp"
#include "support/files/temporary.hpp"
#include "tomo/views/image_folder.hpp"
#include "tomo/views/section_cut.hpp"

namespace slicecorr::tomo {

namespace {

using slicecorr::detail::Container;
using slicecorr::detail::silent;

/// A camera's images in their order.
class Images {
 public:
  Images(const std::string& path, const Printer& printer, const ExecutionContext& context)
      : printer_(printer),
        archive_(slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder,
                                                   context)),
        entries_(detail::images_in(*archive_)) {}
  int count() const { return static_cast<int>(entries_.size()); }
  const std::string& path() const { return archive_->path(); }
  const std::string& name(int i) const { return entries_[static_cast<std::size_t>(i)]->name; }
  GreyImage read(int i) const {
    std::vector<std::uint8_t> png;
    archive_->read(*entries_[static_cast<std::size_t>(i)], std::uint64_t{1} << 32, png);
    const auto header = slicecorr::detail::read_png_header(png, {path(), name(i)});
    if (static_cast<int>(header.width) != printer_.width_px ||
        static_cast<int>(header.height) != printer_.height_px || header.bit_depth == 16) {
      throw InputError(
          path(), name(i),
          fmt::format("has {} x {} pixels of {} bits; expected {} x {} of 8, the projector's",
                      header.width, header.height, header.bit_depth, printer_.width_px,
                      printer_.height_px));
    }
    return decode_png(png, printer_.width_px, printer_.height_px, path(), name(i));
  }

 private:
  const Printer& printer_;
  std::unique_ptr<const Container> archive_;
  std::vector<const Container::Entry*> entries_;
};

void check_job(const TomoJob& job) {
  const auto refuse = [](const char* what) {
    throw InputError(fmt::format("{}; expected another job to look at", what));
  };
  if (slices_share_light(job.printer, job.resin)) {
    refuse("a camera is taken to see parallel lines, and this printer's light rises or spreads");
  }
  if (job.printer.vial->traced()) {
    refuse("a camera is taken to look through a round vial without rods");
  }
  if (!job.insert.values.empty()) refuse("an insert hides from the camera what lies behind it");
  if (job.resin.inhibition_resupply_mj_cm3_s > 0 || job.resin.dose_diffusion_m2_s > 0) {
    refuse("in this resin dose does not grow evenly from turn to turn");
  }
}

/// The camera's lines: those of the projector's pixels, of light that nothing dims.
Bench camera_bench(const TomoJob& job, int angles) {
  Printer printer = job.printer;
  printer.flat_field.reset();
  printer.rotation->max_fps = 0;
  printer.fill_factor = 1;  // it sees what lies between pixels, too
  Resin resin = job.resin;
  resin.absorbance_height10_um = 1e12;
  resin.active_absorption_per_cm = 0;
  Sampling sampling = job.sampling;
  sampling.angles = angles;
  Bench bench = make_bench(printer, resin, sampling);
  bench.rays.weight.clear();
  bench.rays.alpha_per_mm = 0;
  return bench;
}

/// How many steps the camera's images are ahead.
int steps_ahead(double camera_deg, int angles) {
  const double steps = camera_deg * angles / 360, whole = std::round(steps);
  if (!(std::abs(steps - whole) < 1e-3 && std::abs(whole) <= angles)) {
    throw InputError(fmt::format(
        "a camera at {:g}° from the projector, and images at every {:g}°; expected a whole number "
        "of these",
        camera_deg, 360.0 / angles));
  }
  return static_cast<int>(whole);
}

/// -ln(now / before) of the grid's light, and how many pixels show each.
struct Shadows {
  Light taken, pixels;
};
Shadows shadows_of(const Images& before, const Images& now, const Bench& bench, int ahead,
                   const ExecutionContext& context) {
  const TomoGrid& grid = bench.grid;
  Shadows all{Light(grid), Light(grid)};
  Light dark(grid);
  for (int frame = 0; frame < grid.angles; ++frame) {
    context.check_cancelled();
    const GreyImage clear = before.read(frame), here = now.read(frame);
    if (std::all_of(clear.pixels.begin(), clear.pixels.end(), [](auto v) { return v == 0; })) {
      throw InputError(before.path(), before.name(frame),
                       "is black; expected the vial before any light, lit for the camera");
    }
    const int place = ((frame + ahead) % grid.angles + grid.angles) % grid.angles;
    const int m = bench.frame_of_angle(place);
    for (int row = 0; row < clear.height_px; ++row) {
      for (int column = 0; column < clear.width_px; ++column) {
        const FramePlaces::Lit lit = bench.places.lit_by(m, column, row);
        const std::size_t at =
            static_cast<std::size_t>(row) * static_cast<std::size_t>(clear.width_px) +
            static_cast<std::size_t>(column);
        // What is black before tells nothing.
        if (!lit.any() || clear.pixels[at] == 0) continue;
        const std::size_t i = grid.pixel(m, lit.pixel, lit.row);
        all.taken.values[i] += clear.pixels[at];
        dark.values[i] += here.pixels[at];
        all.pixels.values[i] += 1;
      }
    }
    context.report("reading images", static_cast<double>(frame + 1) / grid.angles);
  }
  for (std::size_t i = 0; i < dark.values.size(); ++i) {
    if (!(all.pixels.values[i] > 0)) continue;
    // Half a level where nothing comes through.
    const float least = 0.5F * all.pixels.values[i];
    all.taken.values[i] = -std::log(std::max(dark.values[i], least) / all.taken.values[i]);
    all.pixels.values[i] = 1;
  }
  return all;
}

Field reconstructed(const Bench& bench, const Shadows& shadows, int steps,
                    const ExecutionContext& context) {
  const TomoGrid& grid = bench.grid;
  const auto projector = make_projector(bench);
  const ExecutionContext quiet = silent(context);
  // A line integral is the sum over voxels times the area of a voxel over the width of a pixel.
  const auto per_mm = static_cast<float>(grid.pixel_mm / (grid.voxel_mm() * grid.voxel_mm()));
  Field ones(grid);
  for (float& v : ones.values) v = 1;
  const Light rows = forward(*projector, quiet, ones);
  const Field columns = adjoint(*projector, quiet, shadows.pixels);
  Field x(grid);
  for (int step = 0; step < steps; ++step) {
    context.check_cancelled();
    Light rest = forward(*projector, quiet, x);
    for (std::size_t i = 0; i < rest.values.size(); ++i) {
      const float wanted = shadows.taken.values[i] * per_mm;
      rest.values[i] = shadows.pixels.values[i] > 0 && rows.values[i] > 0
                           ? (wanted - rest.values[i]) / rows.values[i]
                           : 0;
    }
    const Field change = adjoint(*projector, quiet, rest);
    for (std::size_t i = 0; i < x.values.size(); ++i) {
      if (columns.values[i] > 0) {
        x.values[i] = std::max(0.0F, x.values[i] + change.values[i] / columns.values[i]);
      }
    }
    context.report("reconstructing", static_cast<double>(step + 1) / steps);
  }
  return x;
}

/// The plan cut where it is most like what is seen: so many voxels with the greatest doses.
struct Cut {
  std::size_t count = 0;
  double correlation = -1;
};
Cut best_cut(const std::vector<std::pair<float, float>>& falling) {
  const auto n = static_cast<double>(falling.size());
  double sum = 0, squares = 0;
  for (const auto& [dose, seen] : falling) {
    sum += seen;
    squares += static_cast<double>(seen) * seen;
  }
  const double deviation = std::sqrt(std::max(0.0, squares / n - sum / n * (sum / n)));
  Cut best;
  if (!(deviation > 0)) return best;
  double beyond = 0;
  for (std::size_t k = 1; k < falling.size(); ++k) {
    beyond += falling[k - 1].second;
    // Voxels of the same dose are on one side.
    if (falling[k].first == falling[k - 1].first) continue;
    const double share = static_cast<double>(k) / n;
    const double correlation =
        (beyond / n - share * sum / n) / (deviation * std::sqrt(share * (1 - share)));
    if (correlation > best.correlation) best = {k, correlation};
  }
  return best;
}

}  // namespace

Look look_at(const TomoJob& job, const Box<float>& dose, const LookOptions& options,
             const ExecutionContext& context) {
  check_job(job);
  if (!(options.turns > 0 && options.turns <= 1e9)) {
    throw InputError(fmt::format("{:g} turns; expected more than 0", options.turns));
  }
  if (options.steps < 1 || options.steps > 10000) {
    throw InputError(fmt::format("{} steps; expected 1 to 10000", options.steps));
  }
  const Images before(options.before, job.printer, context), now(options.now, job.printer, context);
  if (before.count() < 3 || before.count() > 100000 || now.count() != before.count()) {
    throw InputError(options.now, "",
                     fmt::format("holds {} PNG images, {} holds {}; expected as many, 3 or more",
                                 now.count(), options.before, before.count()));
  }
  const Bench bench = camera_bench(job, before.count());
  const TomoGrid& grid = bench.grid;
  const Shadows shadows =
      shadows_of(before, now, bench, steps_ahead(options.camera_deg, grid.angles), context);
  const Field x = reconstructed(bench, shadows, options.steps, context);

  Look look;
  look.seen = {grid.slices, grid.voxels, grid.voxels, {}};
  std::vector<std::pair<float, float>> voxels;
  double min_gel = std::numeric_limits<double>::infinity(), max_void = 0;
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      const TomoGrid::Range inside = grid.inside(y);
      for (int xx = 0; xx < grid.voxels; ++xx) {
        const float seen = x.values[grid.voxel(xx, y, z)];
        look.seen.values.push_back(seen);
        if (xx < inside.first || xx >= inside.end) continue;
        const std::size_t at = dose.at(z, y, xx);
        voxels.emplace_back(dose.values[at], seen);
        if (job.part.values[at] == 255) {
          ++look.part;
          min_gel = std::min<double>(min_gel, dose.values[at]);
        } else if (job.part.values[at] == 0) {
          max_void = std::max<double>(max_void, dose.values[at]);
        }
      }
    }
  }
  if (look.part == 0) throw InputError("the job has no part; expected one to look for");
  std::sort(voxels.begin(), voxels.end(), [](const auto& a, const auto& b) {
    return a.first > b.first || (a.first == b.first && a.second > b.second);
  });
  const Cut cut = best_cut(voxels);
  look.agreement = cut.correlation;
  if (!(cut.correlation > kSeenAgreement)) {
    throw InputError(
        options.now, "",
        fmt::format("nothing of the plan is to be seen in it: the best agreement is {:.2f}, which "
                    "noise may have, too; expected images in which something has gelled, at the "
                    "projector's pixels, turning as the job does",
                    std::max(cut.correlation, 0.0)));
  }
  look.gelled = cut.count;
  double beyond = 0, others = 0;
  for (std::size_t k = 0; k < voxels.size(); ++k) {
    (k < cut.count ? beyond : others) += voxels[k].second;
  }
  look.line_per_mm = (beyond / static_cast<double>(cut.count) +
                      others / static_cast<double>(voxels.size() - cut.count)) /
                     2;
  // Gelled is what has the gel dose: planned dose times turns over all turns times the share of it.
  const double gel = dose_to_gel_mj_cm3(job.resin), done = options.turns / job.turns;
  const double least = voxels[cut.count - 1].first, next = voxels[cut.count].first;
  look.least_share = gel / (least * done);
  look.most_share = next > 0 ? gel / (next * done) : std::numeric_limits<double>::infinity();
  look.share = std::isfinite(look.most_share) ? std::sqrt(look.least_share * look.most_share)
                                              : look.least_share;
  for (const auto& [planned, seen] : voxels) look.planned += planned * done >= gel ? 1 : 0;
  for (std::size_t k = 0; k < job.part.values.size(); ++k) {
    if (!(dose.values[k] >= least)) continue;
    look.part_gelled += job.part.values[k] == 255 ? 1 : 0;
    look.void_gelled += job.part.values[k] == 0 ? 1 : 0;
  }
  const auto turn_of = [&](double planned) {
    return planned > 0 ? gel / (planned / job.turns * look.share)
                       : std::numeric_limits<double>::infinity();
  };
  look.stop_turn = turn_of(min_gel);
  look.void_turn = turn_of(max_void);
  return look;
}

std::vector<PrintSection> sections_of(const Look& look, const TomoJob& job, const Box<float>& dose,
                                      double turns) {
  const double gel = dose_to_gel_mj_cm3(job.resin), voxel_mm = job.sampling.voxel_mm,
               middle_z_mm = job.sampling.middle_z_mm;
  std::vector<Plane> planes = middle_planes({job, dose, {}});
  planes.erase(planes.begin());  // y and z
  Box<float> come = dose, seen = look.seen;
  for (float& d : come.values) d *= static_cast<float>(turns / job.turns * look.share);
  for (float& v : seen.values) v *= static_cast<float>(gel / look.line_per_mm);
  Box<std::uint8_t> gelled = job.part, shown = job.part;
  for (std::size_t k = 0; k < gelled.values.size(); ++k) {
    gelled.values[k] = come.values[k] >= gel ? 255 : 0;
    shown.values[k] = std::max(shown.values[k], gelled.values[k]);
  }
  const Box<std::uint8_t> no_insert;
  std::vector<PrintSection> all;
  for (const Plane& plane : planes) {
    const auto of = [&](const Box<float>& doses, const Box<std::uint8_t>& target) {
      return detail::cut({doses, target, no_insert, voxel_mm, gel, middle_z_mm, {}, shown}, {plane})
          .front();
    };
    all.push_back(of(come, job.part));
    all.push_back(of(seen, gelled));
  }
  return all;
}

}  // namespace slicecorr::tomo
