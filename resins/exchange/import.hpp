// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The readers behind `import_definitions`, one per kind of file.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/resins/exchange.hpp"

namespace slicecorr::resins {

/// Between the texts of a list in one cell of a table.
inline constexpr char kBetweenTexts = ';';

/// What a reader gets, and where it tells what it had to leave out and why.
struct ImportSource {
  std::string path;
  std::string file;  ///< without its folders: stands in what is written
  std::string text;
  std::vector<std::string>* left_out = nullptr;
  void leave_out(const std::string& why) const {
    if (left_out) left_out->push_back(why);
  }
};

std::vector<Imported> import_prusaslicer(const ImportSource& source, const ImportOptions& options);
std::vector<Imported> import_key_values(const ImportSource& source, const ImportOptions& options);
std::vector<Imported> import_anycubic(const ImportSource& source, const ImportOptions& options);
std::vector<Imported> import_table(const ImportSource& source, const ImportOptions& options);
std::vector<Imported> import_calibration(const ImportSource& source, const ImportOptions& options,
                                         const char* lamp);
/// A calibration that has every grey level of the printer once, from 0 on: one value per row, or
/// level and value.
std::vector<Imported> import_lookup_table(const ImportSource& source, const ImportOptions& options);
std::vector<Imported> import_flat_field(const ImportSource& source, const ImportOptions& options,
                                        bool correction_mask);

/// Whether a file is a print file of one binary block, by its name and by what it holds. `begin`: its
/// first bytes. Throws `InputError` where it has the name of one and is damaged.
bool is_print_file(const std::string& path, const std::string& begin);
std::vector<Imported> import_print_file(const ImportSource& source, const ImportOptions& options);

/// Whether a key of a profile, in small letters and digits alone, says an exposure time.
bool is_exposure_key(const std::string& key);
/// What a profile of a printer says of its display: "1440 x 2560 pixels of 47.25 x 47.25 um, portrait";
/// empty where the text is none, or says exposure times, too.
std::string printer_profile_in_words(const std::string& text);

/// A resin file in the making. Texts that are empty and numbers that are 0 are not written.
struct ResinDraft {
  std::string name, maker, product, chemistry, colour, notes;
  std::vector<std::string> aliases, tags;
  double wavelength_nm = 0;
  std::string model = "jacobs";
  double m = 1;
  double height_e_um = 0;
  double gel_mj_cm2 = 0;           ///< areal; volumetric beside it as a comment
  double aim_mj_cm2 = 0;           ///< areal, instead of gel dose times factor
  double critical_dose_prime = 0;  ///< kinetic
  double gel_a = 0, gel_b = 0;     ///< gel-time, mJ/cm² and sqrt(mW/cm²)·s
  double dose_factor = 0;
  double active_absorption_per_cm = 0, n = 0;
  double inhibition_dose_mj_cm3 = 0, inhibition_resupply_mj_cm3_s = 0;
  double dose_diffusion_m2_s = 0, scatter_um2_per_um = 0, viscosity_pa_s = 0;
  std::optional<double> inhibitor_life_s;
  double beta = 0, huv_um = 0, inhibited_m = 0, inhibited_prime = 0;
  std::vector<std::pair<std::string, std::string>> provenance;
  std::vector<std::string> assumptions;
};
/// The text, which is checked: throws `InputError` when it would be no resin.
Imported finish_resin(const ResinDraft& draft, const ImportSource& source,
                      const std::string& format);

/// A stable name made of any text.
std::string stable_name_of(const std::string& text);

/// Exposure times of one resin at several layer heights, as profiles give them.
struct LayerExposure {
  double layer_um = 0, exposure_s = 0;
};
/// Makes a resin of them. Layers are taken to be cured through: exposure = tc e^(layer / h), so h
/// is the slope of layer height over ln(exposure). Fills height, dose and assumptions of `draft`;
/// otherwise the reason why nothing can be made.
/// `light_share`: share of the intensity that the exposures were made with, above 0.
std::string resin_of_exposures(const std::vector<LayerExposure>& exposures,
                               const ImportOptions& options, ResinDraft& draft,
                               double light_share = 1);

}  // namespace slicecorr::resins
