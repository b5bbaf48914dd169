// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/place_plans.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "bands/place_check.hpp"
#include "correct/inhibited_plan.hpp"
#include "process/even_back.hpp"

namespace slicecorr::detail {

PlacePlans::PlacePlans(const SliceSource& target, const Setup& setup,
                       const ExecutionContext& context)
    : process_(setup.process),
      models_(fitting(setup, target), setup.resin, setup.process, target.grid(), target.frame()),
      images_(target.grid()),
      layers_(target.grid().layers),
      levels_(setup.printer.levels()) {
  refuse_recording(target);
  if (setup.uncertainty && setup.uncertainty->robust) {
    check_correction(setup, {target.left_alone() != nullptr, target.doses() != nullptr});
    robust_ = setup.uncertainty;
  }
  const double exchange_sd =
      setup.uncertainty ? setup.uncertainty->sd(UncertainInput::exchange) : 0.0;
  // 95 % of what is believed, and more.
  constexpr double sds = 2;
  if (exchange_sd > 0 && setup.process.lift_exchange >= 0) {
    most_exchange_ = std::min(1.0, setup.process.lift_exchange + sds * exchange_sd);
  }
  all_layers_ = slices_to_show(target, models_, setup, context);
  if (robust_) check_cases(models_.brightest(), cases(models_.map().greatest()), *robust_);
}

const RobustCases& PlacePlans::cases(std::uint8_t value) const {
  const std::lock_guard lock(making_[value]);
  auto& made = cases_[value];
  if (!made) made = std::make_unique<const RobustCases>(models_, value, *robust_);
  return *made;
}

const CorrectionPlan& PlacePlans::plan(std::uint8_t value) const {
  const std::lock_guard lock(making_[value]);
  auto& made = plans_[value];
  if (!made) {
    CorrectionPlan plan(models_.model(value), process_, layers_, all_layers_);
    if (plan.model.lifts) plan.most_exchange = most_exchange_;
    if (as_planned_ && plan.inhibited) {
      auto planned = std::make_shared<InhibitedPlan>(*plan.inhibited);
      planned->tuning.as_planned = true;
      plan.inhibited = std::move(planned);
    }
    made = std::make_unique<const CorrectionPlan>(std::move(plan));
  }
  return *made;
}

BandCorrector::ColumnLevels PlacePlans::even_levels(
    std::uint8_t value, const BandPredictor::PixelOfColumn& place) const {
  if (!process_.even_light) return {};
  const LevelTable levels(level_intensities(models_.printer_at(value)));
  const double full = level_intensities(models_.printer()).back();
  const auto slices = static_cast<std::size_t>(all_layers_);
  // The level of each light, by what slices get of the usual light.
  const Process lit = as_lamp_shines(process_);
  const EvenBack back(models_.printer(), models_.resin(), process_, images_.layer_um);
  std::vector<double> of_usual;
  std::vector<std::array<std::uint8_t, 256>> level_of;
  std::vector<std::size_t> of_slice;
  for (std::size_t n = 0; n < slices; ++n) {
    const double own = light_share(lit, static_cast<int>(n)) / usual_light_share(lit) *
                       back.times(static_cast<int>(n));
    const auto at = std::find(of_usual.begin(), of_usual.end(), own);
    of_slice.push_back(static_cast<std::size_t>(at - of_usual.begin()));
    if (at != of_usual.end()) continue;
    of_usual.push_back(own);
    level_of.emplace_back();
    for (std::size_t share = 0; share < level_of.back().size(); ++share) {
      const double wanted = full * static_cast<double>(share) / 255.0 / own;
      const auto [below, above] = levels.around(wanted);
      const bool nearer = wanted - levels.phi(below) <= levels.phi(above) - wanted;
      level_of.back()[share] = static_cast<std::uint8_t>(nearer ? below : above);
    }
  }
  const EvenPixels pixels(*process_.even_light, images_);
  return [=](std::size_t column, std::uint8_t* most) {
    const Pixel pixel = place(column);
    const std::span<std::uint8_t> shares(most, slices);
    pixels.blue_of(pixel.x, pixel.y, shares);
    for (std::size_t n = 0; n < slices; ++n) shares[n] = level_of[of_slice[n]][shares[n]];
  };
}

Prediction whole_image(const Prediction& in_groups, const PlaceModels& models, const Grid& grid,
                       int slices, const LightCounts& in_all_groups, const ShownSlices* recorded) {
  // Columns that the part does not light get black light alone: only the brightest of them matter.
  const LightCounts display = models.map().counts({0, 0, grid.width_px, grid.height_px});
  Prediction sum;
  for (std::size_t v = 256; v-- > 0;) {
    if (display[v] <= in_all_groups[v]) continue;
    sum = black_columns(models.model(static_cast<std::uint8_t>(v)), slices,
                        display[v] - in_all_groups[v], recorded);
    break;
  }
  sum.layers = slices;
  sum.layerwise = layerwise_figures(models.brightest());
  sum.layer_um = grid.layer_um;
  sum.heights = models.brightest().heights;
  sum.pixel_x_um = grid.pixel_x_um;
  sum.pixel_y_um = grid.pixel_y_um;
  sum.merge(in_groups);
  return sum;
}

double paired_share(const PlaceModels& models, std::uint8_t value) {
  return models.paired() ? models.uv_factor(models.map().greatest()) / models.uv_factor(value) : 1;
}

void PlaceWindows::merge(std::uint8_t value, const WindowWatch& band) {
  auto& total = totals_[value];
  if (!total) total = std::make_unique<WindowTotal>(models_.model(value), slices_);
  total->merge(band);
}

DeadZones PlaceWindows::result() const {
  DeadZones all;
  const double none = std::numeric_limits<double>::quiet_NaN();
  all.least_um.assign(static_cast<std::size_t>(slices_), none);
  all.greatest_um = all.least_um;
  for (const auto& total : totals_) {
    if (!total) continue;
    const DeadZones one = total->result();
    for (std::size_t n = 0; n < all.least_um.size(); ++n) {
      // fmin and fmax leave out what is NaN.
      all.least_um[n] = std::fmin(all.least_um[n], one.least_um[n]);
      all.greatest_um[n] = std::fmax(all.greatest_um[n], one.greatest_um[n]);
    }
    all.cured_pixels += one.cured_pixels;
    if (one.cured_slice >= 0 && (all.cured_slice < 0 || one.cured_slice < all.cured_slice)) {
      all.cured_slice = one.cured_slice;
    }
  }
  return all;
}

std::vector<double> PlaceWindows::greatest_mw_cm2() const {
  std::vector<double> greatest(static_cast<std::size_t>(slices_), 0.0);
  for (std::size_t v = 0; v < totals_.size(); ++v) {
    if (!totals_[v]) continue;
    const auto value = static_cast<std::uint8_t>(v);
    std::vector<double> blue = level_intensities(models_.printer_at(value));
    // As bright as it is for the UV light of the place that is counted from.
    for (double& of_level : blue) of_level *= paired_share(models_, value);
    // Pulses are full light while they last.
    if (models_.printer().grey == GreyLight::pulsed) {
      std::fill(blue.begin() + 1, blue.end(), blue.back());
    }
    const std::vector<std::uint8_t>& brightest = totals_[v]->brightest();
    for (std::size_t n = 0; n < greatest.size(); ++n) {
      const int level = level_of_pixel(brightest[n], static_cast<int>(blue.size()));
      greatest[n] = std::max(greatest[n], blue[static_cast<std::size_t>(level)]);
    }
  }
  return greatest;
}

}  // namespace slicecorr::detail
