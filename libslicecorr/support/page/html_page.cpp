// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/page/html_page.hpp"

namespace slicecorr::page {

namespace {

Markup of_class(std::string_view kind) {
  return kind.empty() ? Markup() : markup(R"( class="{}")", kind);
}

}  // namespace

Table::Table(std::string_view kind, std::string_view label, bool tall) {
  open_ = markup(R"(<div class="scroll{}")", tall ? " tall" : "");
  open_ += label.empty() ? Markup::raw(kScrolls)
                         : markup(R"( tabindex="0" role="region" aria-label="{}")", label);
  open_ += markup("><table{}>", of_class(kind));
}

void Table::column(const Markup& head, std::string_view kind) {
  columns_ += markup(R"(<th scope="col"{}>{}</th>)", of_class(kind), head);
}

void Table::begin(std::string_view kind) {
  if (!rows_.empty()) rows_ += markup("</tr>");
  rows_ += markup("<tr{}>", of_class(kind));
}

void Table::head(const Markup& text, std::string_view scope) {
  rows_ += markup(R"(<th scope="{}">{}</th>)", scope, text);
}

void Table::cell(const Markup& content, std::string_view kind, int columns) {
  rows_ += markup("<td{}{}>{}</td>", of_class(kind),
                  columns > 1 ? markup(R"( colspan="{}")", columns) : Markup(), content);
}

void Table::row_of(const std::vector<std::string>& texts) {
  for (const std::string& text : texts) &text == &texts.front() ? row(text) : cell(text);
}

Table::operator Markup() const {
  Markup html = open_;
  if (!columns_.empty()) html += markup("<thead><tr>{}</tr></thead>", columns_);
  html += markup("<tbody>{}", rows_);
  if (!rows_.empty()) html += markup("</tr>");
  return html + markup("</tbody></table></div>");
}

std::string style(std::initializer_list<std::string_view> more) {
  std::string all(page_page_css);
  for (const std::string_view css : more) all += css;
  return all;
}

Page::Page(std::string_view title, std::initializer_list<std::string_view> styles)
    : main_(markup(
          R"(<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">{2}<title>{0}</title><style>{1}</style></head><body><main><h1>{0}</h1>)",
          title, Markup::raw(style(styles)), Markup::raw(kGenerator))) {}

void Page::scripts(std::string_view id, std::string_view json,
                   std::initializer_list<std::string_view> sources) {
  scripts_ = markup(R"(<script type="application/json" id="{}">)", id).html();
  // Nothing in it ends the element.
  for (const char c : json) c == '<' ? scripts_ += "\\u003c" : scripts_ += c;
  scripts_ += "</script><script>";
  for (const std::string_view source : sources) scripts_ += source;
  scripts_ += "</script>";
}

}  // namespace slicecorr::page
