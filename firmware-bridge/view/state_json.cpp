// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "view/state_json.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "record/left_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::bridge {
namespace {

using detail::Json;

std::optional<Phase> phase_of(std::string_view name) {
  for (int i = 0; i <= static_cast<int>(Phase::failed); ++i) {
    if (name_of(static_cast<Phase>(i)) == name) return static_cast<Phase>(i);
  }
  return std::nullopt;
}

template <typename T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

template <typename Bounds, typename Counts>
Json counts_json(const Bounds& bounds, const Counts& counts, double sum, double worst) {
  Json json;
  json["up_to"] = bounds;
  json["counts"] = counts;
  json["sum"] = sum;
  json["worst"] = worst;
  return json;
}

template <typename Counts>
void read_counts(const Json& json, const char* key, Counts& counts, double& sum, double& worst) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_object()) return;
  sum = detail::number_in(*found, "sum", 0);
  worst = detail::number_in(*found, "worst", 0);
  const auto list = found->find("counts");
  if (list == found->end() || !list->is_array() || list->size() != counts.size()) return;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if ((*list)[i].is_number_unsigned()) counts[i] = (*list)[i].template get<std::uint64_t>();
  }
}

/// Slices that take other times than those before begin a new line where that makes a 200th of the
/// print.
std::vector<PrintFacts::Begin> thinned(const std::vector<double>& begins_s) {
  using Begin = PrintFacts::Begin;
  const double borne_s = begins_s.back() / 200;
  std::vector<Begin> kept{{0, begins_s.front()}};
  double least = -INFINITY, most = INFINITY;
  for (std::size_t n = 1; n < begins_s.size(); ++n) {
    double way = static_cast<double>(n) - kept.back().slice;
    double slope = (begins_s[n] - kept.back().at_s) / way;
    if (slope < least || slope > most) {
      kept.push_back({static_cast<double>(n - 1), begins_s[n - 1]});
      least = -INFINITY;
      most = INFINITY;
      way = 1;
      slope = begins_s[n] - begins_s[n - 1];
    }
    least = std::max(least, slope - borne_s / way);
    most = std::min(most, slope + borne_s / way);
  }
  kept.push_back({static_cast<double>(begins_s.size() - 1), begins_s.back()});
  return kept.size() > 2 ? kept : std::vector<Begin>();
}

std::vector<PrintFacts::Begin> begins_of(const PrintPlan& plan) {
  const std::size_t slices = plan.frames.size();
  const bool layerwise = plan.mode == ExposureMode::layerwise;
  if (slices == 0 || (!layerwise && plan.slice_speed_um_s.empty())) return {};
  std::vector<double> begins_s{0};
  for (std::size_t n = 0; n < slices; ++n) {
    begins_s.push_back(begins_s.back() +
                       (layerwise ? plan.frames[n].exposure_s
                                  : plan.layer_um / plan.speed_at(static_cast<int>(n))));
  }
  // What the plan has besides: lifts, which are alike; changes of speed, which take time from all.
  const double more_s = plan.expected_s - begins_s.back();
  for (std::size_t n = 0; n <= slices; ++n) {
    begins_s[n] += layerwise ? more_s * static_cast<double>(n) / static_cast<double>(slices)
                             : more_s * begins_s[n] / (plan.expected_s - more_s);
  }
  return thinned(begins_s);
}

void put_facts(Json& json, const PrintFacts& f) {
  json["display"] = f.display;
  if (!f.uv_display.empty()) json["uv_display"] = f.uv_display;
  json["mode"] = f.layerwise ? "layerwise" : "continuous";
  json["uv"] = f.uv;
  json["layer_um"] = f.layer_um;
  json["planned_speed_um_s"] = f.speed_um_s;
  if (f.slowest_um_s > 0) json["slowest_speed_um_s"] = f.slowest_um_s;
  json["start_um"] = f.start_um;
  json["end_um"] = f.end_um;
  json["expected_s"] = f.expected_s;
  json["max_late_um"] = f.max_late_um;
  json["max_late_frames"] = f.max_late_frames;
  json["tolerance_um"] = f.tolerance_um;
  json["cycle_s"] = f.cycle_s;
  json["ring_frames"] = f.ring_frames;
  if (!f.begins.empty()) {
    Json& begins = json["begins_s"] = Json::array();
    for (const PrintFacts::Begin& b : f.begins) begins.push_back({b.slice, b.at_s});
  }
  if (f.turns()) {
    json["angles"] = f.angles;
    json["turns"] = f.frames / f.angles;
    json["um_per_deg"] = f.um_per_deg;
    json["planned_speed_deg_s"] = f.speed_um_s / f.um_per_deg;
    json["max_late_deg"] = f.max_late_um / f.um_per_deg;
    json["tolerance_deg"] = f.tolerance_um / f.um_per_deg;
  }
}

}  // namespace

PrintFacts facts_of(const PrintPlan& plan, const Machine& machine) {
  PrintFacts f;
  f.printer = machine.printer.name;
  f.layerwise = plan.mode == ExposureMode::layerwise;
  f.uv = plan.uv;
  f.frames = static_cast<int>(plan.frames.size());
  f.layer_um = plan.layer_um;
  f.speed_um_s = f.layerwise ? 0 : plan.speed_um_s;
  if (!plan.slice_speed_um_s.empty()) f.slowest_um_s = plan.slowest_um_s();
  f.start_um = plan.start_um;
  f.end_um = plan.end_um;
  f.expected_s = plan.expected_s;
  f.max_late_um = plan.max_late_um(machine.limits);
  f.angles = plan.angles;
  f.um_per_deg = plan.um_per_deg;
  f.max_late_frames = machine.limits.max_late_frames;
  f.tolerance_um = machine.stage.tolerance_um;
  f.cycle_s = machine.limits.cycle_s;
  f.ring_frames = machine.limits.ring_frames;
  f.begins = begins_of(plan);
  return f;
}

double PrintFacts::begin_s(double slice) const {
  if (frames <= 0) return 0;
  slice = std::clamp(slice, 0.0, 1.0 * frames);
  if (begins.size() < 2) return expected_s * slice / frames;
  std::size_t i = 1;
  while (i + 1 < begins.size() && begins[i].slice < slice) ++i;
  const Begin &a = begins[i - 1], &b = begins[i];
  const double way = b.slice - a.slice;
  return way > 0 ? a.at_s + (b.at_s - a.at_s) * std::clamp((slice - a.slice) / way, 0.0, 1.0)
                 : b.at_s;
}

PrintState state_of(const Controller& c, double at_s, int missed_cycles) {
  PrintState s;
  s.phase = c.phase();
  s.fault = c.fault();
  if (s.fault != Fault::none) s.detail = c.fault_detail();
  s.frame = c.frame();
  s.uv_frame = c.uv_frame();
  s.frames_shown = c.frames_shown();
  s.late_frames = c.late_frames();
  s.missed_cycles = missed_cycles;
  s.at_s = at_s;
  s.phase_since_s = c.phase_since_s();
  s.stage_um = c.stage_um();
  s.speed_um_s = c.speed_um_s();
  s.stage_error_um = c.stage_error_um();
  s.worst_late_um = c.worst_late_um();
  s.worst_stage_error_um = c.worst_stage_error_um();
  s.blue_share = c.set_points().blue_share;
  s.uv_mw_cm2 = c.set_points().uv_mw_cm2;
  s.blue_measured = c.status().blue_measured;
  s.uv_measured = c.status().uv_measured;
  s.temperature_c = c.status().temperature_c;
  s.lateness = c.lateness();
  if (c.failing()) s.left = c.left();
  return s;
}

std::optional<double> left_s(const PrintFacts& f, const PrintState& s) {
  if (s.fault != Fault::none || s.phase > Phase::resuming) return std::nullopt;
  if (s.phase < Phase::printing) return f.expected_s;
  if (f.layerwise || !(f.speed_um_s > 0)) {
    if (s.frames_shown <= 0) return f.expected_s;
    // Within a layer, too; one that takes longer than planned stands at its end.
    const double begin_s = f.begin_s(s.frames_shown - 1), end_s = f.begin_s(s.frames_shown);
    return std::max(
        0.0, f.expected_s - begin_s - std::clamp(s.at_s - s.newest_at_s, 0.0, end_s - begin_s));
  }
  const double left_um = std::max(0.0, f.end_um - s.stage_um);
  if (!f.begins.empty() && f.layer_um > 0) {
    return std::max(0.0, f.expected_s - f.begin_s(f.frames - left_um / f.layer_um));
  }
  return left_um / f.speed_um_s;
}

double latest_um(const PrintState& state) {
  return std::max({0.0, state.worst_late_um, state.lateness.worst_um});
}

std::string shown_in_words(const PrintFacts& facts, const PrintState& state) {
  return fmt::format("{} of {} frames", text::count(state.frames_shown), text::count(facts.frames));
}

std::string place_in_words(double z_um, double um_per_deg) {
  return um_per_deg > 0 ? fmt::format("{:.1f}° on from the first", z_um / um_per_deg)
                        : fmt::format("z = {:.3f} mm", z_um * 1e-3);
}

std::string way_in_words(double um, double um_per_deg) {
  return um_per_deg > 0 ? fmt::format("{:.3f}° ({:.2f} um at the wall)", um / um_per_deg, um)
                        : fmt::format("{:.2f} um", um);
}

double angle_in_turn_deg(const PrintFacts& f, const PrintState& s) {
  const double hundredths = std::round(100 * s.stage_um / f.um_per_deg);
  return (hundredths - 36000 * std::floor(hundredths / 36000)) / 100;
}

int turn_of(const PrintFacts& f, const PrintState& s) {
  return static_cast<int>((static_cast<std::int64_t>(s.frames_shown) + f.angles - 1) / f.angles);
}

std::string turn_in_words(const PrintFacts& f, const PrintState& s) {
  const int turns = f.frames / f.angles, turn = turn_of(f, s);
  if (turn > 0) return fmt::format("turn {} of {}", turn, turns);
  return turns == 1 ? "before its turn" : fmt::format("before the first of {} turns", turns);
}

std::string facts_json(const PrintFacts& facts) {
  Json json;
  json["printer"] = facts.printer;
  json["dry_run"] = facts.dry_run;
  json["frames"] = facts.frames;
  put_facts(json, facts);
  return detail::dumped(json);
}

std::string state_json(const PrintFacts& facts, const PrintState& s, const PrintAround& around) {
  Json json;
  if (s.left) json["after_fault"] = left_json(*s.left);
  json["phase"] = name_of(s.phase);
  json["dry_run"] = facts.dry_run;
  json["stack"] = facts.stack;
  json["frame"] = s.frame;
  json["frames"] = facts.frames;
  if (!facts.uv_display.empty()) json["uv_frame"] = s.uv_frame;
  json["stage_um"] = s.stage_um;
  json["z_um"] = s.stage_um - facts.start_um;
  if (facts.turns()) {
    json["angle_deg"] = s.stage_um / facts.um_per_deg;
    json["angle_in_turn_deg"] = angle_in_turn_deg(facts, s);
    json["speed_deg_s"] = s.speed_um_s / facts.um_per_deg;
    json["stage_error_deg"] = s.stage_error_um / facts.um_per_deg;
    json["worst_stage_error_deg"] = s.worst_stage_error_um / facts.um_per_deg;
    json["worst_late_deg"] = s.worst_late_um / facts.um_per_deg;
    json["turn"] = turn_of(facts, s);
    json["turn_in_words"] = turn_in_words(facts, s);
    json["job_frame"] = s.frame < 0 ? kBlackFrame : s.frame % facts.angles;
    json["lateness_deg"] =
        counts_json(Lateness::kBoundsDeg, s.lateness.deg, s.lateness.sum_deg, s.lateness.worst_deg);
  }
  json["fault"] = name_of(s.fault);
  json["detail"] = s.detail;
  json["late_frames"] = s.late_frames;
  json["worst_late_um"] = s.worst_late_um;
  json["latest_um"] = latest_um(s);
  json["worst_stage_error_um"] = s.worst_stage_error_um;
  json["missed_cycles"] = s.missed_cycles;
  if (around.ready_frames) json["ready_frames"] = *around.ready_frames;
  if (around.seconds) json["seconds"] = *around.seconds;
  json["at_s"] = s.at_s;
  json["phase_since_s"] = s.phase_since_s;
  json["frames_shown"] = s.frames_shown;
  json["newest_at_s"] = s.newest_at_s;
  json["speed_um_s"] = s.speed_um_s;
  json["stage_error_um"] = s.stage_error_um;
  json["blue_share"] = s.blue_share;
  json["blue_measured"] = s.blue_measured;
  json["uv_mw_cm2"] = s.uv_mw_cm2;
  json["uv_measured"] = or_null(s.uv_measured);
  json["temperature_c"] = or_null(s.temperature_c);
  json["left_s"] = or_null(left_s(facts, s));
  json["lateness_um"] =
      counts_json(Lateness::kBoundsUm, s.lateness.um, s.lateness.sum_um, s.lateness.worst_um);
  json["lateness_ms"] =
      counts_json(Lateness::kBoundsMs, s.lateness.ms, s.lateness.sum_ms, s.lateness.worst_ms);
  json["threads"] = around.threads;
  put_facts(json, facts);
  json["told"] = s.told;
  if (around.asked) json["asked"] = *around.asked;
  return detail::dumped(json);
}

namespace detail {

PrintFacts facts_in(const Json& json) {
  PrintFacts f;
  f.stack = text_in(json, "stack");
  f.printer = text_in(json, "printer");
  f.display = text_in(json, "display");
  f.dry_run = flag_in(json, "dry_run");
  f.layerwise = text_in(json, "mode") == "layerwise";
  f.uv = flag_in(json, "uv");
  f.frames = whole_in(json, "frames", 0);
  f.layer_um = number_in(json, "layer_um", 0);
  f.speed_um_s = number_in(json, "planned_speed_um_s", 0);
  f.start_um = number_in(json, "start_um", 0);
  f.end_um = number_in(json, "end_um", 0);
  f.expected_s = number_in(json, "expected_s", 0);
  f.max_late_um = number_in(json, "max_late_um", 0);
  f.max_late_frames = whole_in(json, "max_late_frames", 0);
  f.tolerance_um = number_in(json, "tolerance_um", 0);
  f.cycle_s = number_in(json, "cycle_s", 0);
  f.ring_frames = whole_in(json, "ring_frames", 0);
  f.angles = std::max(0, whole_in(json, "angles", 0));
  f.um_per_deg = number_in(json, "um_per_deg", 0);
  f.slowest_um_s = number_in(json, "slowest_speed_um_s", 0);
  f.uv_display = text_in(json, "uv_display");
  if (const auto begins = json.find("begins_s"); begins != json.end() && begins->is_array()) {
    for (const Json& b : *begins) {
      if (!b.is_array() || b.size() != 2 || !b[0].is_number() || !b[1].is_number()) continue;
      f.begins.push_back({b[0].get<double>(), b[1].get<double>()});
    }
  }
  return f;
}

PrintState state_in(const Json& json) {
  PrintState s;
  s.phase = phase_of(text_in(json, "phase")).value_or(Phase::connecting);
  s.fault = fault_of(text_in(json, "fault")).value_or(Fault::none);
  s.detail = text_in(json, "detail");
  s.frame = whole_in(json, "frame", kBlackFrame);
  s.frames_shown = whole_in(json, "frames_shown", 0);
  s.newest_at_s = number_in(json, "newest_at_s", 0);
  s.late_frames = whole_in(json, "late_frames", 0);
  s.missed_cycles = whole_in(json, "missed_cycles", 0);
  s.at_s = number_in(json, "at_s", 0);
  s.phase_since_s = number_in(json, "phase_since_s", 0);
  s.stage_um = number_in(json, "stage_um", 0);
  s.speed_um_s = number_in(json, "speed_um_s", 0);
  s.stage_error_um = number_in(json, "stage_error_um", 0);
  s.worst_late_um = number_in(json, "worst_late_um", 0);
  s.worst_stage_error_um = number_in(json, "worst_stage_error_um", 0);
  s.blue_share = number_in(json, "blue_share", 0);
  s.blue_measured = number_in(json, "blue_measured", 0);
  s.uv_mw_cm2 = number_in(json, "uv_mw_cm2", 0);
  s.uv_measured = number_in(json, "uv_measured");
  s.temperature_c = number_in(json, "temperature_c");
  Lateness& l = s.lateness;
  read_counts(json, "lateness_um", l.um, l.sum_um, l.worst_um);
  read_counts(json, "lateness_deg", l.deg, l.sum_deg, l.worst_deg);
  read_counts(json, "lateness_ms", l.ms, l.sum_ms, l.worst_ms);
  if (const auto left = json.find("after_fault"); left != json.end()) s.left = left_in(*left);
  s.told = static_cast<std::uint64_t>(std::max(0.0, number_in(json, "told", 0)));
  return s;
}

PrintAround around_in(const Json& json) {
  PrintAround a;
  if (number_in(json, "ready_frames")) a.ready_frames = whole_in(json, "ready_frames", 0);
  a.seconds = number_in(json, "seconds");
  a.threads = text_in(json, "threads");
  return a;
}

std::string dumped(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace detail
}  // namespace slicecorr::bridge
