/// What every program that corrects can be told of printer, resin and process.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "slicecorr/pipeline.hpp"

namespace slicecorr::cli {

struct SetupOptions {
  std::string printer, resin;
  // Empty or not above 0: not given.
  double speed_mm_h = 0;
  std::string mode;
  double exposure_s = 0, bottom_exposure_s = 0;
  int bottom_layers = -1, fade_layers = -1;
  double uv_mw_cm2 = 0, dead_zone_um = 0;
  std::string uv_schedule, window_cure, ramp;
  double ramp_mm = 0;
  std::string omega_max = "inf";
  std::string one_slice_gaps = "open";
  std::string platform_features = "capped";
  double dc_mj_cm3 = 0, ha_um = 0;
  /// `required`: printer, resin and schedule must be given; else a stack may bring them.
  void add_to(CLI::App& app, bool required, bool correcting);
  /// What is given here, over what `info` brings; `times`: an archive whose exposure times count
  /// where none are given. Both may be null. Throws `InputError` naming what is missing, or what
  /// does not go together.
  Setup resolve(const StackInfo* info, const StackInfo* times) const;

 private:
  void resolve_exposure(Process& process, const StackInfo* times) const;
  void resolve_uv(Setup& setup) const;
};

/// A corrected stack shows light, not the design: measured against it, nothing means anything.
/// Throws `InputError` when `path` is one, gives it back else.
const std::string& design(const std::string& path);

/// What the user should know of a setup; empty when nothing.
std::string notice(const Setup& setup);

}  // namespace slicecorr::cli
