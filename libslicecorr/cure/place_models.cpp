// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/place_models.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

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

bool uv_is_uneven(const Printer& printer, const Process& process) {
  return printer.uv_flat_field && process.uv.kind != UvKind::off;
}

/// Values of a lamp's map run from 1 to 255; turned round they do, too.
constexpr int kTurnedRound = 256;

/// What the map of classes is made from: the display's flat-field, or the lamp's, turned round.
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

}  // namespace

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
      of_uv_(uv_is_uneven(printer, process)),
      map_(mapped(printer, process), images, frame) {
  check_supported(printer, resin, process);
  printer_.flat_field.reset();
  // Shares of the light are those of what is usual from here on.
  const double usual = usual_light_share(process_);
  printer_ = as_lit(printer_, process_);
  for (double& share : process_.light_share) share /= usual;
  if (even() || process.uv.kind == UvKind::off) return;
  const FlatField& field = of_uv_ ? *printer.uv_flat_field : *printer.flat_field;
  const int least = field.least();
  const int values = field.greatest() - least + 1;
  least_ = least;
  values_ = values;
  const int together = values_per_model(*model(map_.greatest()).inhibited(), values);
  // Edges would lie elsewhere than is told.
  const double off = 0.5 * (together - 1) / std::max(1, least);
  if (off > kMostSharedLight) {
    throw InputError(
        printer.name, of_uv_ ? "uv.flat_field" : "display.flat_field",
        fmt::format(
            "under UV light of so many intensities its light is told apart to {:.1f} % only; "
            "expected UV light of one intensity, or a printer without flat_field",
            100 * off));
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
  return of_uv_ || value == map_.reference() ? 1.0 : map_.factor(value);
}

double PlaceModels::uv_factor(std::uint8_t value) const {
  if (!of_uv_ || value == map_.reference()) return 1;
  return 1.0 * (kTurnedRound - value) / (kTurnedRound - map_.reference());
}

Printer PlaceModels::printer_at(std::uint8_t value) const {
  if (value == map_.reference()) return printer_;
  if (!of_uv_) return dimmed(printer_, map_.factor(value));
  Printer printer = printer_;
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
    const double brightest = even() || of_uv_ ? 1.0 : map_.factor(map_.greatest());
    CureModel model = of_uv_
                          ? make_cure_model(printer_at(value), resin_, process_at(value), layer_um_)
                          : make_cure_model(printer_, resin_, process_, layer_um_,
                                            {curing_factor(value), brightest});
    const PixelCurve curve = pixel_curve(model);
    made = std::make_unique<Made>(Made{std::move(model), curve});
  }
  return made->model;
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
