// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <utility>

#include "record/left_json.hpp"
#include "slicecorr/bridge/view.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"
#include "support/text/csv.hpp"
#include "view/state_json.hpp"

namespace slicecorr::bridge {
namespace {

using detail::Json;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
/// Beyond it a number is none of a print: 1000 km, or 30,000 years.
constexpr double kMost = 1e12;
constexpr std::size_t kMostReadFrames = 2'000'000, kMostReadEvents = 200'000;

struct Column {
  const char* name;
  double FrameRow::*value;
};
constexpr Column kColumns[] = {{"planned_z_um", &FrameRow::planned_z_um},
                               {"z_um", &FrameRow::z_um},
                               {"planned_s", &FrameRow::planned_s},
                               {"shown_s", &FrameRow::shown_s},
                               {"late_um", &FrameRow::late_um},
                               {"speed_um_s", &FrameRow::speed_um_s},
                               {"blue_share", &FrameRow::blue_share},
                               {"uv_mw_cm2", &FrameRow::uv_mw_cm2},
                               {"blue_measured", &FrameRow::blue_measured},
                               {"uv_measured", &FrameRow::uv_measured},
                               {"stage_error_um", &FrameRow::stage_error_um},
                               {"temperature_c", &FrameRow::temperature_c},
                               {"exposure_s", &FrameRow::exposure_s},
                               {"exposed_s", &FrameRow::exposed_s},
                               {"missed_vblanks", &FrameRow::missed_vblanks},
                               {"upload_s", &FrameRow::upload_s},
                               {"present_s", &FrameRow::present_s}};

std::optional<double> number_of(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !(std::abs(value) <= kMost)) {
    return std::nullopt;
  }
  return value;
}

/// Rows of frames.csv by the names in its first line: columns that are not known are left out,
/// those that are missing are not known.
class FrameReader {
 public:
  explicit FrameReader(std::string_view header) {
    const auto names = comma_separated(header);
    width_ = names.size();
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (names[i] == "frame") frame_ = i;
      if (names[i] == "late") late_ = i;
      for (const Column& c : kColumns) {
        if (names[i] == c.name) places_.emplace_back(i, c.value);
      }
    }
  }
  bool usable() const { return frame_ < width_; }
  std::optional<FrameRow> row(std::string_view line) const {
    const auto cells = comma_separated(line);
    if (cells.size() != width_) return std::nullopt;
    FrameRow row;
    for (const Column& c : kColumns) row.*c.value = kUnknown;
    const auto frame = number_of(cells[frame_]);
    if (!frame || *frame < 0 || *frame > 1e9 || *frame != std::floor(*frame)) return std::nullopt;
    row.frame = static_cast<int>(*frame);
    if (late_ < width_) row.late = cells[late_] == "1";
    for (const auto& [at, value] : places_) {
      if (cells[at].empty()) continue;
      const auto number = number_of(cells[at]);
      if (!number) return std::nullopt;
      row.*value = *number;
    }
    return row;
  }

 private:
  std::size_t width_ = 0, frame_ = std::string::npos, late_ = std::string::npos;
  std::vector<std::pair<std::size_t, double FrameRow::*>> places_;
};

/// A whole line; false for the end and for a half one, which a print that goes on, or a power cut,
/// leaves.
bool next_line(std::istream& in, std::string& line) {
  return static_cast<bool>(std::getline(in, line)) && !in.eof();
}

void read_frames(const std::string& path, PrintRecord& record) {
  std::ifstream in(path);
  std::string line;
  if (!next_line(in, line)) {
    if (record.end != PrintRecord::End::none) {
      record.remarks.emplace_back("frames.csv is missing or empty");
    }
    return;
  }
  const FrameReader reader(line);
  if (!reader.usable()) {
    record.remarks.emplace_back("frames.csv has no column 'frame'");
    return;
  }
  int broken = 0;
  while (next_line(in, line)) {
    const auto row = reader.row(line);
    // Frames come in order, each once.
    if (!row || (!record.frames.empty() && row->frame <= record.frames.back().frame)) {
      ++broken;
      continue;
    }
    if (record.frames.size() == kMostReadFrames) {
      record.remarks.push_back(
          fmt::format("frames.csv: only the first {} rows are shown", kMostReadFrames));
      break;
    }
    record.frames.push_back(*row);
  }
  if (broken > 0) {
    record.remarks.push_back(fmt::format("frames.csv: {} rows can't be read", broken));
  }
}

void read_journal(const std::string& path, PrintRecord& record, bool& ended, bool& looked_at) {
  std::ifstream in(path);
  std::string line;
  int broken = 0;
  std::size_t left_out = 0;
  while (next_line(in, line)) {
    if (line.empty()) continue;
    const Json json = slicecorr::detail::try_json<Json>(line);
    const std::string what = detail::text_in(json, "what");
    if (what.empty()) {
      ++broken;
      continue;
    }
    RecordedEvent e;
    e.time = detail::text_in(json, "time");
    e.at_s = detail::number_in(json, "at_s").value_or(kUnknown);
    e.what = what;
    e.detail = detail::text_in(json, "detail");
    e.frame = detail::whole_in(json, "frame", kBlackFrame);
    e.stage_um = detail::number_in(json, "stage_um").value_or(kUnknown);
    if (what == kJournalBegin) {
      const auto facts = json.find("facts");
      record.facts_known = facts != json.end() && facts->is_object();
      if (record.facts_known) record.facts = detail::facts_in(*facts);
      record.facts.stack = e.detail;
      ended = looked_at = false;
    } else if (what == kJournalEnd) {
      looked_at = e.detail == "reset";  // of a print that was killed
      ended = !looked_at;
    } else if (what == kJournalLeft) {
      const auto facts = json.find("facts");
      if (facts != json.end()) record.left = left_in(*facts);
    } else if (what == "threads") {
      record.threads = e.detail;
    } else if (what.starts_with("fault ") && record.fault == Fault::none) {
      record.fault = fault_of(std::string_view(what).substr(6)).value_or(Fault::defect);
      record.detail = e.detail;
      record.fault_frame = e.frame;
      record.fault_z_um = e.stage_um;
    }
    if (record.events.size() == kMostReadEvents) {
      ++left_out;
    } else {
      record.events.push_back(std::move(e));
    }
  }
  if (broken > 0) {
    record.remarks.push_back(fmt::format("the journal: {} lines can't be read", broken));
  }
  if (left_out > 0) {
    record.remarks.push_back(fmt::format("the journal: {} more lines", left_out));
  }
}

}  // namespace

PrintRecord read_record(const StateFolder& folder, bool running, bool previous) {
  PrintRecord record;
  record.folder = folder.path;
  const auto file = [&](const char* name, const char* ending) {
    return folder.file(name) + (previous ? ".previous" : "") + ending;
  };
  bool ended = false, looked_at = false;
  read_journal(file("journal", ".jsonl"), record, ended, looked_at);
  using End = PrintRecord::End;
  if (record.events.empty()) {
    read_frames(file("frames", ".csv"), record);
    return record;
  }
  if (ended) {
    record.end = End::done;  // until its own words say otherwise
    const std::string& last = record.events.back().detail;
    if (record.fault != Fault::none || last == name_of(Phase::failed)) record.end = End::failed;
  } else {
    record.end = running && !previous && !looked_at ? End::running : End::cut_off;
    if (record.end == End::cut_off && !looked_at && !record.left) {
      record.left = Left{};
      record.left->touched = record.left->bridge_gone = true;
    }
  }
  // status.json is written just before the journal's end: else it is of the print before.
  if (ended && !previous) {
    const std::string text = text_of_file(folder.file("status.json")).value_or("");
    const Json json = slicecorr::detail::try_json<Json>(text);
    if (json.is_object() && detail::text_in(json, "stack") == record.facts.stack) {
      record.last = detail::state_in(json);
      record.seconds = detail::number_in(json, "seconds");
      if (!record.facts_known) {
        record.facts = detail::facts_in(json);
        record.facts_known = record.facts.frames > 0;
      }
      // A controller that failed itself has no words in the journal.
      if (record.fault == Fault::none && record.last->fault != Fault::none) {
        record.fault = record.last->fault;
        record.detail = record.last->detail;
        record.fault_frame = record.last->frame;
        record.fault_z_um = record.last->stage_um;
        record.end = End::failed;
      }
    } else {
      record.remarks.emplace_back("status.json is missing or can't be read");
    }
  }
  record.fault_z_um -= record.facts.start_um;
  read_frames(file("frames", ".csv"), record);
  for (const FrameRow& f : record.frames) {
    if (std::isfinite(f.exposure_s)) {
      if (std::isfinite(f.exposed_s)) record.lateness.add_ms((f.exposed_s - f.exposure_s) * 1e3);
      continue;
    }
    if (std::isfinite(f.late_um)) {
      record.lateness.add_um(f.late_um);
      if (record.facts.turns()) record.lateness.add_deg(f.late_um / record.facts.um_per_deg);
    }
    if (std::isfinite(f.shown_s - f.planned_s)) {
      record.lateness.add_ms((f.shown_s - f.planned_s) * 1e3);
    }
  }
  if (!record.facts_known) {
    record.facts.layerwise = !record.frames.empty() && std::isfinite(record.frames[0].exposure_s);
  }
  return record;
}

FaultCounts count_faults(const StateFolder& folder) {
  FaultCounts counts;
  for (int i = 1; i <= static_cast<int>(Fault::defect); ++i) {
    counts.emplace_back(static_cast<Fault>(i), 0);
  }
  std::ifstream in(folder.file("journal.jsonl"));
  std::string line;
  while (next_line(in, line)) {
    // Few lines are faults; parsing all of them each time would cost more than the rest.
    if (line.find("\"fault ") == std::string::npos) continue;
    const std::string what = detail::text_in(slicecorr::detail::try_json<Json>(line), "what");
    if (!what.starts_with("fault ")) continue;
    const Fault fault = fault_of(std::string_view(what).substr(6)).value_or(Fault::defect);
    for (auto& [which, count] : counts) count += which == fault ? 1 : 0;
  }
  return counts;
}

}  // namespace slicecorr::bridge
