// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of printed widths and of knife edges.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "measure/number_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/resins/spread_fit.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kMostUm = 1e6;

double or_else(double value, double otherwise) { return std::isnan(value) ? otherwise : value; }

void read_widths(const std::string& path, SpreadMeasurements& all) {
  enum : std::size_t { kind, designed, printed, depth, level, light, error };
  const std::vector<NumberColumn> columns = {{"kind", 0, 1, true, false, {"line", "gap"}},
                                             {"designed_um", 1e-9, kMostUm, true, false},
                                             {"printed_um", 0, kMostUm, true},
                                             {"depth_um", 0, kMostUm},
                                             {"level", 0, 255},
                                             {"light", 1e-6, 10},
                                             {"error_um", 1e-9, kMostUm}};
  read_number_table(
      path, columns,
      "kind, designed_um, printed_um, and depth_um, level or light, error_um as needed", "widths",
      [&](int line, const std::string& place, const std::vector<double>& v) {
        if (!std::isnan(v[level]) && !std::isnan(v[light])) {
          throw InputError(path, place, "has a level and a light; expected one of them");
        }
        // Forms to fill in have rows that nobody measured.
        if (std::isnan(v[printed])) return;
        all.widths.push_back({line, v[kind] == 0 ? WidthKind::line : WidthKind::gap, v[designed],
                              v[printed], v[depth], v[level], or_else(v[light], 1),
                              or_else(v[error], 1)});
      });
  if (all.widths.empty()) {
    throw InputError(path, "", "has no printed_um; expected widths as they were measured");
  }
}

void read_edges(const std::string& path, double box_um, SpreadMeasurements& all) {
  enum : std::size_t { position, intensity, depth, edge };
  const std::vector<NumberColumn> columns = {{"position_um", -kMostUm, kMostUm, true, false},
                                             {"intensity", -1e12, 1e12, true, false},
                                             {"depth_um", 0, kMostUm},
                                             {"edge", -1e6, 1e6}};
  std::map<std::pair<double, double>, KnifeEdge> edges;
  read_number_table(path, columns, "position_um, intensity, and depth_um, edge as needed", "places",
                    [&](int line, const std::string&, const std::vector<double>& v) {
                      KnifeEdge& e = edges[{or_else(v[edge], 0), or_else(v[depth], 0)}];
                      e.depth_um = or_else(v[depth], 0);
                      e.samples.push_back({line, v[position], v[intensity]});
                    });
  for (auto& [key, e] : edges) {
    e.source = path;
    e.box_um = {box_um, 0};
    std::stable_sort(e.samples.begin(), e.samples.end(),
                     [](const EdgeSample& a, const EdgeSample& b) { return a.at_um < b.at_um; });
    all.edges.push_back(std::move(e));
  }
}

}  // namespace

SpreadMeasurements read_spread_table(const std::string& path, double box_um) {
  SpreadMeasurements all;
  all.source = path;
  expect_form_of(path, {"spread"});
  const auto header = table_header(path);
  const auto has = [&](const char* name) {
    return std::find(header.begin(), header.end(), name) != header.end();
  };
  if (has("position_um") || has("intensity")) {
    read_edges(path, box_um, all);
  } else if (has("kind") || has("designed_um") || has("printed_um")) {
    read_widths(path, all);
  } else {
    throw InputError(path, "line 1",
                     "is no table of light that spreads; expected a header with kind, designed_um, "
                     "printed_um, or with position_um, intensity");
  }
  return all;
}

}  // namespace slicecorr::resins
