// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file same_light.hpp
/// Whether a resin was measured with the light of a printer. Heights and doses of a resin hold for one
/// wavelength: VeroClear is cured three times as deep at 405 nm as at
/// 365 nm. A resin that was
/// tuned holds for the light of one printer file.
///
/// Pure and thread-safe.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// Lights that lie no further apart are the same. LEDs of one kind peak up to 5 nm on either side of
/// their name and are some 10 to 15 nm wide, over which absorption is a mean anyway; the next kind
/// lies 20 nm away (365, 385, 405 nm).
inline constexpr double kSameLightNm = 10;

/// Two wavelengths that differ by more than that.
struct OtherWavelength {
  double printer_nm = 0, resin_nm = 0;  ///< both > 0
  bool operator==(const OtherWavelength&) const = default;
};

/// Whether two wavelengths, nm, are those of one light; 0 is not known, and the same as any.
bool same_light(double a_nm, double b_nm);

/// Of the curing light, and of the UV light where the printer has such a lamp and the resin an
/// [inhibition]; nothing where they are the same, or where one of them is not known.
std::optional<OtherWavelength> other_wavelength(const Printer& printer, const Resin& resin);
std::optional<OtherWavelength> other_uv_wavelength(const Printer& printer, const Resin& resin);

/// "resin 'X' was measured at 365 nm, and the light of printer 'Y' has 405 nm"; empty where they are
/// the same. `uv`: the print has UV light, whose wavelength counts, too.
std::string other_wavelength_in_words(const Printer& printer, const Resin& resin, bool uv);

/// The display whose seconds of full light the resin's doses are in, where it is another than the
/// printer's; "" where nobody names it, nothing where it is the same or doses are absolute.
std::optional<std::string> other_display(const Printer& printer, const Resin& resin);
/// The same as a sentence.
std::string other_display_in_words(const Printer& printer, const Resin& resin);

/// What is to be told of the lights of a print: that they are others, or which of two is not known
/// where the other one is, that light has no absolute unit, and that its unit is of another display; each
/// a sentence.
std::vector<std::string> light_notices(const Printer& printer, const Resin& resin, bool uv);
/// What is to be told of a printer and a resin that were read from files: words that count for nothing
/// (`UnreadWords`), and `light_notices`.
std::vector<std::string> definition_notices(const Printer& printer, const Resin& resin, bool uv);

/// The printer with its least and greatest light, by which tuned resins name it: "my-printer, 0.02 to
/// 29.7 mW/cm2".
std::string printer_and_light(const Printer& printer);
/// What follows it in the note of a tuned resin (`[provenance] tuning`), before the figures.
inline constexpr std::string_view kTunedFigures = ": ha, light, ";

/// Whether the resin was tuned with another printer, or another calibration of this one. Not known, and
/// false, where the printer's light is to be measured.
bool tuned_with_another(const Printer& printer, const Resin& resin);

/// Throws `InputError`, naming both, where their doses and light have different units (light_unit.hpp),
/// where resin and light have other wavelengths, unless `take`, and
/// where the resin was tuned with another printer, or another calibration of it. `take_it`: how people
/// take a resin of another wavelength, "--other-wavelength".
void check_same_light(const Printer& printer, const Resin& resin, bool uv, bool take,
                      const std::string& take_it);

}  // namespace slicecorr
