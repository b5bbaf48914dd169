// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Figures: as a struct, by name, as JSON; and lists.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "c_api/handles.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/tomo/print.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::c_api {

namespace {

using nlohmann::ordered_json;

/// Every number under `json` with the keys that lead to it, joined by points.
void flatten(const ordered_json& json, const std::string& place,
             std::vector<std::pair<std::string, double>>& numbers) {
  if (json.is_structured()) {
    for (const auto& [key, value] : json.items()) {
      flatten(value, place.empty() ? key : place + "." + key, numbers);
    }
  } else if (json.is_number()) {
    numbers.emplace_back(place, json.get<double>());
  } else if (json.is_boolean()) {
    numbers.emplace_back(place, json.get<bool>() ? 1 : 0);
  } else if (json.is_null()) {
    numbers.emplace_back(place, std::numeric_limits<double>::quiet_NaN());
  }
}

double number(const slicecorr_figures& figures, const char* name) {
  need(name, "name");
  for (const auto& [place, value] : figures.numbers) {
    if (place == name) return value;
  }
  Names known;
  for (const auto& [place, value] : figures.numbers) known.emplace_back(place, "");
  unknown_name(name, "figure", known);
}

}  // namespace

std::unique_ptr<slicecorr_figures> figures_of(std::string json) {
  auto figures = std::make_unique<slicecorr_figures>();
  figures->json = std::move(json);
  flatten(slicecorr::detail::own_json<nlohmann::ordered_json>(figures->json), "", figures->numbers);
  return figures;
}

std::unique_ptr<slicecorr_figures> figures_of(const Prediction& prediction) {
  auto figures = figures_of(prediction.to_json());
  figures->prediction = prediction;
  return figures;
}

namespace {

Names places_of(const std::string& json) {
  Names names;
  const auto figures = figures_of(json);
  for (const auto& [place, value] : figures->numbers) names.emplace_back(place, "");
  return names;
}

}  // namespace

Names figure_names() {
  // With those of layer by layer exposure, and of bodies.
  Prediction any;
  any.joints.emplace();
  any.bodies = std::make_shared<const JudgedBodies>();
  return places_of(any.to_json());
}
Names tomo_figure_names() { return places_of(tomo::PrintFigures{}.to_json()); }

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_status slicecorr_figures_summary(const slicecorr_figures* figures,
                                           slicecorr_summary* summary) {
  return guarded(nullptr, [&] {
    if (!need(figures, "figures").prediction) {
      throw BadCall(
          "figures of a plan or a tomographic job have no summary; expected those of a stack");
    }
    const slicecorr::Prediction& p = *figures->prediction;
    // Grows with the struct; this is its first version.
    constexpr std::size_t first_version = sizeof(slicecorr_summary);
    const std::size_t size = need(summary, "summary").struct_size;
    check_struct_size(size, first_version, "slicecorr_summary");
    slicecorr_summary s{};
    s.struct_size = size;
    s.target_voxels = p.target_voxels;
    s.printed_voxels = p.printed_voxels;
    s.cure_through_voxels = p.cure_through_voxels;
    s.undercure_voxels = p.undercure_voxels;
    s.lost_features = p.lost_features;
    s.merged_features = p.merged_features;
    s.iou = p.iou();
    s.mean_abs_height_error_um = number(*figures, "height_error_um.mean_abs");
    s.p95_abs_height_error_um = number(*figures, "height_error_um.p95_abs");
    s.max_abs_height_error_um = number(*figures, "height_error_um.max_abs");
    const std::size_t known = std::min(size, sizeof s);
    std::memcpy(summary, &s, known);
    // A caller with a newer header finds 0 in what this version does not know.
    std::memset(reinterpret_cast<char*>(summary) + known, 0, size - known);
  });
}

slicecorr_status slicecorr_figures_number(const slicecorr_figures* figures, const char* name,
                                          double* value) {
  return guarded(nullptr, [&] { need(value, "value") = number(need(figures, "figures"), name); });
}

slicecorr_status slicecorr_figures_require(const slicecorr_figures* figures, const char* name,
                                           double most) {
  return guarded(nullptr, [&] {
    const double value = number(need(figures, "figures"), name);
    if (std::isnan(most)) throw BadCall("the limit is NaN");
    // Without a sample nothing is beyond the limit.
    if (value > most) {
      throw Missed(fmt::format("{} is {:.6g}, allowed are {:g}", name, value, most));
    }
  });
}

const char* slicecorr_figures_json(const slicecorr_figures* figures) {
  return figures ? figures->json.c_str() : nullptr;
}

void slicecorr_figures_free(slicecorr_figures* figures) { delete figures; }

slicecorr_status slicecorr_list_new(const char* kind, slicecorr_list** list) {
  return guarded(nullptr, [&] {
    Output output(list, "list");
    const std::string asked = &need(kind, "kind");
    auto made = std::make_unique<slicecorr_list>();
    if (asked == "printer" || asked == "resin") {
      for (const auto& d : slicecorr::list_definitions(asked)) {
        made->entries.emplace_back(d.name, d.path);
      }
    } else if (asked == "format") {
      for (const auto& f : slicecorr::archive_formats()) {
        made->entries.emplace_back(f.name,
                                   fmt::format("{} ({})", f.what, fmt::join(f.endings, ", ")));
      }
    } else if (asked == "setting") {
      made->entries = setting_names();
    } else if (asked == "property") {
      made->entries = property_names();
    } else if (asked == "figure") {
      made->entries = figure_names();
    } else if (asked == "bench_property") {
      made->entries = bench_property_names();
    } else if (asked == "tomo_property") {
      made->entries = tomo_property_names();
    } else if (asked == "tomo_figure") {
      made->entries = tomo_figure_names();
    } else {
      unknown_name(kind, "kind of list",
                   {{"printer", ""},
                    {"resin", ""},
                    {"format", ""},
                    {"setting", ""},
                    {"property", ""},
                    {"figure", ""},
                    {"bench_property", ""},
                    {"tomo_property", ""},
                    {"tomo_figure", ""}});
    }
    output.give(std::move(made));
  });
}

size_t slicecorr_list_count(const slicecorr_list* list) { return list ? list->entries.size() : 0; }

const char* slicecorr_list_name(const slicecorr_list* list, size_t index) {
  return list && index < list->entries.size() ? list->entries[index].first.c_str() : nullptr;
}

const char* slicecorr_list_text(const slicecorr_list* list, size_t index) {
  return list && index < list->entries.size() ? list->entries[index].second.c_str() : nullptr;
}

void slicecorr_list_free(slicecorr_list* list) { delete list; }
