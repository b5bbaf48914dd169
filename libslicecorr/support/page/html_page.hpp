// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file html_page.hpp
/// Pages of HTML that need no other files.
///
/// What goes in is text, and is escaped. HTML is a type of its own: `markup` makes it of a literal
/// and the values in it, `Markup::raw` of what is HTML or SVG already.
#pragma once

#include <fmt/format.h>

#include <concepts>
#include <initializer_list>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "support/text/escape.hpp"

namespace slicecorr::page {

// The style of all pages and what their scripts share, embedded when the library is built
// (cmake/EmbedText.cmake). Each is named after its file, beside this one.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_page_css, page_tiles_css, page_inflate_js, page_round_js;
// NOLINTEND(readability-identifier-naming)

/// What every page says of who made it, in its head.
inline constexpr std::string_view kGenerator = R"(<meta name="generator" content="slicecorr">)";

/// A piece of HTML.
class Markup {
 public:
  Markup() = default;
  /// Of a text, which is escaped.
  template <std::convertible_to<std::string_view> Text>
  Markup(const Text& text) : html_(escape_markup(text)) {}  // NOLINT(google-explicit-constructor)
  static Markup raw(std::string_view html) {
    Markup made;
    made.html_ = html;
    return made;
  }
  bool empty() const { return html_.empty(); }
  const std::string& html() const { return html_; }
  void operator+=(const Markup& more) { html_ += more.html_; }
  friend Markup operator+(const Markup& a, const Markup& b) { return raw(a.html_ + b.html_); }

 private:
  std::string html_;
};

/// A value as it stands in HTML.
template <typename Value>
auto in_markup(const Value& value) {
  if constexpr (std::is_arithmetic_v<Value>) {
    return value;
  } else {
    return Markup(value).html();
  }
}
template <typename... Values>
using Literal = fmt::format_string<decltype(in_markup(std::declval<Values>()))...>;

/// As fmt::format: texts among the values are escaped, numbers and pieces of HTML are as they are.
template <typename... Values>
Markup markup(std::type_identity_t<Literal<Values...>> literal, const Values&... values) {
  return Markup::raw(fmt::format(literal, in_markup(values)...));
}

template <typename Texts>
Markup items(const Texts& texts) {
  Markup html;
  for (const auto& text : texts) html += markup("<li>{}</li>", text);
  return html;
}
/// Of a box that scrolls where the page is narrower: keys scroll it, too.
inline constexpr std::string_view kScrolls = R"( tabindex="0" role="group" aria-label="Scrolls")";
inline Markup scrolled(const Markup& wide) {
  return markup(R"(<div class="scroll"{}>{}</div>)", Markup::raw(kScrolls), wide);
}
inline Markup captioned(const Markup& picture, const Markup& words) {
  return markup("<figure>{}<figcaption>{}</figcaption></figure>", picture, words);
}
/// A chart or another SVG, which scrolls.
inline Markup drawing(std::string_view svg, const Markup& words = {}) {
  const Markup drawn = scrolled(Markup::raw(svg));
  return words.empty() ? markup("<figure>{}</figure>", drawn) : captioned(drawn, words);
}

/// Figures in boxes.
class Tiles {
 public:
  /// `kind`: "good", "bad" or empty.
  void add(const Markup& figure, const Markup& words, std::string_view kind = {}) {
    tiles_ += markup(R"(<div class="tile {}"><b>{}</b><span>{}</span></div>)", kind, figure, words);
  }
  // NOLINTNEXTLINE(google-explicit-constructor)
  operator Markup() const { return markup(R"(<div class="tiles">{}</div>)", tiles_); }

 private:
  Markup tiles_;
};

/// A table in a box that scrolls. `kind`: a class.
class Table {
 public:
  /// With a `label` keys scroll it, too; what is `tall` scrolls in a low box.
  explicit Table(std::string_view kind = {}, std::string_view label = {}, bool tall = false);

  void column(const Markup& head, std::string_view kind = {});
  void columns(const auto&... heads) { (column(heads), ...); }
  /// Begins a row; what follows is added to it.
  void begin(std::string_view kind = {});
  void head(const Markup& text, std::string_view scope = "row");
  void cell(const Markup& content, std::string_view kind = {}, int columns = 1);
  void cells(const auto&... values) { (cell(markup("{}", values)), ...); }
  void row(const auto& name, const auto&... values) {
    begin();
    head(markup("{}", name));
    cells(values...);
  }
  /// A row of these texts, the first of which is its head.
  void row_of(const std::vector<std::string>& texts);
  operator Markup() const;  // NOLINT(google-explicit-constructor)

 private:
  Markup open_, columns_, rows_;
};

/// A page: its title, and what is added.
class Page {
 public:
  /// `styles`: CSS besides that of all pages.
  explicit Page(std::string_view title, std::initializer_list<std::string_view> styles = {});
  void operator+=(const Markup& more) { main_ += more; }
  /// Scripts, and the JSON that they find by its `id`.
  void scripts(std::string_view id, std::string_view json,
               std::initializer_list<std::string_view> sources);
  /// Without an end of line.
  std::string html() const { return main_.html() + "</main>" + scripts_ + "</body></html>"; }

 private:
  Markup main_;
  std::string scripts_;
};
/// The style of all pages, and more.
std::string style(std::initializer_list<std::string_view> more);

}  // namespace slicecorr::page
