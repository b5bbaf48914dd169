/// The options that subcommands share.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "program/program.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::cli {

struct MeshOptions {
  std::vector<std::string> parts;
  double layer_um = 0;
  std::string antialias = "on";
  std::vector<double> center_mm;
  std::string units = "auto";
  double scale = 1.0;
  std::vector<double> rotate_deg;
  void add_to(CLI::App& app);
  /// Only how meshes are turned, scaled and placed; `add_to` has these, too.
  void add_placement_to(CLI::App& app);
  Placement placement() const;
  SliceOptions slice_options() const;
};

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

/// Reads and places all parts; tells their figures and defects through `job`.
TriangleMesh read_parts(const MeshOptions& options, const Job& job);

/// The human summary of a prediction.
std::string summary(const Prediction& after, const std::optional<Prediction>& before);
/// The same figures of several predictions side by side, each under its heading.
struct Figures {
  std::string heading;
  const Prediction* prediction;
};
std::string figures_table(const std::vector<Figures>& columns);
std::string describe_stack(const StackInfo& info);
std::string info_json(const StackInfo& info, const std::string& path);
double print_time_s(const StackInfo& info);

}  // namespace slicecorr::cli
