// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "features.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>

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

std::string features_json() {
  nlohmann::ordered_json json;
  for (int f = 0; f < kFeatures; ++f) {
    json["features"].push_back(name_of(static_cast<Feature>(f)));
  }
  json["not_together"] = nlohmann::ordered_json::array();
  for (const Unsupported& pair : unsupported()) {
    json["not_together"].push_back({{"a", name_of(pair.a)},
                                    {"b", name_of(pair.b)},
                                    {"verdict", name_of_verdict(pair.verdict)},
                                    {"words", pair.words}});
  }
  return json.dump(1) + "\n";
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
                    {"library_only", s.said_by == SaidBy::library}});
    if (!s.words.empty()) json.back()["words"] = s.words;
  }
  return json.dump(1) + "\n";
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
                      setting_takes(s), s.said_by == SaidBy::library ? "; C and C++ only" : "",
                      setting_text(ChoiceNames::fields, s));
    }
  }
  return text;
}

/// A command that prints a table, as text or JSON.
void add_table(Program& program, const std::string& name, const std::string& what,
               std::string (*text)(), std::string (*json)()) {
  auto as_json = std::make_shared<bool>(false);
  CLI::App* app = program.add(name, what, [=](const ExecutionContext&, Console&) {
    print_result(*as_json ? json() : text());
    return static_cast<int>(kDone);
  });
  app->add_flag("--json", *as_json, "As JSON, with all that the table says");
}

}  // namespace

void add_tables(Program& program) {
  add_table(program, "features", "What goes with what: features that are not counted together",
            features_text, features_json);
  add_table(program, "settings", "What can be chosen of a print, and what each choice takes",
            settings_text, settings_json);
}

}  // namespace slicecorr::cli
