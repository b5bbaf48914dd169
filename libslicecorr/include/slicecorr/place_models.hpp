// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file place_models.hpp
/// Cure models and doses by place, where a display's light is uneven (light_map.hpp).
///
/// All columns of one value of light have one cure model: that of a printer whose intensities are
/// value / reference of the calibration. Where both lamps are uneven values are classes of places: of pairs of
/// lights that differ by 0.5 % of either at most, rising by blue over UV light.
///
/// `PlaceModels` is thread-safe: models are made when they are first asked for, and never change. A
/// `PlaceDose` is for one thread at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/light_map.hpp"

namespace slicecorr {

/// The cure models of a process by value of light. Made when asked for. Under UV light models have
/// large tables: where those of all values together would take more than 256 MiB, neighbouring
/// values share one (`LightMap::coarsen`), and light that can't be told apart to 0.5 % then is refused.
/// Whether places differ in the light that counts: by a flat-field of the display, or by one of the UV
/// lamp where UV light is shown.
bool light_is_uneven(const Printer& printer, const Process& process);

class PlaceModels {
 public:
  /// Throws as `LightMap`, and `InputError` where tables would have to be shared too widely; making models throws as `make_cure_model`.
  PlaceModels(const Printer& printer, const Resin& resin, const Process& process,
              const Grid& images, const ImageFrame& frame);
  /// The same model at every place.
  PlaceModels(const CureModel& everywhere);  // NOLINT: one model will do
  ~PlaceModels();

  const LightMap& map() const { return map_; }
  bool even() const { return map_.even(); }
  const CureModel& model(std::uint8_t value) const;
  const PixelCurve& curve(std::uint8_t value) const;
  /// The model of the pixel in column x of row y.
  const CureModel& model_at(int x, int y) const { return model(map_.value(x, y)); }
  /// The model of the brightest place, where black gives most dose and a level step moves edges
  /// furthest. Without a flat-field it is the only model.
  const CureModel& brightest() const { return model(map_.greatest()); }
  /// The printer, without its flat-field, with the light that layers get as a rule, and the resin.
  const Printer& printer() const { return printer_; }
  const Resin& resin() const { return resin_; }
  /// The printer as a place of this value sees it: its calibration times the factor, or that of its UV
  /// lamp where that is what is uneven.
  Printer printer_at(std::uint8_t value) const;
  /// The process as a place of this value sees it: its UV light, where that is uneven.
  Process process_at(std::uint8_t value) const;
  /// Share of the calibration's curing light that a value stands for; 1 where UV light alone is uneven.
  double curing_factor(std::uint8_t value) const;
  /// Whether the map is of the UV lamp, or of both. Its values are turned round: the greatest has the least UV
  /// light, and so the most dose; of both it has the least UV light over its blue light.
  bool of_uv() const { return of_uv_; }
  /// Share of the UV calibration's light that a value stands for; 1 where the map is of curing light.
  double uv_factor(std::uint8_t value) const;
  /// Whether places differ in both lights.
  bool paired() const { return !pairs_.empty(); }
  /// The blue light that a pattern of UV light is made for, over that of a value: of the place that has most blue
  /// over its UV light, with the UV light of this one. 1 where light is even.
  double light_held_of(std::uint8_t value) const;
  struct Pair {
    double blue, uv;  ///< shares of the calibrations
  };
  /// How many UV intensities slices may have in all, so that light is told apart as said above.
  int uv_settings_that_fit() const;

 private:
  struct Made;
  void pair_lights(const Printer& printer, const Grid& images, const ImageFrame& frame);
  Printer printer_;  ///< without its flat-field
  Resin resin_;
  Process process_;
  double layer_um_;
  bool of_uv_ = false;
  int least_ = 1,
      values_ = 1;  ///< of an uneven map under UV light: the least value, and how many there are
  LightMap map_;
  std::vector<Pair> pairs_;  ///< by value; empty unless both lamps are uneven
  mutable std::array<std::mutex, 256> making_;
  mutable std::array<std::unique_ptr<Made>, 256> made_;
};

/// `BandDose` of all columns of a box of pixels, each with the model of its place. Slices from the
/// last to the first.
class PlaceDose {
 public:
  /// `models` must outlive this.
  PlaceDose(const PlaceModels& models, const PixelBox& box);
  /// The same for single pixels, a column for each in this order.
  PlaceDose(const PlaceModels& models, const std::vector<Pixel>& pixels);
  /// This and the functions below: as those of `BandDose`.
  void add_slice(int slice, const std::uint8_t* pixels);
  void add_slice(int slice, std::span<const ImageShowing> showings);
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
