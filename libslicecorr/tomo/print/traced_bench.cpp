// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/traced_bench.hpp"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "tomo/operators/blurred_projector.hpp"
#include "tomo/operators/traced_light.hpp"

namespace slicecorr::tomo::detail {

void check_traced_insert(const Bench& bench, const Volume& insert) {
  const TomoGrid& g = bench.grid;
  for (int y = 0; y < g.voxels; ++y) {
    for (int x = g.inside(y).first; x < g.inside(y).end; ++x) {
      if (!bench.traced->resin[static_cast<std::size_t>(y) * static_cast<std::size_t>(g.voxels) +
                               static_cast<std::size_t>(x)]) {
        continue;
      }
      for (int z = 0; z < g.slices; ++z) {
        if (insert.coverage[g.voxel(x, y, z)] == 0) continue;
        throw InputError(fmt::format(
            "the insert has a voxel at x = {:.3f}, y = {:.3f} mm, in the resin of a vial through which "
            "light is traced: inserts of any form are not counted there; expected rods in the printer's "
            "file (glass_rods, metal_rods)",
            g.voxel_at_mm(x), g.voxel_at_mm(y)));
      }
    }
  }
}

Printer closed_like(const Printer& printer, double n_resin) {
  Printer like = printer;
  Vial& vial = *like.vial;
  vial.rods.clear();
  if (vial.shape == VialShape::round) return like;
  vial.shape = VialShape::round;
  vial.n_outside = vial.n_wall = n_resin;
  return like;
}

void check_traced(const Printer& printer, const Resin& resin) {
  const auto wrong = [&](const std::string& what) {
    throw InputError("printer '" + printer.name + "': " + what);
  };
  const std::string what =
      fmt::format("light through {} is traced",
                  printer.vial->shape != VialShape::round
                      ? fmt::format("a vial of shape \"{}\"", name_of(printer.vial->shape))
                      : std::string("a vial with rods"));
  if (light_goes_sideways(printer, resin)) {
    wrong(what +
          ", where it goes straight on: expected a printer without spread, and a resin "
          "without scatter");
  }
  if (printer.optics->tilt_deg != 0 || !printer.rotation->wobble.empty()) {
    wrong(what + " about an axis that stands still: expected tilt_deg 0 and no wobble");
  }
  if (resin.inhibition_resupply_mj_cm3_s > 0) {
    wrong(what +
          ", and inhibitor that comes back is not followed then: expected a resin "
          "without inhibition_resupply_mj_cm3_s");
  }
}

std::shared_ptr<const TracedLight> traced_light(const Printer& printer, double n, const Bench& b) {
  const double column = b.window.column_of(0);
  TracedLight light{VialTrace(*printer.vial, n, b.rays.alpha_per_mm),
                    pixel_x_mm(printer, column),
                    printer.pixel_x_um * 1e-3 * b.window.wide,
                    b.window.wide == 1 ? std::sqrt(printer.fill_factor) : 1,
                    chief_ray(printer, 0, 0).transmittance,
                    resin_of(*printer.vial, b.grid),
                    {},
                    {TracedBundle{}}};
  if (b.grid.coupled()) {
    const bool spread = printer.optics->half_angle_deg > 0;
    TracedRows rows{printer,
                    b.window,
                    aperture_points(spread ? printer.optics->rays_per_pixel : 1),
                    aperture_slope(printer),
                    printer.pixel_y_um * 1e-3 * b.window.high,
                    b.window.high == 1 ? std::sqrt(printer.fill_factor) : 1};
    light.bundles = bundles_of(b.grid, rows);
    light.rows = std::make_shared<const TracedRows>(std::move(rows));
  }
  return std::make_shared<const TracedLight>(std::move(light));
}

std::optional<double> rise_on_axis(const TracedLight& light) {
  const TracedBundle& bundle = light.bundles[light.bundles.size() / 2];
  const TracedRows& rows = *light.rows;
  const double axis = image_place(rows.printer, {0, 0}).column - rows.window.first_column;
  TracedRay ray;
  light.vial.trace(0, light.line((axis - 0.5 * (rows.window.wide - 1)) / rows.window.wide, bundle),
                   ray);
  for (const TracedPiece& piece : ray.pieces) {
    const double way = -(piece.from.x_mm * piece.along.x_mm + piece.from.y_mm * piece.along.y_mm);
    if (way >= 0 && way <= piece.length_mm) return piece.rise_mm + way * ray.rise_per_mm;
  }
  return {};
}

}  // namespace slicecorr::tomo::detail
