// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/shortcomings.hpp"

#include <fmt/format.h>

#include "pipeline/vanished.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

void tell_shortcomings(const Prediction& p, const CureModel& model, const Process& process,
                       int levels, const ExecutionContext& context) {
  tell_nothing_prints(p, context);
  if (p.cure_through_voxels + p.undercure_voxels > 0 && p.finest) {
    context.tell(fmt::format(
        "{} voxels will still cure through and {} stay undercured where light from beside reaches "
        "them; this light prints no line below {:.3g} um and no gap below {:.3g} um",
        p.cure_through_voxels, p.undercure_voxels, p.finest->line_um, p.finest->gap_um));
  } else if (p.cure_through_voxels + p.undercure_voxels > 0 && p.uncertain && p.uncertain->robust) {
    context.tell(fmt::format(
        "{} voxels cure through and {} stay undercured with the inputs as they are said: edges beside "
        "thin features and gaps give way so that these hold when inputs are off",
        p.cure_through_voxels, p.undercure_voxels));
  } else if (p.cure_through_voxels > 0 && p.undercure_voxels == 0 && p.joints &&
             !model.lifts->exchange && p.joints->exchanged_error_um.count() > 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through if lifts exchange no resin, because each layer must hold when "
        "the platform lifts; edges lie within {:.3g} um if they exchange all",
        p.cure_through_voxels, p.joints->exchanged_max_um));
  } else if (p.cure_through_voxels > 0 && p.undercure_voxels == 0 && p.joints && p.uncertain &&
             p.uncertain->inputs.sd(UncertainInput::exchange) > 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through with the share of resin that lifts are said to exchange, "
        "because no feature is cut into for any share that is believed",
        p.cure_through_voxels));
  } else if (p.cure_through_voxels > 0 && p.undercure_voxels == 0 && p.joints &&
             p.left_alone_voxels == 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through, because each layer must hold by its own exposure when the "
        "platform lifts",
        p.cure_through_voxels));
  } else if (process.even_light && p.undercure_voxels > 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through and {} stay undercured with light for a dead zone of {:.4g} um: "
        "the thicker it is, the less light is left for what gels; a thinner one (gap_um) leaves more",
        p.cure_through_voxels, p.undercure_voxels, process.even_light->gap_um));
  } else if (p.cure_through_voxels + p.undercure_voxels > 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through and {} stay undercured: no choice of the {} grey levels "
        "was found that avoids it; {}",
        p.cure_through_voxels, p.undercure_voxels, levels,
        p.left_alone_voxels > 0
            ? std::string("gaps that light of what is left alone reaches may be among them, and "
                          "that light stays as it is")
            : fmt::format("one level moves an edge by up to {:.3g} um", model.level_step_um())));
  }
  if (p.joints && p.joints->not_holding_voxels > 0) {
    context.tell(fmt::format(
        "{} voxels do not hold when the platform lifts: their own exposure leaves less than {:g} gel doses "
        "where they hang (least: {:.3g})",
        p.joints->not_holding_voxels, model.lifts->green_strength, p.joints->least));
  }
  if (p.dead_zones && process.uv.dead_zone_um == 0 && !process.even_light &&
      p.dead_zones->least() < kThinDeadZoneUm) {
    context.tell(
        fmt::format("the dead zone gets as thin as {:.2g} um; UV light chosen for a dead zone, in "
                    "place of an intensity, keeps more of it",
                    p.dead_zones->least()));
  }
  if (p.one_slice_gaps > 0) {
    context.tell(fmt::format("{} gaps are one slice high: {}", p.one_slice_gaps,
                             process.one_slice_gaps == OneSliceGaps::merge ? "merged"
                             : model.mode == ExposureMode::layerwise       ? "kept open"
                             : process.uv.kind != UvKind::off
                                 ? "kept open, at the cost of the edges beside them"
                                 : fmt::format("kept open, at the cost of up to {:.3g} um of the "
                                               "features above them",
                                               process.gap_shortfall * model.layer_um)));
  }
}

}  // namespace slicecorr::detail
