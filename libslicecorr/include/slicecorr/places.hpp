/// @file places.hpp
/// Light and cure models by place: what a display's flat-field means for the pixels of a stack.
///
/// Columns of pixels are independent of each other, so a flat-field is a set of classes of columns,
/// one per value of 0 to 255 that occurs. All columns of a value have one cure model: that of a
/// printer whose intensities are value / reference of the calibration. Everything is exact in
/// integers, so that it is the same on all machines. Immutable and thread-safe once made.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// Value of the light at each pixel of a stack's images.
class LightMap {
 public:
  /// Of `images` that lie like `frame` when `printer` shows them. Throws `InputError` when its
  /// flat-field is one of the plate, and printer and images contradict each other about how that
  /// lies; or when images and display differ in size.
  LightMap(const Printer& printer, const Grid& images, const ImageFrame& frame);
  /// Even.
  LightMap() = default;

  /// Every pixel gets the light of the calibration: there is no flat-field, or one that is flat.
  bool even() const { return even_; }
  /// Share of the calibration's light that a value stands for.
  double factor(std::uint8_t value) const { return 1.0 * value / reference_; }
  /// What stands for the calibration itself; where light is even the value of all pixels.
  std::uint8_t reference() const { return static_cast<std::uint8_t>(reference_); }
  /// The greatest value of the flat-field.
  std::uint8_t greatest() const { return greatest_; }

  /// Joins every `step` neighbouring values into the one in their middle: fewer models, and factors
  /// that are off by up to step / 2 / reference. No light stays no light.
  void coarsen(int step) { step_ = step; }

  std::uint8_t value(int x, int y) const;
  /// Values of the pixels in `box`, row by row.
  void values(const PixelBox& box, std::uint8_t* out) const;
  /// How many pixels of a box have each value.
  std::array<std::uint64_t, 256> counts(const PixelBox& box) const;

 private:
  /// Between which two samples of the flat-field a pixel lies, and how near to the second.
  struct Between {
    std::int32_t first = 0, second = 0;
    std::int64_t share = 0;  ///< 0 to twice the pixels of the axis
  };
  static std::vector<Between> between(int pixels, int samples);
  std::uint8_t sample(int x, int y) const;

  FlatField field_;
  bool even_ = true, fine_ = false;
  int reference_ = 255, step_ = 1;
  std::uint8_t greatest_ = 255;
  int width_px_ = 0, height_px_ = 0;  ///< of the images
  Turn turn_;                         ///< from the images to the flat-field's frame
  std::vector<Between> across_, down_;
  std::int64_t whole_ = 1;
};

/// The cure models of a process by value of light. Made when asked for. Under UV light models have
/// large tables: where those of all values together would take more than 256 MiB, neighbouring
/// values share one (`LightMap::coarsen`).
class PlaceModels {
 public:
  /// Throws as `LightMap`; making models throws as `make_cure_model`.
  PlaceModels(const Printer& printer, const Resin& resin, const Process& process,
              const Grid& images, const ImageFrame& frame);
  /// One model everywhere.
  PlaceModels(const CureModel& everywhere);
  ~PlaceModels();

  const LightMap& map() const { return map_; }
  bool even() const { return map_.even(); }
  const CureModel& model(std::uint8_t value) const;
  const PixelCurve& curve(std::uint8_t value) const;
  /// Of the pixel.
  const CureModel& model_at(int x, int y) const { return model(map_.value(x, y)); }
  /// At the brightest place: what black light and level steps do at most. Without a flat-field the
  /// only one.
  const CureModel& brightest() const { return model(map_.greatest()); }
  /// The printer as a place of this value sees it: its calibration times the factor.
  Printer printer_at(std::uint8_t value) const;

 private:
  struct Made;
  Printer printer_;  ///< without its flat-field
  Resin resin_;
  Process process_;
  double layer_um_;
  LightMap map_;
  mutable std::array<std::mutex, 256> making_;
  mutable std::array<std::unique_ptr<Made>, 256> made_;
};

/// Columns of a band by value of light.
struct LightGroup {
  std::uint8_t value = 0;
  std::vector<std::uint32_t> columns;  ///< of the band, rising
};
/// All columns of `box`, those of one value together, values rising; `keep`: only columns where it
/// is not 0; null: all.
std::vector<LightGroup> light_groups(const LightMap& map, const PixelBox& box,
                                     const std::uint8_t* keep);

/// `BandDose` of all columns of a box of pixels, each with the model of its place. Slices from the
/// last to the first; for one thread at a time.
class PlaceDose {
 public:
  /// `models` must outlive this.
  PlaceDose(const PlaceModels& models, const PixelBox& box);
  /// Of single pixels.
  PlaceDose(const PlaceModels& models, const std::vector<Pixel>& pixels);
  void add_slice(int slice, const std::uint8_t* pixels);
  /// As `BandDose`.
  void add_slice(int slice, std::span<const ImageShowing> parts);
  const double* lower() const {
    return groups_.size() == 1 ? groups_[0].dose.lower() : lower_.data();
  }
  const double* middle() const {
    return groups_.size() == 1 ? groups_[0].dose.middle() : middle_.data();
  }
  const double* upper() const {
    return groups_.size() == 1 ? groups_[0].dose.upper() : upper_.data();
  }

 private:
  struct Group {
    BandDose dose;
    std::vector<std::uint32_t> columns;
  };
  PlaceDose(const PlaceModels& models, std::vector<LightGroup> groups, std::size_t columns);
  std::vector<Group> groups_;
  void scatter(const Group& group);
  std::vector<std::uint8_t> gathered_;
  std::vector<double> lower_, middle_, upper_;
};

}  // namespace slicecorr
