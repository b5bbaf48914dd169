/// @file tomo/bench.hpp
/// A tomographic printer and its resin as the operators see them: which voxels, angles and pixels
/// there are, what the vial does to each pixel's light, and where pixels and slices lie in frames.
///
/// Frames are the projector's images as seen from it, before any mirror of the printer. Plain
/// values; functions are thread-safe.
#pragma once

#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo {

/// What is to be computed on.
struct Sampling {
  double voxel_mm = 0;  ///< side of a voxel, at least the pixel's pitch
  int slices = 0;       ///< along z, middled on the optical axis
  int angles = 0;       ///< frames of a turn
};

/// Where frames show the pixels of the grid, and with how much light. The axis of rotation leans in
/// the image (`Optics::tilt_deg`) and goes astray from angle to angle (`Rotation::wobble`), and the
/// projector shines unevenly (`Printer::flat_field`). Columns count from `Bench::first_column`, rows
/// downwards from the image's first.
class FramePlaces {
 public:
  FramePlaces() = default;
  /// Of `sampling` in frames from `first_column` on, `columns` wide. Throws `InputError` as
  /// `LightMap` does.
  FramePlaces(const Printer& printer, const Sampling& sampling, int first_column, int columns,
              bool clockwise);

  /// Whether frames lie elsewhere than a straight and steady axis would have them.
  bool moved() const { return sine_ != 0 || !right_px_.empty(); }
  bool tilted() const { return sine_ != 0; }
  bool uneven() const { return !share_.empty(); }
  /// Column in which the light of this pixel of the grid, and of this slice, lies at angle m.
  double column_of(int m, double pixel, int slice) const;
  /// The pixel of the grid whose light lies in this column.
  double pixel_of(int m, double column, int slice) const;
  /// The slice that a pixel of frames lights; -1: none.
  int slice_of(int m, int column, int row) const;
  /// The slice whose light of the frame of angle m falls on `slice` while the stage stands at another
  /// of the angles, `at`, where the axis lies higher or lower: the nearest; -1: none has.
  int slice_shown(int m, int at, int slice) const;
  /// Share of the calibration's light that the rows of a slice get, in the mean.
  double share(int m, int column, int slice) const {
    if (share_.empty()) return 1;
    return share_[share_of_angle_[static_cast<std::size_t>(m)] +
                  static_cast<std::size_t>(column) * static_cast<std::size_t>(slices_) +
                  static_cast<std::size_t>(slice)];
  }

 private:
  double right_px(int m) const {
    return right_px_.empty() ? 0 : right_px_[static_cast<std::size_t>(m)];
  }
  double z_mm(int slice) const { return lowest_mm_ + voxel_mm_ * slice; }
  void take_light(const Printer& printer, int first_column, int columns, int angles);

  double sine_ = 0, cosine_ = 1;  ///< of the tilt
  std::vector<double> right_px_;  ///< per angle; empty: 0
  std::vector<int> up_rows_;      ///< per angle; empty: 0
  double axis_column_ = 0;        ///< of a steady axis
  double middle_row_ = 0;         ///< of the image; the optical axis lies so far above it:
  double axis_up_px_ = 0;
  double column_mm_ = 1, row_um_ = 1;  ///< pixels' pitch
  double lowest_mm_ = 0, voxel_mm_ = 1;
  int slices_ = 0;
  std::vector<float> share_;                 ///< [distinct shift of rows][column][slice]
  std::vector<std::size_t> share_of_angle_;  ///< where an angle's begins
};

struct Bench {
  TomoGrid grid;                 ///< all of the resin: voxels from axis to wall
  RayTables rays;                ///< of the grid's pixels
  Exposure exposure;             ///< of one turn
  double resupply_mj_cm3_s = 0;  ///< of inhibitor
  std::vector<double> mw_cm2;    ///< of each grey level
  double radius_mm = 0;          ///< of the resin
  double reach_mm = 0;           ///< up to which light comes from all directions
  double alpha_r = 0;            ///< absorption times the resin's radius
  int frame_width = 0, frame_height = 0;
  int first_column = 0;  ///< of frames, that shows the grid's pixel 0
  FramePlaces places;
  bool clockwise = true;
  /// Frames are shown in order while the vial turns; this one is shown at angle m.
  int frame_of_angle(int m) const { return clockwise || m == 0 ? m : grid.angles - m; }
};

/// Voxels along x and along y of the grid that the resin holds: an odd number, so that one is on the
/// axis. Throws `InputError` when the printer has no vial, and for voxels too large or too small.
int voxels_across(const Printer& printer, double voxel_mm);

/// Throws `InputError` naming what is missing or does not fit: light that is not telecentric, a
/// printer whose rows are higher than a voxel, slices above or below the image, fewer than 3 angles,
/// more frames than the projector shows in a turn.
Bench make_bench(const Printer& printer, const Resin& resin, const Sampling& sampling);

/// Angles of a turn at which voxels at this distance from the axis are resolved: pi r / p for half a
/// turn (Kelly's thesis, 5.5.2).
int resolving_angles(double radius_mm, double voxel_mm);

/// As many angles as resolve the voxels at `part_radius_mm`, as far as the projector can show them.
int usual_angles(const Printer& printer, double part_radius_mm, double voxel_mm);

}  // namespace slicecorr::tomo
