// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/definition_keys.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "process/keys/kind_keys.hpp"
#include "support/text/display_text.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

namespace {

/// A file has at most so many that are told one by one.
constexpr std::size_t kMostTold = 10;

class UnknownKeys {
 public:
  explicit UnknownKeys(std::string_view kind) : kind_(kind) {}

  std::vector<UnknownKey> of(const toml::table& root) {
    for (const auto& [key, node] : root) look_at(key, node);
    std::stable_sort(found_.begin(), found_.end(),
                     [](const UnknownKey& a, const UnknownKey& b) { return a.line < b.line; });
    return std::move(found_);
  }

 private:
  using Words = std::vector<std::string_view>;

  void add(const toml::key& key, std::string_view table, std::string message) {
    found_.push_back({static_cast<int>(key.source().begin.line), full_key(table, key.str()),
                      std::move(message)});
  }
  static void add_once(Words& words, std::string_view word) {
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
  }
  static std::string unknown(const char* what, std::string_view word, const Words& known) {
    const std::string near = nearest(word, known);
    return near.empty() ? fmt::format("unknown {}", what)
                        : fmt::format("unknown {}; did you mean '{}'?", what, near);
  }
  /// Tables of the table `name`: "blue" and "uv" of "lamps".
  Words tables_in(std::string_view name) const {
    Words inner;
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (rule.table.starts_with(name) && rule.table.substr(name.size()).starts_with('.')) {
        add_once(inner, rule.table.substr(name.size() + 1));
      }
    }
    return inner;
  }

  void look_at(const toml::key& key, const toml::node& node) {
    const std::string_view name = key.str();
    const toml::table* table = node.as_table();
    if (const Words inner = tables_in(name); table && !inner.empty()) {
      for (const auto& [word, below] : *table) {
        const bool known = std::find(inner.begin(), inner.end(), word.str()) != inner.end();
        if (!known) {
          add(word, name, unknown("table", word.str(), inner));
        } else if (const toml::table* t = below.as_table()) {
          look_into(full_key(name, word.str()), *t);
        }
      }
      return;
    }
    Words tables, keys;
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (rule.also_at_top) add_once(keys, rule.key);
      if (rule.table.empty()) {
        add_once(keys, rule.key);
      } else {
        add_once(tables, rule.table.substr(0, rule.table.find('.')));
      }
    }
    const auto has = [&](const Words& words) {
      return std::find(words.begin(), words.end(), name) != words.end();
    };
    if (has(keys) && !(has(tables) && table)) return;
    if (has(tables)) {
      if (table) look_into(name, *table);
      return;
    }
    // A key of some tables that was written before the table's head.
    std::string elsewhere;
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (rule.key != name || table) continue;
      elsewhere += fmt::format("{}[{}]", elsewhere.empty() ? "" : " or ", rule.table);
    }
    add(key, "",
        elsewhere.empty()
            ? unknown(table ? "table" : "key", name, table ? tables : keys)
            : fmt::format("stands outside of its table; expected it under {}", elsewhere));
  }

  void look_into(std::string_view name, const toml::table& table) {
    Words keys;
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (rule.table == name) keys.push_back(rule.key);
    }
    for (const auto& [key, node] : table) {
      if (!key_rule(kind_, name, key.str())) add(key, name, unknown("key", key.str(), keys));
    }
  }

  std::string_view kind_;
  std::vector<UnknownKey> found_;
};

}  // namespace

std::span<const KeyRule> definition_keys(std::string_view kind) {
  return kind == "printer" ? detail::printer_keys() : detail::resin_keys();
}

const KeyRule* key_rule(std::string_view kind, std::string_view table, std::string_view key) {
  for (const KeyRule& rule : definition_keys(kind)) {
    const bool here = rule.table == table || (table.empty() && rule.also_at_top);
    if (here && (rule.key == key || rule.key == "*")) return &rule;
  }
  return nullptr;
}

std::string full_key(std::string_view table, std::string_view key) {
  return table.empty() ? std::string(key) : fmt::format("{}.{}", table, key);
}

std::vector<UnknownKey> unknown_keys(std::string_view text, std::string_view kind) {
  const auto root = try_toml(text);
  return root ? UnknownKeys(kind).of(*root) : std::vector<UnknownKey>();
}

UnreadWords unread_words(std::string_view text, const std::string& source, std::string_view kind) {
  UnreadWords unread;
  const std::vector<UnknownKey> found = unknown_keys(text, kind);
  for (const UnknownKey& u : found) {
    if (unread.sentences.size() == kMostTold) {
      unread.sentences.push_back(
          fmt::format("{}: {} more that are not known count for nothing, too", source,
                      found.size() - kMostTold));
      break;
    }
    unread.sentences.push_back(fmt::format("{}:{}: {}: {} It counts for nothing", source, u.line,
                                           text::printable(u.key),
                                           u.message.ends_with('?') ? u.message : u.message + "."));
  }
  return unread;
}

}  // namespace slicecorr
