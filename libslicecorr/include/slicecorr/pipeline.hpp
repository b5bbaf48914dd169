// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file pipeline.hpp
/// From a target to a stack and its figures: the steps of a correction put together band by band,
/// so that a band passes through all of them while it is in memory.
///
/// Every function works on bands in parallel and gives the same bytes and figures for any number of
/// threads. Memory: per thread a band's state and its run-length coded slices; images wait
/// compressed.
///
/// All functions are thread-safe as long as no two write the same file; sources are only read. A
/// `CorrectedSlices` is immutable and thread-safe for reading different bands. What can't be read
/// or does not fit throws `InputError`, what physics forbids `InfeasibleError`, a failing disk
/// `DeviceError`, a cancelled `context` `Cancelled`.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/correct.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

namespace detail {
class PlacePlans;
class TogetherCorrected;
}  // namespace detail

/// Writes a target as a stack of its coverage, with its edge heights where it has some; of archives
/// that have no place for these that is told. Throws `InputError` when no voxel in it is covered
/// fully: nothing of it would print.
StackInfo write_target(const SliceSource& target, const StackFile& file,
                       const ExecutionContext& context = {});
/// The same of layers of different heights.
StackInfo write_target(const SliceSource& target, const LayerHeights& heights,
                       const StackFile& file, const ExecutionContext& context = {});

/// Writes the slices of a stack into another archive, with all that both formats can say. `slices`:
/// the same turned, where they are to lie otherwise; null: as they are. What is lost is told
/// through `context`.
void convert_stack(const StackReader& stack, const StackFile& file,
                   const ExecutionContext& context = {}, const SliceSource* slices = nullptr);

/// Volume of what the images of a stack cover, mm³, each layer as high as it is.
double coverage_mm3(const StackReader& stack, const ExecutionContext& context = {});

/// The process with its UV intensity of each slice, where the schedule asks for one per slice and
/// does not say them yet: what the brightest pixel of a slice needs for the dead zone, found by a
/// first correction with the intensity that full light needs; with the light for an even dead zone
/// where that is asked for (`find_even_light`). Others come back as they are.
Process schedule_uv(const SliceSource& target, const Setup& setup,
                    const ExecutionContext& context = {});

struct ReducedVolume;  // volume.hpp

struct Correction {
  StackInfo info;                    ///< of the stack written
  Prediction after;                  ///< what it prints
  std::optional<Prediction> before;  ///< what the target prints when shown as it is
  /// Both prints, reduced to cells, where it was asked for; see reduce_volume().
  std::shared_ptr<ReducedVolume> volume;
  /// The corrected slices, where they are kept (`CorrectedSlices` of light that spreads); the target
  /// must live on. Null where they are not.
  std::shared_ptr<const SliceSource> slices;
};

/// What a correction is to find out besides the stack and its prediction.
struct CorrectionAsk {
  bool before = false;  ///< what the target prints when shown as it is
  /// The reduced volume with at most so many cells a side, >= 0; 0: none. Implies `before`.
  int volume_cells = 0;
  /// Called when all is computed, before the stack is written: what it throws leaves no stack.
  std::function<void(const Correction&)> before_writing = {};
};

/// Corrects `target` for `setup` and writes the stack; to the doses that are wanted of it, where it
/// has some (`SliceSource::doses`). Throws `InputError` when the target does not fit the printer or
/// has no voxel of coverage 1, or wanted doses don't fit the setup, `InfeasibleError` when physics
/// or the stage's travel forbid it.
Correction correct_stack(const SliceSource& target, const Setup& setup, const StackFile& file,
                         const CorrectionAsk& ask, const ExecutionContext& context = {});

/// Throws `InputError` when a stack and its target differ in the size of images or voxels.
void check_same_voxels(const Grid& stack, const Grid& target);

/// Whether `target`, called `name` in messages, can be what `stack` is measured against; `info`:
/// what the stack says of itself. Throws `InputError` saying what does not fit: as
/// `check_same_voxels`; another height than that of the part that the stack was made from (black
/// layers at the end do not count); less than half of the pixels or of the volume in common with
/// it, and with a stack that was not corrected none at all; no voxel of coverage 1. A corrected
/// stack's target that has another volume is told: it may be the same part, sliced otherwise.
/// `pixel_sum`: of all pixels of the target, where it is known (StackReader); then the target that
/// a stack was made from is known by it, else both are read once.
void check_target(const SliceSource& stack, const StackInfo& info, const SliceSource& target,
                  const std::string& name, std::optional<std::uint64_t> pixel_sum,
                  const ExecutionContext& context = {});

/// Predicts what `stack` prints, against `target`. Throws `InputError` when the two differ in size
/// or scale.
Prediction verify_stack(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                        const ExecutionContext& context = {});

/// What a part prints with each way of showing its slices.
struct Comparison {
  Prediction uncorrected;
  Prediction erase;           ///< whole-layer erase (baseline.hpp) of `best_n` layers
  Prediction table;           ///< fixed grey table
  Prediction ours;            ///< as `correct_stack`
  Prediction z_compensation;  ///< PrusaSlicer's Z compensation (baseline.hpp) by `best_z` layers
  /// The same for a target with edge heights whose slices alone are corrected, judged by the heights.
  std::optional<Prediction> to_slices;
  int best_n = 0;  ///< layers; the N with the least mean height error, the least one of equals
  /// Mean height error with each N from 0 on, in um: what `best_n` was chosen from.
  std::vector<double> erase_mean_um;
  int best_z = 0;                              ///< as `best_n`, of the Z compensation
  std::vector<double> z_compensation_mean_um;  ///< as `erase_mean_um`
};

/// Compares the correction with the baselines. The part is cut to find N, and for each method.
/// Writes nothing. Throws as `correct_stack`.
Comparison compare_methods(const SliceSource& target, const Setup& setup,
                           const ExecutionContext& context = {});

/// One slice in one pixel column.
struct ProbeRow {
  int slice = 0;
  double z_um = 0;              ///< of node `slice`, from the platform
  int grey = 0;                 ///< level, 0..levels - 1
  double intensity_mw_cm2 = 0;  ///< of blue light at the window
  double phi = 0;               ///< layer by layer phi' of this slice, with its own exposure
  double dose = 0;              ///< Omega at node `slice`, seen from inside the layer; 1 gels
  double dose_middle = 0;       ///< in the middle of the layer
  double dose_lower = 0;        ///< at node `slice` + 1, seen from inside the layer
  double target = -1;           ///< coverage 0..1 of the layer; -1 without a target
};
/// The slices of the pixel in column `x` of row `y`, first slice first. `target`: null without one.
/// Throws `InputError` when the pixel is outside the image.
std::vector<ProbeRow> probe_stack(const SliceSource& stack, const SliceSource* target,
                                  const Setup& setup, int x, int y);

/// A vertical section along one image row, through all slices; data are slice by slice.
struct Section {
  int y = 0, x0 = 0, width = 0, layers = 0;  ///< row; columns [x0, x0 + width)
  std::vector<std::uint8_t> coverage;        ///< of the target, 0..255
  std::vector<std::uint8_t> pixels;          ///< shown, 0..255; black after the end of the stack
  std::vector<float> dose;                   ///< relative, at mid-layer; 1 gels
  /// The doses that are wanted where coverage is 1; empty where the target has none.
  std::vector<float> wanted;
};
Section section_of(const SliceSource& stack, const SliceSource& target, const Setup& setup, int y);

/// A target corrected while it is read, without a file: for sections and columns.
class CorrectedSlices final : public SliceSource {
 public:
  /// `target` must outlive this. Where light spreads all is corrected at once and kept, coded, what
  /// the memory should not hold in a nameless file in `scratch_folder` (empty: the working folder);
  /// else bands are corrected while they are read. Throws as `correct_stack`.
  CorrectedSlices(const SliceSource& target, const Setup& setup,
                  const ExecutionContext& context = {}, const std::string& scratch_folder = {});
  ~CorrectedSlices() override;
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  /// All is corrected and kept: the target is read no more.
  bool kept() const { return together_ != nullptr; }
  /// Of the library's own use.
  const detail::PlacePlans& plans() const { return *plans_; }

 private:
  const SlicesAlone alone_;
  const SliceSource& target_;
  std::unique_ptr<const detail::PlacePlans> plans_;
  std::unique_ptr<const detail::TogetherCorrected> together_;  ///< null: each column alone
  Grid grid_;
};

/// Checks that `setup` can print `target` at all: size, scale, stage, light. Throws as
/// `correct_stack`. Where the printer has a flat-field that is too dim at some places, the slices
/// are read to find whether the part is lit there; a `GridOnly` is lit nowhere. The plan is that of
/// the brightest place.
CorrectionPlan plan_correction(const SliceSource& target, const Setup& setup,
                               const ExecutionContext& context = {});

}  // namespace slicecorr
