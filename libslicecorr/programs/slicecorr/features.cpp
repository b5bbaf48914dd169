// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "features.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "programs/common/figures.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr::cli {

namespace {

const char* name_of_verdict(Verdict verdict) {
  return verdict == Verdict::refused         ? "refused"
         : verdict == Verdict::not_corrected ? "not corrected for, and refused"
         : verdict == Verdict::without       ? "left out, and told"
                                             : "corrected column by column, and told";
}

/// What is answered where all of these are asked for: the pair of the table that decides, refusals
/// first; null: all are counted.
const Unsupported* deciding(const std::vector<Feature>& together) {
  for (const Verdict v :
       {Verdict::refused, Verdict::not_corrected, Verdict::alone, Verdict::without}) {
    if (const Unsupported* pair = find_unsupported(together, v)) return pair;
  }
  return nullptr;
}

/// Every feature alone and with every other, in both modes and with both kinds of resin.
nlohmann::ordered_json feature_rows() {
  const auto is_uv = [](Feature f) {
    return f == Feature::uv_constant || f == Feature::uv_per_slice || f == Feature::uv_patterned ||
           f == Feature::even_dead_zone;
  };
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  const auto add = [&](Feature a, std::optional<Feature> b, bool layerwise, bool gel_time) {
    // Layers are lifted where they are exposed one by one.
    const auto is = [&](Feature f) { return a == f || b == f; };
    if (!layerwise && (is(Feature::lifts) || is(Feature::exchange))) return;
    // Heights have a feature for each mode.
    if (is(layerwise ? Feature::moved_heights : Feature::own_heights)) return;
    std::vector<Feature> together{a};
    if (b) together.push_back(*b);
    if (is(Feature::exchange) && !is(Feature::lifts)) together.push_back(Feature::lifts);
    if (is(Feature::own_light)) together.push_back(Feature::dim_light);
    if (layerwise) together.push_back(Feature::layerwise);
    if (gel_time) together.push_back(Feature::gel_time);
    // A correction is robust against what is uncertain.
    if (a == Feature::robust || b == Feature::robust) together.push_back(Feature::derivatives);
    const Unsupported* pair = deciding(together);
    const bool refused =
        pair && (pair->verdict == Verdict::refused || pair->verdict == Verdict::not_corrected);
    rows.push_back({{"feature", name_of(a)},
                    {"with", b ? nlohmann::ordered_json(name_of(*b)) : nullptr},
                    {"mode", layerwise ? "layerwise" : "continuous"},
                    {"model", gel_time ? "gel-time" : "kinetic"},
                    {"answer", !pair     ? "counted"
                               : refused ? "refused"
                                         : "alone"},
                    {"words", pair ? pair->words : ""}});
  };
  for (const bool layerwise : {false, true}) {
    for (const bool gel_time : {false, true}) {
      for (int i = 0; i < kFeatures; ++i) {
        const auto a = static_cast<Feature>(i);
        if (a == Feature::layerwise || a == Feature::gel_time) continue;
        add(a, std::nullopt, layerwise, gel_time);
        for (int k = 0; k < kFeatures; ++k) {
          const auto b = static_cast<Feature>(k);
          if (b == a || b == Feature::layerwise || b == Feature::gel_time) continue;
          // UV light is of one kind.
          if (!(is_uv(a) && is_uv(b))) add(a, b, layerwise, gel_time);
        }
      }
    }
  }
  return rows;
}

std::string features_json() {
  nlohmann::ordered_json json;
  for (int f = 0; f < kFeatures; ++f) {
    json["features"].push_back(name_of(static_cast<Feature>(f)));
  }
  json["rows"] = feature_rows();
  json["not_together"] = nlohmann::ordered_json::array();
  for (const Unsupported& pair : unsupported()) {
    json["not_together"].push_back({{"a", name_of(pair.a)},
                                    {"b", name_of(pair.b)},
                                    {"verdict", name_of_verdict(pair.verdict)},
                                    {"words", pair.words}});
  }
  json["laws_not_counted"] = nlohmann::ordered_json::array();
  for (const UncountedLaw& row : uncounted_laws()) {
    json["laws_not_counted"].push_back(
        {{"use", name_of(row.use)}, {"law", name_of(row.law)}, {"words", row.words}});
  }
  return json.dump(1);
}

/// For each feature what it does not go with.
std::string features_text() {
  std::string text =
      "What a print can have, and with what of it it does not go together. What three of them, a "
      "printer or a file can't do is told where it comes up.\n";
  for (int f = 0; f < kFeatures; ++f) {
    const auto feature = static_cast<Feature>(f);
    text += "\n" + name_of(feature) + "\n";
    for (const Unsupported& pair : unsupported()) {
      if (pair.a != feature && pair.b != feature) continue;
      const Feature other = pair.a == feature ? pair.b : pair.a;
      const bool left_out = pair.verdict == Verdict::without;
      text += fmt::format("  {} {}\n",
                          pair.verdict == Verdict::alone ? "corrected column by column with"
                          : pair.verdict == Verdict::not_corrected ? "not corrected for with"
                          : left_out && pair.a == feature          ? "left out, and told, with"
                          : left_out                               ? "leaves out, and tells,"
                                                                   : "not with",
                          name_of(other));
    }
  }
  text += "\nWhere laws of cure are not counted besides\n";
  for (const UncountedLaw& row : uncounted_laws()) {
    text += fmt::format("  not in {}: {}\n", name_of(row.use), name_of(row.law));
  }
  return text;
}

std::string settings_json() {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const Setting& s : settings()) {
    json.push_back({{"name", s.name},
                    {"group", s.group},
                    {"takes", setting_takes(s)},
                    {"list", !s.column.empty()},
                    {"text", setting_text(ChoiceNames::fields, s)},
                    {"only_where_corrected", s.corrects},
                    {"is_option", s.said_by == SaidBy::all},
                    {"library_only", s.said_by == SaidBy::library}});
    if (!s.words.empty()) json.back()["words"] = s.words;
  }
  return json.dump(1);
}

const char* said_by(const Setting& s) {
  return s.said_by == SaidBy::all    ? ""
         : s.said_by == SaidBy::jobs ? "; C, C++ and jobs only"
                                     : "; C and C++ only";
}

/// By heading each setting with what it takes and is.
std::string settings_text() {
  std::string text =
      "What can be chosen of a print: as an option with dashes (--speed-mm-h), as a key of jobs and a "
      "setting of the C interface as it stands.\n";
  for (const std::string_view heading : kSettingGroups) {
    text += fmt::format("\n{}\n", heading);
    for (const Setting& s : settings()) {
      if (s.group != heading) continue;
      text +=
          fmt::format("  {}: {}{}{}\n      {}\n", s.name, s.column.empty() ? "" : "a list, each ",
                      setting_takes(s), said_by(s), setting_text(ChoiceNames::fields, s));
    }
  }
  return text;
}

/// A command that prints a table, as text or JSON.
void add_table(Program& program, const std::string& name, const std::string& what,
               std::string (*text)(), std::string (*json)()) {
  auto to = std::make_shared<std::string>();
  CLI::App* app = program.add(name, what, [=](const ExecutionContext&, Console&) {
    if (to->empty()) {
      print_result(text());
    } else {
      print_or_write(*to, json());
    }
    return static_cast<int>(kDone);
  });
  app->add_option("--json", *to, "Write all that the table says as JSON to FILE, or - for stdout")
      ->expected(0, 1)
      ->default_str("-");
}

}  // namespace

void add_tables(Program& program) {
  add_table(program, "features", "What goes with what: features that are not counted together",
            features_text, features_json);
  add_table(program, "settings", "What can be chosen of a print, and what each choice takes",
            settings_text, settings_json);
}

}  // namespace slicecorr::cli
