// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "database/toml_edit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

/// Byte at which a line (from 1) begins; the end of the text past the last.
std::size_t line_start(const std::string& text, std::uint32_t line) {
  std::size_t at = 0;
  for (std::uint32_t l = 1; l < line; ++l) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string::npos) return text.size();
    at = end + 1;
  }
  return at;
}

/// Byte of a place; columns count characters, not bytes.
std::size_t byte_of(const std::string& text, const toml::source_position& place) {
  std::size_t at = line_start(text, place.line);
  for (std::uint32_t column = 1; column < place.column && at < text.size(); ++column) {
    ++at;
    while (at < text.size() && (static_cast<unsigned char>(text[at]) & 0xC0) == 0x80) ++at;
  }
  return at;
}

std::size_t after_line(const std::string& text, std::size_t at) {
  const std::size_t end = text.find('\n', at);
  return end == std::string::npos ? text.size() : end + 1;
}

const toml::table* table_in(const toml::table& root, std::string_view name) {
  if (name.empty()) return &root;
  const toml::node* node = root.get(name);
  return node ? node->as_table() : nullptr;
}

const toml::key* key_in(const toml::table& table, std::string_view name) {
  for (const auto& [key, value] : table) {
    if (key.str() == name) return &key;
  }
  return nullptr;
}

/// Last line that a plain key of the table takes up; 0 when it has none.
std::uint32_t last_key_line(const toml::table& table) {
  std::uint32_t last = 0;
  for (const auto& [key, value] : table) {
    if (!value.is_table() && !value.is_array_of_tables()) {
      last = std::max(last, value.source().end.line);
    }
  }
  return last;
}

void check(const toml::table& expected, const std::string& text, const std::string& source,
           std::string_view table, std::string_view key) {
  const auto changed = try_toml(text, source);
  if (!changed || *changed != expected) {
    throw InputError(source, fmt::format("{}{}{}", table, table.empty() ? "" : ".", key),
                     "can't be changed where it stands; expected a table with one key per line");
  }
}

}  // namespace

TomlEdit::TomlEdit(std::string text, std::string source)
    : text_(std::move(text)), source_(std::move(source)) {
  parse_toml(text_, source_);
}

void TomlEdit::set(std::string_view table, std::string_view key, std::string_view value) {
  toml::table root = parse_toml(text_, source_);
  const toml::table* in = table_in(root, table);
  std::string text = text_;
  if (const toml::node* node = in ? in->get(key) : nullptr) {
    const std::size_t begin = byte_of(text, node->source().begin);
    text.replace(begin, byte_of(text, node->source().end) - begin, value);
  } else {
    std::string added = fmt::format("{} = {}\n", key, value);
    std::size_t at = text.size();
    if (in && (table.empty() || in->source().begin)) {
      std::uint32_t line = last_key_line(*in);
      if (const toml::node* name = table.empty() ? in->get("name") : nullptr) {
        line = name->source().end.line;
      }
      if (line == 0 && !table.empty()) line = in->source().begin.line;
      at = line == 0 ? 0 : line_start(text, line + 1);
    } else {
      added = fmt::format("\n[{}]\n{}", table, added);
    }
    if (at > 0 && text[at - 1] != '\n') added.insert(0, "\n");
    text.insert(at, added);
  }
  // What it must parse to now.
  toml::table* target = &root;
  if (!table.empty()) {
    if (!in) root.insert_or_assign(table, toml::table{});
    target = root.get(table)->as_table();
  }
  toml::table single = parse_toml(fmt::format("v = {}\n", value), source_);
  target->insert_or_assign(key, std::move(*single.get("v")));
  check(root, text, source_, table, key);
  text_ = std::move(text);
}

void TomlEdit::remove(std::string_view table, std::string_view key) {
  toml::table root = parse_toml(text_, source_);
  const toml::table* in = table_in(root, table);
  const toml::key* name = in ? key_in(*in, key) : nullptr;
  if (!name) return;
  const std::size_t begin = line_start(text_, name->source().begin.line);
  const std::size_t end = after_line(text_, byte_of(text_, in->get(key)->source().end));
  std::string text = text_;
  text.erase(begin, end - begin);
  (table.empty() ? root : *root.get(table)->as_table()).erase(key);
  check(root, text, source_, table, key);
  text_ = std::move(text);
}

void TomlEdit::set_comment(std::string_view table, std::string_view key, std::string_view comment) {
  const toml::table root = parse_toml(text_, source_);
  const toml::table* in = table_in(root, table);
  const toml::key* name = in ? key_in(*in, key) : nullptr;
  if (!name) return;
  const std::size_t end = line_start(text_, name->source().begin.line);
  std::size_t begin = end;
  while (begin > 0) {
    const std::size_t above = begin < 2 ? 0 : text_.rfind('\n', begin - 2) + 1;
    const std::size_t first = text_.find_first_not_of(" \t", above);
    if (first >= begin || text_[first] != '#') break;
    begin = above;
  }
  std::string lines(comment);
  if (!lines.empty() && lines.back() != '\n') lines += '\n';
  std::string text = text_;
  text.replace(begin, end - begin, lines);
  check(root, text, source_, table, key);
  text_ = std::move(text);
}

bool TomlEdit::has(std::string_view table, std::string_view key) const {
  const toml::table root = parse_toml(text_, source_);
  const toml::table* in = table_in(root, table);
  return in && in->get(key);
}

std::string toml_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    switch (c) {
      case '"':
        out += "\\\"";
        break;
      case '\\':
        out += "\\\\";
        break;
      case '\n':
        out += "\\n";
        break;
      case '\t':
        out += "\\t";
        break;
      case '\r':
        out += "\\r";
        break;
      default:
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) {
          out += fmt::format("\\u{:04X}", static_cast<int>(c));
        } else {
          out += c;
        }
    }
  }
  return out + "\"";
}

std::string toml_texts(const std::vector<std::string>& texts) {
  std::string out;
  for (const std::string& text : texts) out += (out.empty() ? "" : ", ") + toml_text(text);
  return fmt::format("[{}]", out);
}

std::string toml_number(double value, int digits) {
  std::string text = fmt::format("{:.{}g}", value, digits);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

}  // namespace slicecorr::resins
