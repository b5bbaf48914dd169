#include "post/profiles.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <set>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
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
    try {
      const toml::table root = parse_toml(read_text_file(definition.path), definition.path);
      const auto text = [&](const char* key) {
        return root[key].value<std::string>().value_or(std::string());
      };
      const double made_for = root["cure"]["wavelength_nm"].value<double>().value_or(0);
      if (wavelength_nm > 0 && made_for > 0 && made_for != wavelength_nm) continue;
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
      if (std::includes(wanted.begin(), wanted.end(), words.begin(), words.end())) {
        matched = std::max(matched, words.size());
      }
    }
    if (matched == 0 || matched < most) continue;
    several = matched == most;
    most = matched;
    best = definition.name;
  }
  return several ? std::string() : best;
}

}  // namespace slicecorr::post
