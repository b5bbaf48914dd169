// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file print_file.hpp
/// What formats of one binary file (CTB, GOO and the like) are beyond other archives: files with few
/// grey levels, changed more often than made, with a record beside them (docs/formats.md).
///
/// Pure functions of files and values, thread-safe. What can't be read throws `InputError`, a failing
/// disk `DeviceError`.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "slicecorr/settings.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {

/// What new archives of a format can hold.
struct FormatLimits {
  /// Whether archives of it are made from nothing; else only such that are there are changed.
  bool made_new = true;
  int levels = 256;  ///< grey levels of a new file, 2..256
};
/// Throws `InputError` when there is no format of this name.
FormatLimits limits_of_format(const std::string& name);
/// Throws `InputError` where `file` is of a format whose archives are not made from nothing and changes
/// none (`keep_from`), or of one that has no place for `uneven` heights of layers.
void check_can_be_made(const StackFile& file, bool uneven);

/// Whether printers that read files of `format` lift after each layer, whatever their files say: those of
/// print files. False for a format that is not known.
bool printers_always_lift(const std::string& format);
/// Throws `InputError` where `process` is continuous and `file` is such a file, unless somebody said that it is
/// (`said`). Names are of `names`.
void check_lifts(const StackFile& file, const Process& process, bool said, ChoiceNames names);
/// That what is told of a continuous print holds only where nothing lifts, as a sentence: where the printers
/// that read files of `format` do, always or as a rule. Empty elsewhere.
std::string holds_without_lifts(const std::string& format, const Process& process);

/// What else a print file says, for people: name and value. Empty for other archives.
std::vector<std::pair<std::string, std::string>> print_file_facts(const std::string& path);

/// Whether an archive that is corrected into the same format keeps what it says besides its slices: what
/// other programs wrote, and print files, also such as were made from a template.
bool keeps_settings(const std::string& path, const StackInfo& info);

/// Where the record of a stack lies that is written into a format of one binary file, which has no
/// place for it: "part.ctb.slicecorr", a zip. It counts only as long as the file is the one it is of.
std::string record_beside(const std::string& path);
/// Gives a file another name on the same file system, with the record beside it where there is one;
/// one that lay beside the old file of that name goes.
void rename_with_record(const std::string& from, const std::string& to);

/// That a printer is said to show no grey (`[display] grey` of its file, a name or a path), as a sentence; empty
/// where its file does not say so. Throws `InputError` as `load_display`.
std::string doubted_grey_in_words(const std::string& printer);

/// The endings of the files that a printer says it reads (`reads` of its file, a name or a path), with
/// their points; empty where it does not say. Throws `InputError` as `load_display`.
std::vector<std::string> endings_read_by(const std::string& printer);
/// That the printer says it reads others than `file`, as a sentence without the file's name; empty
/// where it does not. UVJ, which is converted, and a file whose settings stay (`keep_from`), which its
/// slicer made, are no others.
std::string not_read_in_words(const std::string& printer, const StackFile& file);
/// Throws `InputError` with that sentence.
void check_read_by(const std::string& printer, const StackFile& file);

/// The printer as a file of its format can show it: where a binary format holds fewer grey levels than
/// the printer has, one with fewer, at the intensities of those that the file shows, as `context` is
/// told. Throws `InputError` where only black and white are left.
Printer printer_for_file(const Printer& printer, const StackFile& file, const Grid& grid,
                         const ExecutionContext& context);

}  // namespace slicecorr
