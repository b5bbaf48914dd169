// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/same_light.hpp"

#include <fmt/format.h>

#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/vial_keys.hpp"

namespace slicecorr {

namespace {

std::optional<OtherWavelength> other(double printer_nm, double resin_nm) {
  if (same_light(printer_nm, resin_nm)) return std::nullopt;
  return OtherWavelength{printer_nm, resin_nm};
}

/// One of two wavelengths is not known: which, and what the other one is.
std::string one_unknown(const std::string& resin, double resin_nm, const std::string& light,
                        double light_nm, const char* measured) {
  if ((resin_nm > 0) == (light_nm > 0)) return {};
  if (resin_nm > 0) {
    return fmt::format("{} was {} at {:g} nm; the file does not say which wavelength {} has", resin,
                       measured, resin_nm, light);
  }
  return fmt::format("{} has {:g} nm; the file does not say at which wavelength {} was {}", light,
                     light_nm, resin, measured);
}

}  // namespace

bool same_light(double a_nm, double b_nm) {
  return a_nm <= 0 || b_nm <= 0 || std::abs(a_nm - b_nm) <= kSameLightNm;
}

std::optional<OtherWavelength> other_wavelength(const Printer& printer, const Resin& resin) {
  return other(printer.wavelength_nm, resin.wavelength_nm);
}

std::optional<OtherWavelength> other_uv_wavelength(const Printer& printer, const Resin& resin) {
  if (!printer.uv || !resin.inhibition) return std::nullopt;
  return other(printer.uv->wavelength_nm, resin.inhibition->wavelength_nm);
}

std::string other_wavelength_in_words(const Printer& printer, const Resin& resin, bool uv) {
  std::string text;
  if (const auto o = other_wavelength(printer, resin)) {
    text =
        fmt::format("resin '{}' was measured at {:g} nm, and the light of printer '{}' has {:g} nm",
                    resin.name, o->resin_nm, printer.name, o->printer_nm);
  }
  const auto o = uv ? other_uv_wavelength(printer, resin) : std::nullopt;
  if (!o) return text;
  return text + fmt::format(
                    "{}the inhibition of resin '{}' was measured at {:g} nm, and the UV light of "
                    "printer '{}' has {:g} nm",
                    text.empty() ? "" : "; ", resin.name, o->resin_nm, printer.name, o->printer_nm);
}

std::vector<std::string> light_notices(const Printer& printer, const Resin& resin, bool uv) {
  std::vector<std::string> told;
  const auto add = [&](std::string text) {
    if (!text.empty()) told.push_back(std::move(text));
  };
  const std::string words = other_wavelength_in_words(printer, resin, uv);
  if (!words.empty()) {
    add(words + ": heights and doses may be off by a factor, and with them all that is predicted");
  }
  if (is_relative(printer) && is_relative(resin)) {
    add(fmt::format(
        "light is counted in shares of the brightest level of printer '{}', and doses in "
        "seconds of it, also where a name says mW or mJ",
        printer.name));
    add(other_display_in_words(printer, resin));
  }
  const std::string of_resin = fmt::format("resin '{}'", resin.name),
                    of_printer = fmt::format("printer '{}'", printer.name);
  add(one_unknown(of_resin, resin.wavelength_nm, "the light of " + of_printer,
                  printer.wavelength_nm, "measured"));
  if (uv && printer.uv && resin.inhibition) {
    add(one_unknown("the inhibition of " + of_resin, resin.inhibition->wavelength_nm,
                    "the UV light of " + of_printer, printer.uv->wavelength_nm, "measured"));
  }
  return told;
}

std::string vial_keys_in_words(const Resin& resin) {
  const bool taken = resin.inhibition_dose_mj_cm3 > 0,
             again = resin.inhibition_resupply_mj_cm3_s > 0;
  if (!taken && !again) return {};
  return fmt::format(
      "resin '{}' has inhibitors that light must use up first ({}), which count in tomographic prints "
      "alone: gel may come later than is told{}",
      resin.name,
      !again   ? "inhibition_dose_mj_cm3"
      : !taken ? "inhibition_resupply_mj_cm3_s"
               : "inhibition_dose_mj_cm3, inhibition_resupply_mj_cm3_s",
      again ? ", and in dim light never" : "");
}

std::vector<std::string> definition_notices(const Printer& printer, const Resin& resin, bool uv) {
  std::vector<std::string> told = printer.unread.sentences;
  told.insert(told.end(), resin.unread.sentences.begin(), resin.unread.sentences.end());
  if (printer.model) {
    told.push_back(fmt::format(
        "printer '{}' is a model: its light is made up, and figures are those of that light: measure that of your own",
        printer.name));
  }
  if (std::string text = vial_keys_in_words(resin); !printer.vial && !text.empty()) {
    told.push_back(std::move(text));
  }
  for (std::string& text : light_notices(printer, resin, uv)) told.push_back(std::move(text));
  return told;
}

std::optional<std::string> other_display(const Printer& printer, const Resin& resin) {
  if (!is_relative(resin) || resin.display == printer.name) return std::nullopt;
  return resin.display;
}

std::string other_display_in_words(const Printer& printer, const Resin& resin) {
  if (!other_display(printer, resin)) return {};
  return fmt::format(
      "the dose of resin '{}' is in seconds of the full light of {}, not of printer '{}': it holds "
      "where both are as bright, and what is predicted is off by what they differ",
      resin.name,
      resin.display.empty() ? "a display that its file does not name (cure.display)"
                            : fmt::format("printer '{}'", resin.display),
      printer.name);
}

std::string printer_and_light(const Printer& printer) {
  return fmt::format("{}, {:.4g} to {:.4g} {}", printer.name,
                     printer.calibration.front().intensity_mw_cm2,
                     printer.calibration.back().intensity_mw_cm2, unit_in_files(printer.unit));
}

bool tuned_with_another(const Printer& printer, const Resin& resin) {
  return !resin.tuned_with.empty() && !printer.calibration.empty() &&
         printer_and_light(printer) != resin.tuned_with;
}

void check_same_light(const Printer& printer, const Resin& resin, bool uv, bool take,
                      const std::string& take_it) {
  check_same_unit(printer, resin);
  if (tuned_with_another(printer, resin)) {
    throw InputError(fmt::format(
        "resin '{}' was tuned with the printer '{}' and holds for its light alone; this is the "
        "printer '{}'; expected the printer file that was written with the resin, or a resin that "
        "was not tuned",
        resin.name, resin.tuned_with, printer_and_light(printer)));
  }
  if (take) return;
  if (const std::string words = other_wavelength_in_words(printer, resin, uv); !words.empty()) {
    throw InputError(
        fmt::format("{}; expected a resin that was measured within {:g} nm of the printer's light, "
                    "or {}, which takes it as it is",
                    words, kSameLightNm, take_it));
  }
}

}  // namespace slicecorr
