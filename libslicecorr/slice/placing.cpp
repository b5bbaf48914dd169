// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/placing.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// In layers: what rounding may add to a part's height without adding a slice.
constexpr double kLayerTolerance = 1e-6;
/// In pixels: how far a part may reach over the display by rounding, so that one that fills it
/// fits.
constexpr double kPixelTolerance = 1e-3;

}  // namespace

PartBox box_of(const TriangleMesh& mesh, const ExecutionContext& context) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  Point3 low{infinity, infinity, infinity}, high{-infinity, -infinity, -infinity};
  bool finite = true;
  std::mutex joining;
  in_chunks(mesh.triangles.size(), context, [&](std::size_t, std::size_t begin, std::size_t end) {
    Point3 its_low{infinity, infinity, infinity}, its_high{-infinity, -infinity, -infinity};
    bool its_finite = true;
    for (std::size_t i = begin; i < end; ++i) {
      const bool adds = mesh.adds(i);
      for (const std::uint32_t v : mesh.triangles[i]) {
        for (std::size_t k = 0; k < 3; ++k) {
          its_finite &= std::isfinite(mesh.vertices[v][k]);
          if (!adds) continue;
          its_low[k] = std::min(its_low[k], mesh.vertices[v][k]);
          its_high[k] = std::max(its_high[k], mesh.vertices[v][k]);
        }
      }
    }
    const std::lock_guard lock(joining);
    finite &= its_finite;
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], its_low[k]);
      high[k] = std::max(high[k], its_high[k]);
    }
  });
  if (!finite) throw InputError("a corner of the part is not at a finite place");
  if (low[0] > high[0]) throw InputError("the part is nothing but volumes that are taken away");
  return {low, high};
}

Placing placing_of(const Grid& plate, const SliceOptions& options) {
  const double display_x = plate.width_px * (plate.pixel_x_um * 1e-3);
  const double display_y = plate.height_px * (plate.pixel_y_um * 1e-3);
  const double cx = options.center_mm ? (*options.center_mm)[0] : display_x / 2;
  const double cy = options.center_mm ? (*options.center_mm)[1] : display_y / 2;
  if (!std::isfinite(cx) || !std::isfinite(cy)) {
    throw InputError(fmt::format("centre {:g}, {:g} mm; expected finite numbers", cx, cy));
  }
  return {display_x, display_y, cx, cy};
}

/// What a part that is too large can be made to fit by; empty where only its place is wrong.
std::string what_fits(const PartBox& box, double display_x, double display_y) {
  const auto share = [&](double x, double y) { return std::min(display_x / x, display_y / y); };
  const double as_it_is = share(box.size(0), box.size(1));
  const double turned = share(box.size(1), box.size(0));
  if (as_it_is >= 1) return "; in the middle it fits";
  if (turned >= 1) return "; turned by 90 degrees about z it fits";
  // Rounded down, so that what is told fits.
  const double share_of = std::max(as_it_is, turned);
  const double step = std::pow(10.0, std::floor(std::log10(share_of)) - 2);
  const double most = std::floor(share_of / step) * step;
  const double longest = std::max({box.size(0), box.size(1), box.size(2)});
  std::string text =
      fmt::format("; at {:.3g} times this size, a longest side of {:.1f} mm, it fits{}", most,
                  std::floor(most * longest * 10) / 10,
                  turned > as_it_is ? ", turned by 90 degrees about z" : "");
  if (most < 0.02) {
    // A micrometre is a thousandth; more is no unit that files have.
    text += most >= 2e-5 ? ". Is the file in micrometres?" : ". Are its units and the scale right?";
  }
  return text;
}

void check_fits(const PartBox& box, const Placing& at, const Grid& plate, const Printer& printer) {
  const double px = plate.pixel_x_um * 1e-3, py = plate.pixel_y_um * 1e-3;
  const auto [display_x, display_y, cx, cy] = at;
  const double half_x = 0.5 * box.size(0), half_y = 0.5 * box.size(1);
  const double excess_x = std::max(half_x - cx, cx + half_x - display_x);
  const double excess_y = std::max(half_y - cy, cy + half_y - display_y);
  if (excess_x > kPixelTolerance * px || excess_y > kPixelTolerance * py) {
    std::string text;
    if (excess_x > kPixelTolerance * px) text += fmt::format(" {:.3f} mm in x", excess_x);
    if (excess_y > kPixelTolerance * py) {
      text += fmt::format("{} {:.3f} mm in y", text.empty() ? "" : " and", excess_y);
    }
    throw InputError(fmt::format(
        "the part of {:.3f} x {:.3f} mm, centred at {:.3f}, {:.3f} mm, reaches{} beyond the "
        "display of '{}' ({:.3f} x {:.3f} mm){}",
        box.size(0), box.size(1), cx, cy, text, printer.name, display_x, display_y,
        what_fits(box, display_x, display_y)));
  }
}

double platform_z_mm(const PartBox& box, const SliceOptions& options) {
  return options.platform_z_mm.value_or(box.low[2]) - options.raised_um * 1e-3;
}

int layers_of(const PartBox& box, const Printer& printer, const SliceOptions& options) {
  const double layer_mm = options.layer_um * 1e-3;
  const double platform_mm = platform_z_mm(box, options);
  // From the platform up.
  const double height_mm = box.high[2] - platform_mm;
  const double layers = std::ceil(height_mm / layer_mm - 0.5 - kLayerTolerance);
  if (!(platform_mm <= box.low[2] + kLayerTolerance * layer_mm)) {
    throw InputError(
        fmt::format("platform at z = {:g} mm of the part; expected at most its least z, {:g} mm",
                    platform_mm, box.low[2]));
  }
  if (printer.travel_mm > 0 && height_mm > printer.travel_mm + kLayerTolerance * layer_mm) {
    throw InputError(fmt::format(
        "the part is {:.3f} mm high, {:.3f} mm more than the stage of '{}' travels ({:g} mm)",
        height_mm, height_mm - printer.travel_mm, printer.name, printer.travel_mm));
  }
  if (!(layers >= 1)) {
    throw InputError(
        fmt::format("the part is {:.6g} mm high, thinner than half a layer of {:g} um; are its "
                    "units and scale right (metres or inches read as millimetres)?",
                    height_mm, options.layer_um));
  }
  if (layers > 1e6) {
    throw InputError(fmt::format("the part needs {:.0f} slices; expected at most 1000000", layers));
  }
  return static_cast<int>(layers);
}

}  // namespace slicecorr::detail
