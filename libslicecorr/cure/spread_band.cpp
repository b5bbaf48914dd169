// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/spread_band.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "cure/walkers.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

PixelBox common(const PixelBox& a, const PixelBox& b) {
  PixelBox box{std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1),
               std::min(a.y1, b.y1)};
  if (box.empty()) box = {a.x0, a.y0, a.x0, a.y0};
  return box;
}

bool same(const PixelBox& a, const PixelBox& b) {
  return a.x0 == b.x0 && a.y0 == b.y0 && a.x1 == b.x1 && a.y1 == b.y1;
}

std::size_t index(const PixelBox& box, const Pixel& pixel) {
  return static_cast<std::size_t>(pixel.y - box.y0) * static_cast<std::size_t>(box.width()) +
         static_cast<std::size_t>(pixel.x - box.x0);
}

/// Copies what `from` and `to` have in common.
void copy_common(const std::vector<double>& in, const PixelBox& from, std::vector<double>& out,
                 const PixelBox& to) {
  const PixelBox box = common(from, to);
  for (int y = box.y0; y < box.y1; ++y) {
    const auto at = [&](const PixelBox& whole) {
      return static_cast<std::ptrdiff_t>(y - whole.y0) * whole.width() + (box.x0 - whole.x0);
    };
    std::copy_n(in.begin() + at(from), box.width(), out.begin() + at(to));
  }
}

void refuse(const std::string& why) { throw InputError(why); }

/// A kernel for light between grey levels, over the UV light of slices: where light is made for an even dead zone
/// the dose goes by both lights and not by the front alone.
std::shared_ptr<const InhibitedKernel> by_light(const PlaceModels& models) {
  const std::uint8_t place = models.map().greatest();
  const Printer printer = models.printer_at(place);
  constexpr int levels = 2048;
  // Neighbours differ by 0.6 %: the front is right to 0.1 um, and the amount counts exactly.
  constexpr double least = 1e-5;
  const double full = level_intensities(printer).back();
  std::vector<double> light{0};
  for (int l = 1; l < levels; ++l) {
    light.push_back(full * std::pow(least, 1 - (l - 1) / (levels - 2.0)));
  }
  return make_inhibited_kernel(printer, models.resin(), models.process_at(place),
                               models.brightest().layer_um, light, 1);
}

}  // namespace

double uv_share(const PlaceModels& models, std::uint8_t value) {
  return models.of_uv() ? models.uv_factor(value) / models.uv_factor(models.map().greatest()) : 1;
}

double most_uv_share(const PlaceModels& models) {
  if (!models.of_uv()) return 1;
  const FlatField& field = *models.printer().uv_flat_field;
  return 1.0 * field.greatest() / field.reference / models.uv_factor(models.map().greatest());
}

SpreadLight::SpreadLight(const PlaceModels& models, const Grid& grid, const ImageFrame& frame)
    : models_(models), display_{0, 0, grid.width_px, grid.height_px} {
  const Printer& printer = models.printer();
  const Resin& resin = models.resin();
  const bool uv_spreads = printer.uv && !printer.uv->spread.none();
  if (printer.spread.none() && resin.scatter_um2_per_um == 0 && !uv_spreads) return;
  const CureModel& model = models.brightest();
  if (!model.inhibited() && printer.spread.none() && resin.scatter_um2_per_um == 0) return;
  const Grid images = images_of(printer, frame);
  const ScatterWay way{resin.scatter_um2_per_um, model.layer_um / (model.eta * units::kLn10),
                       model.layer_um,           model.mode == ExposureMode::layerwise,
                       images.pixel_x_um,        images.pixel_y_um};
  const Turn to_display = turn_to_display(frame, printer);
  if (way.um2_per_um > 0) {
    scatter_in(model, way, to_display);
  } else {
    blur_ = LightBlur(printer.spread, images.pixel_x_um, images.pixel_y_um, to_display);
  }
  if (model.inhibited()) {
    if (uv_spreads && !model.inhibited()->uv_levels().empty()) {
      uv_blur_ = LightBlur(printer.uv->spread, images.pixel_x_um, images.pixel_y_um, to_display);
    }
    if (!none()) {
      const double full = level_intensities(models.printer_at(models.map().greatest())).back();
      own_model_ = model;
      // Fronts go by the ratio of both lights.
      if (model.inhibited()->gap_um() > 0) {
        own_model_->law = UnderUv{by_light(models)};
        return;
      }
      own_model_->law =
          UnderUv{model.inhibited()->by_front(kDimmest * full / most_uv_share(models))};
    }
  }
  if (reach_x() >= grid.width_px || reach_y() >= grid.height_px) {
    refuse(fmt::format(
        "light spreads over {} x {} pixels to either side, and the images have {} x {}; expected "
        "less (are sigmas in um?)",
        reach_x(), reach_y(), grid.width_px, grid.height_px));
  }
}

/// The spread of light that scatters; with what it goes, `check_supported` has asked.
void SpreadLight::scatter_in(const CureModel& model, const ScatterWay& way,
                             const Turn& to_display) {
  const LightSpread& spread = models_.printer().spread;
  distances_ = distance_blurs(spread, way, model.bath_slices, to_display);
  blur_ = distances_.front().blur;
  for (const DistanceBlur& d : distances_) {
    halo_x_ = std::max(halo_x_, d.blur.reach_x() - blur_.reach_x());
    halo_y_ = std::max(halo_y_, d.blur.reach_y() - blur_.reach_y());
  }
  if (model.bath_slices == 0) return;
  own_model_ = model;
  own_model_->bath_slices = 0;
  own_model_->beyond = 0;
}

PixelBox SpreadLight::grown(const PixelBox& box, int x, int y) const {
  if (box.empty()) return box;
  return common({box.x0 - x, box.y0 - y, box.x1 + x, box.y1 + y}, display_);
}

std::optional<FinestWidths> SpreadLight::finest() const {
  const CureModel& m = models_.brightest();
  if (m.inhibited() || m.gel_time()) return std::nullopt;
  const LightSpread& spread = models_.printer().spread;
  const bool layerwise = m.mode == ExposureMode::layerwise;
  // Layer by layer each layer gels in its own exposure, and black adds up.
  const double full = layerwise ? m.phi_max() * m.a : m.steady(m.phi_max());
  const double black = layerwise ? m.phi_min() * m.a / m.one_minus_a : m.steady(m.phi_min());
  if (spread.none() || !(full > 1.0) || !(black < 0.9)) return std::nullopt;
  const FinestWidths across = finest_widths(spread, false, full, black),
                     down = finest_widths(spread, true, full, black);
  return FinestWidths{std::min(across.line_um, down.line_um), std::min(across.gap_um, down.gap_um)};
}

SpreadBand::SpreadBand(const SpreadLight& light, const SliceSource& stack,
                       const ShownSlices& slices, const PixelBox& window)
    : SpreadBand(light, stack, slices, window, {}) {
  if (same(field_, window)) return;
  for (int y = window.y0; y < window.y1; ++y) {
    for (int x = window.x0; x < window.x1; ++x) columns_.push_back(index(field_, {x, y}));
  }
}

SpreadBand::SpreadBand(const SpreadLight& light, const SliceSource& stack,
                       const ShownSlices& slices, const PixelBox& window,
                       const std::vector<Pixel>& places)
    : light_(light),
      slices_(slices),
      field_(light.grown(window, 0, 0)),
      shown_(common(light.around(window), stack.bounds())),
      coded_(coded_band_of(stack, shown_)),
      images_(slices, coded_) {
  for (const Pixel& place : places) columns_.push_back(index(field_, place));
  if (!light.distances_.empty()) {
    dose_.assign(columns_of(field_), 0.0);
    const CureModel& model = light.model();
    const bool layerwise = model.mode == ExposureMode::layerwise;
    sums_.emplace(light.distances_,
                  DistanceSums::Scene{
                      field_, shown_, light.display_, model.a, model.m,
                      layerwise ? model.a : model.one_minus_a,
                      [this](const DistanceSums::Image* image, const PixelBox& box, double* out) {
                        shine_in(image ? image->data() : nullptr, box, &SpreadBand::intensities, 0,
                                 out);
                      }});
  }
  dark_.resize(columns_of(field_));
  blur(nullptr, field_, dark_);
}

const std::vector<double>& SpreadBand::intensities(std::uint8_t place, int) {
  std::vector<double>& values = intensities_[place];
  if (values.empty() && light_.under_uv()) {
    const std::vector<double> of_level = level_intensities(light_.models_.printer_at(place));
    const int levels = static_cast<int>(of_level.size());
    for (int v = 0; v < 256; ++v) {
      values.push_back(of_level[static_cast<std::size_t>(level_of_pixel(v, levels))]);
    }
  } else if (values.empty()) {
    const PixelCurve& curve = light_.models_.curve(place);
    const double m = light_.model().m;
    values.assign(curve.begin(), curve.end());
    if (const GelTimeKernel* const kernel = light_.model().gel_time()) {
      for (double& v : values) v = kernel->intensity_mw_cm2(v);
    } else if (m != 1.0) {
      for (double& v : values) v = std::pow(v, 1.0 / m);
    }
  }
  return values;
}

const std::vector<double>& SpreadBand::uv_intensities(std::uint8_t place, int setting) {
  std::vector<double>& values = uv_intensities_[setting][place];
  if (values.empty()) {
    const InhibitedKernel& kernel = *light_.models_.brightest().inhibited();
    const double share = uv_share(light_.models_, place);
    for (int v = 0; v < 256; ++v) {
      values.push_back(share *
                       kernel.setting_uv_mw_cm2(setting, level_of_pixel(v, kernel.levels())));
    }
  }
  return values;
}

/// UV light over `field_` where the image is black.
const std::vector<double>& SpreadBand::dark_uv(int setting) {
  std::vector<double>& dark = dark_uv_[setting];
  if (!dark.empty()) return dark;
  const std::uint8_t place = light_.models_.map().greatest();
  dark.assign(columns_of(field_), uv_intensities(place, setting)[0]);
  if (!light_.uv_blur_.none() || light_.models_.of_uv()) {
    blur(nullptr, field_, light_.uv_blur_, &SpreadBand::uv_intensities, setting, dark);
  }
  return dark;
}

PixelBox SpreadBand::lit_box(const std::uint8_t* pixels) const {
  PixelBox lit{shown_.x1, shown_.y1, shown_.x0, shown_.y0};
  const auto width = static_cast<std::size_t>(shown_.width());
  for (int y = shown_.y0; y < shown_.y1; ++y, pixels += width) {
    if (all_zero(pixels, width)) continue;
    lit.y0 = std::min(lit.y0, y);
    lit.y1 = y + 1;
    const auto above = [](std::uint8_t v) { return v != 0; };
    const auto first = std::find_if(pixels, pixels + width, above) - pixels;
    std::size_t past = width;
    while (pixels[past - 1] == 0) --past;
    lit.x0 = std::min(lit.x0, shown_.x0 + static_cast<int>(first));
    lit.x1 = std::max(lit.x1, shown_.x0 + static_cast<int>(past));
  }
  return lit;
}

void SpreadBand::blur(const std::uint8_t* pixels, const PixelBox& to, std::vector<double>& field) {
  blur(pixels, to, light_.blur_, &SpreadBand::intensities, 0, field);
}

void SpreadBand::blur(const std::uint8_t* pixels, const PixelBox& to, const LightBlur& spread,
                      Shine shine, int setting, std::vector<double>& field) {
  const PixelBox from = light_.grown(to, spread.reach_x(), spread.reach_y());
  in_.resize(columns_of(from));
  shine_in(pixels, from, shine, setting, in_.data());
  out_.resize(columns_of(to));
  spread.apply(in_.data(), from, out_.data(), to);
  if (const GelTimeKernel* const kernel = light_.model().gel_time()) {
    for (double& v : out_) v = kernel->phi(v);
  } else if (const double m = light_.model().m; m != 1.0 && !light_.under_uv()) {
    for (double& v : out_) v = std::pow(v, m);
  }
  copy_common(out_, to, field, field_);
}

void SpreadBand::shine_in(const std::uint8_t* pixels, const PixelBox& box, Shine shine, int setting,
                          double* light) {
  const LightMap& map = light_.models_.map();
  const auto width = static_cast<std::size_t>(box.width());
  std::vector<std::uint8_t> row(width), places(width, map.reference());
  for (int y = box.y0; y < box.y1; ++y) {
    std::fill(row.begin(), row.end(), std::uint8_t{0});
    const PixelBox line = common({box.x0, y, box.x1, y + 1}, shown_);
    if (pixels && !line.empty()) {
      std::copy_n(pixels + static_cast<std::ptrdiff_t>(y - shown_.y0) * shown_.width() +
                      (line.x0 - shown_.x0),
                  line.width(), row.begin() + (line.x0 - box.x0));
    }
    double* const out = light + static_cast<std::size_t>(y - box.y0) * width;
    if (map.even()) {
      const double* const of = (this->*shine)(map.reference(), setting).data();
      for (std::size_t i = 0; i < width; ++i) out[i] = of[row[i]];
    } else {
      map.values({box.x0, y, box.x1, y + 1}, places.data());
      for (std::size_t i = 0; i < width; ++i) out[i] = (this->*shine)(places[i], setting)[row[i]];
    }
  }
}

void SpreadBand::show(const std::uint8_t* pixels, Shown& out) {
  const std::size_t size = columns_of(shown_);
  // Walls go straight down: images are often the same again.
  if (!out.field.empty() && std::equal(out.pixels.begin(), out.pixels.end(), pixels)) return;
  out.pixels.assign(pixels, pixels + size);
  if (sums_) out.image = std::make_shared<const DistanceSums::Image>(out.pixels);
  out.field = dark_;
  const PixelBox lit = lit_box(pixels);
  const LightBlur& spread = light_.blur_;
  const PixelBox to = common(light_.grown(lit, spread.reach_x(), spread.reach_y()), field_);
  if (!lit.empty() && !to.empty()) blur(pixels, to, out.field);
}

/// What blue and UV light together give the columns.
void SpreadBand::show_under_uv(const std::uint8_t* pixels, int setting, Shown& out) {
  const std::size_t size = columns_of(shown_);
  if (!out.fronts.empty() && out.setting == setting &&
      std::equal(out.pixels.begin(), out.pixels.end(), pixels)) {
    return;
  }
  out.pixels.assign(pixels, pixels + size);
  out.setting = setting;
  out.field = dark_;
  out.uv = dark_uv(setting);
  const PixelBox lit = lit_box(pixels);
  const auto show = [&](const LightBlur& spread, Shine shine, std::vector<double>& field) {
    const PixelBox to = common(light_.grown(lit, spread.reach_x(), spread.reach_y()), field_);
    if (!lit.empty() && !to.empty()) blur(pixels, to, spread, shine, setting, field);
  };
  show(light_.blur_, &SpreadBand::intensities, out.field);
  const std::vector<double>& of_uv = uv_intensities(light_.models_.map().greatest(), setting);
  if (of_uv.front() != of_uv.back()) show(light_.uv_blur_, &SpreadBand::uv_intensities, out.uv);

  const InhibitedKernel& kernel = *light_.model().inhibited();
  out.fronts.resize(column_count());
  out.own.assign(column_count(), 0);
  double blue = -1, uv = -1;
  FrontLight light;
  for (std::size_t i = 0; i < out.fronts.size(); ++i) {
    const std::size_t at = column(i);
    // Light is the same over much of an image.
    if (out.field[at] != blue || out.uv[at] != uv) {
      blue = out.field[at];
      uv = out.uv[at];
      light = kernel.front_light(blue, uv);
    }
    out.fronts[i] = light;
    const Pixel p{field_.x0 + static_cast<int>(at % static_cast<std::size_t>(field_.width())),
                  field_.y0 + static_cast<int>(at / static_cast<std::size_t>(field_.width()))};
    if (p.x >= shown_.x0 && p.x < shown_.x1 && p.y >= shown_.y0 && p.y < shown_.y1) {
      out.own[i] = pixels[index(shown_, p)];
    }
  }
}

const double* SpreadBand::of_columns(const std::vector<double>& field,
                                     std::vector<double>& room) const {
  if (columns_.empty()) return field.data();
  room.resize(columns_.size());
  for (std::size_t i = 0; i < columns_.size(); ++i) room[i] = field[columns_[i]];
  return room.data();
}

void SpreadBand::scatter(int slice) {
  const CureModel& model = light_.model();
  scattered_ = sums_->next();
  const bool layerwise = model.mode == ExposureMode::layerwise;
  const double gain = (layerwise ? 1.0 : model.a / model.one_minus_a) / model.ratio(slice);
  const double per_phi = (layerwise ? model.a : model.one_minus_a) * model.ratio(slice);
  gained_.resize(dose_.size());
  for (std::size_t i = 0; i < dose_.size(); ++i) {
    gained_[i] = gain * (scattered_[i] - dose_[i]);
    dose_[i] = model.a * scattered_[i];
  }
  std::vector<DistanceSums::Lit> lit;
  for (std::size_t k = 0; k < showings_.size(); ++k) {
    const double weight = per_phi * showings_[k].light;
    lit.push_back({kept_[k].image, model.ratio(slice) * showings_[k].light});
    const std::vector<double>& field = kept_[k].field;
    for (std::size_t i = 0; i < dose_.size(); ++i) dose_[i] += weight * field[i];
  }
  sums_->add(std::move(lit));
  ImageShowing gained;
  gained.setting = kNoExposure;
  gained.phi = of_columns(gained_, gained_of_columns_);
  showings_.push_back(gained);
}

std::span<const ImageShowing> SpreadBand::of(int slice) {
  showings_.clear();
  std::span<const ImageShowing> images = images_.of(slice);
  ImageShowing whole;
  if (!slices_.recorded() && slice < slices_.slices()) {
    pixels_.resize(columns_of(shown_));
    coded_.read(slice, pixels_.data());
    whole.pixels = pixels_.data();
    images = {&whole, 1};
  }
  if (kept_.size() < images.size()) kept_.resize(images.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    ImageShowing& showing = showings_.emplace_back(images[k]);
    if (light_.under_uv()) {
      const int setting = slices_.recorded()
                              ? images[k].setting
                              : light_.models_.brightest().inhibited()->setting_of_slice(slice);
      show_under_uv(images[k].pixels, setting, kept_[k]);
      showing.pixels = kept_[k].own.data();
      showing.fronts = kept_[k].fronts.data();
      // A kernel by fronts has one for all.
      showing.setting = light_.model().inhibited()->settings() == 1 ? 0 : setting;
      continue;
    }
    show(images[k].pixels, kept_[k]);
    showing.pixels = nullptr;
    showing.phi = of_columns(kept_[k].field, kept_[k].phi);
  }
  if (sums_) scatter(slice);
  return showings_;
}

}  // namespace slicecorr::detail
