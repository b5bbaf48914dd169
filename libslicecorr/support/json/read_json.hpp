// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file read_json.hpp
/// The one way to read JSON. The parser of the library has no bounds: what is nested 100,000 deep is
/// read, and ends the program when it is copied or written.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace slicecorr::detail {

/// Where a JSON text stands: a file, and the entry in it where that is an archive.
struct JsonSource {
  /// Stands for no limit in the checks of numbers.
  static constexpr double kLargest = 1e300;
  std::string file, entry;
};

/// What a text may have at most.
struct JsonBounds {
  std::size_t bytes = std::size_t{64} << 20;
  int depth = 64;                  ///< of lists and objects in each other
  std::size_t values = 4'000'000;  ///< in all lists and objects together
};
/// For a list of up to a million layers of which each is dropped as soon as it has been read.
inline constexpr JsonBounds kManyLayers{std::size_t{1} << 30, 64, 100'000'000};

/// Which bound the text is beyond, "is nested more than 64 deep"; empty where it keeps all. Looks
/// at every byte once, takes no memory; says nothing of whether the text is JSON.
std::string beyond_bounds(std::string_view text, const JsonBounds& bounds);

/// What the parser says of a text, without its own names: "line 1, column 5: ...".
std::string in_words(const nlohmann::json::exception& error);

/// Reads a text. Throws `InputError` where it is beyond the bounds or no JSON. `keep`: as in
/// nlohmann::json.
template <class Json = nlohmann::json>
Json read_json(std::string_view text, const JsonSource& source, const JsonBounds& bounds = {},
               const typename Json::parser_callback_t& keep = nullptr);

/// The same where a text that can't be read counts as none: gives a discarded value then, which is
/// no object and no list.
template <class Json = nlohmann::json>
Json try_json(std::string_view text, const JsonBounds& bounds = {});

/// A text that this program wrote a moment ago.
template <class Json = nlohmann::json>
Json own_json(std::string_view text);

}  // namespace slicecorr::detail
