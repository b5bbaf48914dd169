// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "plan/checks.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"

namespace slicecorr::bridge {

void check_kind(const StackReader& stack, const std::string& path) {
  const StackInfo& info = stack.info();
  switch (info.kind) {
    case StackKind::corrected:
      break;
    case StackKind::target:
      throw InputError(path, "",
                       "shows the part's design, not light; expected a stack that `slicecorr "
                       "correct` made for this printer");
    case StackKind::foreign:
      throw InputError(path, "",
                       "does not say for which printer, resin and speed it was made; expected a "
                       "stack of `slicecorr correct`, which takes this file as its input");
    default:
      throw InputError(path, "",
                       "records what was shown in a print; expected the stack that was printed");
  }
  if (!info.process || !info.printer || !info.resin) {
    throw InputError(path, "",
                     "lacks its printer, resin or process; expected a stack of `slicecorr "
                     "correct`");
  }
  if (!info.process->layer_heights_um.empty()) {
    throw InputError(
        path, "",
        "has layers of different heights, to which the stage is not moved; expected layers "
        "of one height");
  }
  if (!stack.has_checksums()) {
    throw InputError(path, "",
                     "has no checksum of its images; expected a stack that was not changed since "
                     "`slicecorr correct` made it");
  }
  if (!info.parameters_checked) {
    throw InputError(path, "",
                     "has no checksum of its parameters: it was made by an earlier version, or "
                     "changed since; expected a stack as `slicecorr correct` makes it: correct the "
                     "part again, or look at what `slicecorr info` says of it and write it anew "
                     "with `slicecorr convert`");
  }
  if (stack.images_changed() || stack.uv_images_changed()) {
    throw InputError(path, "",
                     "its images were changed after the stack was made (checksum); expected a "
                     "stack as `slicecorr correct` made it");
  }
  const bool patterned = info.process->uv.kind == UvKind::patterned;
  if (patterned != stack.has_uv_images()) {
    throw InputError(path, "",
                     patterned ? "has no images for its patterned UV light"
                               : "has UV images, but no patterned UV light");
  }
}

namespace {

/// Slices of a continuous print may pull as hard as the printer's limit allowed when the stack was
/// made: one that bears less now has not been asked. Without a limit nothing was judged.
void check_suction(const Printer& made, const Printer& here, const std::string& path) {
  if (!(here.suction_limit_pa > 0)) return;
  if (made.suction_limit_pa > 0 && made.suction_limit_pa <= here.suction_limit_pa) return;
  throw InputError(
      path, "",
      fmt::format(
          "was made for another printer: {}, printer '{}' bears {:g} Pa (suction_limit_pa); "
          "correct the part for this printer",
          made.suction_limit_pa > 0
              ? fmt::format("its slices may pull with up to {:g} Pa", made.suction_limit_pa)
              : std::string("the suction of its slices was not limited"),
          here.name, here.suction_limit_pa));
}

}  // namespace

void check_printer(const StackInfo& info, const std::string& path, const Machine& machine) {
  const Printer &made = *info.printer, &here = machine.printer;
  const auto differs = [&](const std::string& what, const std::string& was, const std::string& is) {
    throw InputError(path, "",
                     fmt::format("was made for another printer: {} {}, expected {} as printer '{}' "
                                 "has; correct the part for this printer",
                                 what, was, is, here.name));
  };
  if (made.name != here.name) differs("its name is", "'" + made.name + "'", "'" + here.name + "'");
  const auto size = [](const Printer& p) {
    return fmt::format("{} x {} pixels of {:g} x {:g} um, {} bits", p.width_px, p.height_px,
                       p.pixel_x_um, p.pixel_y_um, p.bit_depth);
  };
  if (size(made) != size(here) || made.pixel_x_um != here.pixel_x_um ||
      made.pixel_y_um != here.pixel_y_um) {
    differs("its display has", size(made), size(here));
  }
  if (made.unit != here.unit) {
    differs("its light is in units", std::string(unit_of_light(made.unit)),
            std::string(unit_of_light(here.unit)));
  }
  if (made.calibration != here.calibration) {
    differs("its calibration ends at",
            fmt::format("{:g} {} ({} points)", made.calibration.back().intensity_mw_cm2,
                        unit_of_light(made.unit), made.calibration.size()),
            fmt::format("{:g} {} ({} points, all alike)", here.calibration.back().intensity_mw_cm2,
                        unit_of_light(here.unit), here.calibration.size()));
  }
  if (made.flat_field != here.flat_field) {
    differs("its light is", made.flat_field ? "uneven in another way" : "even",
            here.flat_field ? "uneven" : "even");
  }
  if (made.distortion != here.distortion) {
    differs("its pixels land on", made.distortion ? "a grid bent in another way" : "an even grid",
            here.distortion ? "a bent one" : "an even one");
  }
  if (made.grey != here.grey) {
    const auto words = [](const Printer& p) {
      return p.grey == GreyLight::pulsed ? "full light for a share of the time" : "steady";
    };
    differs("its grey light is", words(made), words(here));
  }
  if (info.process->uv.kind != UvKind::off && made.uv_flat_field != here.uv_flat_field) {
    differs("its UV light is", made.uv_flat_field ? "uneven in another way" : "even",
            here.uv_flat_field ? "uneven" : "even");
  }
  if (made.orientation.value_or(Orientation{}) != here.orientation.value_or(Orientation{})) {
    differs("its display lies", in_words(made.orientation.value_or(Orientation{})),
            in_words(here.orientation.value_or(Orientation{})));
  }
  if (info.process->uv.kind != UvKind::off && made.uv != here.uv) {
    differs("its UV lamp has",
            made.uv ? fmt::format("up to {:g} mW/cm²", made.uv->max_mw_cm2()) : "no light",
            here.uv ? fmt::format("up to {:g} mW/cm², calibrated alike", here.uv->max_mw_cm2())
                    : "no such lamp");
  }
  const UvKind kind = info.process->uv.kind;
  if (here.uv && here.uv->patterned && (kind == UvKind::constant || kind == UvKind::per_slice)) {
    throw InputError(path, "",
                     "has no UV images, which the UV lamp of printer '" + here.name +
                         "' shows; correct the part with --uv-schedule patterned");
  }
  if (info.process->mode == ExposureMode::continuous) check_suction(made, here, path);
  const Turn turn = turn_to_display(image_frame(info), here);
  const Grid shown = turned(info.grid, turn);
  if (shown.width_px != here.width_px || shown.height_px != here.height_px) {
    differs("its images have",
            fmt::format("{} x {} pixels on the display", shown.width_px, shown.height_px),
            fmt::format("{} x {}", here.width_px, here.height_px));
  }
}

}  // namespace slicecorr::bridge
