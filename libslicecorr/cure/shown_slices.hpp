// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file shown_slices.hpp
/// Which images each slice shows: image n in slice n, or what a recording says.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/coded_band.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

inline std::size_t columns_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}

inline CodedBand coded_band_of(const SliceSource& source, const PixelBox& band) {
  CodedBand coded(columns_of(band));
  source.read_band(band, [&](int, const std::uint8_t* rows) { coded.append(rows); });
  return coded;
}

/// Throws `InputError` when `source` is a recording under UV light: for what does not compute with
/// measured UV light.
void refuse_recording_under_uv(const SliceSource& source);

/// Immutable and thread-safe.
class ShownSlices {
 public:
  struct Showing {
    int image = -1;  ///< -1: black
    double light = 1;
    int setting = 0;
    double from = 0, to = 1;  ///< see ImageShowing
  };

  /// Most settings of the UV lamp that have tables of their own, and how many showings a slice may
  /// have.
  static constexpr int kMostSettings = 32;
  static constexpr std::size_t kMostShowings = 256;
  /// Where a slice has more showings than this, their light is taken as spread over the slice.
  static constexpr std::size_t kMostPlaced = 32;
  /// Light that an image may have in a slice, as a share of what is planned for it, while its UV
  /// image is another: two displays change their images within milliseconds, not at once.
  static constexpr double kMostOtherUv = 0.1;

  /// Of a stack, recorded or not, that is shown by `printer` and `process`, which for a recording
  /// are those it was made with. Throws `InputError` when a slice of a recording has more than
  /// `kMostShowings` images that were lit, or its UV images were others than those of its slices for
  /// more than `kMostOtherUv`.
  ShownSlices(const SliceSource& stack, const Printer& printer, const Resin& resin,
              const Process& process);
  /// Without UV light: throws `InputError` when a recording has some.
  explicit ShownSlices(const SliceSource& stack);

  bool recorded() const { return recorded_; }
  /// Number of slices that are shown.
  int slices() const { return slices_; }
  /// The showings of a recorded slice that have light, one for each image, setting and place. Of a
  /// stack that is no recording: one showing of image n.
  std::span<const Showing> of(int slice) const;

  /// Printer and process for making the models: those given, but with UV light as it was measured.
  const Printer& printer() const { return printer_; }
  const Process& process() const { return process_; }
  /// UV intensities differ from those of their settings by up to this share.
  double setting_deviation() const { return deviation_; }
  /// Most light of a slice under a UV image that was another; 0: none.
  double other_uv_light() const { return other_uv_light_; }

 private:
  void take(const Recording& recording, const Resin& resin, double layer_um);
  void add(const Showing& showing, std::size_t first);
  void make_settings(const std::vector<double>& asked);

  bool recorded_ = false;
  int slices_ = 0;
  std::vector<Showing> showings_;
  std::vector<std::size_t> ends_;
  Printer printer_;
  Process process_;
  double deviation_ = 0;
  double other_uv_light_ = 0;
};

/// The showings of each slice of a recording as a column without a pixel above black sees them.
class BlackColumn {
 public:
  explicit BlackColumn(const ShownSlices& slices) : slices_(slices) {}
  /// Valid until the next call.
  std::span<const ImageShowing> operator()(int slice);

 private:
  const ShownSlices& slices_;
  const std::uint8_t black_ = 0;
  std::vector<ImageShowing> showings_;
};

/// The images of a band's slices, ready to be added to a `BandDose`. Keeps the images of the last
/// slice asked for: as many bytes per column as a slice has showings. For one thread.
class ShownBand {
 public:
  /// `coded` holds the images of the band; both must outlive this.
  ShownBand(const ShownSlices& slices, const CodedBand& coded);
  /// Valid until the next call. None after the end: light off.
  std::span<const ImageShowing> of(int slice);

 private:
  struct Kept {
    int image = -2;
    bool used = false;
    std::vector<std::uint8_t> pixels;
  };
  const std::uint8_t* pixels_of(int image);

  const ShownSlices& slices_;
  const CodedBand& coded_;
  std::vector<std::unique_ptr<Kept>> kept_;
  std::vector<ImageShowing> showings_;
};

}  // namespace slicecorr::detail
