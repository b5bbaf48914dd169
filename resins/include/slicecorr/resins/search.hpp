// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file search.hpp
/// How words find resins and printers, and which resins go with a printer.
///
/// Capitals, spaces, hyphens and the like count for nothing: "abs-like" occurs in "ABS Like", "strongx"
/// in "Strong-X". Words that say the same are one: "gray" is "grey".
///
/// All functions are thread-safe. What reads the database throws `DeviceError` when a disk fails; files
/// that can't be read are passed over, `find_records` tells them.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// The words of a text, in order, each once.
std::vector<std::string> words_in(std::string_view text);
/// Whether every word of `words` occurs in one of `texts`, which may be a part of it.
bool words_occur(std::string_view words, std::span<const std::string> texts);
/// Where words of a resin are looked for: name, maker, product, aliases, tags, chemistry, colour, notes,
/// and its wavelength ("405 nm").
std::vector<std::string> searched_texts(const ResinRecord& record);
/// The same of a printer's file: name, maker and product. Empty when it can't be read.
std::vector<std::string> searched_texts_of_printer(const std::string& path);

/// What helps where a search finds nothing.
struct SearchHelp {
  std::size_t resins = 0;  ///< that have all the words: something else left them out
  /// Each word, and how many resins have it.
  std::vector<std::pair<std::string, std::size_t>> alone;
  std::vector<std::string> near;  ///< words of resins that are like one that none has
  std::size_t printers = 0;       ///< that have all the words
};
SearchHelp search_help(std::string_view words);

/// Why a resin does not go with a printer.
enum class Misfit {
  wavelength,  ///< it was measured in light of another one (same_light.hpp)
  unit,        ///< its doses count light in another unit (light_unit.hpp)
  tuned,       ///< it was tuned with another printer, or another calibration of it
};
/// Nothing where resin and printer go together, as far as their files say. Of a printer whose light is
/// to be measured the wavelength alone counts.
std::optional<Misfit> misfit(const Printer& printer, const Resin& resin);

}  // namespace slicecorr::resins
