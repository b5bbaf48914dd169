// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file setup.hpp
/// From what a user says to a complete `Setup`: one set of rules for the program and the C
/// interface.
///
/// Plain values; all functions are thread-safe. Errors are `InputError`.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/pipeline.hpp"

namespace slicecorr {

/// What a user says of printer, resin and process. An empty text, a number of 0 or less and a count
/// below 0 mean that nothing was said. Ranges are those of `Process`.
struct SetupChoices {
  std::string printer, resin;            ///< names, or paths of .toml files
  std::string printer_toml, resin_toml;  ///< texts of such files, in place of the names
  std::string mode;                      ///< continuous, layerwise
  double speed_mm_h = 0;
  /// `Process::slice_speed_mm_h`, each > 0; the last holds for later slices.
  std::vector<double> slice_speed_mm_h;
  std::string
      slice_lamps;  ///< follow, stay: `Process::slice_lamps`; with speeds of slices, else follow
  double exposure_s = 0, bottom_exposure_s = 0;
  int bottom_layers = -1, fade_layers = -1;
  /// Exposure of each layer, > 0; the last holds for later layers. Alone, without the numbers
  /// above.
  std::vector<double> layer_exposure_s;
  double uv_mw_cm2 = 0, dead_zone_um = 0;
  /// `Setup::gap_um`, at most `kMostGapUm`; with an even dead zone the one aimed at.
  double gap_um = 0;
  std::string uv_schedule;     ///< constant, per-slice, patterned
  std::string even_dead_zone;  ///< auto, constant, blue, uv, both: `Process::even_dead_zone`
  std::string window_cure;     ///< refuse, allow
  std::string ramp;            ///< none, lamp-follows, outside
  double ramp_mm = 0;
  std::string omega_max = "inf";             ///< inf, or a number of at least 1
  std::string one_slice_gaps = "open";       ///< open, merge
  double gap_shortfall = 0;                  ///< `Process::gap_shortfall`, at most 0.5
  double edge_aim_um = 0;                    ///< `Process::edge_aim_um`, at most `kMostEdgeAimUm`
  std::string platform_features = "capped";  ///< capped, uncapped
  std::string surface = "mesh";              ///< slices, mesh: `Process::surface`
  std::string spread_correction = "on";      ///< on; off: no rounds, each column alone
  int rounds = -1;                           ///< `Process::spread_rounds`
  double dc_mj_cm3 = 0, ha_um = 0;           ///< in place of the resin's; height in base 10
  double resin_depth_um = 0;                 ///< in place of the printer's (`[vat] depth_um`)
  /// In place of the printer's (`[vat] platform_reflectance`), 0..1; below 0: not said.
  double platform_reflectance = -1;
  double dose_factor = 0;  ///< in place of the resin's (`Resin::dose_factor`)
};

/// The surface of this name; every other text is the slices'.
inline Surface surface_named(std::string_view name) {
  return name == "mesh" ? Surface::mesh : Surface::slices;
}

/// How messages name the choices.
enum class ChoiceNames {
  options,  ///< of the command line: --speed-mm-h
  fields,   ///< of SetupChoices: speed_mm_h
};

/// What of the choices changes the resin.
ResinOverrides resin_overrides(const SetupChoices& choices);

/// The printer that is chosen, and the resin with its changes: all that tomographic printing needs of
/// the choices. Throws `InputError` when none is chosen, and as `load_printer` and `load_resin`.
Printer chosen_printer(const SetupChoices& choices, ChoiceNames names);
Resin chosen_resin(const SetupChoices& choices, ChoiceNames names);

/// What is chosen, over what `info` brings; `times`: an archive whose exposure times count where
/// none are given, and whose first exposure stays where it is longer than the one chosen. Both may
/// be null. The caller has checked that words are among those listed above. Throws `InputError`
/// naming what is missing, or what does not go together.
Setup resolve_setup(const SetupChoices& choices, const StackInfo* info, const StackInfo* times,
                    ChoiceNames names);

/// By how much the inputs of `setup` may be off, as `text` says ("ha=5%,dc=5%", "fit,light=1%"):
/// `parse_uncertainty` with the resin file that `choices` name. Throws `InputError`.
Uncertainty chosen_uncertainty(const std::string& text, const Setup& setup,
                               const SetupChoices& choices, ChoiceNames names);

/// What the user should know of a setup, each in a sentence; `times`: as for `resolve_setup`.
std::vector<std::string> setup_notices(const Setup& setup, const StackInfo* times,
                                       ChoiceNames names);

/// All of a setup as JSON, in the words in which stacks record it: the same setup gives the same
/// text, and reading it back gives the same setup, bit for bit.
std::string setup_json(const Setup& setup);
/// Throws `InputError` naming `source` and the key.
Setup parse_setup_json(std::string_view json, const std::string& source);

/// Printer and resin in the same way: all that tomographic prints have of a setup.
std::string definitions_json(const Printer& printer, const Resin& resin);
/// Throws `InputError` naming `source` and the key.
std::pair<Printer, Resin> parse_definitions_json(std::string_view json, const std::string& source);

/// A corrected stack shows light, not the design: measured against it, or corrected again, nothing
/// means anything. Throws `InputError` when `info`, of the archive at `path`, is of one.
void check_design(const StackInfo& info, const std::string& path);

}  // namespace slicecorr
