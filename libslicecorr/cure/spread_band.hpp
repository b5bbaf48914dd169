/// The images of slices as resin sees them where light spreads: what `ShownBand` is where the light
/// of each pixel stays in its column.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/light_spread.hpp"
#include "cure/shown_slices.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// How the light of a printer spreads over images and in a resin. Immutable; may be shared between
/// threads.
class SpreadLight {
 public:
  /// Of the models' printer and resin, for images of `grid` that lie like `frame`. `models` must
  /// outlive this. Throws `InputError`
  /// where what spreads can't be counted: under UV light; scatter in a resin whose exponent m is
  /// not 1, that ends, or below a platform that sends light back; a spread that reaches further than the images are wide or high.
  SpreadLight(const PlaceModels& models, const Grid& grid, const ImageFrame& frame);

  /// Light stays where it is.
  bool none() const { return blur_.none() && scatter_.none(); }
  /// Light from further away than this many pixels changes no dose, or by less than 1e-6 of it.
  int reach_x() const { return blur_.reach_x() + halo_x_; }
  int reach_y() const { return blur_.reach_y() + halo_y_; }
  /// The pixels whose columns light from `box` reaches, and as well those whose light reaches its
  /// columns: of the display.
  PixelBox around(const PixelBox& box) const { return grown(box, reach_x(), reach_y()); }
  const LightBlur& blur() const { return blur_; }
  const SliceScatter& scatter() const { return scatter_; }
  /// All pixels; beyond them it is dark.
  const PixelBox& display() const { return display_; }
  /// The finest line and gap, along the better of the display's axes; nothing where all light of the
  /// printer stays where it is.
  std::optional<FinestWidths> finest() const;
  /// The model of all columns: what they get is no longer what their own place of the display gives.
  const CureModel& model() const { return models_.brightest(); }

 private:
  friend class SpreadBand;
  PixelBox grown(const PixelBox& box, int x, int y) const;

  const PlaceModels& models_;
  PixelBox display_;
  LightBlur blur_;
  SliceScatter scatter_;
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
  /// without pixels. Where light scatters one more says what the slices after this one have brought
  /// from column to column. Slices follow each other downwards in number, beginning with the last.
  /// Valid until the next call.
  std::span<const ImageShowing> of(int slice);

 private:
  /// An image, as it is needed for one showing of a slice.
  struct Shown {
    std::vector<std::uint8_t> pixels;  ///< over `shown_`; empty: none so far
    std::vector<double> field;         ///< the light that it gives, over `field_`
    std::vector<double> phi;           ///< the same of the columns; empty where these are the field
  };
  void show(const std::uint8_t* pixels, Shown& out);
  /// The pixels above black; empty: none.
  PixelBox lit_box(const std::uint8_t* pixels) const;
  /// What an image gives the columns of `to`, written over `to` in `field`. Null: black.
  void blur(const std::uint8_t* pixels, const PixelBox& to, std::vector<double>& field);
  const std::vector<double>& intensities(std::uint8_t place);
  void scatter(int slice);
  const double* of_columns(const std::vector<double>& field, std::vector<double>& room) const;

  const SpreadLight& light_;
  const ShownSlices& slices_;
  const PixelBox field_, shown_;
  std::vector<std::size_t> columns_;  ///< in `field_`; empty: all of it
  CodedBand coded_;
  ShownBand images_;
  /// Relative intensity of each pixel value to the power 1 / m, by value of the display's light.
  std::array<std::vector<double>, 256> intensities_;
  std::vector<double> dark_;          ///< the light of a black image, over `field_`
  std::vector<std::uint8_t> pixels_;  ///< of a slice that shows one image
  std::vector<double> in_, out_;
  std::vector<Shown> kept_;                                            ///< by showing of the slice
  std::vector<double> dose_, scattered_, gained_, gained_of_columns_;  ///< where light scatters
  std::vector<ImageShowing> showings_;
};

}  // namespace slicecorr::detail
