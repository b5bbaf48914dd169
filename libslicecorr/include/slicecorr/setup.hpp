// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file setup.hpp
/// From what a user says to a complete `Setup`: one set of rules for the program and the C
/// interface.
///
/// Plain values; all functions are thread-safe. Errors are `InputError`.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/flow_suction.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/uncertainty.hpp"

namespace slicecorr {

/// Printer, resin and process with which a stack is corrected or judged.
struct Setup {
  Printer printer;
  Resin resin;
  Process process;
  /// Gap under the part that suction is judged with, um (flow_suction.hpp); 0: by the UV light. Where an
  /// even dead zone is asked for, that dead zone; 0: the best. Stacks do not keep it: even light has its
  /// own.
  double gap_um = 0;
  /// By how much the inputs may be off: predictions then say how sure they are, and corrections allow
  /// for it where that is asked for (`Uncertainty::robust`). Stacks do not keep it.
  std::optional<Uncertainty> uncertainty{};
  /// A print of which some body hangs on nothing when it begins (bodies.hpp) is refused, not only told.
  /// Stacks do not keep it.
  bool refuse_loose = false;
  /// Area by which a body must hang on what printed before it, mm²: what hangs by less is told, or refused
  /// with `refuse_loose`; 0: any. Stacks do not keep it.
  double least_neck_mm2 = 0;
  /// How the platform lifts: as the archive says whose times count, else as the printer file does;
  /// nothing: not known. Only times of prints need it. Stacks keep the printer's.
  std::optional<LiftTimes> lift_times{};
};

/// What of the choices changes the resin.
ResinOverrides resin_overrides(const SetupChoices& choices);

/// The printer that is chosen, and the resin with its changes: all that tomographic printing needs of
/// the choices. Throws `InputError` when none is chosen, as `load_printer` and `load_resin`, and as
/// `check_same_light` where they do not go together.
std::pair<Printer, Resin> chosen_definitions(const SetupChoices& choices, ChoiceNames names);

/// `check_same_light` (same_light.hpp), with what `choices` say of it, and under the UV light of
/// `uv`. Throws `InputError`.
void check_chosen_light(const Printer& printer, const Resin& resin, bool uv,
                        const SetupChoices& choices, ChoiceNames names);

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

/// What a stack is measured with in place of what it says it was made with: a sentence for each setting, and for
/// printer and resin. Empty where the stack does not say.
std::vector<std::string> other_than_made(const Setup& setup, const StackInfo& made,
                                         ChoiceNames names);

/// What of `choices` says how a part is corrected, and changes nothing of a stack that is corrected already: a sentence for
/// each. Empty where `made` is of none.
std::vector<std::string> choices_past(const SetupChoices& choices, const StackInfo& made,
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

/// What a design has beside features and gaps.
struct DesignHas {
  bool left_alone = false, doses = false;
};
/// All of a correction that is refused before the work, by the table of supports.hpp and by what three
/// of its features or an input bring. Throws `InputError`.
void check_correction(const Setup& setup, const DesignHas& design);
/// The setup with which a target is corrected: `check_correction`, and without what supports.hpp says
/// is left out, which is told.
Setup setup_to_correct(const SliceSource& target, Setup setup, const ExecutionContext& context);

/// Throws `InputError`, naming it, where a setup has something under which it is not known how the
/// dose changes: patterns of UV light, light that scatters, or spreads under UV light, resin that ends, a
/// platform that sends light back.
void check_uncertain(const Setup& setup);

/// Looks at how hard `target` pulls at window and vat (`print_suction` in flow_suction.hpp) where the
/// resin says its viscosity and the print is continuous: tells it in a line, and throws
/// `InfeasibleError`, naming slice, place and the speed that works, where the printer says what it
/// bears and that is less. `correct_stack` does so before it corrects. Returns what it found.
std::optional<PrintSuction> judge_suction(const SliceSource& target, const Setup& setup,
                                          const ExecutionContext& context = {});
/// Whether there is something to look at.
bool judges_suction(const Setup& setup);

}  // namespace slicecorr
