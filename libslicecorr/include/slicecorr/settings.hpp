// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file settings.hpp
/// What people choose of printer, resin and process: one table with a row for each setting. Options
/// of programs, setters of the C interface, keys of jobs, the description of the API, the browser's
/// form, pages of the documentation and the block that stacks carry are made from it.
///
/// Plain values; all functions are thread-safe. Errors are `InputError`.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// What a user says of printer, resin and process. An empty text, a number of 0 or less (of
/// `platform_reflectance`, `lift_exchange` and counts one below 0) and an empty list mean that nothing was said. What
/// each means and its range stand in `settings()`.
struct SetupChoices {
  std::string printer, resin;            ///< names, or paths of .toml files
  std::string printer_toml, resin_toml;  ///< texts of such files, in place of the names
  std::string mode;
  double speed_mm_h = 0;
  std::vector<double> slice_speed_mm_h;  ///< the last holds for later slices
  std::string slice_lamps;               ///< with speeds of slices
  double exposure_s = 0, bottom_exposure_s = 0;
  int bottom_layers = -1, fade_layers = -1;
  /// The last holds for later layers. Alone, without the numbers above.
  std::vector<double> layer_exposure_s;
  std::vector<double> light_share;       ///< the last holds for later layers
  std::vector<double> layer_heights_um;  ///< the last holds for later layers
  std::string lifts;                     ///< each or none
  double green_strength = 0, skin = 0;
  double lift_exchange = -1;
  double uv_mw_cm2 = 0, dead_zone_um = 0;
  double gap_um = 0;  ///< `Setup::gap_um`; with an even dead zone the one aimed at
  std::string uv_schedule, even_dead_zone;
  std::string window_cure;
  std::string ramp;
  double ramp_mm = 0;
  std::string omega_max = "inf";  ///< inf, or a number
  std::string one_slice_gaps = "open";
  double gap_shortfall = 0;
  double edge_aim_um = 0;
  std::string platform_features = "capped";
  std::string overhangs = "bright";
  std::string surface = "mesh";
  std::string spread_correction = "on";  ///< off: no rounds, each column alone
  std::string loose;                     ///< `Setup::refuse_loose`: tell or refuse
  double least_neck_mm2 = 0;
  int rounds = -1;                   ///< `Process::spread_rounds`
  double dc_mj_cm3 = 0, ha_um = 0;   ///< in place of the resin's; height in base 10
  double resin_depth_um = 0;         ///< in place of the printer's (`[vat] depth_um`)
  double platform_reflectance = -1;  ///< in place of the printer's
  double dose_factor = 0;            ///< in place of the resin's (`Resin::dose_factor`)
  std::string other_wavelength;      ///< refuse or take (same_light.hpp)
  double layer_um = 0;  ///< height of layers where no archive says one, which `assume` needs
  std::string assume;   ///< whose light, in place of what nobody measured (assumed_light.hpp)
  std::vector<double> lamp_log;     ///< what the lamp still gives; the last holds for later slices
  std::vector<double> uv_lamp_log;  ///< the same of the UV lamp
};

/// The numbers that a setting takes.
struct SettingRange {
  double least = 0, most = std::numeric_limits<double>::infinity();
  bool above = true;   ///< `least` itself is not among them
  bool whole = false;  ///< whole numbers only
};

/// A word of `Process` by its place among the words of its setting.
struct ProcessWord {
  std::size_t (*get)(const Process&);
  void (*set)(Process&, std::size_t);
};
/// Where a setting ends in `Process` as it is said; nothing where it takes more than that.
using ProcessValue = std::variant<std::monostate, double Process::*, int Process::*,
                                  std::vector<double> Process::*, ProcessWord>;

/// Where the block of a stack has a setting (docs/formats.md): with what is corrected, or from
/// version 2 on with times of exposure and with what the stage does.
enum class BlockPart { none, correction, exposure, stage };

/// Who can say a setting.
enum class SaidBy {
  all,
  jobs,     ///< C, C++ and jobs of a farm; command lines have options of their own
  library,  ///< C and C++ only
};

/// Headings of settings.
inline constexpr std::string_view kHowItPrints = "Printer, resin and process";
inline constexpr std::string_view kHowItIsCorrected = "Correction";
inline constexpr std::string_view kUvAndFlow = "UV light and flow";
inline constexpr std::string_view kAlongTheHeight = "Speeds along the height";
/// All of them, in the order in which people are shown them.
inline constexpr std::array kSettingGroups{kHowItPrints, kHowItIsCorrected, kUvAndFlow,
                                           kAlongTheHeight};

struct Setting {
  using Chosen = std::variant<std::string SetupChoices::*, double SetupChoices::*,
                              int SetupChoices::*, std::vector<double> SetupChoices::*>;
  std::string_view name;   ///< of fields and keys: speed_mm_h; as an option --speed-mm-h
  std::string_view group;  ///< one of the headings above
  Chosen chosen;
  /// What it is, in a sentence; {name} stands for another setting, and a last part in brackets for
  /// what holds where nothing is said.
  std::string_view text;
  std::vector<std::string_view> words = {};  ///< of a text, all that it takes; empty: any
  SettingRange range = {};                   ///< of a number, or of each in a list
  bool or_inf = false;                       ///< a text that is a number of `range`, or inf
  /// Of a list: what `slice,COLUMN` tables call its numbers on command lines.
  std::string_view column = {};
  std::string_view bare = {};  ///< the word meant by an option without one; empty: it needs one
  bool corrects = false;       ///< only where images are made, not where they are judged
  SaidBy said_by = SaidBy::all;
  ProcessValue process = {};
  BlockPart block = BlockPart::none;
  std::string_view block_key = {};  ///< where it has another name there
  bool changed_only = false;        ///< the block has it only where it is not as by default
};

/// All settings; those of a part of the block in its order.
std::span<const Setting> settings();
/// Null where no setting has this name.
const Setting* find_setting(std::string_view name);

/// How messages name the choices.
enum class ChoiceNames {
  options,  ///< of the command line: --speed-mm-h
  fields,   ///< of SetupChoices: speed_mm_h
};
std::string setting_name(ChoiceNames names, std::string_view name);
/// `Setting::text` with the names of other settings put in.
std::string setting_text(ChoiceNames names, const Setting& setting);

/// What a setting takes, in words: "a number above 0 and at most 100", "one of open, merge".
std::string setting_takes(const Setting& setting);
/// Whether a number, finite, is in the range of a setting.
bool takes_number(const Setting& setting, double value);
/// Whether a word, or for `or_inf` a number in words, is one that the setting takes.
bool takes_text(const Setting& setting, std::string_view text);

/// Whether a setting is other than where nothing is said.
bool is_said(const Setting& setting, const SetupChoices& choices);
/// Throws where a choice is out of the range of its setting.
void check_choices(const SetupChoices& choices, ChoiceNames names);
/// Puts a setting that has a `process` there: what is chosen, else the default of `Process`.
/// `choices` have been checked.
void apply_choice(const Setting& setting, const SetupChoices& choices, Process& process);

/// What a process has of a setting: words as its row has them, "inf" where `or_inf` has no number;
/// nothing where it has no `process`. Lists and words live as long as the process and the table.
using SettingValue =
    std::variant<std::monostate, double, int, std::span<const double>, std::string_view>;
SettingValue setting_value(const Setting& setting, const Process& process);
/// Of a setting that has a `process`: copies it, and whether two processes have the same.
void copy_setting(const Setting& setting, const Process& from, Process& to);
bool same_setting(const Setting& setting, const Process& a, const Process& b);

/// The surface of this name; every other text is the slices'.
inline Surface surface_named(std::string_view name) {
  return name == "mesh" ? Surface::mesh : Surface::slices;
}

}  // namespace slicecorr
