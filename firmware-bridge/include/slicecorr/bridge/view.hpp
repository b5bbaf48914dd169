/// @file view.hpp
/// What a person sees of a print: the page after it, the live view, metrics. Nothing here touches
/// the print: it reads the state folder's files and what the control socket answered. All functions
/// are thread-safe, but those that write the same folder's report belong to one thread.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

/// A row of frames.csv; NaN where something is not known. What the columns mean is said at
/// `FrameRecord` and `DisplayTimes`; z is counted from the first slice's begin, times on the
/// print's clock.
struct FrameRow {
  int frame = 0;              ///< number of the slice
  double planned_z_um = 0;    ///< where its light was to begin
  double z_um = 0;            ///< where it began
  double planned_s = 0;       ///< when its light was to begin
  double shown_s = 0;         ///< when it began
  double late_um = 0;         ///< along the stage's way; below 0: early
  double speed_um_s = 0;      ///< of the stage
  double blue_share = 0;      ///< asked, 1: as calibrated
  double uv_mw_cm2 = 0;       ///< asked
  double blue_measured = 0;   ///< share, 1: as calibrated
  double uv_measured = 0;     ///< mW/cm²
  double stage_error_um = 0;  ///< measured less commanded
  double temperature_c = 0;
  double exposure_s = 0;      ///< asked, layer by layer
  double exposed_s = 0;       ///< as it was, layer by layer
  double missed_vblanks = 0;  ///< a count
  double upload_s = 0;        ///< pixels into the display's memory
  double present_s = 0;       ///< from there to the light
  bool late = false;          ///< counts as late
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
  std::optional<double> left_s;  ///< as `bridge::left_s` gives it
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
