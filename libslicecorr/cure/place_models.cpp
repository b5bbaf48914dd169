// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/place_models.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr {

namespace {

/// Bound of the tables of all places.
constexpr double kMostBytes = 256.0 * 1024 * 1024;

/// How many values must share a model so that the tables of all stay within bounds.
int values_per_model(const InhibitedKernel& kernel, int values) {
  return std::clamp(static_cast<int>(std::ceil(values * kernel.table_bytes() / kMostBytes)), 1, 64);
}

/// The same of the values that occur: a picture may have few, far from each other.
int values_per_model(const InhibitedKernel& kernel, const std::array<std::uint64_t, 256>& counts) {
  const double most = std::max(1.0, kMostBytes / kernel.table_bytes());
  int step = 1;
  for (; step < 64; ++step) {
    int classes = 0, last = -1;
    for (int v = 0; v < static_cast<int>(counts.size()); ++v) {
      if (counts[static_cast<std::size_t>(v)] == 0 || v / step == last) continue;
      last = v / step;
      ++classes;
    }
    if (classes <= most) break;
  }
  return step;
}

bool uv_is_uneven(const Printer& printer, const Process& process) {
  // The images of an even dead zone make its UV light even.
  const bool made_even = process.even_light || process.even_dead_zone != EvenDeadZone::off;
  return printer.uv_flat_field && process.uv.kind != UvKind::off && !made_even;
}

/// Values of a lamp's map run from 1 to 255; turned round they do, too.
constexpr int kTurnedRound = 256;

/// What the map of classes is made from where one lamp is uneven: the display's flat-field, or the UV lamp's,
/// turned round.
Printer mapped(Printer printer, const Process& process) {
  if (!uv_is_uneven(printer, process)) return printer;
  FlatField field = *printer.uv_flat_field;
  std::vector<std::uint8_t> values = *field.values;
  for (std::uint8_t& v : values) {
    v = static_cast<std::uint8_t>(kTurnedRound - std::max<int>(v, 1));
  }
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(values));
  field.reference = kTurnedRound - field.reference;
  printer.flat_field = std::move(field);
  return printer;
}

/// By how much light may be off where values share a model.
constexpr double kMostSharedLight = 0.005;
/// Classes of places that differ in two lights: one more is that of the calibration, and 0 is no light.
constexpr int kMostPairs = 254;

/// Pixels that the pictures of both lamps give the same values.
class PairsOfLight {
 public:
  PairsOfLight(const LightMap& blue, const LightMap& uv, const Grid& images)
      : blue_(blue), uv_(uv), occurs_(kValues * kValues, 0) {
    for (int y = 0; y < images.height_px; ++y) {
      for (int x = 0; x < images.width_px; ++x) occurs_[at(x, y)] = 1;
    }
    for (std::size_t pair = kValues; pair < occurs_.size(); ++pair) {
      if (occurs_[pair] == 0) continue;
      least_blue_ = std::min(least_blue_, static_cast<int>(pair / kValues));
      least_uv_ = std::min(least_uv_, std::max(1, static_cast<int>(pair % kValues)));
    }
  }
  std::size_t at(int x, int y) const {
    return kValues * blue_.value(x, y) + static_cast<std::size_t>(uv_.value(x, y));
  }
  int least_blue() const { return least_blue_; }
  int least_uv() const { return least_uv_; }

  /// Boxes of pairs in which each light is off by a share of `off` at most.
  struct Boxes {
    std::vector<PlaceModels::Pair> light;  ///< in their middles, rising by blue over UV light
    std::vector<std::uint8_t>
        value_of;  ///< 1 more than the box, by pair; 0: no light. Empty: too many
    std::size_t count = 0;
  };
  Boxes boxes(double off) const {
    const int of_blue = 1 + static_cast<int>(2 * off * least_blue_ * (1 + 1e-9)),
              of_uv = 1 + static_cast<int>(2 * off * least_uv_ * (1 + 1e-9));
    struct Box {
      PlaceModels::Pair light;
      std::vector<std::size_t> pairs;
    };
    std::map<std::pair<int, int>, Box> found;
    for (std::size_t pair = kValues; pair < occurs_.size(); ++pair) {
      if (occurs_[pair] == 0) continue;
      const int blue = (static_cast<int>(pair / kValues) - least_blue_) / of_blue,
                uv = (std::max(1, static_cast<int>(pair % kValues)) - least_uv_) / of_uv;
      Box& box = found[{blue, uv}];
      box.light = {(least_blue_ + blue * of_blue + 0.5 * (of_blue - 1)) / blue_.reference(),
                   (least_uv_ + uv * of_uv + 0.5 * (of_uv - 1)) / uv_.reference()};
      box.pairs.push_back(pair);
    }
    Boxes all;
    all.count = found.size();
    if (all.count > kMostPairs) return all;
    std::vector<const Box*> order;
    order.reserve(found.size());
    for (const auto& [place, box] : found) order.push_back(&box);
    std::stable_sort(order.begin(), order.end(), [](const Box* a, const Box* b) {
      return a->light.blue * b->light.uv < b->light.blue * a->light.uv;
    });
    all.value_of.resize(occurs_.size(), 0);
    for (const Box* box : order) {
      all.light.push_back(box->light);
      for (const std::size_t pair : box->pairs) {
        all.value_of[pair] = static_cast<std::uint8_t>(all.light.size());
      }
    }
    return all;
  }

 private:
  static constexpr std::size_t kValues = 256;
  const LightMap &blue_, &uv_;
  std::vector<std::uint8_t> occurs_;  ///< by blue value times 256 and UV value
  int least_blue_ = 255, least_uv_ = 255;
};

}  // namespace

/// Sorts places by both of their lights into classes, and makes the map of these.
void PlaceModels::pair_lights(const Printer& printer, const Grid& images, const ImageFrame& frame) {
  const LightMap blue(printer, images, frame), uv = uv_light_map(printer, images, frame);
  const PairsOfLight pairs(blue, uv, images);
  const double bytes =
      make_cure_model(printer_, resin_, process_, layer_um_).inhibited()->table_bytes();
  const auto most = static_cast<std::size_t>(std::clamp(kMostBytes / bytes, 1.0, 1.0 * kMostPairs));
  values_ = static_cast<int>(pairs.boxes(kMostSharedLight).count);
  PairsOfLight::Boxes boxes;
  for (int step = 1; boxes.value_of.empty() || boxes.count > most; ++step) {
    // Either light goes up to so many values of the picture together.
    const double off = 0.5 * (step - 1) / std::max(pairs.least_blue(), pairs.least_uv());
    if (off > kMostSharedLight) {
      throw InputError(
          printer.name, "uv.flat_field",
          fmt::format(
              "places differ in the light of the display and in UV light: told apart to {:g} % they make {} "
              "pairs, and there is room for the tables of {}; expected lights that are less uneven, UV light "
              "of fewer intensities, or a printer with one flat_field",
              100 * kMostSharedLight, values_, most));
    }
    boxes = pairs.boxes(off);
  }
  pairs_.assign(256, {0, 1});
  std::copy(boxes.light.begin(), boxes.light.end(), pairs_.begin() + 1);
  // Places that get just the light of the calibration, whether there are any or not.
  std::size_t reference = 1;
  while (reference <= boxes.light.size() &&
         !(pairs_[reference].blue == 1 && pairs_[reference].uv == 1)) {
    ++reference;
  }
  pairs_[reference] = {1, 1};
  std::vector<std::uint8_t> values(static_cast<std::size_t>(printer.width_px) *
                                   static_cast<std::size_t>(printer.height_px));
  const Turn turn = turn_to_display(frame, printer);
  for (int y = 0; y < images.height_px; ++y) {
    for (int x = 0; x < images.width_px; ++x) {
      const Pixel p = turned(Pixel{x, y}, turn, images.width_px, images.height_px);
      values[static_cast<std::size_t>(p.y) * static_cast<std::size_t>(printer.width_px) +
             static_cast<std::size_t>(p.x)] = boxes.value_of[pairs.at(x, y)];
    }
  }
  Printer of_classes = printer;
  of_classes.flat_field = {printer.width_px, printer.height_px,
                           std::make_shared<const std::vector<std::uint8_t>>(std::move(values)),
                           static_cast<int>(reference), false};
  map_ = LightMap(of_classes, images, frame);
}

struct PlaceModels::Made {
  CureModel model;
  PixelCurve curve;
};

bool light_is_uneven(const Printer& printer, const Process& process) {
  return printer.flat_field.has_value() || uv_is_uneven(printer, process);
}

PlaceModels::PlaceModels(const Printer& printer, const Resin& resin, const Process& process,
                         const Grid& images, const ImageFrame& frame)
    : printer_(for_resin(printer, resin)),
      resin_(resin),
      process_(as_lamp_shines(process)),
      layer_um_(images.layer_um),
      of_uv_(uv_is_uneven(printer, process)) {
  check_supported(printer, resin, process);
  printer_.flat_field.reset();
  // Shares of the light are those of what is usual from here on.
  const double usual = usual_light_share(process_);
  printer_ = as_lit(printer_, process_);
  for (double& share : process_.light_share) share /= usual;
  if (of_uv_ && printer.flat_field) {
    pair_lights(printer, images, frame);
    return;
  }
  map_ = LightMap(mapped(printer, process), images, frame);
  if (even() || process.uv.kind == UvKind::off) return;
  const FlatField& field = of_uv_ ? *printer.uv_flat_field : *printer.flat_field;
  const int least = field.least();
  const int values = field.greatest() - least + 1;
  least_ = least;
  values_ = values;
  const InhibitedKernel& kernel = *model(map_.greatest()).inhibited();
  int together = values_per_model(kernel, values);
  if (together > 1) {
    const PixelBox all{0, 0, images.width_px, images.height_px};
    together = std::min(together, values_per_model(kernel, map_.counts(all)));
  }
  const bool own = !kernel.alike();
  // Edges would lie elsewhere than is told.
  const double off = 0.5 * (together - 1) / std::max(1, least);
  if (off > kMostSharedLight) {
    throw InputError(
        printer.name, of_uv_ ? "uv.flat_field" : "display.flat_field",
        fmt::format(
            "under UV light {} its light is told apart to {:.1f} % only; expected {}, or a printer without flat_field",
            own ? "of slices that each have tables of their own (different heights, a platform that sends light back)"
                : "of so many intensities",
            100 * off,
            own ? "layers of one height and a platform that takes light up"
                : "UV light of one intensity"));
  }
  map_.coarsen(together);
}

PlaceModels::PlaceModels(const CureModel& everywhere) : layer_um_(everywhere.layer_um) {
  made_[map_.reference()] = std::make_unique<Made>(Made{everywhere, pixel_curve(everywhere)});
}

PlaceModels::~PlaceModels() = default;

int PlaceModels::uv_settings_that_fit() const {
  if (even() || !brightest().inhibited()) return std::numeric_limits<int>::max();
  const InhibitedKernel& kernel = *brightest().inhibited();
  const double together = std::floor(1 + 2 * kMostSharedLight * std::max(1, least_));
  const double of_one = kernel.table_bytes() / kernel.settings() * values_;
  return std::max(1, static_cast<int>(together * kMostBytes / of_one));
}

double PlaceModels::curing_factor(std::uint8_t value) const {
  if (paired()) return pairs_[value].blue;
  return of_uv_ || value == map_.reference() ? 1.0 : map_.factor(value);
}

double PlaceModels::uv_factor(std::uint8_t value) const {
  if (paired()) return pairs_[value].uv;
  if (!of_uv_ || value == map_.reference()) return 1;
  return 1.0 * (kTurnedRound - value) / (kTurnedRound - map_.reference());
}

Printer PlaceModels::printer_at(std::uint8_t value) const {
  if (value == map_.reference()) return printer_;
  if (!of_uv_) return dimmed(printer_, map_.factor(value));
  Printer printer = paired() ? dimmed(printer_, curing_factor(value)) : printer_;
  for (CalibrationPoint& c : printer.uv->calibration) c.intensity_mw_cm2 *= uv_factor(value);
  return printer;
}

Process PlaceModels::process_at(std::uint8_t value) const {
  Process process = process_;
  process.uv.uv_mw_cm2 *= uv_factor(value);
  for (double& uv : process.uv.slice_mw_cm2) uv *= uv_factor(value);
  return process;
}

const CureModel& PlaceModels::model(std::uint8_t value) const {
  const std::lock_guard lock(making_[value]);
  std::unique_ptr<Made>& made = made_[value];
  if (!made) {
    double brightest = even() || of_uv_ ? 1.0 : map_.factor(map_.greatest());
    // A pattern knows no places: it is made for the one with the least UV light over its blue light, as if others
    // got more blue light.
    if (of_uv_ && process_.uv.kind == UvKind::patterned) brightest = light_held_of(value);
    CureModel model = of_uv_ ? make_cure_model(printer_at(value), resin_, process_at(value),
                                               layer_um_, {1.0, brightest})
                             : make_cure_model(printer_, resin_, process_, layer_um_,
                                               {curing_factor(value), brightest});
    const PixelCurve curve = pixel_curve(model);
    made = std::make_unique<Made>(Made{std::move(model), curve});
  }
  return made->model;
}

double PlaceModels::light_held_of(std::uint8_t value) const {
  if (even()) return 1;
  const std::uint8_t held = map_.greatest();
  const double own = curing_factor(value) / uv_factor(value);
  return own > 0 ? curing_factor(held) / uv_factor(held) / own : 1;
}

const PixelCurve& PlaceModels::curve(std::uint8_t value) const {
  model(value);
  return made_[value]->curve;
}

namespace {

std::vector<LightGroup> groups_of(const LightMap& map, const PixelBox& box) {
  if (!map.even()) return light_groups(map, box, nullptr);
  // A single group: its list of columns is not used.
  return {{map.reference(), {}}};
}

std::vector<LightGroup> groups_of(const LightMap& map, const std::vector<Pixel>& pixels) {
  if (map.even()) return {{map.reference(), {}}};
  std::vector<LightGroup> groups(256);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::uint8_t value = map.value(pixels[i].x, pixels[i].y);
    groups[value].value = value;
    groups[value].columns.push_back(static_cast<std::uint32_t>(i));
  }
  std::erase_if(groups, [](const LightGroup& g) { return g.columns.empty(); });
  return groups;
}

}  // namespace

PlaceDose::PlaceDose(const PlaceModels& models, const PixelBox& box)
    : PlaceDose(models, groups_of(models.map(), box),
                static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height())) {}

PlaceDose::PlaceDose(const PlaceModels& models, const std::vector<Pixel>& pixels)
    : PlaceDose(models, groups_of(models.map(), pixels), pixels.size()) {}

PlaceDose::PlaceDose(const PlaceModels& models, std::vector<LightGroup> groups,
                     std::size_t columns) {
  for (LightGroup& g : groups) {
    const std::size_t size = groups.size() == 1 ? columns : g.columns.size();
    groups_.push_back({BandDose(models.model(g.value), size), std::move(g.columns)});
  }
  if (groups_.size() == 1) return;
  gathered_.resize(columns);
  for (auto* doses : {&lower_, &middle_, &upper_}) doses->resize(columns);
}

void PlaceDose::add_slice(int slice, const std::uint8_t* pixels) {
  if (groups_.size() == 1) return groups_[0].dose.add_slice(slice, pixels);
  for (Group& group : groups_) {
    const std::size_t n = group.columns.size();
    if (pixels) {
      for (std::size_t k = 0; k < n; ++k) gathered_[k] = pixels[group.columns[k]];
    }
    group.dose.add_slice(slice, pixels ? gathered_.data() : nullptr);
    scatter(group);
  }
}

void PlaceDose::add_slice(int slice, std::span<const ImageShowing> showings) {
  if (groups_.size() == 1) return groups_[0].dose.add_slice(slice, showings);
  const std::size_t columns = lower_.size();
  gathered_.resize(std::max<std::size_t>(1, showings.size()) * columns);
  std::vector<ImageShowing> of_place(showings.begin(), showings.end());
  for (Group& group : groups_) {
    const std::size_t n = group.columns.size();
    for (std::size_t s = 0; s < showings.size(); ++s) {
      std::uint8_t* const pixels = gathered_.data() + s * columns;
      for (std::size_t k = 0; k < n; ++k) pixels[k] = showings[s].pixels[group.columns[k]];
      of_place[s].pixels = pixels;
    }
    group.dose.add_slice(slice, of_place);
    scatter(group);
  }
}

void PlaceDose::scatter(const Group& group) {
  for (std::size_t k = 0; k < group.columns.size(); ++k) {
    const std::uint32_t at = group.columns[k];
    lower_[at] = group.dose.lower()[k];
    middle_[at] = group.dose.middle()[k];
    upper_[at] = group.dose.upper()[k];
  }
}

}  // namespace slicecorr
