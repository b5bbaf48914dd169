// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How a laboratory's prints wander: charts of single values with their bands.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/scan.hpp"
#include "support/chart/chart.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr {

namespace {

using Json = nlohmann::ordered_json;
using Node = detail::JsonNode<nlohmann::json>;

constexpr std::size_t kLeastPrints = 3;
/// Predicted surfaces are rounded to a thousandth of a layer: below that nothing wanders.
constexpr double kLeastSdUm = 0.1;
/// Standard deviation over the mean distance of two values that follow each other, of normal ones: sqrt(pi) / 2.
constexpr double kSdOfRange = 0.8862269254527580;
constexpr double kBandSds = 3;
/// So many in a row on one side of the middle come by chance once in 128 times.
constexpr std::size_t kRun = 8;

/// The band of one figure, by the prints that are taken as settled.
DriftBand band_of(std::string name, const std::vector<double>& values, std::size_t settled) {
  DriftBand band;
  band.name = std::move(name);
  band.values_um = values;
  double sum = 0, ranges = 0;
  for (std::size_t i = 0; i < settled; ++i) {
    sum += values[i];
    if (i > 0) ranges += std::abs(values[i] - values[i - 1]);
  }
  band.middle_um = sum / static_cast<double>(settled);
  const double sd = std::max(kLeastSdUm, kSdOfRange * ranges / static_cast<double>(settled - 1));
  band.low_um = band.middle_um - kBandSds * sd;
  band.high_um = band.middle_um + kBandSds * sd;
  std::size_t run = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (values[i] < band.low_um || values[i] > band.high_um) band.beyond.push_back(i);
    const bool same = i > 0 && (values[i] > band.middle_um) == (values[i - 1] > band.middle_um);
    run = same ? run + 1 : 1;
    if (run == kRun) band.runs.push_back(i);
  }
  return band;
}

constexpr double kPanelHigh = 180;

/// Which prints beyond their band have their names beside them: from the last on, where no other name is. All are named in
/// the table, and where they are pointed at.
std::vector<bool> named(const DriftBand& band, const std::vector<DriftPrint>& prints,
                        const chart::Axis& um) {
  constexpr double panel_wide = 540, letter_wide = 9, line_high = 20, beside = 28;
  std::vector<bool> shown(prints.size());
  std::vector<std::size_t> names;
  for (std::size_t k = band.beyond.size(); k-- > 0;) {
    const std::size_t i = band.beyond[k];
    const bool free = std::none_of(names.begin(), names.end(), [&](std::size_t other) {
      const auto longest =
          static_cast<double>(std::max(prints[i].name.size(), prints[other].name.size()));
      const double x = panel_wide * static_cast<double>(other - i) /
                       static_cast<double>(prints.size()),
                   y = kPanelHigh * std::abs(band.values_um[other] - band.values_um[i]) /
                       (um.high - um.low);
      return y < line_high && x < letter_wide * longest + beside;
    });
    if (!free) continue;
    shown[i] = true;
    names.push_back(i);
  }
  return shown;
}

chart::Panel panel_of(const DriftBand& band, const std::vector<DriftPrint>& prints) {
  std::vector<double> seen = band.values_um;
  seen.push_back(band.low_um);
  seen.push_back(band.high_um);
  const double last = static_cast<double>(prints.size());
  const chart::Axis um = chart::axis_over(band.name + ", um", false, seen);
  const std::vector<bool> with_name = named(band, prints, um);
  chart::Panel panel({"print", false, 0.5, last + 0.5}, um, kPanelHigh);
  panel.band({{0.5, band.low_um}, {last + 0.5, band.low_um}},
             {{0.5, band.high_um}, {last + 0.5, band.high_um}}, chart::Style::fit);
  panel.line({{0.5, band.middle_um}, {last + 0.5, band.middle_um}}, chart::Style::reference);
  for (std::size_t i = 0; i < prints.size(); ++i) {
    const chart::Point p{static_cast<double>(i + 1), band.values_um[i]};
    panel.point(p, 0, fmt::format("{}: {:+.2f} um", prints[i].name, p.y));
    const bool out = std::find(band.beyond.begin(), band.beyond.end(), i) != band.beyond.end();
    if (out) panel.ring(p, with_name[i] ? prints[i].name : std::string());
  }
  return panel;
}

}  // namespace

DriftPrint read_comparison(std::string_view json, const std::string& source) {
  const detail::JsonSource place{source, ""};
  const auto parsed = detail::read_json(json, place);
  const Node root(parsed, "", place);
  DriftPrint print;
  print.source = source;
  print.name = std::filesystem::path(root["scan"].string()).filename().string();
  // The last is what was predicted, where there was a stack.
  const Node d = root["deviations"].list(1, 2).back();
  constexpr double kMost = 1e7;
  print.against = d["against"].string();
  print.mean_um = d["mean_um"].number(-kMost, kMost);
  print.mean_abs_um = d["mean_abs_um"].number(0, kMost);
  print.p95_um = d["p95_abs_um"].number(0, kMost);
  return print;
}

ScanDrift scan_drift(const std::vector<DriftPrint>& prints, std::size_t settled) {
  if (prints.size() < kLeastPrints || settled == 1 || settled == 2 || settled > prints.size()) {
    throw InputError(fmt::format(
        "{} prints, of which {} are taken as settled; expected {} or more of both, and no more settled than there are",
        prints.size(), settled, kLeastPrints));
  }
  for (const DriftPrint& p : prints) {
    if (p.against == prints.front().against) continue;
    throw InputError(
        p.source, "deviations",
        fmt::format("is measured against '{}', {} against '{}'; expected the same of all",
                    p.against, prints.front().source, prints.front().against));
  }
  ScanDrift drift;
  drift.prints = prints;
  drift.settled = settled == 0 ? prints.size() : settled;
  const auto add = [&](const char* name, double DriftPrint::*figure) {
    std::vector<double> values;
    values.reserve(prints.size());
    for (const DriftPrint& p : prints) values.push_back(p.*figure);
    drift.bands.push_back(band_of(name, values, drift.settled));
  };
  add("mean deviation", &DriftPrint::mean_um);
  add("mean absolute deviation", &DriftPrint::mean_abs_um);
  return drift;
}

bool ScanDrift::last_is_beyond() const {
  return std::any_of(bands.begin(), bands.end(), [&](const DriftBand& band) {
    return !band.beyond.empty() && band.beyond.back() + 1 == prints.size();
  });
}

std::string ScanDrift::to_json() const {
  Json j = {{"against", prints.front().against}, {"settled", settled}};
  j["prints"] = Json::array();
  for (const DriftPrint& p : prints) {
    j["prints"].push_back({{"scan", p.name},
                           {"mean_um", p.mean_um},
                           {"mean_abs_um", p.mean_abs_um},
                           {"p95_abs_um", p.p95_um}});
  }
  j["bands"] = Json::array();
  for (const DriftBand& b : bands) {
    j["bands"].push_back({{"name", b.name},
                          {"middle_um", b.middle_um},
                          {"low_um", b.low_um},
                          {"high_um", b.high_um},
                          {"beyond", b.beyond},
                          {"runs", b.runs}});
  }
  j["last_is_beyond"] = last_is_beyond();
  return j.dump(2) + "\n";
}

std::string ScanDrift::to_text() const {
  std::string text = fmt::format(
      "{} prints against {}, the first {} of which say the band\n", prints.size(),
      prints.front().against == "design" ? "the design" : "what was predicted", settled);
  for (const DriftBand& b : bands) {
    text += fmt::format("  {}: {:+.2f} um, band {:+.2f} to {:+.2f} um, last {:+.2f} um\n", b.name,
                        b.middle_um, b.low_um, b.high_um, b.values_um.back());
    for (const std::size_t i : b.beyond) {
      text +=
          fmt::format("  {} lies beyond its band: {:+.2f} um\n", prints[i].name, b.values_um[i]);
    }
    for (const std::size_t i : b.runs) {
      text +=
          fmt::format("  {} prints in a row up to {} lie on one side of the middle: it drifts\n",
                      kRun, prints[i].name);
    }
  }
  return text;
}

std::string ScanDrift::to_svg() const {
  chart::Picture picture("Deviation over prints",
                         "Deviation of each print with the band of those that were settled.");
  picture.legend_point(0, "a print");
  picture.legend_band(chart::Style::fit,
                      "three standard deviations of prints that follow each other");
  for (const DriftBand& band : bands) picture.add(panel_of(band, prints));
  return picture.svg();
}

std::string ScanDrift::to_page() const {
  page::Page page("Deviation over prints", {page::page_tiles_css});
  page::Tiles tiles;
  tiles.add(fmt::format("{}", prints.size()), "prints");
  tiles.add(last_is_beyond() ? "beyond" : "within", "the last print and its band",
            last_is_beyond() ? "bad" : "good");
  page += tiles;
  page += page::drawing(to_svg());
  page::Table table;
  table.columns("print", "mean, um", "mean absolute, um", "95 % within, um");
  for (const DriftPrint& p : prints) {
    table.row(p.name, fmt::format("{:+.2f}", p.mean_um), fmt::format("{:.2f}", p.mean_abs_um),
              fmt::format("{:.2f}", p.p95_um));
  }
  page += table;
  return page.html() + "\n";
}

}  // namespace slicecorr
