// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Corrections that keep features above and gaps below gelling although inputs are off.
///
/// Every dose rises and falls with each of ln ha, ln areal Dc, ln light, ln speed and stray light, so
/// that of all inputs off by no more than so much two cases decide: the *weak* one, where all say
/// less dose, and the *strong* one. A feature survives if its greatest dose is 1 or more in the weak
/// case, a gap if its least is below 1 in the strong one. Of errors that are off together (a fit) the
/// cases are ln Omega -+ chi sd(ln Omega), to first order.
///
/// Column by column, where one of these fails: correct; both edges of a feature that is lost aim at 1 %
/// more dose, both beside a gap that fills at 1 % less, none that is wanted both ways (robust_edges.hpp).
/// Where that does not mend all of it, the light of the column is chosen slice by slice for the fewest
/// failures (light_plan.hpp), or, where doses do not follow by one number from slice to slice, what can't hold
/// beside the rest is given up. The best is kept, the first of equals. An edge that aims at the dose D is the same as one that lies where the dose is 1 when it is D there:
///
///     upper edge   ln((D - phi_min) / (1 - phi_min)) / (ln10 eta)   slices nearer to the platform
///     lower edge   ln((phi_max - 1) / (phi_max - D)) / (ln10 eta)   further from it
///
/// so that a robust correction is an ordinary one of a design whose edges were moved, by edge heights
/// (target.hpp). All other edges stay: no other aim betters the mean of their errors, which is least
/// where the nominal dose is 1.
#pragma once

#include <cstdint>
#include <memory>

#include "bands/design_band.hpp"
#include "bands/dose_meter.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose_derivatives.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr {
struct Setup;
}

namespace slicecorr::detail {

/// The model of a print with all inputs off at once, by their standard deviation each, towards less
/// dose (`weak`) or more. `model`: plain.
CureModel case_model(const CureModel& model, const Uncertainty& uncertainty, bool weak);

/// The prints of both cases.
struct RobustCases {
  /// Of places with this value of light.
  RobustCases(const PlaceModels& models, std::uint8_t value, const Uncertainty& uncertainty);
  /// Of a plain model.
  RobustCases(const CureModel& plain, const Uncertainty& uncertainty);
  CureModel weak, strong;
  /// Where errors of a fit go with differences between prints.
  std::unique_ptr<const NearbyModels> nearby;
};
/// Throws `InfeasibleError` where light never gels in the weak case, or black gels in the strong one, as far
/// as that is known without a part.
void check_cases(const CureModel& model, const RobustCases& cases, const Uncertainty& uncertainty);

/// Slices more that must be shown so that lower edges of the last layer can aim higher.
int robust_slices(const CureModel& model);

/// Grey levels of a band, the last slice first, as `BandCorrector` gives them.
struct RobustLevels {
  CodedBand levels;
  CodedBand plain;  ///< those of the plain correction
  RobustFigures figures;
};
/// What a robust correction allows for.
struct RobustAsk {
  const Uncertainty& uncertainty;
  const RobustCases& cases;
  const WantedBand* doses = nullptr;  ///< null: none are wanted
};
RobustLevels robust_levels(const CorrectionPlan& plan, const RobustAsk& ask,
                           const CodedDesign& design, const ExecutionContext& context);

}  // namespace slicecorr::detail
