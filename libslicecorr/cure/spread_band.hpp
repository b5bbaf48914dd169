// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The images of slices as resin sees them where light spreads: what `ShownBand` is where the light
/// of each pixel stays in its column.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/distance_sums.hpp"
#include "cure/light_spread.hpp"
#include "cure/shown_slices.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Under UV light, light dimmer than this share of full light has the front of light that is not.
inline constexpr double kDimmest = 1e-7;

/// The setting of what light from beside adds to a column's own where it scatters: it is no exposure.
inline constexpr int kNoExposure = -1;

/// What places of a value of light get of the UV light of those that get the least, and the most of it; 1 where
/// UV light is even.
double uv_share(const PlaceModels& models, std::uint8_t value);
double most_uv_share(const PlaceModels& models);

/// How the light of a printer spreads over images and in a resin. Immutable; may be shared between
/// threads.
class SpreadLight {
 public:
  /// Of the models' printer and resin, for images of `grid` that lie like `frame`. `models` must
  /// outlive this. Throws `InputError` where the spread reaches further than the images are wide or high.
  SpreadLight(const PlaceModels& models, const Grid& grid, const ImageFrame& frame);

  /// Light stays where it is.
  bool none() const { return blur_.none() && uv_blur_.none() && distances_.empty(); }
  /// Light from further away than this many pixels changes no dose, or by less than 1e-6 of it.
  int reach_x() const { return std::max(blur_.reach_x(), uv_blur_.reach_x()) + halo_x_; }
  int reach_y() const { return std::max(blur_.reach_y(), uv_blur_.reach_y()) + halo_y_; }
  /// The pixels whose columns light from `box` reaches, and as well those whose light reaches its
  /// columns: of the display.
  PixelBox around(const PixelBox& box) const { return grown(box, reach_x(), reach_y()); }
  const LightBlur& blur() const { return blur_; }
  /// How the light of each distance spreads where it scatters; else empty. `blur` is that of the first.
  const std::vector<DistanceBlur>& distances() const { return distances_; }
  /// All pixels; beyond them it is dark.
  const PixelBox& display() const { return display_; }
  /// The finest line and gap, along the better of the display's axes; nothing where all light of the
  /// printer stays where it is.
  std::optional<FinestWidths> finest() const;
  /// The model of all columns: what they get is no longer what their own place of the display gives.
  /// Under UV light its kernel is by fronts; with `distances` its bath has no end, as what the columns
  /// get says it already.
  const CureModel& model() const { return own_model_ ? *own_model_ : models_.brightest(); }
  bool under_uv() const { return model().inhibited() && own_model_; }

 private:
  friend class SpreadBand;
  PixelBox grown(const PixelBox& box, int x, int y) const;
  void scatter_in(const CureModel& model, const ScatterWay& way, const Turn& to_display);

  const PlaceModels& models_;
  PixelBox display_;
  std::optional<CureModel> own_model_;  ///< see `model`; nothing: that of the brightest place
  LightBlur blur_, uv_blur_;
  std::vector<DistanceBlur> distances_;
  int halo_x_ = 0, halo_y_ = 0;  ///< so far around a window doses matter, because they scatter
};

/// The light of each slice over a window of columns. For one thread at a time.
class SpreadBand {
 public:
  /// Reads what it needs of `stack`, the images that `slices` shows. All but `stack` must outlive
  /// this.
  SpreadBand(const SpreadLight& light, const SliceSource& stack, const ShownSlices& slices,
             const PixelBox& window);
  /// The same for single pixels of the window, a column for each in this order.
  SpreadBand(const SpreadLight& light, const SliceSource& stack, const ShownSlices& slices,
             const PixelBox& window, const std::vector<Pixel>& places);
  /// What slice `slice` shows, each image with the light that it gives the columns of the window, and
  /// without pixels; under UV light with the pixels of the columns, too. Where light scatters one more says what the slices after this one have brought
  /// from column to column. Slices follow each other downwards in number, beginning with the last.
  /// Valid until the next call.
  std::span<const ImageShowing> of(int slice);

 private:
  /// An image, as it is needed for one showing of a slice.
  struct Shown {
    std::vector<std::uint8_t> pixels;  ///< over `shown_`; empty: none so far
    std::vector<double> field;         ///< the light that it gives, over `field_`
    std::vector<double> phi;           ///< the same of the columns; empty where these are the field
    // Under UV light, of the columns.
    int setting = -1;
    std::vector<double> uv;  ///< over `field_`, mW/cm², as `field` is then
    std::vector<FrontLight> fronts;
    std::vector<std::uint8_t> own;                     ///< their pixels
    std::shared_ptr<const DistanceSums::Image> image;  ///< `pixels`, for `sums_`
  };
  /// What pixels of a value shine with, at a place of the display.
  using Shine = const std::vector<double>& (SpreadBand::*)(std::uint8_t place, int setting);
  /// What the pixels of `box` shine when an image over `shown_` is lit; null: black.
  void shine_in(const std::uint8_t* pixels, const PixelBox& box, Shine shine, int setting,
                double* light);
  void show(const std::uint8_t* pixels, Shown& out);
  void show_under_uv(const std::uint8_t* pixels, int setting, Shown& out);
  /// The pixels above black; empty: none.
  PixelBox lit_box(const std::uint8_t* pixels) const;
  /// What an image gives the columns of `to`, written over `to` in `field`. Null: black.
  void blur(const std::uint8_t* pixels, const PixelBox& to, std::vector<double>& field);
  /// The same of light that `shine` tells, as it spreads.
  void blur(const std::uint8_t* pixels, const PixelBox& to, const LightBlur& spread, Shine shine,
            int setting, std::vector<double>& field);
  const std::vector<double>& intensities(std::uint8_t place, int);
  const std::vector<double>& uv_intensities(std::uint8_t place, int setting);
  const std::vector<double>& dark_uv(int setting);
  std::size_t column(std::size_t i) const { return columns_.empty() ? i : columns_[i]; }
  std::size_t column_count() const { return columns_.empty() ? dark_.size() : columns_.size(); }
  void scatter(int slice);
  const double* of_columns(const std::vector<double>& field, std::vector<double>& room) const;

  const SpreadLight& light_;
  const ShownSlices& slices_;
  const PixelBox field_, shown_;
  std::vector<std::size_t> columns_;  ///< in `field_`; empty: all of it
  CodedBand coded_;
  ShownBand images_;
  /// Relative intensity of each pixel value to the power 1 / m, by value of the display's light;
  /// under UV light and with a time to gel the intensity.
  std::array<std::vector<double>, 256> intensities_;
  std::map<int, std::array<std::vector<double>, 256>> uv_intensities_;  ///< by setting and place
  std::map<int, std::vector<double>> dark_uv_;                          ///< by setting
  std::vector<double> dark_;          ///< the light of a black image, over `field_`
  std::vector<std::uint8_t> pixels_;  ///< of a slice that shows one image
  std::vector<double> in_, out_;
  std::vector<Shown> kept_;                                            ///< by showing of the slice
  std::vector<double> dose_, scattered_, gained_, gained_of_columns_;  ///< where light scatters
  std::optional<DistanceSums> sums_;
  std::vector<ImageShowing> showings_;
};

}  // namespace slicecorr::detail
