/// @file view.hpp
/// What a person sees of a print: the page after it, the live view, metrics. Nothing here touches
/// the print: it reads the state folder's files and what the control socket answered.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

/// A row of frames.csv; NaN where something is not known.
struct FrameRow {
  int frame = 0;
  double planned_z_um = 0, z_um = 0, planned_s = 0, shown_s = 0, late_um = 0, speed_um_s = 0,
         blue_share = 0, uv_mw_cm2 = 0, blue_measured = 0, uv_measured = 0, stage_error_um = 0,
         temperature_c = 0, exposure_s = 0, exposed_s = 0, missed_vblanks = 0, upload_s = 0,
         present_s = 0;
  bool late = false;
};

/// A line of the journal.
struct RecordedEvent {
  std::string time;
  double at_s = 0;
  std::string what, detail;
  int frame = -1;
  double stage_um = 0;
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
  std::optional<double> seconds;
  Fault fault = Fault::none;
  std::string detail;    ///< of the fault
  int fault_frame = -1;  ///< on the display when it was found
  double fault_z_um = 0;
  std::optional<Left> left;          ///< of lamps and stage, after a fault or a kill
  std::string threads;               ///< real-time priority and memory locking
  Lateness lateness;                 ///< of `frames`
  std::vector<std::string> remarks;  ///< what of the record can't be read
};

/// Reads frames.csv, journal.jsonl and status.json, or with `previous` the ones of the print before
/// (which has no status). Never throws for what is in them: damaged lines are left out, and said in
/// `remarks`. `running`: whether a print holds the folder's lock.
PrintRecord read_record(const StateFolder& folder, bool running, bool previous = false);

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

/// What the printer does now, or how the last print ended: of the JSON of `status`.
struct Seen {
  std::string printer;
  bool running = false;
  /// The print has told something; else it is just starting, or there was none.
  bool known = false;
  PrintFacts facts;
  PrintState state;
  PrintAround around;
  std::optional<double> left_s;
  bool latched = false;
  Fault latched_fault = Fault::none;
  std::string latched_detail;
};
/// The JSON of `printbridge status`; `running`: what a running print answered.
std::string status_text(const StateFolder& folder, const std::string& printer,
                        const std::optional<std::string>& running);
Seen seen_in(const std::string& status);

/// A frame of the live view: at most `rows` lines of at most `columns`.
std::vector<std::string> live_frame(const Seen& seen, int columns, int rows, bool colour);
/// The same in a line.
std::string live_line(const Seen& seen);
/// A line of the journal for people; empty for one that can't be read.
std::string event_line(const std::string& journal_line);

/// Text format of Prometheus. `faults`: as `count_faults` gives them.
using FaultCounts = std::vector<std::pair<Fault, int>>;
/// Faults in the journal of the last print, or the one that runs.
FaultCounts count_faults(const StateFolder& folder);
std::string metrics_text(const Seen& seen, const FaultCounts& faults);

}  // namespace slicecorr::bridge
