// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How a laboratory's prints wander.

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/scans.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

std::string print_name(const KeptScan& s) {
  return fmt::format("job {} {}, scan {}", s.job, s.name, s.number);
}

/// The bands are of the prints before the last: what is judged does not say how it is judged.
std::optional<ScanDrift> drift_of(const std::vector<KeptScan>& scans) {
  constexpr std::size_t least = 3;
  if (scans.size() < least) return std::nullopt;
  std::vector<DriftPrint> prints;
  prints.reserve(scans.size());
  for (const KeptScan& s : scans) {
    prints.push_back(
        {print_name(s), print_name(s), "predicted", s.mean_um, s.mean_abs_um, s.p95_um});
  }
  return scan_drift(prints, std::clamp(scans.size() - 1, least, kSettledScans));
}

}  // namespace

std::vector<PrintsOverTime> prints_over_time(ReadModel& model) {
  std::vector<PrintsOverTime> all;
  for (KeptScan& s : model.scans()) {
    const auto same = std::find_if(all.begin(), all.end(), [&](const PrintsOverTime& p) {
      return p.printer == s.printer && p.resin == s.resin;
    });
    // The one with the newest scan comes last until all are turned about.
    PrintsOverTime prints =
        same == all.end() ? PrintsOverTime{s.printer, s.resin, {}, {}} : std::move(*same);
    if (same != all.end()) all.erase(same);
    prints.scans.push_back(std::move(s));
    all.push_back(std::move(prints));
  }
  std::reverse(all.begin(), all.end());
  for (PrintsOverTime& prints : all) prints.drift = drift_of(prints.scans);
  return all;
}

std::string beyond_in_words(const PrintsOverTime& prints) {
  if (!prints.drift || prints.drift->settled < kLeastSettledScans ||
      prints.scans.size() <= prints.drift->settled || !prints.drift->last_is_beyond()) {
    return {};
  }
  const KeptScan& last = prints.scans.back();
  std::string text = fmt::format("{} on {} with {} lies beyond its band", print_name(last),
                                 prints.printer, prints.resin);
  const char* between = ": ";
  for (const DriftBand& band : prints.drift->bands) {
    if (band.beyond.empty() || band.beyond.back() + 1 != prints.scans.size()) continue;
    text += fmt::format("{}{} {:+.2f} um, expected {:+.2f} to {:+.2f} um", between, band.name,
                        band.values_um.back(), band.low_um, band.high_um);
    between = "; ";
  }
  return text;
}

std::string prints_over_time_json(const std::vector<PrintsOverTime>& all) {
  Json list = Json::array();
  for (const PrintsOverTime& p : all) {
    Json scans = Json::array();
    for (const KeptScan& s : p.scans) {
      scans.push_back(slicecorr::detail::own_json<Json>(scan_json(s)));
    }
    list.push_back({{"printer", p.printer}, {"resin", p.resin}, {"scans", scans}});
    list.back()["drift"] =
        p.drift ? slicecorr::detail::own_json<Json>(p.drift->to_json()) : Json(nullptr);
    list.back()["beyond"] = beyond_in_words(p);
  }
  return Json{{"prints", list}}.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace slicecorr::farm
