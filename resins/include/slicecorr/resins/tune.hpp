// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tune.hpp
/// What measured test parts say of resin and light, with what was known before as the prior.
///
/// Unknowns are x = (ln ha, kappa, stray, exchange): the absorbance height with the areal dose held, kappa =
/// ln(light / areal Dc), which prints can't tell apart, light on top of all levels, mW/cm², and the
/// share of the liquid resin that a lift exchanges (docs/lifts.md), which prints layer by layer alone tell;
/// all as changes of what the files say, the share where the printer's does not of `exchange_before`. Where
/// light is told in shares of the brightest level's (light_unit.hpp), stray light and all fields that are
/// named for mW count these; what is found is told in shares of the new brightest light. With the covariance S0 before and measurements of standard
/// deviation sigma whose derivatives by x are J, the information after is
///
///     A = inv(S0) + J'J / sigma²,     gain = 1/2 ln(det S0 det A)   in nat
///
/// Plain values; functions are thread-safe. Errors are `InputError`.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

inline constexpr std::size_t kTuned = 4;
using TuneVector = std::array<double, kTuned>;
using TuneMatrix = std::array<TuneVector, kTuned>;

/// A plug that cured on the window, or an edge of a print: `upper` where a feature begins, seen from
/// the platform, `lower` where it ends.
enum class MeasuredKind { plug, upper, lower };
struct MeasuredEdge {
  std::string name;
  MeasuredKind kind = MeasuredKind::plug;
  double designed_um = 0;       ///< from the platform; not of plugs
  double exposure_s = 0;        ///< of plugs
  double intensity_mw_cm2 = 0;  ///< of plugs, as the printer file says it
  double measured_um = 0;       ///< height of a plug, distance from the platform; NaN: not measured
  double dark_s = 0;            ///< how long a plug is dark after that
  double dark_mw_cm2 = 0;       ///< light of black pixels there, as the printer file says it
};

/// What was measured on one part.
struct MeasuredPart {
  std::string source;
  std::vector<MeasuredEdge> edges;
  /// Light of each slice of the column that was measured, as printed and as the printer file says
  /// it, mW/cm²; empty where there are plugs alone.
  std::vector<double> intensity_mw_cm2;
  Process process;      ///< how it was printed; `Process::lift_exchange` is not heeded
  double layer_um = 0;  ///< > 0
};

/// A table as `slicecorr testpart` makes it, filled in. Its part has no light yet.
struct TuningTable {
  MeasuredPart part;
  std::string kind;  ///< "comb", "lift-comb", "staircase", "wedge"
  bool printed() const { return kind == "comb" || kind == "lift-comb"; }
  int width_px = 0, height_px = 0;  ///< of the images
  int x_px = 0, y_px = 0;           ///< of the column that is measured
};
/// Throws `InputError` with line and column for what is no number, for tables of other parts, and
/// for rows that are not those of the part that the table names.
TuningTable read_tuning_table(const std::string& path);

/// A short mark of what was measured on a part, by which the same measurements are known again whatever
/// their file is called.
std::string mark_of(const MeasuredPart& part);
/// Throws `InputError` where the text of a resin's file notes one of these marks: what was measured once
/// would count twice.
void check_not_counted(const std::string& resin_text, const std::string& resin_source,
                       const std::vector<MeasuredPart>& parts);

struct TunePrior {
  TuneMatrix covariance{};
  std::string text;   ///< where it comes from, in words
  TuneVector mean{};  ///< the most probable x before
};
/// ha 10 %, kappa 10 %, stray light 0.3 mW/cm² or 0.01 of the brightest level's, exchange 0.3.
TunePrior default_prior(LightUnit unit = LightUnit::mw_cm2);
/// Of a resin that others measured: `height_sd` and `light_sd` of the logarithms of ha and kappa, the rest as
/// above.
TunePrior foreign_prior(double height_sd, double light_sd);
/// What an earlier tuning wrote into the resin's file, where it was with this printer's light; else
/// the covariance of a fit there and 3 % of the light; else the default. Throws where what is
/// written there is no covariance.
TunePrior prior_of(const std::string& resin_text, const std::string& resin_source,
                   const Printer& printer);
/// Throws unless it is symmetric and all eigenvalues are above 0, naming the pair at fault.
void check_prior(const TunePrior& prior);

/// The share of resin that a lift exchanges as the printer says it, and where it does not the middle of all
/// that can be.
double exchange_before(const Printer& printer);
/// The share as x says it: above 0, at most 1.
double tuned_exchange(const Printer& printer, const TuneVector& x);

/// Resin and printer as x says them: the change of light is given to the resin's dose. Where the printer's
/// brightest level is 1 it stays so: stray light brightens the unit itself, of both.
Resin tuned_resin(const Resin& resin, const TuneVector& x);
Printer tuned_printer(const Printer& printer, double m, const TuneVector& x);

/// Where the edges of a part lie if x is so, um; NaN where there is none: the feature is lost or has
/// grown together with its neighbour. Derivatives by x where `jacobian` is not null. Throws for
/// models without derivatives.
std::vector<double> predict_edges(const MeasuredPart& part, const Printer& printer,
                                  const Resin& resin, const TuneVector& x,
                                  std::vector<TuneVector>* jacobian = nullptr);

/// Gain in nat of measuring with these derivatives, and the covariance after.
struct TuneGain {
  double nat = 0;
  TuneMatrix covariance{};
};
TuneGain gain_of(const TuneMatrix& prior, const std::vector<TuneVector>& jacobian, double sigma_um);

struct TuneResult {
  TuneVector x{};
  TuneMatrix covariance{};
  double gain_nat = 0, rms_um = 0;
  std::size_t used = 0;
  /// The share of resin that a lift exchanges; nothing: the parts don't tell it (to less than 0.15,
  /// were ha and light known ten times less well).
  std::optional<double> lift_exchange{};
  std::vector<std::string> missing;   ///< edges that were not measured, or that are not predicted
  std::vector<std::string> outliers;  ///< left out: more than 4 standard deviations away
  std::vector<std::string> remarks;   ///< results beyond 3 standard deviations of the prior
  /// What the resin shrinks by, as scans told; nothing: its file stays as it is.
  std::optional<Shrinkage> shrinkage{};
  /// Of the printer's light at the window, the resin's scatter, and `Inhibition::beta`, as scans told; nothing: the
  /// files stay as they are.
  std::optional<LightSpread> spread{};
  std::optional<double> scatter_um2_per_um{}, uv_beta{};
  /// `mark_of` the parts that were counted: `resin_with_tuning` notes them.
  std::vector<std::string> counted{};
  /// The name of the resin that goes on as another one: `printer_with_tuning` notes it; empty: nothing.
  std::string resin_before{};
  /// What was known, what is found, and by how much that changes printer and resin.
  std::string to_text(const Printer& printer, const Resin& resin, const TunePrior& prior) const;
};
/// The most probable x. `sigma_um`: of a measured edge, > 0. Throws where nothing was measured, for
/// edges that are in the wrong order, and for lengths that are a thousand times off.
TuneResult tune(const std::vector<MeasuredPart>& parts, const Printer& printer, const Resin& resin,
                const TunePrior& prior, double sigma_um);

/// The name of a definition that is written to `path`: as the file is called, where that is a name,
/// else `before`.
std::string name_in_file(const std::string& path, const std::string& before);
/// The resin's file with what was found and a new name, and its covariance for the next time.
/// `printer`: before, by the name that it will have.
std::string resin_with_tuning(const std::string& text, const std::string& source,
                              const std::string& name, const Printer& printer,
                              const TuneResult& result);
/// The printer's file with the stray light that was found on top of its calibration, and with
/// `TuneResult::lift_exchange`. `printer` is
/// what that file says, its name that of the new one; a calibration in a file of its own becomes part
/// of it.
std::string printer_with_tuning(const std::string& text, const std::string& source,
                                const Printer& printer, const TuneResult& result);

/// A part of `slicecorr testpart`, and what measuring it once would tell.
struct NextPart {
  std::string part;  ///< "comb"
  double nat = 0;    ///< 0: nothing, or it can't be made: `text` says why
  bool tuned =
      true;  ///< of ha, light and stray light; false: of something else, which `text` names
  std::string text;
};
/// All kinds of parts, those that tell most of ha, light and stray light first, then those that tell
/// of something else, most first. Printer and resin as they were before `known`, which says what is
/// known by now. `process`: how combs are printed; none: continuously, at the speed at which black
/// and full light are as far from the dose aimed at. A lift-comb is looked at where it is layer by layer,
/// a comb where it is not.
std::vector<NextPart> next_parts(const Printer& printer, const Resin& resin,
                                 const TuneResult& known, const std::optional<Process>& process,
                                 double layer_um, double sigma_um);

}  // namespace slicecorr::resins
