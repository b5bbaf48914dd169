// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/vial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "slicecorr/error.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kRadians = std::numbers::pi / 180;

const Optics& optics_of(const Printer& printer) {
  if (!printer.optics) {
    throw InputError(printer.name, "optics",
                     "the printer has no [optics]; expected kind = \"telecentric\" or \"pinhole\"");
  }
  return *printer.optics;
}

const Vial& vial_of(const Printer& printer) {
  if (!printer.vial) {
    throw InputError(printer.name, "vial",
                     "the printer has no [vial]; expected outer_mm and inner_mm, its radii");
  }
  return *printer.vial;
}

/// The faces that a ray passes, with the indices across the axis. Few, and asked for often.
struct Passed {
  struct Face {
    double radius_mm = 0;
    double n = 1, n_across = 1;  ///< behind it
  };
  std::array<Face, 4> faces{};
  std::size_t count = 0;
  double outside = 1;  ///< index across the axis

  Passed(const Vial& v, double n_resin, double kz)
      : outside(index_across(v.n_outside, v.n_outside, kz)) {
    if (v.traced()) {
      throw InputError(
          "vial", "",
          "is not round, or has rods, which tomo solve, verify, section, report, video "
          "and limits count, and nothing else; expected a round one without rods");
    }
    const auto add = [&](double radius_mm, double n) {
      faces[count++] = {radius_mm, n, index_across(n, v.n_outside, kz)};
    };
    if (v.jacket_outer_mm > 0) {
      add(v.jacket_outer_mm, v.n_jacket);
      add(v.jacket_inner_mm, v.n_between);
    }
    add(v.outer_mm, v.n_wall);
    add(v.inner_mm, n_resin);
  }
  const Face& last() const { return faces[count - 1]; }
};

bool misses(const Passed& p, double q_mm) {
  // Written so that what is no number misses.
  if (!(std::abs(q_mm) < p.faces[0].radius_mm)) return true;
  const double nq = p.outside * std::abs(q_mm);
  for (std::size_t k = 0; k < p.count; ++k) {
    const Passed::Face& face = p.faces[k];
    if (!(nq < face.n_across * face.radius_mm)) return true;
    if (k > 0 && !(nq < p.faces[k - 1].n_across * face.radius_mm)) return true;
  }
  return false;
}

/// Cosine of the angle between a ray and the normal of a cylinder of this radius, in a medium.
double cosine_at(double q_mm, double radius_mm, double index_across, double index) {
  const double sine = q_mm / radius_mm;
  return std::sqrt(1 - sine * sine) * index_across / index;
}

/// Transmitted power of a face, by polarisation.
struct FaceTransmittance {
  double s, p;
};
FaceTransmittance through(double n, double cosine, double n_after, double cosine_after) {
  const double s = (n * cosine - n_after * cosine_after) / (n * cosine + n_after * cosine_after);
  const double p = (n_after * cosine - n * cosine_after) / (n_after * cosine + n * cosine_after);
  return {1 - s * s, 1 - p * p};
}

/// What the window of a bath makes of light near the optical axis: pixels as large, seen from so far.
struct SeenThrough {
  double larger = 1, distance_mm = 0;
};
SeenThrough through_window(const Printer& printer) {
  const Optics& optics = *printer.optics;
  if (!printer.bath) return {1, optics.distance_mm};
  const Bath& b = *printer.bath;
  const double larger =
      (optics.distance_mm - b.window_mm + b.wall_mm / b.n_wall + (b.window_mm - b.wall_mm) / b.n) /
      optics.distance_mm;
  return {larger, b.n * larger * optics.distance_mm};
}

/// The ray of a pinhole through this place of the plane of the axis, as it goes on in the bath.
LightLine ray_of_pinhole(const Printer& printer, const PlanePlace& place) {
  const double distance = printer.optics->distance_mm;
  LightLine line{place.x_mm, place.z_mm, place.x_mm / distance, place.z_mm / distance};
  if (!printer.bath) return line;
  const Bath& b = *printer.bath;
  const double r = std::hypot(place.x_mm, place.z_mm), sine = r / std::hypot(r, distance);
  const auto tangent = [&](double n) { return sine / std::sqrt(n * n - sine * sine); };
  // Over r, as sines are: 1 / hypot(r, L) on the axis.
  const double by_r = r > 0 ? 1 / r : 0;
  const SeenThrough middle = through_window(printer);
  const double moved =
      r > 0 ? by_r * ((distance - b.window_mm) * tangent(1) + b.wall_mm * tangent(b.n_wall) +
                      (b.window_mm - b.wall_mm) * tangent(b.n))
            : middle.larger;
  const double slope = r > 0 ? by_r * tangent(b.n) : 1 / (distance * b.n);
  line.slope_x = place.x_mm * slope;
  line.slope_z = place.z_mm * slope;
  line.x_mm *= moved;
  line.z_mm *= moved;
  return line;
}

/// What both faces of a bath's window let through, of light that comes in at this sine in air.
double window_transmittance(const Bath& b, double sine) {
  const auto cosine = [&](double n) { return std::sqrt(1 - sine * sine / (n * n)); };
  const FaceTransmittance outer = through(1, cosine(1), b.n_wall, cosine(b.n_wall)),
                          inner = through(b.n_wall, cosine(b.n_wall), b.n, cosine(b.n));
  return (outer.s * inner.s + outer.p * inner.p) / 2;
}

}  // namespace

double LightLine::angle_rad() const { return std::atan(slope_x); }
double LightLine::q_mm() const { return x_mm / std::hypot(1.0, slope_x); }
double LightLine::kz() const { return slope_z / std::hypot(1.0, slope_x, slope_z); }

double pixel_x_mm(const Printer& printer, double column) {
  const double axis = printer.optics ? printer.optics->axis_right_px : 0;
  return (column - (printer.width_px - 1) / 2.0 - axis) * printer.pixel_x_um * 1e-3;
}

double pixel_z_mm(const Printer& printer, double row) {
  const double axis = printer.optics ? printer.optics->axis_up_px : 0;
  return ((printer.height_px - 1) / 2.0 - row - axis) * printer.pixel_y_um * 1e-3;
}

PlanePlace pixel_mm(const Printer& printer, double column, double row) {
  const double x = pixel_x_mm(printer, column), z = pixel_z_mm(printer, row);
  const double tilt_deg = printer.optics ? printer.optics->tilt_deg : 0;
  if (tilt_deg == 0) return {x, z};
  const double c = std::cos(tilt_deg * kRadians), s = std::sin(tilt_deg * kRadians);
  return {x * c - z * s, x * s + z * c};
}

ImagePlace image_place(const Printer& printer, const PlanePlace& place) {
  const Optics optics = printer.optics.value_or(Optics{});
  const double c = std::cos(optics.tilt_deg * kRadians), s = std::sin(optics.tilt_deg * kRadians);
  const double x = place.x_mm * c + place.z_mm * s, z = place.z_mm * c - place.x_mm * s;
  return {x / (printer.pixel_x_um * 1e-3) + (printer.width_px - 1) / 2.0 + optics.axis_right_px,
          (printer.height_px - 1) / 2.0 - optics.axis_up_px - z / (printer.pixel_y_um * 1e-3)};
}

AxisWobble wobble_at(const Rotation& rotation, double angle_deg) {
  const std::vector<AxisWobble>& all = rotation.wobble;
  angle_deg -= 360 * std::floor(angle_deg / 360);
  if (all.empty()) return {angle_deg, 0, 0};
  const auto after =
      std::upper_bound(all.begin(), all.end(), angle_deg,
                       [](double angle, const AxisWobble& w) { return angle < w.angle_deg; });
  const AxisWobble& b = after == all.end() ? all.front() : *after;
  const AxisWobble& a = after == all.begin() ? all.back() : *(after - 1);
  double span = b.angle_deg - a.angle_deg, way = angle_deg - a.angle_deg;
  if (span <= 0) span += 360;
  if (way < 0) way += 360;
  const double share = way / span;
  return {angle_deg, a.right_px + share * (b.right_px - a.right_px),
          a.up_px + share * (b.up_px - a.up_px)};
}

double most_wobble_px(const Rotation& rotation) {
  double most = 0;
  for (const AxisWobble& w : rotation.wobble) most = std::max(most, std::abs(w.right_px));
  return most;
}

LightLine chief_ray(const Printer& printer, double column, double row) {
  const Optics& optics = optics_of(printer);
  const PlanePlace place = pixel_mm(printer, column, row);
  const bool spreads = optics.kind == OpticsKind::pinhole;
  LightLine line = spreads ? ray_of_pinhole(printer, place) : LightLine{place.x_mm, place.z_mm};
  if (printer.bath) {
    const double r = spreads ? std::hypot(place.x_mm, place.z_mm) : 0;
    line.transmittance =
        window_transmittance(*printer.bath, spreads ? r / std::hypot(r, optics.distance_mm) : 0);
  }
  return line;
}

double aperture_slope(const Printer& printer) {
  const double angle = optics_of(printer).half_angle_deg * kRadians;
  if (!printer.bath) return std::tan(angle);
  return std::tan(std::asin(std::sin(angle) / printer.bath->n));
}

std::optional<WrongBath> wrong_bath(const Printer& printer) {
  if (!printer.bath) return std::nullopt;
  const Bath& b = *printer.bath;
  if (b.wall_mm >= b.window_mm) {
    return WrongBath{"wall_mm", fmt::format("is {:g}; expected less than window_mm, {:g}: the "
                                            "window lies before the axis",
                                            b.wall_mm, b.window_mm)};
  }
  if (printer.vial && b.window_mm - b.wall_mm < printer.vial->outside_mm()) {
    return WrongBath{
        "window_mm",
        fmt::format("is {:g}, with {:g} mm of window in it; expected the vial, of {:g} mm, behind "
                    "the window",
                    b.window_mm, b.wall_mm, printer.vial->outside_mm())};
  }
  if (printer.vial && std::abs(printer.vial->n_outside - b.n) > 1e-9) {
    return WrongBath{"n",
                     fmt::format("is {:g}, and n_outside in [vial] {:g}; expected the same, or "
                                 "one of them: the bath is around the vial",
                                 b.n, printer.vial->n_outside)};
  }
  if (printer.optics && printer.optics->kind == OpticsKind::pinhole &&
      b.window_mm >= printer.optics->distance_mm) {
    return WrongBath{"window_mm",
                     fmt::format("is {:g}; expected less than distance_mm, {:g}: the point that "
                                 "light comes from is in air",
                                 b.window_mm, printer.optics->distance_mm)};
  }
  return std::nullopt;
}

double index_across(double n, double n_outside, double kz) {
  return std::sqrt(n * n - n_outside * kz * (n_outside * kz));
}

std::vector<VialFace> faces_of(const Vial& vial, double n_resin) {
  const Passed passed(vial, n_resin, 0);
  std::vector<VialFace> faces;
  for (std::size_t k = 0; k < passed.count; ++k) {
    faces.push_back({passed.faces[k].radius_mm, passed.faces[k].n});
  }
  return faces;
}

std::optional<WrongVial> wrong_vial(const Vial& v) {
  if (v.inner_mm >= v.outer_mm) {
    return WrongVial{"inner_mm",
                     fmt::format("is {:g}; expected less than outer_mm, {:g}: both are radii",
                                 v.inner_mm, v.outer_mm)};
  }
  if (v.jacket_outer_mm == 0 && v.jacket_inner_mm == 0) return std::nullopt;
  if (v.jacket_inner_mm < v.outer_mm) {
    return WrongVial{
        "jacket_inner_mm",
        fmt::format(
            "is {:g}; expected outer_mm, {:g}, or more: the second wall is around the first",
            v.jacket_inner_mm, v.outer_mm)};
  }
  if (v.jacket_outer_mm <= v.jacket_inner_mm) {
    return WrongVial{
        "jacket_outer_mm",
        fmt::format("is {:g}; expected more than jacket_inner_mm, {:g}: both are radii",
                    v.jacket_outer_mm, v.jacket_inner_mm)};
  }
  return std::nullopt;
}

double most_in_resin_mm(const Vial& vial, double n_resin, double q_mm) {
  double most = vial.n_outside * std::min(vial.outside_mm(), q_mm), before = vial.n_outside;
  for (const VialFace& face : faces_of(vial, n_resin)) {
    most = std::min({most, before * face.radius_mm, face.n_behind * face.radius_mm});
    before = face.n_behind;
  }
  return most / n_resin;
}

bool misses(const Vial& vial, double n_resin, double q_mm, double kz) {
  return misses(Passed(vial, n_resin, kz), q_mm);
}

double q_in_resin_mm(const Vial& vial, double n_resin, double q_mm, double kz) {
  const Passed passed(vial, n_resin, kz);
  return misses(passed, q_mm) ? kNone : passed.outside * q_mm / passed.last().n_across;
}

double turned_rad(const Vial& vial, double n_resin, double q_mm, double kz) {
  const Passed passed(vial, n_resin, kz);
  if (misses(passed, q_mm)) return kNone;
  const double nq = passed.outside * q_mm;
  double turned = 0;
  for (std::size_t k = 0; k < passed.count; ++k) {
    const Passed::Face& face = passed.faces[k];
    const double before =
        k == 0 ? q_mm / face.radius_mm : nq / (passed.faces[k - 1].n_across * face.radius_mm);
    turned += std::asin(before) - std::asin(nq / (face.n_across * face.radius_mm));
  }
  return turned;
}

double chord_mm(const Vial& vial, double n_resin, double q_mm, double kz) {
  const double q3 = q_in_resin_mm(vial, n_resin, q_mm, kz);
  const double kz3 = vial.n_outside * kz / n_resin;
  return 2 * std::sqrt((vial.inner_mm - q3) * (vial.inner_mm + q3)) / std::sqrt(1 - kz3 * kz3);
}

double transmittance(const Vial& vial, double n_resin, double q_mm, double kz) {
  const Passed passed(vial, n_resin, kz);
  if (misses(passed, q_mm)) return kNone;
  FaceTransmittance all{1, 1};
  double n = vial.n_outside, n_across = passed.outside;
  for (std::size_t k = 0; k < passed.count; ++k) {
    const Passed::Face& face = passed.faces[k];
    const double q_before = passed.outside * q_mm / n_across,
                 q_behind = passed.outside * q_mm / face.n_across;
    const FaceTransmittance one =
        through(n, cosine_at(q_before, face.radius_mm, n_across, n), face.n,
                cosine_at(q_behind, face.radius_mm, face.n_across, face.n));
    all = {all.s * one.s, all.p * one.p};
    n = face.n;
    n_across = face.n_across;
  }
  return (all.s + all.p) / 2;
}

std::optional<ResinRay> ray_in_resin(const Vial& vial, double n_resin, const LightLine& line) {
  const double q = line.q_mm(), kz = line.kz(), psi = line.angle_rad();
  const Passed passed(vial, n_resin, kz);
  if (misses(passed, q)) return std::nullopt;
  ResinRay ray;
  ray.turn_rad = turned_rad(vial, n_resin, q, kz) - psi;
  ray.t_mm = passed.outside * q / passed.last().n_across;
  ray.kz = vial.n_outside * kz / n_resin;
  // From the plane Y = 0 back to the vial, then through the walls and what is between them.
  const double outside_mm = vial.outside_mm();
  ray.entry_z_mm =
      line.z_mm - (std::sqrt((outside_mm - q) * (outside_mm + q)) + line.x_mm * std::sin(psi)) *
                      line.slope_z * std::cos(psi);
  for (std::size_t k = 0; k + 1 < passed.count; ++k) {
    const Passed::Face& face = passed.faces[k];
    const double next_mm = passed.faces[k + 1].radius_mm;
    const double q2 = passed.outside * q / face.n_across, kz2 = vial.n_outside * kz / face.n;
    const double way_mm = std::sqrt((face.radius_mm - q2) * (face.radius_mm + q2)) -
                          std::sqrt((next_mm - q2) * (next_mm + q2));
    ray.entry_z_mm += way_mm * kz2 / std::sqrt(1 - kz2 * kz2);
  }
  ray.chord_mm = chord_mm(vial, n_resin, q, kz);
  ray.transmittance = transmittance(vial, n_resin, q, kz) * line.transmittance;
  return ray;
}

double reach_mm(const Printer& printer, double n_resin) {
  const Vial& vial = vial_of(printer);
  const Optics& optics = optics_of(printer);
  // The side of the image that is nearer to the axis counts.
  const double last = printer.width_px - 1;
  const double wobble_mm =
      printer.rotation ? most_wobble_px(*printer.rotation) * printer.pixel_x_um * 1e-3 : 0;
  const double side_mm =
      std::max(0.0, std::min(-pixel_x_mm(printer, 0), pixel_x_mm(printer, last)) - wobble_mm);
  const double q_mm =
      optics.kind == OpticsKind::pinhole ? ray_of_pinhole(printer, {side_mm, 0}).q_mm() : side_mm;
  return most_in_resin_mm(vial, n_resin, q_mm);
}

double height_on_axis(const Printer& printer, double n_resin) {
  const Vial& vial = vial_of(printer);
  const Optics& optics = optics_of(printer);
  if (optics.kind == OpticsKind::telecentric) return 1;
  const SeenThrough seen = through_window(printer);
  // Ways in the walls, and what is between them, as they look from outside.
  double way_mm = seen.distance_mm - vial.outside_mm();
  const std::vector<VialFace> faces = faces_of(vial, n_resin);
  for (std::size_t k = 0; k < faces.size(); ++k) {
    const double next_mm = k + 1 < faces.size() ? faces[k + 1].radius_mm : 0;
    way_mm += (faces[k].radius_mm - next_mm) * vial.n_outside / faces[k].n_behind;
  }
  return seen.larger * way_mm / seen.distance_mm;
}

const char* name_of(OpticsKind kind) {
  return kind == OpticsKind::pinhole ? "pinhole" : "telecentric";
}

const char* name_of(TurnDirection direction) {
  return direction == TurnDirection::clockwise ? "clockwise" : "counterclockwise";
}

int most_frames_per_turn(const Rotation& rotation) {
  // A whole number stays one whatever the division rounds.
  const double frames = rotation.max_fps * rotation.turn_s() * (1 + 1e-12);
  return static_cast<int>(std::min(frames, 1e9));
}

void require_tomographic(const Printer& printer) {
  vial_of(printer);
  optics_of(printer);
  if (!printer.rotation) {
    throw InputError(printer.name, "rotation",
                     "the printer has no [rotation]; expected deg_s and direction");
  }
}

double index_of(const Resin& resin) {
  if (resin.n > 0) return resin.n;
  throw InputError(resin.name, "n",
                   "the resin file does not say its refractive index; expected n, from 1 to 3");
}

double absorption_per_mm(const Resin& resin) { return absorption_per_cm(resin) / 10; }
double curing_absorption_per_mm(const Resin& resin) { return curing_absorption_per_cm(resin) / 10; }

double dose_to_gel_mj_cm3(const Resin& resin) {
  refuse_law(resin, LawUse::tomography);
  refuse_shrinkage(resin, "tomographic printing");
  if (resin.m != 1) {
    throw InputError(
        resin.name, "m",
        fmt::format("is {:g}; expected a resin with m = 1: light from all sides adds up "
                    "in mJ/cm³ for that alone",
                    resin.m));
  }
  const double gel = resin.gel_dose_mj_cm3 > 0 ? resin.gel_dose_mj_cm3
                                               : resin.critical_dose_mj_cm3 / resin.dose_factor;
  return resin.inhibition_dose_mj_cm3 + gel;
}

double dose_spread_mm(const Resin& resin, double seconds) {
  return std::sqrt(2 * resin.dose_diffusion_m2_s * 1e6 * seconds);
}

}  // namespace slicecorr
