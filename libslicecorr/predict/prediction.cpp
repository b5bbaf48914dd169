// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/assumed_light.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "slicecorr/verdict.hpp"
#include "support/json/finite.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr {

void FeatureExamples::add(const FeatureExample& example) {
  if (heap_.size() == kMost) {
    if (example >= heap_.front()) return;
    std::pop_heap(heap_.begin(), heap_.end());
    heap_.pop_back();
  }
  heap_.push_back(example);
  std::push_heap(heap_.begin(), heap_.end());
}

void FeatureExamples::merge(const FeatureExamples& other) {
  for (const FeatureExample& e : other.heap_) add(e);
}

std::vector<FeatureExample> FeatureExamples::sorted() const {
  std::vector<FeatureExample> list = heap_;
  std::sort(list.begin(), list.end());
  return list;
}

std::optional<LayerwiseFigures> layerwise_figures(const CureModel& model) {
  if (model.mode != ExposureMode::layerwise || model.inhibited() || !model.adds_up()) {
    return std::nullopt;
  }
  const double longest = model.greatest_ratio();
  return LayerwiseFigures{model.cut_through_um(), model.cut_through_um(longest),
                          model.heterogeneity(), model.gels_further_teeth(longest)};
}

namespace {

using nlohmann::ordered_json;

constexpr double kDoseUnit = 4294967296.0;

ordered_json front_json(const FrontDose& f) {
  return {{"dose", {{"min", f.min}, {"mean", f.mean}, {"max", f.max}}},
          {"within_10_percent", f.within_10},
          {"dead_zone_um", {{"min", f.dead_zone_min_um}, {"max", f.dead_zone_max_um}}},
          {"window_dose", f.max_window}};
}

ordered_json flow_json(const FlowDoses& flow) {
  ordered_json slices = ordered_json::array();
  for (const FlowDoses::Slice& s : flow.slices) {
    ordered_json slice{{"slice", s.slice}, {"area_mm2", s.area_mm2}, {"lit_share", s.lit}};
    slice.update(front_json(s.even));
    slice["without"] = front_json(s.without);
    slices.push_back(std::move(slice));
  }
  return {{"gap_um", flow.gap_um},
          {"within_10_percent", flow.within_10()},
          {"without", {{"within_10_percent", flow.within_10_without()}}},
          {"slices", std::move(slices)}};
}

unsigned __int128 scaled(double value) {
  return static_cast<std::uint64_t>(std::llround(value * kDoseUnit));
}
double mean_of(unsigned __int128 sum, std::uint64_t count) {
  return count ? static_cast<double>(sum) / kDoseUnit / static_cast<double>(count) : 0.0;
}

}  // namespace

void RegionDose::add(double wanted, double dose) {
  ++voxels;
  least_wanted = std::min(least_wanted, wanted);
  greatest_wanted = std::max(greatest_wanted, wanted);
  least = std::min(least, dose);
  greatest = std::max(greatest, dose);
  most_below = std::max(most_below, wanted - dose);
  most_above = std::max(most_above, dose - wanted);
  sum_ += scaled(dose);
  wanted_sum_ += scaled(wanted);
  off_sum_ += scaled(std::abs(dose - wanted));
}

void RegionDose::merge(const RegionDose& o) {
  voxels += o.voxels;
  least_wanted = std::min(least_wanted, o.least_wanted);
  greatest_wanted = std::max(greatest_wanted, o.greatest_wanted);
  least = std::min(least, o.least);
  greatest = std::max(greatest, o.greatest);
  most_below = std::max(most_below, o.most_below);
  most_above = std::max(most_above, o.most_above);
  sum_ += o.sum_;
  wanted_sum_ += o.wanted_sum_;
  off_sum_ += o.off_sum_;
}

double RegionDose::mean() const { return mean_of(sum_, voxels); }
double RegionDose::mean_wanted() const { return mean_of(wanted_sum_, voxels); }
double RegionDose::mean_off() const { return mean_of(off_sum_, voxels); }

double Prediction::plane_signed_um() const {
  const std::uint64_t edges = plane_error_um.count();
  return edges ? 1e-3 * static_cast<double>(plane_signed_nm) / static_cast<double>(edges) : 0;
}

double Prediction::iou() const {
  const std::uint64_t both = target_voxels - undercure_voxels;
  const std::uint64_t either = target_voxels + cure_through_voxels;
  return either ? static_cast<double>(both) / static_cast<double>(either) : 1.0;
}

void JointFigures::merge(const JointFigures& o) {
  least = std::min(least, o.least);
  not_holding_voxels += o.not_holding_voxels;
  films += o.films;
  liquid_layers_max = std::max(liquid_layers_max, o.liquid_layers_max);
  exchanged_error_um.merge(o.exchanged_error_um);
  exchanged_max_um = std::max(exchanged_max_um, o.exchanged_max_um);
  staying_error_um.merge(o.staying_error_um);
  staying_max_um = std::max(staying_max_um, o.staying_max_um);
  if (o.exchange) exchange = o.exchange;
}

void Prediction::merge(const Prediction& o) {
  if (o.joints) {
    if (!joints) joints.emplace();
    joints->merge(*o.joints);
  }
  using P = Prediction;
  for (const auto counted :
       {&P::target_voxels, &P::printed_voxels, &P::cure_through_voxels, &P::undercure_voxels,
        &P::grey_voxels, &P::left_alone_voxels, &P::gap_teeth, &P::runs, &P::gaps,
        &P::lost_features, &P::lost_thick_features, &P::split_features, &P::liquid_at_platform,
        &P::runs_on_platform, &P::one_slice_gaps, &P::merged_features, &P::merged_thick_gaps,
        &P::plane_closed, &P::plane_lost}) {
    this->*counted += o.*counted;
  }
  if (!layerwise) layerwise = o.layerwise;
  // Of equal errors the first in reading order counts: merging from the top down keeps it.
  if (o.worst_x >= 0) {
    const double mine = worst_x >= 0 ? height_error_um.greatest() : -1.0;
    const double theirs = o.height_error_um.greatest();
    const bool earlier = o.worst_y < worst_y || (o.worst_y == worst_y && o.worst_x < worst_x);
    if (theirs > mine || (theirs == mine && earlier)) {
      worst_x = o.worst_x;
      worst_y = o.worst_y;
    }
  }
  for (const auto examples : {&P::lost_examples, &P::merged_examples, &P::split_examples,
                              &P::plane_closed_examples, &P::plane_lost_examples}) {
    (this->*examples).merge(o.*examples);
  }
  for (const auto histogram : {&P::height_error_um, &P::surface_error_um, &P::plane_error_um,
                               &P::gap_contrast, &P::grey_dose_error}) {
    (this->*histogram).merge(o.*histogram);
  }
  plane_signed_nm += o.plane_signed_nm;
  at_heights = at_heights || o.at_heights;
  for (const auto most : {&P::plane_overreach_um, &P::plane_shortfall_um, &P::greatest_overreach_um,
                          &P::greatest_shortfall_um, &P::max_dose_inside, &P::max_dose_outside,
                          &P::black_alone_dose}) {
    this->*most = std::max(this->*most, o.*most);
  }
  for (const auto least : {&P::min_dose_inside, &P::min_inside_layers}) {
    this->*least = std::min(this->*least, o.*least);
  }
}

std::string Prediction::to_json() const {
  using nlohmann::ordered_json;
  const auto or_null = [](bool known, double value) {
    return known ? ordered_json(value) : ordered_json();
  };
  const bool edges = height_error_um.count() > 0;
  const bool contrasts = gap_contrast.count() > 0;
  const bool greys = grey_dose_error.count() > 0;
  ordered_json j;
  j["layers"] = layers;
  if (heights.alike()) {
    j["layer_um"] = layer_um;
  } else {
    std::vector<double> each;
    each.reserve(static_cast<std::size_t>(layers));
    for (int n = 0; n < layers; ++n) each.push_back(heights.of(n, layer_um));
    j["layer_um"] = each;
  }
  if (pixel_x_um == pixel_y_um) {
    j["pixel_um"] = pixel_x_um;
  } else {
    j["pixel_um"] = {pixel_x_um, pixel_y_um};
  }
  j["target_voxels"] = target_voxels;
  j["printed_voxels"] = printed_voxels;
  j["cure_through_voxels"] = cure_through_voxels;
  j["undercure_voxels"] = undercure_voxels;
  j["iou"] = iou();
  j["height_error_um"] = {{"mean_abs", or_null(edges, height_error_um.mean())},
                          {"p95_abs", or_null(edges, height_error_um.quantile(0.95))},
                          {"max_abs", or_null(edges, height_error_um.greatest())},
                          {"edges", height_error_um.count()},
                          {"max_overreach", or_null(edges, greatest_overreach_um)},
                          {"max_shortfall", or_null(edges, greatest_shortfall_um)}};
  if (uncertain && edges) {
    const EdgeBands &upper = uncertain->upper, &lower = uncertain->lower;
    const double count = static_cast<double>(upper.edges + lower.edges);
    j["height_error_um"]["band95"] = {(upper.weak_um.value() + lower.weak_um.value()) / count,
                                      (upper.strong_um.value() + lower.strong_um.value()) / count};
  }
  if (joints) {
    const bool any = joints->exchanged_error_um.count() > 0;
    j["height_error_um"]["exchanged"] = {
        {"mean_abs", or_null(any, joints->exchanged_error_um.mean())},
        {"max_abs", or_null(any, joints->exchanged_max_um)}};
    j["height_error_um"]["staying"] = {{"mean_abs", or_null(any, joints->staying_error_um.mean())},
                                       {"max_abs", or_null(any, joints->staying_max_um)}};
  }
  const bool surface = surface_error_um.count() > 0;
  j["surface_error_um"] = {{"mean_abs", or_null(surface, surface_error_um.mean())},
                           {"p95_abs", or_null(surface, surface_error_um.quantile(0.95))},
                           {"max_abs", or_null(surface, surface_error_um.greatest())},
                           {"edges", surface_error_um.count()}};
  const bool plane = plane_error_um.count() > 0;
  j["edge_error_in_plane_um"] = {{"mean_abs", or_null(plane, plane_error_um.mean())},
                                 {"mean", or_null(plane, plane_signed_um())},
                                 {"p95_abs", or_null(plane, plane_error_um.quantile(0.95))},
                                 {"max_abs", or_null(plane, plane_error_um.greatest())},
                                 {"edges", plane_error_um.count()},
                                 {"max_overreach", or_null(plane, plane_overreach_um)},
                                 {"max_shortfall", or_null(plane, plane_shortfall_um)},
                                 {"closed", plane_closed},
                                 {"lost", plane_lost}};
  if (finest) j["finest_um"] = {{"line", finest->line_um}, {"gap", finest->gap_um}};
  // Where nobody looked the names are known nevertheless.
  const JudgedBodies* const hanging = bodies.get();
  if (hanging) {
    j.update(slicecorr::detail::own_json<ordered_json>(hanging->printed.to_json()));
    j["designed"] = {{"loose_bodies", hanging->designed.loose_bodies},
                     {"islands_in_all", hanging->designed.islands_in_all},
                     {"loose_bodies_whole", nullptr}};
    if (hanging->loose_whole) j["designed"]["loose_bodies_whole"] = *hanging->loose_whole;
  } else {
    j["loose_bodies"] = j["islands_in_all"] = nullptr;
  }
  j["runs"] = runs;
  j["gaps"] = gaps;
  j["lost_features"] = lost_features;
  j["lost_features_two_slices_or_more"] = lost_thick_features;
  j["split_features"] = split_features;
  j["liquid_at_platform"] = liquid_at_platform;
  j["one_slice_gaps"] = one_slice_gaps;
  j["merged_features"] = merged_features;
  j["merged_gaps_two_slices_or_more"] = merged_thick_gaps;
  if (black_alone_dose > 0) j["black_alone_dose"] = black_alone_dose;
  j["dose"] = {{"min_inside", or_null(target_voxels > 0, min_dose_inside)},
               {"max_inside", or_null(target_voxels > 0, max_dose_inside)},
               {"min_inside_layers", or_null(target_voxels > 0, min_inside_layers)},
               {"max_outside", or_null(max_dose_outside >= 0, max_dose_outside)}};
  if (!regions.empty()) {
    auto& list = j["regions"] = ordered_json::array();
    for (const RegionDose& r : regions) {
      if (r.voxels == 0) {
        list.push_back({{"name", r.name}, {"voxels", 0}});
        continue;
      }
      list.push_back(
          {{"name", r.name},
           {"voxels", r.voxels},
           {"wanted",
            {{"min", r.least_wanted}, {"mean", r.mean_wanted()}, {"max", r.greatest_wanted}}},
           {"dose", {{"min", r.least}, {"mean", r.mean()}, {"max", r.greatest}}},
           {"off",
            {{"mean_abs", r.mean_off()},
             {"most_below", r.most_below},
             {"most_above", r.most_above}}}});
    }
  }
  j["gap_contrast"] = {{"min", or_null(contrasts, gap_contrast.least())},
                       {"p05", or_null(contrasts, gap_contrast.quantile(0.05))}};
  j["grey_voxels"] = grey_voxels;
  if (left_alone_voxels > 0) j["left_alone_voxels"] = left_alone_voxels;
  j["grey_dose_error"] = {{"mean_abs", or_null(greys, grey_dose_error.mean())},
                          {"p95_abs", or_null(greys, grey_dose_error.quantile(0.95))}};
  if (joints) {
    j["joints"] = {{"least", slicecorr::detail::finite_or_null(joints->least)},
                   {"not_holding_voxels", joints->not_holding_voxels},
                   {"films", joints->films},
                   {"liquid_layers_max", joints->liquid_layers_max}};
  }
  if (layerwise) {
    j["layerwise"] = {{"cut_through_um", layerwise->cut_through_um},
                      {"max_cut_through_um", layerwise->max_cut_through_um},
                      {"heterogeneity", layerwise->heterogeneity},
                      {"gels_further_teeth", layerwise->gels_further_teeth},
                      {"gap_teeth", gap_teeth}};
  }
  if (flow) j["flow"] = flow_json(*flow);
  if (dead_zones) {
    const auto um = [](double value) { return detail::finite_or_null(value); };
    ordered_json slices = ordered_json::array();
    for (std::size_t n = 0; n < dead_zones->least_um.size(); ++n) {
      slices.push_back({um(dead_zones->least_um[n]), um(dead_zones->greatest_um[n])});
    }
    j["dead_zone_um"] = {{"min", um(dead_zones->least())},
                         {"max", um(dead_zones->greatest())},
                         {"by_slice", slices}};
    j["window_cured_pixels"] = dead_zones->cured_pixels;
  }
  if (uncertain)
    j["uncertainty"] = slicecorr::detail::own_json<nlohmann::ordered_json>(uncertain->to_json());
  if (other_wavelength) {
    j["other_wavelength"] = {{"printer_nm", other_wavelength->printer_nm},
                             {"resin_nm", other_wavelength->resin_nm}};
  }
  if (other_display) {
    j["other_display"] = other_display->empty() ? ordered_json() : ordered_json(*other_display);
  }
  if (assumed != AssumedLight::none) j["assumed"] = name_of(assumed);
  const PrintVerdict verdict = verdict_of(*this);
  j["outcome"] = name_of(verdict.outcome);
  j["verdict"] = verdict.words;
  j["worst_pixel"] = worst_x >= 0 ? ordered_json{worst_x, worst_y} : ordered_json();
  return j.dump(2);
}

}  // namespace slicecorr
