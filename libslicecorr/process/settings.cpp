// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/settings.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

template <class>
struct MemberOf;
template <class Class, class Value>
struct MemberOf<Value Class::*> {
  using Type = Value;
};

/// A word that is a value of an enumeration, in its order.
template <auto member>
constexpr ProcessWord kWord{[](const Process& p) { return static_cast<std::size_t>(p.*member); },
                            [](Process& p, std::size_t w) {
                              p.*member = static_cast<typename MemberOf<decltype(member)>::Type>(w);
                            }};

constexpr ProcessWord kPlatformFeatures{
    [](const Process& p) { return std::size_t{p.cap_platform_features ? 0U : 1U}; },
    [](Process& p, std::size_t w) { p.cap_platform_features = w == 0; }};

constexpr SettingRange kShare{0, 1, false};
constexpr SettingRange kLayers{0, 1e6, false, true};
constexpr SettingRange up_to(double most) { return {0, most}; }

using C = SetupChoices;

const std::vector<Setting>& table() {
  static const std::vector<Setting> rows = {
      {.name = "printer",
       .group = kHowItPrints,
       .chosen = &C::printer,
       .text = "Printer: a .toml file or a name"},
      {.name = "resin",
       .group = kHowItPrints,
       .chosen = &C::resin,
       .text = "Resin: a .toml file or a name"},
      {.name = "printer_toml",
       .group = kHowItPrints,
       .chosen = &C::printer_toml,
       .text = "Text of a printer file, in place of {printer}",
       .said_by = SaidBy::library},
      {.name = "resin_toml",
       .group = kHowItPrints,
       .chosen = &C::resin_toml,
       .text = "Text of a resin file, in place of {resin}",
       .said_by = SaidBy::library},
      {.name = "mode",
       .group = kHowItPrints,
       .chosen = &C::mode,
       .text = "How the printer exposes: while the stage moves, or standing still for each layer "
               "[continuous]",
       .words = {"continuous", "layerwise"},
       .process = kWord<&Process::mode>},
      {.name = "speed_mm_h",
       .group = kHowItPrints,
       .chosen = &C::speed_mm_h,
       .text = "Print speed (continuous)",
       .process = &Process::speed_mm_h,
       .block = BlockPart::correction},
      {.name = "exposure_s",
       .group = kHowItPrints,
       .chosen = &C::exposure_s,
       .text = "Exposure of each layer (layerwise) [the times in the archive, where it has some]",
       .process = &Process::exposure_s,
       .block = BlockPart::exposure},
      {.name = "bottom_exposure_s",
       .group = kHowItPrints,
       .chosen = &C::bottom_exposure_s,
       .text = "Exposure of the first layers (layerwise)",
       .process = &Process::bottom_exposure_s,
       .block = BlockPart::exposure},
      {.name = "bottom_layers",
       .group = kHowItPrints,
       .chosen = &C::bottom_layers,
       .text = "Number of layers with {bottom_exposure_s} (layerwise)",
       .range = kLayers,
       .process = &Process::bottom_layers,
       .block = BlockPart::exposure},
      {.name = "fade_layers",
       .group = kHowItPrints,
       .chosen = &C::fade_layers,
       .text = "Number of layers after the bottom layers, over which the exposure falls to the "
               "normal one in equal steps (layerwise)",
       .range = kLayers,
       .process = &Process::fade_layers,
       .block = BlockPart::exposure},
      {.name = "layer_exposure_s",
       .group = kHowItPrints,
       .chosen = &C::layer_exposure_s,
       .text = "Exposure of each layer, in place of {exposure_s} and what goes with it (layerwise)",
       .column = "exposure_s",
       .process = &Process::layer_exposure_s,
       .block = BlockPart::exposure},
      {.name = "light_share",
       .group = kHowItPrints,
       .chosen = &C::light_share,
       .text =
           "Share of full light that each layer gets, above 0 and at most 1 [as the archive says, "
           "else 1]",
       .range = up_to(1),
       .column = "light_share",
       .process = &Process::light_share,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "lamp_log",
       .group = kHowItPrints,
       .chosen = &C::lamp_log,
       .text =
           "Share of the calibration's light that the lamp still gives at each slice while it fades, above "
           "0 and at most 1; no printer is told to do so [all of it]",
       .range = up_to(1),
       .column = "lamp_share",
       .process = &Process::lamp_share,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "uv_lamp_log",
       .group = kHowItPrints,
       .chosen = &C::uv_lamp_log,
       .text =
           "The same of the UV lamp: share of the light asked of it that it still gives at each slice, above "
           "0 and at most 1 [all of it]",
       .range = up_to(1),
       .column = "uv_lamp_share",
       .process = &Process::uv_lamp_share,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "layer_heights_um",
       .group = kHowItPrints,
       .chosen = &C::layer_heights_um,
       .text = "Height of each layer, where they differ [as the archive says]",
       .range = up_to(1000),
       .column = "layer_um",
       .said_by = SaidBy::jobs,
       .process = &Process::layer_heights_um,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "lifts",
       .group = kHowItPrints,
       .chosen = &C::lifts,
       .text =
           "Whether the platform lifts after each exposure, so that every layer must hold by its "
           "own (layerwise) [under UV light none; else the printer file's, else each]",
       .words = {"none", "each"},
       .process = kWord<&Process::lifts>,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "green_strength",
       .group = kHowItPrints,
       .chosen = &C::green_strength,
       .text =
           "With {lifts}: gel doses that a layer's own exposure leaves at its far edge where it "
           "holds [the resin file's, else 1.2]",
       .range = {1, 10, false},
       .process = &Process::green_strength,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "skin",
       .group = kHowItPrints,
       .chosen = &C::skin,
       .text = "With {lifts}: part of a first layer over a gap that has gelled where it is a film "
               "[0.5]",
       .range = up_to(1),
       .process = &Process::skin,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "lift_exchange",
       .group = kHowItPrints,
       .chosen = &C::lift_exchange,
       .text =
           "With {lifts}: share of the liquid resin that each lift exchanges, 0 to 1 [the printer "
           "file's, else unknown: then no feature gets thinner for any]",
       .range = kShare,
       .process = &Process::lift_exchange,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "assume",
       .group = kHowItPrints,
       .chosen = &C::assume,
       .text =
           "Where nobody measured the printer's light: that of a typical display, and that exposures are "
           "2 to 5 times what holds (layerwise). typical: a monochrome LCD, or at 385 nm a DLP "
           "projector [none: refused]",
       .words = {"none", "mono-lcd-405", "dlp-385", "dlp-405", "typical"},
       .process = kWord<&Process::assumed>,
       .block = BlockPart::exposure,
       .changed_only = true},
      {.name = "other_wavelength",
       .group = kHowItPrints,
       .chosen = &C::other_wavelength,
       .text =
           "What to do where the resin was measured more than 10 nm from the printer's light, at "
           "another wavelength: refuse the two, or take the resin as it is [refuse]",
       .words = {"refuse", "take"},
       .bare = "take"},
      {.name = "dc_mj_cm3",
       .group = kHowItPrints,
       .chosen = &C::dc_mj_cm3,
       .text = "Critical dose, at which the correction aims, instead of the resin file's; for an "
               "exponent m of 1"},
      {.name = "dose_factor",
       .group = kHowItPrints,
       .chosen = &C::dose_factor,
       .text = "Critical dose over gel dose, instead of the resin file's. Where the file has one "
               "dose alone, that dose is taken for the gel dose"},
      {.name = "ha_um",
       .group = kHowItPrints,
       .chosen = &C::ha_um,
       .text = "Absorbance height, base 10, instead of the resin file's"},
      {.name = "resin_depth_um",
       .group = kHowItPrints,
       .chosen = &C::resin_depth_um,
       .text = "Depth of the resin above the window, instead of the printer file's",
       .range = up_to(kMostDepthUm)},
      {.name = "platform_reflectance",
       .group = kHowItPrints,
       .chosen = &C::platform_reflectance,
       .text = "Share of the light that the platform sends back, 0 to 1, instead of the printer "
               "file's",
       .range = kShare},
      {.name = "omega_max",
       .group = kHowItIsCorrected,
       .chosen = &C::omega_max,
       .text = "Cap of the dose inside features, in critical doses: inf, 1 or more",
       .range = {1, std::numeric_limits<double>::infinity(), false},
       .or_inf = true,
       .corrects = true,
       .process = &Process::omega_max,
       .block = BlockPart::correction},
      {.name = "one_slice_gaps",
       .group = kHowItIsCorrected,
       .chosen = &C::one_slice_gaps,
       .text = "Gaps one slice high: keep them open, for which the feature on their platform side "
               "loses some height, or let them close (merge)",
       .words = {"open", "merge"},
       .corrects = true,
       .process = kWord<&Process::one_slice_gaps>,
       .block = BlockPart::correction},
      {.name = "gap_shortfall",
       .group = kHowItIsCorrected,
       .chosen = &C::gap_shortfall,
       .text = "For open gaps one slice high: share of a slice that the feature on their platform "
               "side may lose, up to 0.5; the more it may lose, the less the gap cures "
               "(continuous) [0.18]",
       .range = up_to(0.5),
       .corrects = true,
       .process = &Process::gap_shortfall,
       .block = BlockPart::correction,
       .changed_only = true},
      {.name = "edge_aim_um",
       .group = kHowItIsCorrected,
       .chosen = &C::edge_aim_um,
       .text = "How far from its height an edge may lie; a larger distance leaves gaps of two and "
               "three slices darker (continuous) [as near as grey levels allow, some 0.05]",
       .range = up_to(kMostEdgeAimUm),
       .corrects = true,
       .process = &Process::edge_aim_um,
       .block = BlockPart::correction,
       .changed_only = true},
      {.name = "rounds",
       .group = kHowItIsCorrected,
       .chosen = &C::rounds,
       .text = "Where light spreads: most rounds in which columns are corrected together [20]",
       .range = {0, Process::kMostSpreadRounds, false, true},
       .corrects = true,
       .process = &Process::spread_rounds,
       .block = BlockPart::correction,
       .block_key = "spread_rounds",
       .changed_only = true},
      {.name = "surface",
       .group = kHowItIsCorrected,
       .chosen = &C::surface,
       .text = "Where edges are to lie: where the mesh has them, as far as the stack says it "
               "(mesh), or where slices end (slices)",
       .words = {"slices", "mesh"},
       .corrects = true,
       .process = kWord<&Process::surface>,
       .block = BlockPart::correction,
       .changed_only = true},
      {.name = "platform_features",
       .group = kHowItIsCorrected,
       .chosen = &C::platform_features,
       .text = "Whether {omega_max} caps features that lie on the platform, too (capped). Their "
               "light reaches no gap behind them, so that they may do without (uncapped)",
       .words = {"capped", "uncapped"},
       .corrects = true,
       .process = kPlatformFeatures,
       .block = BlockPart::correction},
      {.name = "overhangs",
       .group = kHowItIsCorrected,
       .chosen = &C::overhangs,
       .text =
           "What features over gaps do: be as bright everywhere as their edges leave (bright), or "
           "gel a shelf of theirs early, so that less hangs on nothing while it prints (early) "
           "(continuous)",
       .words = {"bright", "early"},
       .corrects = true,
       .process = kWord<&Process::overhangs>,
       .block = BlockPart::correction,
       .changed_only = true},
      {.name = "spread_correction",
       .group = kHowItIsCorrected,
       .chosen = &C::spread_correction,
       .text = "Where light spreads: correct columns together (on), or each as if it stood alone "
               "(off)",
       .words = {"on", "off"},
       .corrects = true},
      {.name = "loose",
       .group = kHowItIsCorrected,
       .chosen = &C::loose,
       .text = "What to do where a body of the print hangs on nothing when it begins: tell it and "
               "go on, or refuse the print [tell]",
       .words = {"tell", "refuse"},
       .corrects = true},
      {.name = "least_neck_mm2",
       .group = kHowItIsCorrected,
       .chosen = &C::least_neck_mm2,
       .text = "Area by which each body must hang on what printed before it, platform included: "
               "what hangs by less counts as {loose} says [any area]"},
      {.name = "uv_mw_cm2",
       .group = kUvAndFlow,
       .chosen = &C::uv_mw_cm2,
       .text = "Intensity of inhibiting UV light, the same throughout"},
      {.name = "dead_zone_um",
       .group = kUvAndFlow,
       .chosen = &C::dead_zone_um,
       .text = "Dead zone at the window that the UV light is to hold, in place of {uv_mw_cm2}"},
      {.name = "gap_um",
       .group = kUvAndFlow,
       .chosen = &C::gap_um,
       .text = "Gap between part and window for which suction is judged, where the resin file has "
               "viscosity_pa_s [the dead zone that the UV light holds; without UV light 80]",
       .range = up_to(kMostGapUm),
       .corrects = true},
      {.name = "even_dead_zone",
       .group = kUvAndFlow,
       .chosen = &C::even_dead_zone,
       .text = "Find light that makes dose and dead zone even although resin flows. constant: each "
               "lamp has one intensity per slice; blue: the curing light differs from place to "
               "place; uv: the UV light does; both: both do; auto: all that the lamps can do. "
               "{gap_um} says which dead zone to reach",
       .words = {"auto", "constant", "blue", "uv", "both"},
       .bare = "auto",
       .corrects = true},
      {.name = "uv_schedule",
       .group = kUvAndFlow,
       .chosen = &C::uv_schedule,
       .text = "How UV light changes: one intensity for all, one per slice, or one per pixel and "
               "slice [constant; with {dead_zone_um} what the lamp can do]",
       .words = {"constant", "per-slice", "patterned"}},
      {.name = "ramp",
       .group = kAlongTheHeight,
       .chosen = &C::ramp,
       .text = "Where the stage speeds up and slows down (continuous): lamp-follows: within the "
               "lit slices, and the lamp follows the speed; outside: before and after them; none: "
               "the stack does not say [none; lamp-follows where the printer file's machine would "
               "refuse the speed else]",
       .words = {"none", "lamp-follows", "outside"},
       .process = kWord<&Process::ramp>,
       .block = BlockPart::stage},
      {.name = "ramp_mm",
       .group = kAlongTheHeight,
       .chosen = &C::ramp_mm,
       .text = "Distance in which the stage reaches its speed",
       .process = &Process::ramp_mm,
       .block = BlockPart::stage},
      {.name = "window_cure",
       .group = kUvAndFlow,
       .chosen = &C::window_cure,
       .text = "What to do when the resin would cure to the window, which ruins the vat [refuse]",
       .words = {"refuse", "allow"},
       .process = kWord<&Process::allow_window_cure>,
       .block = BlockPart::stage},
      {.name = "slice_speed_mm_h",
       .group = kAlongTheHeight,
       .chosen = &C::slice_speed_mm_h,
       .text = "Speed at each slice, at most {speed_mm_h}; the last holds for later ones "
               "(continuous)",
       .column = "speed_mm_h",
       .process = &Process::slice_speed_mm_h,
       .block = BlockPart::stage,
       .changed_only = true},
      {.name = "slice_lamps",
       .group = kAlongTheHeight,
       .chosen = &C::slice_lamps,
       .text = "What the lamps do in slices with speeds of their own: follow the speed, so that "
               "doses stay the same, or stay as they are, so that a slice at half the speed gets "
               "twice the dose [follow]",
       .words = {"follow", "stay"},
       .process = kWord<&Process::slice_lamps>,
       .block = BlockPart::stage,
       .changed_only = true},
  };
  return rows;
}

/// The whole text as a number, inf too, whatever the locale.
std::optional<double> number_in(std::string_view text) {
  double value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

bool is_word(const Setting& s, std::string_view text) {
  return std::find(s.words.begin(), s.words.end(), text) != s.words.end();
}

/// Whether somebody said this number.
bool is_said(const Setting& s, double value) {
  // Of what may be 0, only what is below is not said.
  return s.range.above || s.range.least > 0 ? value > 0 : value >= 0;
}

}  // namespace

std::span<const Setting> settings() { return table(); }

const Setting* find_setting(std::string_view name) {
  const auto all = settings();
  const auto at = std::find_if(all.begin(), all.end(), [&](auto& s) { return s.name == name; });
  return at == all.end() ? nullptr : &*at;
}

std::string setting_name(ChoiceNames names, std::string_view name) {
  std::string text(name);
  if (names == ChoiceNames::fields) return text;
  std::replace(text.begin(), text.end(), '_', '-');
  return "--" + text;
}

std::string setting_text(ChoiceNames names, const Setting& setting) {
  std::string text;
  std::string_view rest = setting.text;
  for (std::size_t at; (at = rest.find('{')) != rest.npos;) {
    const std::size_t end = rest.find('}', at);
    text += rest.substr(0, at);
    text += setting_name(names, rest.substr(at + 1, end - at - 1));
    rest.remove_prefix(end + 1);
  }
  return text.append(rest);
}

std::string setting_takes(const Setting& s) {
  if (!s.words.empty()) return fmt::format("one of {}", fmt::join(s.words, ", "));
  if (std::holds_alternative<std::string SetupChoices::*>(s.chosen) && !s.or_inf) return "a text";
  const SettingRange& r = s.range;
  const bool bounded = std::isfinite(r.most);
  std::string text = s.or_inf ? "inf, or a number" : r.whole ? "a whole number" : "a number";
  text += r.above   ? fmt::format(" above {:g}", r.least)
          : bounded ? fmt::format(" from {:g} to {:.7g}", r.least, r.most)
                    : fmt::format(" of at least {:g}", r.least);
  if (r.above && bounded) text += fmt::format(" and at most {:.7g}", r.most);
  return text;
}

bool takes_number(const Setting& s, double value) {
  const SettingRange& r = s.range;
  return std::isfinite(value) && (r.above ? value > r.least : value >= r.least) &&
         value <= r.most && (!r.whole || value == std::floor(value));
}

bool takes_text(const Setting& s, std::string_view text) {
  if (!s.or_inf) return s.words.empty() || is_word(s, text);
  const auto value = number_in(text);
  return text == "inf" || (value && takes_number(s, *value));
}

bool is_said(const Setting& setting, const SetupChoices& choices) {
  static const SetupChoices unset;
  return std::visit([&](auto member) { return choices.*member != unset.*member; }, setting.chosen);
}

void check_choices(const SetupChoices& choices, ChoiceNames names) {
  for (const Setting& s : settings()) {
    const auto check = [&](bool fits, const std::string& value) {
      if (fits) return;
      throw InputError(fmt::format("{} is {}; expected {}", setting_name(names, s.name), value,
                                   setting_takes(s)));
    };
    if (const auto* text = std::get_if<std::string C::*>(&s.chosen)) {
      const std::string& value = choices.*(*text);
      // Programs have modes of their own, which they look at.
      if (s.name != "mode") check(value.empty() || takes_text(s, value), "'" + value + "'");
    } else if (const auto* number = std::get_if<double C::*>(&s.chosen)) {
      const double value = choices.*(*number);
      check(!is_said(s, value) || takes_number(s, value), fmt::format("{:g}", value));
    } else if (const auto* count = std::get_if<int C::*>(&s.chosen)) {
      const int value = choices.*(*count);
      check(!is_said(s, value) || takes_number(s, value), fmt::format("{}", value));
    } else {
      for (const double value : choices.*std::get<std::vector<double> C::*>(s.chosen)) {
        check(takes_number(s, value), fmt::format("{:g}", value));
      }
    }
  }
}

void apply_choice(const Setting& s, const SetupChoices& choices, Process& process) {
  static const Process unset;
  std::visit(
      [&](auto chosen) {
        const auto& value = choices.*chosen;
        using Value = std::decay_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, std::string>) {
          if (const auto* number = std::get_if<double Process::*>(&s.process)) {
            // Of inf the largest that files can have.
            process.*(*number) = value.empty()
                                     ? unset.*(*number)
                                     : std::min(number_in(value).value_or(kNoCap), kNoCap);
          } else if (const auto* w = std::get_if<ProcessWord>(&s.process)) {
            const auto at = std::find(s.words.begin(), s.words.end(), value);
            w->set(process, at == s.words.end() ? w->get(unset)
                                                : static_cast<std::size_t>(at - s.words.begin()));
          }
        } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
          process.*std::get<std::vector<double> Process::*>(s.process) = value;
        } else if (const auto* member = std::get_if<Value Process::*>(&s.process)) {
          process.*(*member) = is_said(s, value) ? value : unset.*(*member);
        }
      },
      s.chosen);
}

void copy_setting(const Setting& s, const Process& from, Process& to) {
  std::visit(
      [&](const auto& value) {
        using Value = std::decay_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, ProcessWord>) {
          value.set(to, value.get(from));
        } else if constexpr (!std::is_same_v<Value, std::monostate>) {
          to.*value = from.*value;
        }
      },
      s.process);
}

SettingValue setting_value(const Setting& s, const Process& p) {
  return std::visit(
      [&](const auto& value) -> SettingValue {
        using Value = std::decay_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, std::monostate>) {
          return {};
        } else if constexpr (std::is_same_v<Value, ProcessWord>) {
          return s.words[value.get(p)];
        } else if constexpr (std::is_same_v<Value, std::vector<double> Process::*>) {
          return std::span<const double>(p.*value);
        } else {
          if (s.or_inf && p.*value >= kNoCap) return std::string_view("inf");
          return p.*value;
        }
      },
      s.process);
}

bool same_setting(const Setting& s, const Process& a, const Process& b) {
  const SettingValue x = setting_value(s, a), y = setting_value(s, b);
  return std::visit(
      [&](const auto& value) {
        using Value = std::decay_t<decltype(value)>;
        const auto* other = std::get_if<Value>(&y);
        if (!other) return false;
        if constexpr (std::is_same_v<Value, std::span<const double>>) {
          return std::equal(value.begin(), value.end(), other->begin(), other->end());
        } else {
          return value == *other;
        }
      },
      x);
}

}  // namespace slicecorr
