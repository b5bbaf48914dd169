/// @file record.hpp
/// What is left of a print: a journal of events that survives a power cut, a CSV of frames, and the
/// latch that keeps a failed machine from printing until somebody has looked.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {

/// Appends events as JSON, one per line, each on the disk (fdatasync) before the call returns where
/// `important`, else within a second. A line that a power cut halved is ignored by readers.
class Journal {
 public:
  explicit Journal(const std::string& path);
  ~Journal();
  void add(const Event& event, bool important);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// frame, planned_z_um, z_um, planned_s, shown_s, late_um, speed_um_s, blue_share, uv_mw_cm2,
/// blue_measured, uv_measured. Never blocks the print: a thread of its own writes.
class FrameLog {
 public:
  explicit FrameLog(const std::string& path);
  ~FrameLog();
  void add(const FrameRecord& record);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The folder of a printer's state: DIR/PRINTER/{print.lock, latch.json, status.json, control.sock,
/// journal.jsonl, frames.csv}; DIR is --dir, $SLICECORR_BRIDGE_DIR, else below the user's state
/// folder.
struct StateFolder {
  std::string path;
  static StateFolder of(const std::string& dir, const Printer& printer);
};

/// A fault that nobody has looked at. Also found when a print was killed: print.lock is free and
/// the journal has no end.
struct Latch {
  Fault fault = Fault::none;
  std::string detail, stack;
  int frame = -1;
  double stage_um = 0;
};
std::optional<Latch> read_latch(const StateFolder& folder);
void write_latch(const StateFolder& folder, const Latch& latch);
void clear_latch(const StateFolder& folder);

}  // namespace slicecorr::bridge
