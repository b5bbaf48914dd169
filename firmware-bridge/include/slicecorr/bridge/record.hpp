// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file record.hpp
/// What is left of a print: a journal of events that survives a power cut, a CSV of frames, and the
/// latch that keeps a failed machine from printing until somebody has looked. All is thread-safe,
/// but each `PrintLock` belongs to one thread. Where a disk fails while a print goes on nothing is
/// thrown: `trouble` says it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {

/// Events as JSON, one per line: time (UTC), at_s, what, detail, frame, stage_um, of a stage that
/// turns stage_deg, facts. A thread of its own writes: `add` never waits for the disk. What is `important` is on the disk
/// (fdatasync) as soon as the disk can, the rest within a second. A line that a power cut halved is
/// ignored by readers. Throws `DeviceError` when it can't be begun.
class Journal {
 public:
  /// An earlier journal is kept beside it as journal.previous.jsonl.
  /// `um_per_deg`: as in `Stage`.
  explicit Journal(const std::string& path, double um_per_deg = 0);
  ~Journal();
  /// Never waits, and never throws for the disk.
  void add(const PrintEvent& event, bool important);
  /// Waits until all is on the disk.
  void flush();
  /// Why something could not be written; empty: all was.
  std::string trouble() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// frame, planned_z_um, z_um, planned_s, shown_s, late_um, speed_um_s, blue_share, uv_mw_cm2,
/// blue_measured, uv_measured, late (0 or 1), stage_error_um, temperature_c, exposure_s, exposed_s,
/// vblank, missed_vblanks, upload_s, present_s, of a job (`turns`) also job_frame, from_deg, to_deg;
/// what is not known is empty. z is counted from the first slice's begin. Never blocks the print: a
/// thread of its own writes. An earlier one is kept beside it as frames.previous.csv.
class FrameLog {
 public:
  /// `start_um`: stage position of the first slice's begin; `uv_display`: columns of that one, too.
  /// Throws `DeviceError`.
  FrameLog(const std::string& path, double start_um, bool turns = false, bool uv_display = false);
  ~FrameLog();
  void add(const FrameRecord& record);
  /// Waits until all is on the disk.
  void flush();
  /// Why something could not be written; empty: all was.
  std::string trouble() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The folder of a printer's state: DIR/PRINTER/{print.lock, latch.json, status.json, control.sock,
/// journal.jsonl, frames.csv}; DIR is --dir, $SLICECORR_BRIDGE_DIR, else slicecorr/bridge below the
/// user's state folder.
struct StateFolder {
  std::string path;
  /// Makes the folder. Throws `DeviceError`, and `InputError` when the printer's name can't be that
  /// of a folder.
  static StateFolder of(const std::string& dir, const Printer& printer);
  std::string file(const char* name) const { return path + "/" + name; }
};

/// One bridge per printer: held as long as it lives, and gone with the process.
class PrintLock {
 public:
  /// Throws `InputError` when another process holds it.
  explicit PrintLock(const StateFolder& folder);
  ~PrintLock();
  PrintLock(const PrintLock&) = delete;
  PrintLock& operator=(const PrintLock&) = delete;
  /// Whether some process holds it.
  static bool held(const StateFolder& folder);

 private:
  int file_ = -1;
};

/// A fault that nobody has looked at.
struct Latch {
  Fault fault = Fault::none;
  std::string detail, stack;
  int frame = kBlackFrame;  ///< on the display when it was found
  double stage_um = 0;      ///< above the window
  double z_um = 0;          ///< the same from the first slice's begin
  /// Of lamps and stage; nothing where the file says nothing of it.
  std::optional<Left> left = {};
};
/// The latch of the folder; nothing: there is none. A print that was killed counts as latched, too:
/// its journal has no end, and no other process prints (`locked`: the caller holds the lock).
std::optional<Latch> read_latch(const StateFolder& folder, bool locked);
/// On the disk when it returns. Throws `DeviceError`.
void write_latch(const StateFolder& folder, const Latch& latch);
/// Throws `DeviceError` when it can't be removed.
void clear_latch(const StateFolder& folder);

/// What the journal begins and ends with.
inline constexpr const char* kJournalBegin = "print begins";
inline constexpr const char* kJournalEnd = "print ends";
/// After a fault: what it left of lamps and stage, in words, and as JSON (`facts`).
inline constexpr const char* kJournalLeft = "lamps and stage";

/// UTC, as the journal has it: "2026-01-02T03:04:05.678Z".
std::string utc_now();

/// Writes a file whole or not at all; it is on the disk when this returns. Throws `DeviceError`.
void write_whole(const std::string& path, const std::string& text);

}  // namespace slicecorr::bridge
