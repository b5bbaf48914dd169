// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file beam_vat.hpp
/// A vat into which several displays shine along its axes: the table [beams] of a printer file.
///
/// Everything else of the printer, pixels and curve of its displays above all, is `Printer`; all of
/// its displays are alike. Plain values; functions are thread-safe.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// One beam: from which side it comes, and which display shows its image where.
struct BeamWay {
  int axis = 0;            ///< 0 x, 1 y, 2 z
  bool from_plus = false;  ///< comes in where the axis ends, and goes against it
  int display = 1;         ///< 1..kMostDisplays
  /// Where the axis through the middle of the vat lies in the display's image, pixels from its left
  /// and from its top, edges counting as whole numbers.
  double column_px = 0, row_px = 0;
  bool mirror = false;  ///< the optics between display and vat show left as right
  bool operator==(const BeamWay&) const = default;
};
inline constexpr int kMostDisplays = 16;

/// Displays that delay light, with a lens of this focal length each (hologram.hpp).
struct PhaseVat {
  double pitch_um = 0, focal_mm = 0;  ///< > 0
  /// By which images stand beside the axis of the lens, to the right and up; the beam's axis is there.
  double dx_mm = 0, dy_mm = 0;
  int levels = 256;
  std::optional<double> stroke_turns, fill;
  bool operator==(const PhaseVat&) const = default;
};

struct BeamVat {
  std::array<double, 3> inside_mm{};  ///< along x, y, z (up), > 0
  std::vector<BeamWay> ways;          ///< at least one; sides differ
  std::optional<PhaseVat> phase;      ///< nothing: displays whose pixels are lit
  int displays() const;
  bool operator==(const BeamVat&) const = default;
};

/// Side length that a vat may have, mm.
inline constexpr double kMostVatMm = 1e4;

/// "-x", "+x" and so on; throws `InputError` for others.
BeamWay way_of_side(const std::string& side);
std::string side_of(const BeamWay& way);

/// The table [beams] of a printer file; nothing where it has none. Throws `InputError` naming file,
/// line and key. `printer`: of the same file.
std::optional<BeamVat> parse_beam_vat(const std::string& text, const std::string& source,
                                      const Printer& printer);
/// By a path to a .toml file, or by a name that `find_definition` finds.
std::optional<BeamVat> load_beam_vat(const std::string& name_or_path, const Printer& printer);

/// A vat of this size with a display for each of these sides, in whose middle the image is: for
/// printers whose file has no [beams].
BeamVat plain_vat(const std::array<double, 3>& inside_mm, const std::vector<std::string>& sides,
                  const Printer& printer);

}  // namespace slicecorr
