/// @file load_printer.hpp
/// Printers with the pictures that their files name. Apart from process.hpp, because images are
/// read. Thread-safe. All throw `InputError`, which names file, line and key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// By a path to a .toml file, or by a name that `find_definition` finds.
Printer load_printer(const std::string& name_or_path);
/// From the text of a printer file. Other files that it names lie beside `source`.
Printer complete_printer(std::string_view text, const std::string& source);

/// Reads the picture of a flat-field: a PNG, colour is averaged. Throws `InputError` when it is
/// none, black, or does not fit the display.
FlatField load_flat_field(const std::string& path, const Printer& printer, bool of_plate,
                          std::optional<int> reference);

}  // namespace slicecorr
