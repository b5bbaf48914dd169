// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "slicecorr/scan.hpp"

namespace slicecorr {

namespace {

using Json = nlohmann::ordered_json;

Json json_of(const DeviationFigures& f) {
  return {{"name", f.name},         {"points", f.points},
          {"mean_um", f.mean_um},   {"mean_abs_um", f.mean_abs_um},
          {"p95_abs_um", f.p95_um}, {"max_abs_um", f.largest_um}};
}

Json json_of(const std::vector<DeviationFigures>& groups) {
  Json list = Json::array();
  for (const DeviationFigures& f : groups) list.push_back(json_of(f));
  return list;
}

Json json_of(const Deviation& d) {
  Json j = {{"against", d.against}};
  j.update(json_of(d.all));
  j.erase("name");
  j["rms_um"] = d.rms_um;
  j["points_beside"] = d.beside;
  j["reach_um"] = d.reach_um;
  j["facing"] = json_of(d.facing);
  j["heights"] = json_of(d.heights);
  j["gaps"] = json_of(d.gaps);
  j["worst"] = Json::array();
  for (const WorstPlace& w : d.worst) {
    j["worst"].push_back({{"place_mm", w.place}, {"deviation_um", w.deviation_um}});
  }
  j["unseen_share"] = d.unseen_share;
  j["unseen"] = Json::array();
  for (const UnseenPlace& u : d.unseen) {
    j["unseen"].push_back({{"place_mm", u.place}, {"area_mm2", u.area_mm2}});
  }
  return j;
}

std::string line_of(const DeviationFigures& f) {
  return fmt::format("  {:22} {:>8} {:>+9.2f} {:>9.2f} {:>9.2f} {:>9.2f}\n", f.name, f.points,
                     f.mean_um, f.mean_abs_um, f.p95_um, f.largest_um);
}

}  // namespace

std::string ScanComparison::to_json() const {
  const Registration& r = registration;
  Json j = {{"scan", scan},           {"unit", unit},   {"points", points},
            {"triangles", triangles}, {"notes", notes}, {"posed_by", posed_by}};
  j["pose"] = {{"turn", r.pose.turn}, {"shift_mm", r.pose.shift}};
  j["registration"] = {{"median_um", r.median_um},
                       {"within_share", r.within_share},
                       {"reach_um", r.reach_um},
                       {"mirrored_median_um", r.mirrored_um},
                       {"rounds", r.rounds}};
  j["deviations"] = Json::array();
  for (const Deviation& d : deviations) j["deviations"].push_back(json_of(d));
  return j.dump(2) + "\n";
}

std::string ScanComparison::to_text() const {
  std::string text = fmt::format("{}: {} points, in {}\n", scan, points, unit);
  for (const Deviation& d : deviations) {
    text += fmt::format(
        "against {}: mean {:+.2f} um, of absolute values {:.2f} um, 95 % within {:.2f} um, rms {:.2f} um; {:.3g} % of "
        "the surface not seen; {} points beside it\n",
        d.against == "design" ? "the design" : "what was predicted to print", d.all.mean_um,
        d.all.mean_abs_um, d.all.p95_um, d.rms_um, 100 * d.unseen_share, d.beside);
    text += fmt::format("  {:22} {:>8} {:>9} {:>9} {:>9} {:>9}\n", "um", "points", "mean", "|mean|",
                        "|95 %|", "|most|");
    for (const DeviationFigures& f : d.facing) text += line_of(f);
    for (DeviationFigures f : d.gaps) {
      if (f.points == 0) continue;
      f.name = "gap " + f.name;
      text += line_of(f);
    }
    if (!d.worst.empty()) {
      const WorstPlace& w = d.worst.front();
      text += fmt::format("  worst: {:+.1f} um at {:.3f}, {:.3f}, {:.3f} mm\n", w.deviation_um,
                          w.place[0], w.place[1], w.place[2]);
    }
  }
  return text;
}

}  // namespace slicecorr
