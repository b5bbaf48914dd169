// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What every program that corrects can be told of printer, resin and process.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::cli {

struct SetupOptions : SetupChoices {
  /// `required`: printer, resin and schedule must be given; else a stack may bring them.
  /// `more_modes`: that the program knows besides those of the settings.
  void add_to(CLI::App& app, bool required, bool correcting,
              const std::vector<std::string>& more_modes = {});
  /// `--surface` alone, for what slices but does not correct; `add_to` has it for what corrects.
  void add_surface_to(CLI::App& app);
  Surface wanted_surface() const { return surface_named(surface); }
  /// Whether something is said by slice or layer, in tables.
  bool by_slice() const;
  /// With what the tables say. Throws `InputError` when one can't be read. `slice_s`: how long a slice
  /// takes, for tables in seconds; 0: not known.
  SetupChoices choices(double slice_s = 0) const;
  /// See `resolve_setup`. Throws `InputError` when a table can't be read, too.
  Setup resolve(const StackInfo* info, const StackInfo* times) const;

 protected:
  CLI::Option* add(CLI::App& app, const Setting& setting);

 private:
  /// Of a continuous print at one speed; 0 else, and where speed or height of slices are not known.
  double slice_s(const StackInfo* info, const StackInfo* times) const;

  std::map<std::string_view, std::string> tables_;  ///< of settings that are lists, their paths
};

/// `--other-wavelength` alone, of programs that take printer and resin in ways of their own.
class LightOptions : SetupOptions {
 public:
  CLI::Option* add_to(CLI::App& app);
  /// Throws `InputError` where printer and resin do not go together (`check_same_light`), gives back
  /// what is to be told of their lights else. `uv`: the print has UV light.
  std::vector<std::string> checked(const Printer& printer, const Resin& resin,
                                   bool uv = false) const;
};

/// Values of slices from a table with the columns `slice,COLUMN`: from that slice on that value. A log of
/// both lamps has `slice,lamp_share,uv_lamp_share`. The first row is of slice 0, slices rise. Throws `InputError` naming file and line.
std::vector<double> read_by_slice(const std::string& path, const std::string& column);

/// Whether a log of a lamp counts `seconds`, in place of `slice`.
bool is_lamp_curve(const std::string& path);
/// Whether it is one of both lamps, with the columns `lamp_share,uv_lamp_share`.
bool has_both_lamps(const std::string& path);
/// The share of each slice in its middle: seconds since the first slice rise, straight lines between
/// rows, flat before and after them. Throws `InputError` naming file and line, also where `slice_s` is 0.
std::vector<double> read_lamp_curve(const std::string& path, double slice_s,
                                    const std::string& column = "lamp_share");

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

/// Tells what of a printer's or resin's file counts for nothing.
void tell_unread(const UnreadWords& unread, const ExecutionContext& context);
/// Tells what the user should know of a setup; `times` as for `resolve_setup`.
void tell_notices(const Setup& setup, const StackInfo* times, const ExecutionContext& context);
/// Of a mesh that is sliced for this setup: tells where its own heights are wanted and not counted.
void tell_heights_left_out(const Setup& setup, Surface wanted, const ExecutionContext& context);
/// Where its light is assumed: that `printer`, a name or a path, is said to show no grey.
void tell_doubted_grey(const std::string& printer, const Setup& setup,
                       const ExecutionContext& context);

/// Why printbridge would refuse to print `setup` in slices of `grid` on the machine of `printer`, a name or
/// file; empty where it would not, or the file drives no machine.
std::string refused_by_machine(const Setup& setup, const std::string& printer, const Grid& grid,
                               ChoiceNames names = ChoiceNames::options);
/// Tells it, before the work.
void tell_machine(const Setup& setup, const std::string& printer, const Grid& grid,
                  const ExecutionContext& context);

}  // namespace slicecorr::cli
