// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file load_printer.hpp
/// Printers with the pictures that their files name. Apart from process.hpp, because images are
/// read. Thread-safe. All throw `InputError`, which names file, line and key.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

struct GreyImage;

/// By a path to a .toml file, or by a name that `find_definition` finds.
Printer load_printer(const std::string& name_or_path);
/// From the text of a printer file. Other files that it names lie beside `source`.
Printer complete_printer(std::string_view text, const std::string& source);

/// The grey pixels of a PNG file; colour is averaged. `check` sees width and height before a pixel
/// is unpacked. Throws `InputError` when the file is no PNG, or larger than `is_image_size` has it.
GreyImage read_flat_field_png(const std::string& path,
                              const std::function<void(int width_px, int height_px)>& check = {});

/// A grey picture with all that a PNG tells of light.
struct CameraPicture {
  int width_px = 0, height_px = 0;
  int white = 255;                    ///< greatest value that there can be: 255 or 65535
  std::vector<std::uint16_t> pixels;  ///< row by row
};
/// The same of 16 bits where the file has them.
CameraPicture read_camera_png(const std::string& path);

/// Reads the picture of a flat-field: a PNG, colour is averaged. Throws `InputError` when it is
/// none, black, or does not fit the display.
FlatField load_flat_field(const std::string& path, const Printer& printer, bool of_plate,
                          std::optional<int> reference);

}  // namespace slicecorr
