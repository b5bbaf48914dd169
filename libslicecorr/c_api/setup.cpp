// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Setups: settings by name, so that new ones need no new functions.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <new>
#include <utility>
#include <variant>

#include "c_api/handles.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::c_api {

namespace {

using Text = std::string Choices::*;
using Number = double Choices::*;
using Count = int Choices::*;
using Numbers = std::vector<double> Choices::*;

/// A setting by which the C interface says all that programs say by options: those of `settings()` and
/// those beside them.
struct Named {
  std::string_view name;
  std::variant<Text, Number, Count, Numbers> member;
  std::string what, takes;
  std::vector<std::string_view> words = {};  ///< texts that are accepted; empty: all
  const Setting* setting = nullptr;          ///< of `settings()`
  bool any_number = false;                   ///< negative ones and 0, too
};

const std::vector<Named>& all_settings() {
  using C = Choices;
  static const std::vector<Named> all = [] {
    std::vector<Named> list;
    for (const Setting& s : settings()) {
      const auto member = std::visit(
          [](auto m) -> decltype(Named::member) {
            return static_cast<std::decay_t<decltype(std::declval<C>().*m)> C::*>(m);
          },
          s.chosen);
      list.push_back(
          {s.name, member, setting_text(ChoiceNames::fields, s), setting_takes(s), s.words, &s});
    }
    const auto text = [&](std::string_view name, Text member, const char* what,
                          std::vector<std::string_view> words = {}) {
      const std::string takes = fmt::format("{}", fmt::join(words, ", "));
      list.push_back({name, member, what, takes, std::move(words)});
    };
    const auto number = [&](std::string_view name, Number member, const char* what) {
      list.push_back({name, member, what, "a number above 0"});
    };
    const auto count = [&](std::string_view name, Count member, const char* what) {
      list.push_back({name, member, what, "a whole number from 0 to 1000000"});
    };
    text("leave_alone", &C::leave_alone,
         "path of a mesh on the plate, or of a stack like the target, of what is shown as it is "
         "sliced: supports, rafts");
    text(
        "part_inside", &C::part_inside,
        "paths of meshes, one a line, that the archive was sliced from: they are found there, and what it "
        "lights outside of them, supports and rafts, is left alone");
    text("units", &C::units, "unit of the meshes of part_inside", {"auto", "mm", "inch", "m"});
    number("scale", &C::scale, "factor of the size of the meshes of part_inside");
    number("fit_mm", &C::fit_mm,
           "longest side of all meshes of part_inside together, in place of scale");
    list.push_back(
        {"rotate_deg", &C::rotate_deg,
         "by how much the meshes of part_inside are turned about x, y and z, in this order",
         "three numbers"});
    list.back().any_number = true;
    text("uncertain", &C::uncertain,
         "by how much inputs may be off: ha=5%,dc=5%, or fit for what the resin's file says");
    text("robust", &C::robust, "keep features and gaps for all that uncertain names: on or off",
         {"on", "off"});
    number("tolerance_um", &C::tolerance_um, "how far edges may lie from the design (plan)");
    number("gap_contrast", &C::gap_contrast, "1 less the least dose that gaps are to have (plan)");
    text("design", &C::design, "path of the mesh that was sliced (scan_compare)");
    text("scan_unit", &C::scan_unit, "unit of a scan's numbers (scan_compare)",
         {"auto", "um", "mm", "cm", "inch", "m"});
    number("voxel_um", &C::voxel_um, "side of a voxel of a scan that is a volume (scan_compare)");
    number("voxel_mm", &C::voxel_mm, "side of a voxel (tomographic)");
    count("angles", &C::angles, "frames of a turn (tomographic)");
    text("method", &C::method, "how light is found: ladder, osmo, kelly or fbp (tomographic)",
         {std::begin(tomo::kMethodNames), std::end(tomo::kMethodNames)});
    text("window", &C::window,
         "of the filter that it starts from: hamming, ram-lak or kelly (tomographic)",
         {std::begin(tomo::kWindowNames), std::end(tomo::kWindowNames)});
    count("iterations", &C::iterations, "steps, with the ladder of each rung (tomographic)");
    number("clip_sigma", &C::clip_sigma,
           "OSMO: cut off light above the mean and so many standard deviations (tomographic)");
    number("stop_error", &C::stop_error,
           "OSMO: stop when doses are wrong by less than this share of the part's (tomographic)");
    number("max_time_s", &C::max_time_s, "refuse what takes longer to print (tomographic)");
    text("beyond_reach", &C::beyond_reach,
         "parts that reach further than light from all directions: refuse or allow (tomographic)",
         {"refuse", "allow"});
    return list;
  }();
  return all;
}

const Named& setting(const char* name) {
  need(name, "name");
  for (const Named& s : all_settings()) {
    if (s.name == name) return s;
  }
  unknown_name(name, "setting", setting_names());
}

[[noreturn]] void refuse(const Named& s, const std::string& value, const std::string& expected) {
  throw InputError(fmt::format("{} is {}; expected {}", s.name, value, expected));
}

/// The whole text as a number, whatever the locale.
double number_of(const Named& s, std::string_view text) {
  double value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) {
    refuse(s, fmt::format("'{}'", text), "a number");
  }
  return value;
}

double checked(const Named& s, double value) {
  const bool fits = s.any_number ? std::isfinite(value)
                    : s.setting  ? takes_number(*s.setting, value)
                    : std::holds_alternative<Count>(s.member)
                        ? value >= 0 && value <= 1e6 && value == std::floor(value)
                        : value > 0 && std::isfinite(value);
  if (!fits) refuse(s, fmt::format("{:g}", value), s.takes);
  return value;
}

void take_back(Choices& choices, const Named& s) {
  const Choices unset;
  std::visit([&](auto member) { choices.*member = unset.*member; }, s.member);
}

void set_number(Choices& choices, const Named& s, double value) {
  if (const auto* number = std::get_if<Number>(&s.member)) {
    choices.*(*number) = checked(s, value);
  } else if (const auto* count = std::get_if<Count>(&s.member)) {
    choices.*(*count) = static_cast<int>(checked(s, value));
  } else if (const auto* numbers = std::get_if<Numbers>(&s.member)) {
    choices.*(*numbers) = {checked(s, value)};
  } else if (s.setting && s.setting->or_inf) {
    const bool inf = std::isinf(value) && value > 0;
    choices.*std::get<Text>(s.member) = inf ? "inf" : fmt::format("{}", checked(s, value));
  } else {
    throw BadCall(fmt::format("{} is no number; expected slicecorr_setup_set_text()", s.name));
  }
}

void set_text(Choices& choices, const Named& s, const std::string& value) {
  const auto* text = std::get_if<Text>(&s.member);
  if (!text || (s.setting && s.setting->or_inf)) {
    set_number(choices, s, number_of(s, value));
    return;
  }
  if (!s.words.empty() && std::find(s.words.begin(), s.words.end(), value) == s.words.end()) {
    refuse(s, fmt::format("'{}'", value), s.takes);
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
  for (const Named& s : all_settings()) names.emplace_back(s.name, s.what);
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
    const Named& s = setting(name);
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
    const Named& s = setting(name);
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
    const Named& s = setting(name);
    const auto* member = std::get_if<Numbers>(&s.member);
    if (!member) throw BadCall(fmt::format("{} is no list of numbers", s.name));
    if (count > 0) need(values, "values");
    if (count > 1000000) refuse(s, fmt::format("{} numbers long", count), "at most 1000000");
    std::vector<double> list;
    for (size_t i = 0; i < count; ++i) list.push_back(checked(s, values[i]));
    choices.*(*member) = std::move(list);
  });
}

const char* slicecorr_setup_error_text(const slicecorr_setup* setup) {
  return setup ? setup->error.c_str() : "";
}
