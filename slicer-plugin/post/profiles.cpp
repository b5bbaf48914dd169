// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/profiles.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <set>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/text/ascii.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::post {

namespace {

using Words = std::set<std::string>;

/// Letters and digits in lower case, everything else between words.
Words words_of(const std::string& text) {
  Words words;
  std::string word;
  for (const char c : text + " ") {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || byte >= 0x80) {
      word += lower_case(c);
    } else if (!word.empty()) {
      words.insert(std::move(word));
      word.clear();
    }
  }
  return words;
}

/// "405nm"
bool is_wavelength(const std::string& word) {
  return word.size() > 2 && word.substr(word.size() - 2) == "nm" &&
         std::all_of(word.begin(), word.end() - 2,
                     [](unsigned char c) { return std::isdigit(c) != 0; });
}

/// "pro", "2", "4k", "m3": in a profile such words tell one model of a printer from another. A layer
/// height ("0.05") is none.
bool tells_models_apart(const std::string& word) {
  static const Words known = {"c", "dlp", "lite", "max", "mini",  "mono", "plus", "premium", "pro",
                              "s", "se",  "sky",  "sq",  "ultra", "x",    "xl",   "zero"};
  const bool digits =
      std::any_of(word.begin(), word.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
  return known.contains(word) || (digits && word[0] != '0' && !is_wavelength(word));
}

/// Whether a printer of this name is meant by a profile: all its words are there, and none that
/// makes it another model. Its light would be another's.
bool is_this_printer(const Words& name, const Words& profile) {
  return std::all_of(profile.begin(), profile.end(), [&](const std::string& word) {
    return name.contains(word) || !tells_models_apart(word);
  });
}

}  // namespace

std::string definition_of_profile(const std::string& profile, const std::string& kind,
                                  double wavelength_nm) {
  const Words wanted = words_of(profile);
  if (wanted.empty()) return {};
  std::string best;
  std::size_t most = 0;
  bool several = false;
  for (const Definition& definition : list_definitions(kind)) {
    std::vector<Words> names;
    bool to_be_measured = false;
    try {
      const toml::table root = parse_toml(read_text_file(definition.path), definition.path);
      const auto text = [&](const char* key) {
        return root[key].value<std::string>().value_or(std::string());
      };
      const double made_for = root["cure"]["wavelength_nm"].value<double>().value_or(0);
      if (!same_light(wavelength_nm, made_for)) continue;
      to_be_measured = root["blue"]["calibration"].value<std::string>() == kToBeMeasured;
      Words name = words_of(definition.name);
      std::erase_if(name, is_wavelength);
      names.push_back(std::move(name));
      if (const std::string product = text("product"); !product.empty()) {
        names.push_back(words_of(text("maker") + " " + product));
        // What makers call their printers names the maker already.
        if (kind == "printer") names.push_back(words_of(product));
      }
    } catch (const InputError&) {
      continue;  // a damaged definition is no one's profile
    }
    std::size_t matched = 0;
    for (const Words& words : names) {
      if (std::includes(wanted.begin(), wanted.end(), words.begin(), words.end()) &&
          (kind != "printer" || is_this_printer(words, wanted))) {
        matched = std::max(matched, words.size());
      }
    }
    if (matched == 0) continue;
    // Whoever measured a printer has a file of the same maker and product beside the one that is to be
    // measured, and means that.
    const std::size_t fits = 2 * matched + (to_be_measured ? 0 : 1);
    if (fits < most) continue;
    several = fits == most;
    most = fits;
    best = definition.name;
  }
  return several ? std::string() : best;
}

}  // namespace slicecorr::post
