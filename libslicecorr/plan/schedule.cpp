// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Speeds that change from slice to slice.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/plan.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

StageChange load_stage_change(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  return parse_stage_change(read_text_file(path), path);
}

StageChange parse_stage_change(const std::string& text, const std::string& source) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  StageChange change;
  change.motion = parse_machine_motion(text, source);
  const auto stage = root.table("stage");
  if (!stage || !stage->has("variable_speed")) return change;
  const auto says = stage->node("variable_speed")->value_exact<bool>();
  if (!says) stage->fail("variable_speed", "is no truth value; expected true or false");
  change.variable_speed = *says;
  change.acceleration_mm_s2 = stage->number("acceleration_mm_s2", 0, 1e5).value_or(0);
  if (change.variable_speed && !(change.acceleration_mm_s2 > 0)) {
    stage->fail("variable_speed", "is true; expected acceleration_mm_s2 with it");
  }
  return change;
}

std::vector<double> speeds_within(const std::vector<double>& limits_mm_h, double most_mm_h,
                                  double acceleration_mm_s2, double layer_um) {
  if (!(acceleration_mm_s2 > 0)) {
    throw InputError(
        fmt::format("an acceleration of {:g} mm/s²; expected one above 0", acceleration_mm_s2));
  }
  std::vector<double> speeds;
  for (const double limit : limits_mm_h) {
    if (!(limit > 0)) throw InputError("a slice bears no speed at all");
    speeds.push_back(std::min(limit, most_mm_h));
  }
  // |change of s²| <= 2 A hs, s in mm/s.
  constexpr double kMmHFromMmS = 3600;
  const double change = 2 * acceleration_mm_s2 * layer_um * 1e-3 * kMmHFromMmS * kMmHFromMmS;
  const auto held = [&](double speed, double beside) {
    return std::min(speed, std::sqrt(beside * beside + change));
  };
  for (std::size_t n = 1; n < speeds.size(); ++n) speeds[n] = held(speeds[n], speeds[n - 1]);
  for (std::size_t n = speeds.size(); n-- > 1;) speeds[n - 1] = held(speeds[n - 1], speeds[n]);
  for (double& speed : speeds) speed = rounded_down(speed, 6);
  return speeds;
}

std::string PrintPlan::slice_speeds_csv() const {
  std::string text = "slice,speed_mm_h\n";
  double before = 0;
  for (std::size_t n = 0; n < slice_speed_mm_h.size(); ++n) {
    if (slice_speed_mm_h[n] == before) continue;
    before = slice_speed_mm_h[n];
    text += fmt::format("{},{}\n", n, before);
  }
  return text;
}

}  // namespace slicecorr
