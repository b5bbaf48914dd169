// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file view.hpp
/// What a person sees of a print: the page after it, the live view, metrics. Nothing here touches
/// the print: it reads the state folder's files and what the control socket answered. All functions
/// are thread-safe, but those that write the same folder's report belong to one thread. Only
/// `write_report` and `lamp_log` throw.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

/// A row of frames.csv, as `FrameLog` writes it of a `FrameRecord`. A number is NaN where its
/// column is missing or its cell empty. z is the stage's position from the first slice's begin;
/// times are on the print's clock.
struct FrameRow {
  int frame = 0;              ///< number of the slice, from 0
  double planned_z_um = 0;    ///< z at which its light was to begin
  double z_um = 0;            ///< z at which its light began
  double planned_s = 0;       ///< when its light was to begin
  double shown_s = 0;         ///< when its light began
  double late_um = 0;         ///< z_um less planned_z_um; below 0: early
  double speed_um_s = 0;      ///< of the stage; above 0: away from the window
  double blue_share = 0;      ///< asked of the blue lamp, >= 0; 1: as calibrated
  double uv_mw_cm2 = 0;       ///< asked of the UV lamp, >= 0
  double blue_measured = 0;   ///< share, as `blue_share`
  double uv_measured = 0;     ///< mW/cm²; 0 where the machine does not tell
  double stage_error_um = 0;  ///< measured less commanded
  double temperature_c = 0;   ///< NaN where the machine does not tell
  double exposure_s = 0;      ///< layer by layer: asked; else NaN
  double exposed_s = 0;       ///< layer by layer: given, NaN where it did not end; else NaN
  double missed_vblanks = 0;  ///< a whole number, see DisplayTimes
  double upload_s = 0;        ///< see DisplayTimes
  double present_s = 0;       ///< see DisplayTimes
  bool late = false;          ///< see FrameRecord
};

/// A line of the journal.
struct RecordedEvent {
  std::string time;  ///< UTC, as `utc_now` writes it
  double at_s = 0;   ///< on the print's clock
  std::string what, detail;
  int frame = kBlackFrame;  ///< on the display
  double stage_um = 0;      ///< above the window
};

/// A print as its state folder tells it.
struct PrintRecord {
  enum class End {
    none,     ///< no print was recorded
    running,  ///< it goes on
    done,
    failed,
    cut_off,  ///< the program was killed, or the power failed
  };
  End end = End::none;
  std::string folder;
  PrintFacts facts;
  bool facts_known = false;
  std::vector<RecordedEvent> events;
  std::vector<FrameRow> frames;
  std::optional<PrintState> last;  ///< from status.json, when it is of this print
  std::optional<double> seconds;   ///< how long the print took; it has ended
  Fault fault = Fault::none;
  std::string detail;                ///< of the fault
  int fault_frame = kBlackFrame;     ///< on the display when it was found
  double fault_z_um = 0;             ///< stage, from the first slice's begin
  std::optional<Left> left;          ///< of lamps and stage, after a fault or a kill
  std::string threads;               ///< real-time priority and memory locking
  Lateness lateness;                 ///< of `frames`
  std::vector<std::string> remarks;  ///< what of the record can't be read
};

/// Reads frames.csv, journal.jsonl and status.json, or with `previous` the ones of the print before
/// (which has no status). Never throws for what is in them: damaged lines are left out, and said in
/// `remarks`. `running`: whether a print holds the folder's lock.
PrintRecord read_record(const StateFolder& folder, bool running, bool previous = false);

/// What lamps gave of what was asked of them.
struct LampLog {
  std::string csv;               ///< `slice,lamp_share` or `slice,lamp_share,uv_lamp_share`
  std::size_t rows = 0;          ///< each of `frames_a_row` frames: the median of their shares
  std::size_t frames_a_row = 0;  ///< so many that there are some two hundred rows at most
  /// The greatest share; above 1 a lamp gave more than its calibration says, and the table has 1.
  double greatest = 0;
};
/// Throws `InputError` where nothing was measured, and for records of vials that turn.
LampLog lamp_log(const PrintRecord& record);

/// The page of a print: HTML that needs nothing else, without scripts; below 2 MB for 100,000
/// frames.
std::string report_page(const PrintRecord& record);
/// The page's part between its heading and its end, for the live page.
std::string report_body(const PrintRecord& record);

/// Makes report.html where it is missing: of a print that was killed. Nobody prints. Never throws.
void make_missing_report(const StateFolder& folder);
/// Before a print begins: the page of the one before becomes report.previous.html, and is made
/// where it is missing. Never throws.
void keep_report(const StateFolder& folder);
/// Writes report.html into the folder. Throws `DeviceError`.
void write_report(const StateFolder& folder, bool running);

/// What the printer does now, or how the last print ended, as the JSON of `status` says it.
struct Seen {
  std::string printer;
  bool running = false;
  /// The print has told something; else it is just starting, or there was none.
  bool known = false;
  PrintFacts facts;
  PrintState state;
  PrintAround around;
  std::optional<double> left_s;  ///< as `bridge::left_s` gives it
  bool latched = false;
  Fault latched_fault = Fault::none;
  std::string latched_detail;
};
/// The JSON of `printbridge status`; `running`: what a running print answered.
std::string status_text(const StateFolder& folder, const std::string& printer,
                        const std::optional<std::string>& running);
Seen seen_in(const std::string& status);

/// A frame of the live view: at most `rows` lines of at most `columns` characters.
std::vector<std::string> live_frame(const Seen& seen, int columns, int rows, bool colour);
/// What the live view says, in one line.
std::string live_line(const Seen& seen);
/// A line of the journal for people; empty for one that can't be read.
std::string event_line(const std::string& journal_line);

/// Text format of Prometheus. `faults`: as `count_faults` gives them.
using FaultCounts = std::vector<std::pair<Fault, int>>;
/// Faults in the journal of the last print, or the one that runs.
FaultCounts count_faults(const StateFolder& folder);
std::string metrics_text(const Seen& seen, const FaultCounts& faults);

}  // namespace slicecorr::bridge
