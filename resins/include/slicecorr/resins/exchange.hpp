// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file exchange.hpp
/// Resins and printers from and for other programs. Every conversion says what it assumed.
///
/// All functions are thread-safe. What can't be read or made throws `InputError`, failing disks
/// `DeviceError`.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "slicecorr/gel_time.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// A file that a definition names; it must be saved beside it first.
struct Attachment {
  std::string table, key;  ///< where the definition names it
  std::string stem, extension, bytes;
};

/// A definition made from a foreign file: text of a resin or printer file, ready to save.
struct Imported {
  std::string kind;  ///< "resin" or "printer"
  std::string name;
  std::string text;
  std::vector<std::string> assumptions;  ///< also in the text, as comments
  std::vector<Attachment> attachments;   ///< images of printers
};

/// What import takes from the command line, where a file does not say it.
struct ImportOptions {
  /// auto, prusaslicer, uvtools, anycubic, table, calibration, uv-calibration, lut (a calibration
  /// with every grey level of the printer), flat-field, print-file, correction-mask (of a projector that
  /// multiplies grey levels by it)
  std::string format = "auto";
  std::string only = "";  ///< substring of the preset names to import; empty: all
  std::string name = "";  ///< name of the result when the file has one definition
  /// Of the printer that a profile is for; needed to turn s into mJ. Of full light, for a
  /// calibration or lut in other units; 0: it is in mW/cm².
  double intensity_mw_cm2 = 0;
  double wavelength_nm = 0;
  double height_um = 0;      ///< absorbance height, base e, where a profile can't give it
  std::string printer = "";  ///< calibration, lut, flat-field: the printer file it belongs to
  /// flat-field: where its picture or readings lie, "plate" or "image"; empty: readings on the plate,
  /// pictures as their shape says.
  std::string frame = "";
  /// flat-field: x and y, mm, of the place where the calibration was measured; empty: the brightest.
  std::vector<double> calibrated_at_mm = {};
};

/// Reads what users have: PrusaSlicer .ini with [sla_material:...] sections (or one exported
/// material), UVtools and other `key = value` profiles, print files of one binary block, Anycubic JSON with depth_penetration_curve,
/// tables of Dp and Ec (CSV), measured calibrations and flat-fields of printers. `left_out` takes
/// what the file has that nothing could be made of, and why. Throws `InputError` naming what the
/// file lacks when nothing at all could be made.
std::vector<Imported> import_definitions(const std::string& path, const ImportOptions& options,
                                         std::vector<std::string>* left_out = nullptr);

/// A definition from a file of its own, with the files that it names as attachments.
Imported with_its_files(const std::string& path, const std::string& kind);
/// Throws `InputError` when saving a definition would replace one in `folder`, or hide one of the
/// same name in another, and that was not asked for. The same text is no replacement.
void must_be_free(const std::string& folder, const Imported& definition, Replace replace);
/// Saves the attachments, then the definition that names them. One of the same name in another
/// folder, which it will hide, goes into the history first.
Saved save_imported(const Imported& definition, const std::string& folder, Replace replace,
                    const std::string& message);

/// "toml", "json", "csv" (columns that `import_definitions` reads as a table), "prusaslicer" (a
/// material as PrusaSlicer loads it). The last needs `layer_um` and `intensity_mw_cm2`; others take
/// no notice of them.
std::string export_record(const ResinRecord& record, const std::string& format, double layer_um,
                          double intensity_mw_cm2);

/// A full name and each of its words: "Jo Miller", "Jo", "Miller".
std::vector<std::string> names_of_person(const std::string& full_name);

/// A definition as it may be handed in: for others, without what is one person's alone.
struct Shared {
  std::string text;                     ///< of NAME.toml, without comments
  std::vector<Attachment> attachments;  ///< measurements; their whole names are stem + extension
  std::vector<std::string> left_out;    ///< sentences: what the text does not have, and why
  /// Why it may not be handed in; empty when it may. The rest is then empty.
  std::vector<Finding> wrong;
};
/// Makes one of the definition at `path`, under another name if `name` says one. `private_names`: of
/// users and computers, which no text may hold. What is wrong is all that `validate_definition` calls an
/// error, what a reader needs and the provenance lacks, and texts that hold a path, an address or one of
/// those names: it is the owner who says it in other words. Throws `InputError` where `name` can be none.
Shared share_definition(const std::string& path, const std::string& name,
                        const std::vector<std::string>& private_names);

/// Text of a resin file made from fits of the same resin (a cure fit, and maybe a dead-zone fit).
/// `previous`: a record whose words, comments and other keys are kept. No date is written: the same
/// fits give the same text. Measurements are named relative to `folder`, where the text will stand;
/// by their file names alone when it is empty.
std::string record_text_from_fit(const std::string& name, const std::vector<FitResult>& fits,
                                 const ResinRecord* previous, const std::string& folder = "");

/// How a resin cures, as found by calculation or from times alone.
struct CureLaw {
  CureModelKind model = CureModelKind::jacobs;
  double m = 1;                    ///< kinetic
  double critical_dose_prime = 0;  ///< jacobs (areal, mJ/cm²) and kinetic; that of gel
  GelTime gel_time;                ///< gel-time; that of gel
};

/// Text of a resin file of another name that cures by `law`; all else is as `previous` has it, but for
/// the measurements. `notes`: keys and texts for [provenance]. Throws `InputError` where the law has
/// something that is not above 0, and where `previous` has an [inhibition] that does not go with it.
std::string record_text_with_law(const std::string& name, const CureLaw& law,
                                 const std::vector<std::pair<std::string, std::string>>& notes,
                                 const ResinRecord& previous);

}  // namespace slicecorr::resins
