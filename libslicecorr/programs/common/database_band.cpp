// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/database_band.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::cli {

namespace fs = std::filesystem;

namespace {

/// Whether a name leads to the installed database, not to a file of the user's own.
bool is_installed(const std::string& resin) {
  if (resin.empty() || resin.ends_with(".toml")) return false;
  const fs::path found = fs::path(find_definition(resin, "resin")).lexically_normal();
  const char* const database = std::getenv("SLICECORR_DB");
  for (const std::string& own : {std::string(database ? database : ""), user_definition_folder()}) {
    if (own.empty()) continue;
    for (const fs::path& folder : {fs::path(own), fs::path(own) / "resins"}) {
      if ((folder / found.filename()).lexically_normal() == found) return false;
    }
  }
  return true;
}

constexpr double kSds = 1.96;  // of 95 %

/// By how much cured heights may be off, 95 %: a dose that is f times as large cures (h/m) ln f less, base e.
std::string in_words(const Resin& resin) {
  const double dose_um =
      resin.absorbance_height10_um / std::numbers::ln10 / resin.m * kSds * kDatabaseDoseSd;
  return fmt::format(
      "resin '{}' is from the database, not measured on this printer: laboratories that measured one resin "
      "were up to 7 times apart in absorbance height and 70 times in dose, so that it has these to a factor of "
      "{:.2g} and {:.2g} (95 %), and what light cures may be {:.0f} um higher or lower than told; one comb, "
      "staircase or roof measured here shrinks that (slicecorr testpart staircase, slicecorr tune)",
      resin.name, std::exp(kSds * kDatabaseHeightSd), std::exp(kSds * kDatabaseDoseSd), dose_um);
}

/// The same where the dose is assumed: so many times what gels arrives at a layer's far edge, whatever the
/// height; how far beyond it light cures goes with the height alone.
std::string in_words_assumed(const Resin& resin) {
  return fmt::format(
      "resin '{}' is from the database, not measured on this printer: laboratories that measured one resin "
      "were up to 7 times apart in absorbance height, so that it has that to a factor of {:.2g} (95 %), and so has "
      "what is told of how far light cures beyond its layer; what is told of edges counts with labs that are 10 % "
      "apart, as most are (docs/calipers.md); films measured here shrink that (slicecorr testpart films, resinctl "
      "calibrate)",
      resin.name, std::exp(kSds * kDatabaseHeightSd));
}

std::string in_words(const Resin& resin, AssumedLight assumed) {
  return assumed == AssumedLight::none ? in_words(resin) : in_words_assumed(resin);
}

}  // namespace

std::string database_band(const std::string& resin, AssumedLight assumed) {
  return is_installed(resin) ? in_words(load_resin(resin), assumed) : std::string();
}

std::string database_band(const Resin& resin, AssumedLight assumed) {
  try {
    const Resin known = load_resin(resin.name);
    // With lifts the gel dose is aimed at, whatever the file's factor.
    const auto alike = [](double a, double b) { return std::abs(a - b) <= 1e-9 * std::abs(b); };
    const bool same_dose =
        assumed != AssumedLight::none || (alike(known.critical_dose_mj_cm3 / known.dose_factor,
                                                resin.critical_dose_mj_cm3 / resin.dose_factor) &&
                                          alike(known.critical_dose_prime / known.dose_factor,
                                                resin.critical_dose_prime / resin.dose_factor));
    const bool same = same_dose && known.m == resin.m &&
                      alike(known.absorbance_height10_um, resin.absorbance_height10_um);
    return same && is_installed(resin.name) ? in_words(resin, assumed) : std::string();
  } catch (const InputError&) {
    return {};  // no such name: it was measured, or came from a file
  }
}

void tell_database_band(const Resin& resin, const ExecutionContext& context, AssumedLight assumed) {
  if (const std::string text = database_band(resin, assumed); !text.empty()) context.tell(text);
}

void tell_database_band(const std::string& resin, const ExecutionContext& context,
                        AssumedLight assumed) {
  if (const std::string text = database_band(resin, assumed); !text.empty()) context.tell(text);
}

std::vector<std::string> unmeasured_in_words(const SetupChoices& chosen, const Setup& setup) {
  const AssumedLight assumed = setup.process.assumed;
  std::vector<std::string> words;
  if (assumed != AssumedLight::none && !chosen.printer.empty()) {
    words.push_back(doubted_grey_in_words(chosen.printer));
  }
  if (chosen.resin_toml.empty()) {
    words.push_back(chosen.resin.empty() ? database_band(setup.resin, assumed)
                                         : database_band(chosen.resin, assumed));
  }
  std::erase(words, std::string());
  return words;
}

}  // namespace slicecorr::cli
