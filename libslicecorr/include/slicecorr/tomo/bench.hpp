// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/bench.hpp
/// A tomographic printer and its resin as the operators see them: which voxels, angles and pixels
/// there are, what the vial does to each pixel's light, and where pixels and slices lie in frames.
///
/// Frames are the projector's images as seen from it, before any mirror of the printer. Plain
/// values; functions are thread-safe.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/light_blur.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo {

namespace detail {
struct TracedLight;
}

/// What is to be computed on.
struct Sampling {
  double voxel_mm = 0;  ///< side of a voxel, at least the pixel's pitch
  int slices = 0;       ///< along z
  int angles = 0;       ///< frames of a turn
  /// Pixels that are finer than voxels show the same in groups, squares of half a voxel to a whole one.
  /// Light is found so; frames show what they like, pixel by pixel.
  bool grouped = false;
  /// z of the middle of all slices, upwards from the optical axis.
  double middle_z_mm = 0;

  /// z of the middle of a slice.
  double z_mm(int slice) const { return middle_z_mm + (slice - 0.5 * (slices - 1)) * voxel_mm; }
};

/// Where frames show the light of the grid, and with how much of it.
///
/// Where slices have light of their own, a column of frames shows a pixel of the grid and a row the
/// slice that it lights. The axis of rotation leans in the image (`Optics::tilt_deg`) and goes astray
/// from angle to angle (`Rotation::wobble`), which moves light sideways by parts of a column. Where
/// slices share light, the rays of pixels know of the leaning, and wobble moves the whole image by whole
/// pixels.
///
/// The projector shines unevenly (`Printer::flat_field`). Columns and rows of frames count from the
/// image's first, rows downwards.
class FramePlaces {
 public:
  FramePlaces() = default;
  /// Of the light of `grid` in frames. `window`: which pixels of frames show it, each for itself;
  /// where slices have light of their own its columns count, and all rows. Throws `InputError` as
  /// `LightMap` does.
  FramePlaces(const Printer& printer, const TomoGrid& grid, const PixelWindow& window,
              bool clockwise);

  /// A pixel and a row of the grid's light; -1: of none.
  struct Lit {
    int pixel = -1, row = -1;
    bool any() const { return row >= 0; }
  };
  /// Whose light a pixel of the frame at angle m shows.
  Lit lit_by(int m, int column, int row) const;
  /// Where slices share light: among the grid's pixels and rows, the place of one in the frame of
  /// angle m.
  struct Place {
    double pixel = 0, row = 0;
  };
  Place place_of(int m, double column, double row) const;
  /// Of level light: the slice whose light of the frame of angle m falls on `slice` while the stage
  /// stands at another of the angles, `at`, where the axis lies higher or lower: the nearest; -1: none
  /// has.
  int slice_shown(int m, int at, int slice) const;

  /// z of the middle of slice 0. Level light may lie so far from the optical axis's that edges of rows
  /// are edges of slices, where these are whole rows high: by half a row at most.
  double lowest_mm() const { return lowest_mm_; }
  /// Whether light of a pixel of the grid lies elsewhere than in its own column.
  bool moved() const { return !coupled_ && (sine_ != 0 || !right_px_.empty()); }
  bool uneven() const { return !share_.empty(); }
  /// Of level light: the pixel, counted as those of the grid, in which the light of this pixel of the
  /// grid, and of this slice, lies at angle m.
  double column_of(int m, double pixel, int slice) const;
  /// The pixel of the grid whose light lies in that one.
  double pixel_of(int m, double column, int slice) const;
  /// Where the image shows the axis at angle m, from where it does a steady one, pixels.
  double right_px(int m) const {
    return right_px_.empty() ? 0 : right_px_[static_cast<std::size_t>(m)];
  }
  double up_px(int m) const { return up_px_.empty() ? 0 : up_px_[static_cast<std::size_t>(m)]; }

  /// Share of the calibration's light that the pixels which show this light get, in the mean.
  double share(int m, int pixel, int row) const {
    if (share_.empty()) return 1;
    return share_[share_of_angle_[static_cast<std::size_t>(m)] +
                  static_cast<std::size_t>(pixel) * static_cast<std::size_t>(rows_) +
                  static_cast<std::size_t>(row)];
  }

 private:
  int slice_of(int m, int pixel, int row) const;
  double z_mm(int slice) const { return lowest_mm_ + slice_mm_ * slice; }
  void take_light(const Printer& printer, int angles);

  bool coupled_ = false;
  PixelWindow window_;
  double sine_ = 0, cosine_ = 1;          ///< of the tilt
  std::vector<double> right_px_, up_px_;  ///< per angle; empty: 0
  double axis_column_ = 0;                ///< of a steady axis, counted as pixels of the grid
  double middle_row_ = 0;                 ///< of the image; the optical axis lies so far above it:
  double axis_up_px_ = 0;
  double column_mm_ = 1, row_um_ = 1;  ///< pixels' pitch
  double lowest_mm_ = 0, slice_mm_ = 1;
  int rows_ = 0;                             ///< of light
  std::vector<float> share_;                 ///< [distinct shift][pixel][row]
  std::vector<std::size_t> share_of_angle_;  ///< where an angle's begins
};

struct Bench {
  TomoGrid grid;   ///< all of the resin: voxels from axis to wall
  RayTables rays;  ///< of the grid's pixels; where slices share light the nearest to them
  /// All rays of a frame where slices share light; null where they do not.
  std::shared_ptr<const LabRays> lab;
  /// Of the light of `lab`: one sharp term, or how it goes sideways. Empty where there is no `lab`.
  std::vector<BlurredLight> blur;
  Exposure exposure;             ///< of one turn
  double resupply_mj_cm3_s = 0;  ///< of inhibitor
  std::vector<double> mw_cm2;    ///< of each grey level
  double radius_mm = 0;          ///< of the resin
  double reach_mm = 0;           ///< up to which light comes from all directions
  double alpha_r = 0;            ///< absorption times the resin's radius
  int frame_width = 0, frame_height = 0;
  PixelWindow window;  ///< of frames, that shows the grid's light
  FramePlaces places;  ///< of pixels that are not grouped
  bool clockwise = true;
  /// Of a vial that is not round or has rods (`Vial::traced`): how its light is traced. Null of others;
  /// `rays` are nearly its lines then, to begin with.
  std::shared_ptr<const detail::TracedLight> traced;
  /// Frames are shown in order while the vial turns; this one is shown at angle m.
  int frame_of_angle(int m) const { return clockwise || m == 0 ? m : grid.angles - m; }
};

/// Voxels along x and along y of the grid that the resin holds: an odd number, so that one is on the
/// axis. Throws `InputError` when the printer has no vial, and for voxels too large or too small.
int voxels_across(const Printer& printer, double voxel_mm);

/// Whether light rises, falls or spreads on its way: a pinhole's, that of an aperture, and light that a
/// projector blurs or a resin scatters.
bool slices_share_light(const Printer& printer, const Resin& resin);

/// Telecentric light without an aperture that goes straight on stays in its slice. Other light is that
/// of `lab_rays`. Throws `InputError` naming what is missing or does not fit: a printer whose rows are
/// higher than a voxel, slices above or below the image, fewer than 3 angles, more frames than the
/// projector shows in a turn, a spread that is a picture, a fill factor of level light whose axis leans
/// or wobbles.
Bench make_bench(const Printer& printer, const Resin& resin, const Sampling& sampling);

/// What to say of a turbid resin whose light is scattered so often that doses are less sure; empty: nothing.
std::string doubt_of_turbidity(const Printer& printer, const Resin& resin);

/// z on the axis of a row of the grid's light, mm.
double z_of_row(const Bench& bench, int row);
/// The row whose light comes nearest to the middle of a slice on the axis.
int row_of_slice(const Bench& bench, int slice);

/// Light of groups of pixels (`Sampling::grouped`), on the pixels of the same printer.
Light light_of_groups(const Bench& groups, Light light, const Bench& pixels);

/// The operators of a bench, around an insert (of its grid) or none.
std::shared_ptr<const Projector> make_projector(const Bench& bench, const Volume* insert = nullptr);

/// Memory of the weights that the operators of traced light keep, bytes, nearly; 0 of other light.
double bytes_of_weights(const Bench& bench);

/// How closely operators that look for light follow the turn of the vial.
enum class Search { rough, close };
/// The same to look for light with: quicker, and close to them. Bounds and doses are for others to say.
std::shared_ptr<const Projector> make_search_projector(const Bench& bench, Search search,
                                                       const Volume* insert = nullptr);
/// Whether the rough ones are quicker.
bool has_rough_search(const Bench& bench);

/// Angles of a turn at which voxels at this distance from the axis are resolved: pi r / p for half a
/// turn (Kelly's thesis, 5.5.2).
int resolving_angles(double radius_mm, double voxel_mm);

/// As many angles as resolve the voxels at `part_radius_mm`, as far as the projector can show them.
int usual_angles(const Printer& printer, double part_radius_mm, double voxel_mm);

}  // namespace slicecorr::tomo
