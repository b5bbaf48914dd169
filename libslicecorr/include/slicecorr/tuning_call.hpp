// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tuning_call.hpp
/// What `slicecorr-tuning.so` is asked and answers. It tunes by scans, for callers that are no program of ours: with it
/// comes what fits resins, which who only corrects slices need not have. The C interface loads it when it is first needed.
///
/// Plain values that pass between two files that were compiled by themselves: no exceptions, no types of ours.
#pragma once

#include <atomic>

namespace slicecorr {

struct TuningCall {
  /// An object: "scans", a list of paths; "stack", the path of what was printed; "printer" and "resin", names or paths,
  /// or "printer_toml" and "resin_toml", texts; "unit" and "voxel_um" as `ScanReading`; "scratch", a folder; "threads",
  /// 0: all.
  const char* request = "";
  const std::atomic<bool>* cancel = nullptr;  ///< null: is not cancelled
  void (*progress)(void* user, const char* stage, double fraction) = nullptr;
  void (*notice)(void* user, const char* text) = nullptr;
  /// Called once: with an object, or with what went wrong.
  void (*answer)(void* user, const char* text) = nullptr;
  void* user = nullptr;
};

/// How a call ended.
enum class TuningEnd : int { done, cancelled, input, infeasible, device, memory, defect };

/// The module's function, and its name.
using TuningFunction = int (*)(const TuningCall*);
inline constexpr const char* kTuningFunction = "slicecorr_tuning";
inline constexpr const char* kTuningModule = "slicecorr-tuning.so";

}  // namespace slicecorr
