/// @file exchange.hpp
/// Resins and printers from and for other programs. Every conversion says what it assumed.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// A definition made from a foreign file: text of a resin or printer file, ready to save.
struct Imported {
  std::string kind;  ///< "resin" or "printer"
  std::string name;
  std::string text;
  std::vector<std::string> assumptions;  ///< also in the text, as comments
};

/// What import takes from the command line, where a file does not say it.
struct ImportOptions {
  std::string format =
      "auto";        ///< auto, prusaslicer, uvtools, anycubic, table, calibration, flat-field
  std::string only;  ///< substring of the preset names to import; empty: all
  std::string name;  ///< name of the result when the file has one definition
  double intensity_mw_cm2 = 0;  ///< of the printer that a profile is for; needed to turn s into mJ
  double wavelength_nm = 0;
  std::string printer;  ///< calibration, flat-field: the printer file it belongs to
};

/// Reads what users have: PrusaSlicer .ini with [sla_material:...] sections (or one exported
/// material), UVtools and other `key = value` profiles, Anycubic JSON with depth_penetration_curve,
/// tables of Dp and Ec (CSV), measured calibrations and flat-fields of printers. Throws
/// `InputError` naming what the file lacks.
std::vector<Imported> import_definitions(const std::string& path, const ImportOptions& options);

/// "toml", "json", "csv", "prusaslicer".
std::string export_record(const ResinRecord& record, const std::string& format, double layer_um,
                          double intensity_mw_cm2);

/// Text of a resin file made from fits of the same resin (a cure fit, and maybe a dead-zone fit).
/// `previous`: a record whose words, comments and other keys are kept.
std::string record_text_from_fit(const std::string& name, const std::vector<FitResult>& fits,
                                 const ResinRecord* previous);

}  // namespace slicecorr::resins
