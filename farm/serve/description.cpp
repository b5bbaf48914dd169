// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/description.hpp"

#include <nlohmann/json.hpp>

#include "serve/studies.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/settings.hpp"
#include "submit/fields.hpp"
#include "support/json/read_json.hpp"
#include "views/page_text.hpp"

namespace slicecorr::farm::detail {

namespace {

using Json = nlohmann::ordered_json;

/// Whether a key belongs to one of the groups that openapi.json names in `x-keys`.
bool belongs(const std::string& key, const std::string& group) {
  if (group == "all") return true;
  if (group == "placing") return is_placing(key);
  if (group == "process") {
    const Setting* const setting = find_setting(key);
    return setting && setting->said_by == SaidBy::all && key != "printer" && key != "resin";
  }
  return key == group;
}

}  // namespace

const std::string& api_description() {
  static const std::string text = [] {
    Json json = slicecorr::detail::try_json<Json>(std::string(page_openapi_json));
    const Json keys = field_schemas();
    for (Json& schema : json["components"]["schemas"]) {
      if (!schema.contains("properties") || !schema["properties"].contains("x-keys")) continue;
      Json& properties = schema["properties"];
      const Json groups = properties["x-keys"];
      properties.erase("x-keys");
      for (const auto& [key, described] : keys.items()) {
        for (const Json& group : groups) {
          if (belongs(key, group.get<std::string>())) properties[key] = described;
        }
      }
    }
    // What the browser takes, and what it can ask for, by the table of formats.
    Json formats = Json::array();
    for (const FormatInfo& f : archive_formats()) {
      if (f.endings.empty()) continue;
      formats.push_back({{"name", f.name},
                         {"what", f.what},
                         {"endings", f.endings},
                         {"made_new", limits_of_format(f.name).made_new}});
    }
    json["x-formats"] = std::move(formats);
    return json.dump(1) + "\n";
  }();
  return text;
}

}  // namespace slicecorr::farm::detail
