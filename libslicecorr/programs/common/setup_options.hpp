// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What every program that corrects can be told of printer, resin and process.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::cli {

struct SetupOptions : SetupChoices {
  std::string slice_speeds;  ///< a table for `slice_speed_mm_h`
  /// `required`: printer, resin and schedule must be given; else a stack may bring them.
  /// `more_modes`: that the program knows besides those of `SetupChoices`.
  void add_to(CLI::App& app, bool required, bool correcting,
              const std::vector<std::string>& more_modes = {});
  /// `--surface` alone, for what slices but does not correct; `add_to` has it for what corrects.
  void add_surface_to(CLI::App& app);
  Surface wanted_surface() const { return surface_named(surface); }
  /// See `resolve_setup`. Throws `InputError` when the table of speeds can't be read, too.
  Setup resolve(const StackInfo* info, const StackInfo* times) const;
};

/// Speeds of slices from a table with the columns `slice,speed_mm_h`: from that slice on that speed.
/// The first row is of slice 0, slices rise. Throws `InputError` naming file and line.
std::vector<double> read_slice_speeds(const std::string& path);

/// A corrected stack shows light, not the design: measured against it, nothing means anything.
/// Throws `InputError` when `path` is one, gives it back else.
const std::string& design(const std::string& path);

/// Of a refusal by physics layer by layer: which dose was aimed at, and how another one is. Empty
/// where that is not the matter.
std::string dose_words(const Setup& setup);
/// Does what a program was asked for, and adds `dose_words` where physics refuses it.
template <typename Work>
auto with_dose_words(const Setup& setup, const Work& work) {
  try {
    return work();
  } catch (const InfeasibleError& e) {
    throw InfeasibleError(e.what() + dose_words(setup));
  }
}

/// Tells what the user should know of a setup; `times` as for `resolve_setup`.
void tell_notices(const Setup& setup, const StackInfo* times, const ExecutionContext& context);

}  // namespace slicecorr::cli
