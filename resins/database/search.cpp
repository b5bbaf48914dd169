// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/search.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/files/text_file.hpp"
#include "support/text/ascii.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

/// Words that say the same; the second one stands for both.
constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kSameWords = {
    {{"gray", "grey"}, {"transparent", "clear"}}};

/// Small letters and digits alone, and what is not ASCII.
std::string plain(std::string_view text) {
  std::string out;
  for (const char c : text) {
    const char l = lower_case(c);
    if ((l >= 'a' && l <= 'z') || is_digit(l) || static_cast<unsigned char>(l) > 0x7F) out += l;
  }
  for (const auto& [word, stands] : kSameWords) {
    for (std::size_t at = 0; (at = out.find(word, at)) != std::string::npos; at += stands.size()) {
      out.replace(at, word.size(), stands);
    }
  }
  return out;
}

bool occurs(const std::string& word, std::span<const std::string> texts) {
  const std::string looked_for = plain(word);
  return std::any_of(texts.begin(), texts.end(), [&](const std::string& text) {
    // A word of signs alone stands as it is.
    return looked_for.empty() ? text.find(word) != std::string::npos
                              : plain(text).find(looked_for) != std::string::npos;
  });
}

}  // namespace

std::vector<std::string> words_in(std::string_view text) {
  std::vector<std::string> words;
  std::istringstream in{std::string(text)};
  for (std::string word; in >> word;) {
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
  }
  return words;
}

bool words_occur(std::string_view words, std::span<const std::string> texts) {
  const auto all = words_in(words);
  return std::all_of(all.begin(), all.end(),
                     [&](const std::string& word) { return occurs(word, texts); });
}

std::vector<std::string> searched_texts(const ResinRecord& record) {
  std::vector<std::string> texts = {record.name,      record.maker,  record.product,
                                    record.chemistry, record.colour, record.notes};
  texts.insert(texts.end(), record.aliases.begin(), record.aliases.end());
  texts.insert(texts.end(), record.tags.begin(), record.tags.end());
  if (record.wavelength_nm > 0) texts.push_back(fmt::format("{:g} nm", record.wavelength_nm));
  return texts;
}

std::vector<std::string> searched_texts_of_printer(const std::string& path) {
  try {
    const toml::table root = parse_toml(read_text_file(path), path);
    const TomlTable printer(root, path);
    return {printer.text("name", ""), printer.text("maker", ""), printer.text("product", "")};
  } catch (const InputError&) {
    return {};
  }
}

SearchHelp search_help(std::string_view words) {
  SearchHelp help;
  for (const std::string& word : words_in(words)) help.alone.emplace_back(word, 0);
  std::vector<std::string> known;
  for (const ResinRecord& record : find_records({})) {
    const auto texts = searched_texts(record);
    if (words_occur(words, texts)) ++help.resins;
    for (auto& [word, resins] : help.alone) resins += occurs(word, texts) ? 1 : 0;
    // Notes are sentences, whose words are none that somebody means.
    for (const std::string& text : texts) {
      if (text == record.notes) continue;
      for (const std::string& word : words_in(text)) known.push_back(lower_case(word));
    }
  }
  const std::vector<std::string_view> views(known.begin(), known.end());
  for (const auto& [word, resins] : help.alone) {
    const std::string near = resins > 0 ? std::string() : nearest(lower_case(word), views);
    if (!near.empty()) help.near.push_back(near);
  }
  for (const Definition& d : list_definitions("printer")) {
    if (words_occur(words, searched_texts_of_printer(d.path))) ++help.printers;
  }
  return help;
}

std::optional<Misfit> misfit(const Printer& printer, const Resin& resin) {
  if (other_wavelength(printer, resin)) return Misfit::wavelength;
  if (!light_is_measured(printer)) return std::nullopt;
  if (printer.unit != resin.unit) return Misfit::unit;
  if (tuned_with_another(printer, resin)) return Misfit::tuned;
  return std::nullopt;
}

}  // namespace slicecorr::resins
