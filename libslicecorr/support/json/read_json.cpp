// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/json/read_json.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::detail {

std::string beyond_bounds(std::string_view text, const JsonBounds& bounds) {
  if (text.size() > bounds.bytes) return "has more than " + text::bytes(double(bounds.bytes));
  int depth = 0;
  std::size_t values = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    switch (text[i]) {
      case '"':
        // To the end of the text in quotes.
        for (++i; i < text.size() && text[i] != '"'; ++i) i += text[i] == '\\' ? 1 : 0;
        break;
      case '[':
      case '{':
        if (++depth > bounds.depth) return fmt::format("is nested more than {} deep", bounds.depth);
        ++values;
        break;
      case ']':
      case '}':
        --depth;
        break;
      case ',':
        if (++values > bounds.values) {
          return "has more than " + text::count(static_cast<std::int64_t>(bounds.values)) +
                 " values";
        }
        break;
      default:
        break;
    }
  }
  return {};
}

std::string in_words(const nlohmann::json::exception& error) {
  // "[json.exception.parse_error.101] parse error at line 1, column 5: ..."
  std::string_view what = error.what();
  if (const auto end = what.find("] "); what.starts_with('[') && end != what.npos) {
    what.remove_prefix(end + 2);
  }
  constexpr std::string_view kAt = "parse error at ", kOnly = "parse error: ";
  for (const std::string_view prefix : {kAt, kOnly}) {
    if (what.starts_with(prefix)) what.remove_prefix(prefix.size());
  }
  // It shows all that it has read of a token: megabytes of a text without an end.
  return text::clipped(text::printable(what.substr(0, 4000)), 300);
}

namespace {

template <class Json>
[[noreturn]] void refuse(const typename Json::exception& error, const JsonSource& source) {
  throw InputError(source.file, source.entry, "is not valid JSON: " + in_words(error));
}

}  // namespace

template <class Json>
Json read_json(std::string_view text, const JsonSource& source, const JsonBounds& bounds,
               const typename Json::parser_callback_t& keep) {
  if (const std::string beyond = beyond_bounds(text, bounds); !beyond.empty()) {
    throw InputError(source.file, source.entry, "is no JSON that is read here: it " + beyond);
  }
  try {
    return Json::parse(text.begin(), text.end(), keep);
  } catch (const typename Json::exception& error) {
    refuse<Json>(error, source);
  }
}

template <class Json>
Json try_json(std::string_view text, const JsonBounds& bounds) {
  if (!beyond_bounds(text, bounds).empty()) return Json(Json::value_t::discarded);
  return Json::parse(text.begin(), text.end(), nullptr, false);
}

template <class Json>
Json own_json(std::string_view text) {
  return Json::parse(text.begin(), text.end());
}

template nlohmann::json read_json(std::string_view, const JsonSource&, const JsonBounds&,
                                  const nlohmann::json::parser_callback_t&);
template nlohmann::ordered_json read_json(std::string_view, const JsonSource&, const JsonBounds&,
                                          const nlohmann::ordered_json::parser_callback_t&);
template nlohmann::json try_json(std::string_view, const JsonBounds&);
template nlohmann::ordered_json try_json(std::string_view, const JsonBounds&);
template nlohmann::json own_json(std::string_view);
template nlohmann::ordered_json own_json(std::string_view);

}  // namespace slicecorr::detail
