// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Setups: settings by name, so that new ones need no new functions.

#include "slicecorr/setup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <new>
#include <variant>

#include "c_api/handles.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::c_api {

namespace {

using Text = std::string Choices::*;
using Number = double Choices::*;  ///< above 0
using Count = int Choices::*;      ///< 0 to 1000000
using Numbers = std::vector<double> Choices::*;

struct Setting {
  const char* name;
  std::variant<Text, Number, Count, Numbers> member;
  const char* what;
  std::vector<std::string_view> words = {};  ///< texts that are accepted; empty: all
};

const std::vector<Setting>& settings() {
  using C = Choices;
  static const std::vector<Setting> all = {
      {"printer", &C::printer, "printer: name of a definition, or path of a .toml file"},
      {"resin", &C::resin, "resin: name of a definition, or path of a .toml file"},
      {"printer_toml", &C::printer_toml, "text of a printer file"},
      {"resin_toml", &C::resin_toml, "text of a resin file"},
      {"mode",
       &C::mode,
       "continuous: the stage moves while slices are shown; layerwise: it stands still",
       {"continuous", "layerwise"}},
      {"speed_mm_h", &C::speed_mm_h, "print speed (continuous)"},
      {"slice_speed_mm_h", &C::slice_speed_mm_h,
       "speed at each slice, at most speed_mm_h (continuous)"},
      {"slice_lamps",
       &C::slice_lamps,
       "with it, whether the lamps follow (doses stay) or stay (slower slices get more): follow or stay",
       {"follow", "stay"}},
      {"exposure_s", &C::exposure_s, "light-on time of a layer (layerwise)"},
      {"bottom_exposure_s", &C::bottom_exposure_s, "light-on time of the first layers (layerwise)"},
      {"bottom_layers", &C::bottom_layers, "number of these first layers"},
      {"fade_layers", &C::fade_layers, "layers after them that lead to the normal time"},
      {"layer_exposure_s", &C::layer_exposure_s, "light-on time of each layer (layerwise)"},
      {"dc_mj_cm3", &C::dc_mj_cm3, "dose to aim at, instead of the resin's"},
      {"dose_factor", &C::dose_factor, "dose to aim at over the gel dose, instead of the resin's"},
      {"ha_um", &C::ha_um, "absorbance height, base 10, instead of the resin's"},
      {"resin_depth_um", &C::resin_depth_um,
       "depth of the resin above the window, instead of the printer's"},
      {"platform_reflectance", &C::platform_reflectance,
       "share of the light that the platform sends back, 0 to 1, instead of the printer's"},
      {"omega_max", &C::omega_max,
       "cap of the dose inside features, in critical doses: inf, or 1 and more"},
      {"one_slice_gaps",
       &C::one_slice_gaps,
       "gaps one slice high: open or merge",
       {"open", "merge"}},
      {"gap_shortfall", &C::gap_shortfall,
       "what the feature above an open gap one slice high may lose, in slices, at most 0.5"},
      {"edge_aim_um", &C::edge_aim_um,
       "how near edges are aimed at, um; more leaves low gaps darker; some 0.05 when not set"},
      {"platform_features",
       &C::platform_features,
       "whether omega_max holds for features on the platform: capped or uncapped",
       {"capped", "uncapped"}},
      {"surface",
       &C::surface,
       "where edges lie whose heights the target knows: there (mesh), or at its slices",
       {"slices", "mesh"}},
      {"spread_correction",
       &C::spread_correction,
       "where light spreads: columns together (on) or each alone (off)",
       {"on", "off"}},
      {"rounds", &C::rounds, "most rounds of correcting columns together"},
      {"uv_mw_cm2", &C::uv_mw_cm2, "intensity of inhibiting UV light"},
      {"dead_zone_um", &C::dead_zone_um, "dead zone at the window that the UV light is to hold"},
      {"gap_um", &C::gap_um, "gap between part and window that suction is judged with"},
      {"even_dead_zone",
       &C::even_dead_zone,
       "find light with which dose and dead zone are even although resin flows: auto, constant, blue, "
       "uv, both",
       {"auto", "constant", "blue", "uv", "both"}},
      {"uv_schedule",
       &C::uv_schedule,
       "how the UV light goes: constant, per-slice or patterned",
       {"constant", "per-slice", "patterned"}},
      {"window_cure",
       &C::window_cure,
       "when the resin would cure to the window: refuse or allow",
       {"refuse", "allow"}},
      {"ramp",
       &C::ramp,
       "where the stage speeds up and slows down: none, lamp-follows or outside",
       {"none", "lamp-follows", "outside"}},
      {"ramp_mm", &C::ramp_mm, "distance in which the stage reaches its speed"},
      {"leave_alone", &C::leave_alone,
       "path of a mesh on the plate, or of a stack like the target, of what is shown as it is "
       "sliced: supports, rafts"},
      {"uncertain", &C::uncertain,
       "by how much inputs may be off: ha=5%,dc=5%, or fit for what the resin's file says"},
      {"robust",
       &C::robust,
       "keep features and gaps for all that uncertain names: on or off",
       {"on", "off"}},
      {"tolerance_um", &C::tolerance_um, "how far edges may lie from the design (plan)"},
      {"gap_contrast", &C::gap_contrast, "1 less the least dose that gaps are to have (plan)"},
      {"voxel_mm", &C::voxel_mm, "side of a voxel (tomographic)"},
      {"angles", &C::angles, "frames of a turn (tomographic)"},
      {"method",
       &C::method,
       "how light is found: ladder, osmo, kelly or fbp (tomographic)",
       {std::begin(tomo::kMethodNames), std::end(tomo::kMethodNames)}},
      {"window",
       &C::window,
       "of the filter that it starts from: hamming, ram-lak or kelly (tomographic)",
       {std::begin(tomo::kWindowNames), std::end(tomo::kWindowNames)}},
      {"iterations", &C::iterations, "steps, with the ladder of each rung (tomographic)"},
      {"clip_sigma", &C::clip_sigma,
       "OSMO: cut off light above the mean and so many standard deviations (tomographic)"},
      {"stop_error", &C::stop_error,
       "OSMO: stop when doses are wrong by less than this share of the part's (tomographic)"},
      {"max_time_s", &C::max_time_s, "refuse what takes longer to print (tomographic)"},
      {"beyond_reach",
       &C::beyond_reach,
       "parts that reach further than light from all directions: refuse or allow (tomographic)",
       {"refuse", "allow"}},
  };
  return all;
}

const Setting& setting(const char* name) {
  need(name, "name");
  for (const Setting& s : settings()) {
    if (std::string_view(s.name) == name) return s;
  }
  unknown_name(name, "setting", setting_names());
}

[[noreturn]] void refuse(const Setting& s, const std::string& value, const std::string& expected) {
  throw InputError(fmt::format("{} is {}; expected {}", s.name, value, expected));
}

/// The whole text as a number, whatever the locale.
double number_of(const Setting& s, std::string_view text) {
  double value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) {
    refuse(s, fmt::format("'{}'", text), "a number");
  }
  return value;
}

double positive(const Setting& s, double value) {
  if (!(value > 0) || !std::isfinite(value)) {
    refuse(s, fmt::format("{:g}", value), "a number above 0");
  }
  return value;
}

void take_back(Choices& choices, const Setting& s) {
  const Choices unset;
  std::visit([&](auto member) { choices.*member = unset.*member; }, s.member);
}

void set_number(Choices& choices, const Setting& s, double value) {
  if (s.member == decltype(s.member)(&Choices::platform_reflectance)) {
    if (!(value >= 0 && value <= 1)) refuse(s, fmt::format("{:g}", value), "a number from 0 to 1");
    choices.platform_reflectance = value;
  } else if (const auto* number = std::get_if<Number>(&s.member)) {
    choices.*(*number) = positive(s, value);
  } else if (const auto* count = std::get_if<Count>(&s.member)) {
    if (!(value >= 0 && value <= 1e6) || value != std::floor(value)) {
      refuse(s, fmt::format("{:g}", value), "a whole number from 0 to 1000000");
    }
    choices.*(*count) = static_cast<int>(value);
  } else if (const auto* numbers = std::get_if<Numbers>(&s.member)) {
    choices.*(*numbers) = {positive(s, value)};
  } else if (s.member == decltype(s.member)(&Choices::omega_max)) {
    if (!(value >= 1)) refuse(s, fmt::format("{:g}", value), "inf or a number of at least 1");
    choices.omega_max = std::isinf(value) ? "inf" : fmt::format("{}", value);
  } else {
    throw BadCall(fmt::format("{} is no number; expected slicecorr_setup_set_text()", s.name));
  }
}

void set_text(Choices& choices, const Setting& s, const std::string& value) {
  const auto* text = std::get_if<Text>(&s.member);
  const bool is_number = s.member == decltype(s.member)(&Choices::omega_max);
  if (!text || is_number) {
    set_number(choices, s, number_of(s, value));
    return;
  }
  if (!s.words.empty() && std::find(s.words.begin(), s.words.end(), value) == s.words.end()) {
    refuse(s, fmt::format("'{}'", value), fmt::format("{}", fmt::join(s.words, ", ")));
  }
  choices.*(*text) = value;
  // A name and a text say the same thing: what comes last counts.
  if (*text == &Choices::printer) choices.printer_toml.clear();
  if (*text == &Choices::printer_toml) choices.printer.clear();
  if (*text == &Choices::resin) choices.resin_toml.clear();
  if (*text == &Choices::resin_toml) choices.resin.clear();
}

}  // namespace

Names setting_names() {
  Names names;
  for (const Setting& s : settings()) names.emplace_back(s.name, s.what);
  return names;
}

void unknown_name(const char* name, const char* what, const Names& known) {
  std::string text;
  for (const auto& [known_name, meaning] : known) text += (text.empty() ? "" : ", ") + known_name;
  throw UnknownName(fmt::format("no {} '{}'; known are {}", what, name, text));
}

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_setup* slicecorr_setup_new(void) {
  slicecorr_setup* made = nullptr;
  guarded(nullptr, [&] { made = new slicecorr_setup; });
  return made;
}

void slicecorr_setup_free(slicecorr_setup* setup) { delete setup; }

slicecorr_status slicecorr_setup_set_text(slicecorr_setup* setup, const char* name,
                                          const char* value) {
  return guarded(error_of(setup), [&] {
    auto& choices = need(setup, "setup").choices;
    const Setting& s = setting(name);
    if (value && *value) {
      set_text(choices, s, value);
    } else {
      take_back(choices, s);
    }
  });
}

slicecorr_status slicecorr_setup_set_number(slicecorr_setup* setup, const char* name,
                                            double value) {
  return guarded(error_of(setup), [&] {
    auto& choices = need(setup, "setup").choices;
    const Setting& s = setting(name);
    if (std::isnan(value)) {
      take_back(choices, s);
    } else {
      set_number(choices, s, value);
    }
  });
}

slicecorr_status slicecorr_setup_set_numbers(slicecorr_setup* setup, const char* name,
                                             const double* values, size_t count) {
  return guarded(error_of(setup), [&] {
    auto& choices = need(setup, "setup").choices;
    const Setting& s = setting(name);
    const auto* member = std::get_if<Numbers>(&s.member);
    if (!member) throw BadCall(fmt::format("{} is no list of numbers", s.name));
    if (count > 0) need(values, "values");
    if (count > 1000000) refuse(s, fmt::format("{} numbers long", count), "at most 1000000");
    std::vector<double> list;
    for (size_t i = 0; i < count; ++i) list.push_back(positive(s, values[i]));
    choices.*(*member) = std::move(list);
  });
}

const char* slicecorr_setup_error_text(const slicecorr_setup* setup) {
  return setup ? setup->error.c_str() : "";
}
