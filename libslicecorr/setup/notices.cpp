// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the user should know of a setup.
#include <fmt/format.h>

#include <utility>

#include "setup/exposures.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {

using detail::has_first_exposure;
using detail::trimmed;

namespace {

/// What a resin shrinks by, where slices that come from elsewhere may not have been made for it.
std::string shrinkage_notice(const Resin& resin, const StackInfo* times) {
  if (times == nullptr || times->made_for == resin.shrinkage) return {};
  const auto words = [](const Shrinkage& s) {
    return s.any() ? shrinkage_in_words(s) : std::string("does not shrink");
  };
  if (times->kind == StackKind::foreign) {
    return fmt::format(
        "resin '{}' {}: the slices of another program stay as they are, and whether it counted that nobody knows; "
        "a slicer's own shrinkage and elephant's foot should be off, or the resin's file say none",
        resin.name, words(resin.shrinkage));
  }
  return fmt::format(
      "resin '{}' {}, but the slices were made for one that {}; prints are off by as much: slice the mesh anew with "
      "this resin",
      resin.name, words(resin.shrinkage), words(times->made_for));
}

/// What became of an archive's first exposure when another one follows it; empty when nothing is
/// to be said.
std::string first_exposure_notice(const Process& p, const StackInfo* times) {
  if (p.mode == ExposureMode::layerwise && times && times->kind == StackKind::foreign &&
      p.bottom_layers + p.fade_layers == 0 && !times->layer_exposure_s.empty()) {
    if (p.layer_exposure_s.empty()) {
      return fmt::format(
          "the archive's own exposures of its layers, {:g} s for the first, are not kept: every layer gets "
          "{:g} s, also those by which the part holds on to the platform",
          times->layer_exposure_s.front(), p.exposure_s);
    }
    const bool follow = p.exposure_s != times->layer_exposure_s.back() &&
                        p.layer_exposure_s == detail::listed_first_exposures(times, p.exposure_s);
    return follow ? "the archive's longer first exposures stay, in steps to the new one: " +
                        exposures_in_words(p)
                  : "";
  }
  const bool changed = p.mode == ExposureMode::layerwise && p.layer_exposure_s.empty() &&
                       has_first_exposure(times) && times->exposure_s > 0 &&
                       p.exposure_s != times->exposure_s;
  if (!changed) return {};
  if (p.bottom_layers + p.fade_layers == 0) {
    if (times->bottom_exposure_s > p.exposure_s) return {};  // as was asked
    return fmt::format(
        "the archive's first exposure of {:g} s is not longer than the new one: layers get {:g} s "
        "from the first on",
        times->bottom_exposure_s, p.exposure_s);
  }
  if (p.bottom_exposure_s != times->bottom_exposure_s || p.bottom_layers != times->bottom_layers ||
      p.fade_layers != times->fade_layers) {
    return {};
  }
  return "the archive's longer first exposure stays: " + exposures_in_words(p);
}

}  // namespace

namespace {

std::string value_in_words(const SettingValue& value) {
  return std::visit(
      [](const auto& v) -> std::string {
        using Value = std::decay_t<decltype(v)>;
        if constexpr (std::is_same_v<Value, std::monostate>) return "nothing";
        if constexpr (std::is_same_v<Value, std::span<const double>>) {
          return v.empty() ? "none" : fmt::format("{} numbers", v.size());
        }
        if constexpr (std::is_same_v<Value, double>) return fmt::format("{:.6g}", v);
        if constexpr (std::is_same_v<Value, int>) return fmt::format("{}", v);
        if constexpr (std::is_same_v<Value, std::string_view>) return std::string(v);
      },
      value);
}

}  // namespace

std::vector<std::string> other_than_made(const Setup& setup, const StackInfo& made,
                                         ChoiceNames names) {
  std::vector<std::string> told;
  const auto tell = [&](const std::string& what, const std::string& was, const std::string& is) {
    told.push_back(
        fmt::format("{}: the stack was made with {}, and is measured with {}", what, was, is));
  };
  for (const Setting& s : settings()) {
    if (!made.process || s.block == BlockPart::none || s.corrects ||
        std::holds_alternative<std::monostate>(s.process) ||
        same_setting(s, setup.process, *made.process)) {
      continue;
    }
    tell(setting_name(names, s.name), value_in_words(setting_value(s, *made.process)),
         value_in_words(setting_value(s, setup.process)));
  }
  if (const auto& p = made.printer) {
    const Printer& q = setup.printer;
    if (p->name != q.name || p->width_px != q.width_px || p->height_px != q.height_px ||
        p->calibration != q.calibration) {
      tell("printer", fmt::format("'{}' of {} x {} pixels", p->name, p->width_px, p->height_px),
           fmt::format("'{}' of {} x {}", q.name, q.width_px, q.height_px));
    }
  }
  if (const auto& r = made.resin) {
    const Resin& q = setup.resin;
    if (r->name != q.name || r->absorbance_height10_um != q.absorbance_height10_um) {
      tell("resin", fmt::format("'{}' of {:.4g} um", r->name, r->absorbance_height10_um),
           fmt::format("'{}' of {:.4g} um", q.name, q.absorbance_height10_um));
    }
  }
  return told;
}

std::vector<std::string> choices_past(const SetupChoices& choices, const StackInfo& made,
                                      ChoiceNames names) {
  std::vector<std::string> told;
  if (!made.process) return told;
  for (const Setting& s : settings()) {
    if (!s.corrects || !is_said(s, choices)) continue;
    told.push_back(
        fmt::format("{} says how a part is corrected: this stack is, and it changes nothing",
                    setting_name(names, s.name)));
  }
  return told;
}

std::vector<std::string> setup_notices(const Setup& setup, const StackInfo* times,
                                       ChoiceNames names) {
  std::vector<std::string> notices =
      definition_notices(setup.printer, setup.resin, setup.process.uv.kind != UvKind::off);
  if (std::string text = assumption_in_words(setup.printer, setup.resin, setup.process);
      !text.empty()) {
    notices.push_back(std::move(text));
  }
  if (setup.printer.levels() == 2) {
    notices.push_back(fmt::format(
        "printer '{}' shows black and white alone (bit_depth = 1): greys of the slices become one of both",
        setup.printer.name));
  }
  if (setup.process.uv.kind == UvKind::off && setup.resin.inhibition && setup.printer.uv) {
    notices.push_back(fmt::format(
        "the UV lamp of printer '{}' counts as off: without {} or {} the inhibition of resin '{}' "
        "is not considered",
        setup.printer.name, setting_name(names, "uv_mw_cm2"), setting_name(names, "dead_zone_um"),
        setup.resin.name));
  }
  if (setup.process.ramp == Ramp::lamp_follows) {
    notices.push_back(fmt::format(
        "the lamps follow the stage while it gets to its speed, over the first and last {:g} mm",
        setup.process.ramp_mm));
  }
  if (setup.printer.suction_limit_pa > 0 && !(setup.resin.viscosity_pa_s > 0) &&
      setup.process.mode == ExposureMode::continuous) {
    notices.push_back(fmt::format(
        "printer '{}' says what suction it bears (suction_limit_pa); without the viscosity of resin "
        "'{}' (viscosity_pa_s) nobody knows how much there is",
        setup.printer.name, setup.resin.name));
  }
  const double depth_um = setup.printer.resin_depth_um;
  if (depth_um > 0 && depth_um < 2 * setup.resin.absorbance_height10_um) {
    notices.push_back(fmt::format(
        "the resin is {:g} um deep, less than two absorbance heights ({:g} um): light goes out at "
        "its far side",
        depth_um, 2 * setup.resin.absorbance_height10_um));
  }
  if (std::string text = light_share_in_words(setup.process); !text.empty()) {
    notices.push_back("layers are lit with " + text +
                      (times && trimmed(times->light_share) == setup.process.light_share
                           ? ", as the archive says"
                           : "") +
                      ": doses are those of that light");
  }
  if (!setup.process.lamp_share.empty()) {
    Process lamp;
    lamp.light_share = setup.process.lamp_share;
    notices.push_back("the lamp still gives " + light_share_in_words(lamp) +
                      ": doses are those of that light");
  }
  if (const auto& uv_lamp = setup.process.uv_lamp_share; !uv_lamp.empty()) {
    notices.push_back(setup.process.uv.kind == UvKind::off
                          ? "the log of the UV lamp is not used: there is no UV light"
                          : "the UV lamp still gives " + shares_in_words(uv_lamp) +
                                " of what is asked of it");
  }
  if (setup.printer.distortion && times && times->kind == StackKind::foreign) {
    notices.push_back(
        "the slices of the archive were made for an even grid and stay where they are; pixels land " +
        distortion_in_words(setup.printer));
  }
  if (std::string text = shrinkage_notice(setup.resin, times); !text.empty()) {
    notices.push_back(std::move(text));
  }
  if (std::string text = first_exposure_notice(setup.process, times); !text.empty()) {
    notices.push_back(std::move(text));
  }
  return notices;
}

}  // namespace slicecorr
