// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file vial.hpp
/// Light of a tomographic printer on its way into the vial, in closed form.
///
/// Frame: lengths in mm; z is the axis of rotation, upwards, 0 on the projector's optical axis. Light
/// comes along +Y from a projector at Y < 0; X is to the right of who looks along with it, so that
/// (X, Y, z) is right-handed. In a vial that has been turned by th, t = x cos th + y sin th and
/// u = -x sin th + y cos th are X and Y of a point (x, y) of the part; th grows when the vial turns
/// clockwise, seen from above.
///
/// A ray is known by q, how far its projection along z passes by the axis, with the sign of X, and by
/// kz, the z part of its unit direction, both outside the vial. Two things stay the same through all
/// walls: n kz, and n' q with n' = sqrt(n² - (n_outside kz)²). Reflected and scattered light is not
/// modelled.
///
/// Plain functions, thread-safe. Where a ray misses the resin (`misses`), functions of rays give NaN.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// A straight line of light outside the vial: through (x_mm, 0, z_mm) with so many mm of X and z for
/// one of Y.
struct LightLine {
  double x_mm = 0, z_mm = 0;
  double slope_x = 0, slope_z = 0;
  double transmittance = 1;  ///< share of its light that is left: what a bath's window lets through
  double angle_rad() const;  ///< psi: of its projection along z, from +Y towards +X
  double q_mm() const;       ///< x cos psi
  double kz() const;
};

/// X and z of the middle of a pixel on the plane Y = 0, without the vial. Columns to the right and
/// rows downwards from 0, in the image as seen from the projector. The axes lie where `Optics` says;
/// without it in the image's middle.
double pixel_x_mm(const Printer& printer, double column);
double pixel_z_mm(const Printer& printer, double row);

/// X and z of that place in the frame of the axis, which leans by `Optics::tilt_deg` in the image.
struct PlanePlace {
  double x_mm = 0, z_mm = 0;
};
PlanePlace pixel_mm(const Printer& printer, double column, double row);
/// The same backwards: where the image shows a place of the plane Y = 0, in columns and rows.
struct ImagePlace {
  double column = 0, row = 0;
};
ImagePlace image_place(const Printer& printer, const PlanePlace& place);

/// Where the axis is after the stage has turned by this angle since the first frame: linear between
/// the angles of `Rotation::wobble`, turn after turn.
AxisWobble wobble_at(const Rotation& rotation, double angle_deg);
/// Most that it is moved to a side, in pixels.
double most_wobble_px(const Rotation& rotation);

/// The middle one of a pixel's rays next to the vial: parallel to the optical axis (telecentric), or
/// from the point `distance_mm` in front of the axis (pinhole), bent by both faces of the window where
/// there is a bath. Throws `InputError` when the printer has no optics.
LightLine chief_ray(const Printer& printer, double column, double row);

/// Slope against the middle ray, next to the vial, of the edge of the cone that a pixel's light fills.
double aperture_slope(const Printer& printer);

/// What is wrong with a bath: a key of its table and words; nothing where it goes with vial and optics.
struct WrongBath {
  const char* key = "";
  std::string words;
};
std::optional<WrongBath> wrong_bath(const Printer& printer);

/// n': the refractive index that counts across the axis, sqrt(n² - (n_outside kz)²).
double index_across(double n, double n_outside, double kz);

/// What light passes on its way into the resin, from outside: the radius of a face, and the index behind it.
struct VialFace {
  double radius_mm = 0, n_behind = 1;
};
/// Two of them, or four of a double-walled vial; the resin is behind the last.
std::vector<VialFace> faces_of(const Vial& vial, double n_resin);

/// What is wrong with a vial: a key of its table and words; nothing where its radii go with each other.
struct WrongVial {
  const char* key = "";
  std::string words;
};
std::optional<WrongVial> wrong_vial(const Vial& vial);

/// Greatest distance from the axis, mm, at which light that passes by the axis at up to this, outside, is in
/// the resin.
double most_in_resin_mm(const Vial& vial, double n_resin, double q_mm);

/// Whether a ray does not come into the resin: it passes by the vial, or is reflected as a whole.
bool misses(const Vial& vial, double n_resin, double q_mm, double kz);

/// q in the resin, mm: n_outside' q / n_resin'. The wall has no say in it.
double q_in_resin_mm(const Vial& vial, double n_resin, double q_mm, double kz);

/// delta, by how much the ray's projection is turned towards the axis, rad, with the sign of q.
double turned_rad(const Vial& vial, double n_resin, double q_mm, double kz);

/// Length of the way through the resin, mm, along which light dims.
double chord_mm(const Vial& vial, double n_resin, double q_mm, double kz);

/// Power that comes through all faces, 0..1 (Fresnel), of light without polarisation.
double transmittance(const Vial& vial, double n_resin, double q_mm, double kz);

/// A ray in the resin: that of a parallel beam in the plane, which rises.
struct ResinRay {
  double turn_rad =
      0;            ///< th' - th = delta - psi: the turn of the vial at which it is parallel to u
  double t_mm = 0;  ///< q in the resin
  double kz = 0;    ///< z part of its unit direction
  double entry_z_mm = 0;     ///< where it comes into the resin, at u = -sqrt(inner_mm² - t_mm²)
  double chord_mm = 0;       ///< from there to where it leaves
  double transmittance = 0;  ///< of all faces of the vial, and of what the line says
  double climb_mm() const { return chord_mm * kz; }  ///< how much it rises on its way
};
/// Nothing where the line misses the resin.
std::optional<ResinRay> ray_in_resin(const Vial& vial, double n_resin, const LightLine& line);

/// Radius up to which all directions reach the resin, mm, at most `inner_mm`: beyond it angles are
/// missing. In the plane of the optical axis; the image's outermost columns bound it, too. Throws
/// `InputError` when the printer has no vial or optics.
double reach_mm(const Printer& printer, double n_resin);

/// z on the axis of a pixel near the optical axis, over what it is without vial and bath: 1 where light is
/// telecentric. Throws `InputError` when the printer has no vial or optics.
double height_on_axis(const Printer& printer, double n_resin);

/// As files say them: "telecentric", "pinhole"; "clockwise", "counterclockwise".
const char* name_of(OpticsKind kind);
const char* name_of(TurnDirection direction);

/// Images that the projector can show in one turn; 0 where the file does not say how many a second.
int most_frames_per_turn(const Rotation& rotation);

/// Throws `InputError` naming the table that is missing for tomographic printing.
void require_tomographic(const Printer& printer);

/// Refractive index of a resin. Throws `InputError` when its file does not say it.
double index_of(const Resin& resin);

/// Absorption of the curing light, base e, 1/mm, for exponents in mm; and the part of it that cures.
double absorption_per_mm(const Resin& resin);
double curing_absorption_per_mm(const Resin& resin);

/// Dose at which the resin gels in tomographic printing, mJ/cm³ by what cures: what its inhibitors
/// take and the gel dose after it. Where the file gives only a dose to aim at, that over its factor.
/// Throws `InputError` for m other than 1, where doses in mJ/cm³ say nothing.
double dose_to_gel_mj_cm3(const Resin& resin);

/// Standard deviation along each axis, mm, of dose that was in one place so many seconds ago.
double dose_spread_mm(const Resin& resin, double seconds);

}  // namespace slicecorr
