// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What was shown to a vial that turned, as a table for `slicecorr tomo verify --shown`.
#pragma once

#include <string>
#include <vector>

#include "recorder.hpp"

namespace slicecorr::bridge {

/// A row for each stretch of angle in which one frame, or black (-1), was lit: job_frame, from_deg,
/// to_deg, exposed_s, blue_measured, the last the mean share of light. Prints that follow another go
/// to shown-2.csv and so on.
class TurnRecorder final : public PrintRecorder {
 public:
  /// `path` empty: nothing is recorded.
  TurnRecorder(std::string path, const Machine& machine, TimedModel& model);
  void begin(const WireHello& hello) override;
  std::vector<std::string> finish() override;

 private:
  /// The table so far; empty where nothing was lit.
  std::string table();
  void write();

  const std::string path_;
  const Machine& machine_;
  TimedModel& model_;
  int angles_ = 0;
  double start_um_ = 0;
  std::vector<int> frames_;  ///< of the job, for each image that was lit
  std::vector<std::string> written_;
};

}  // namespace slicecorr::bridge
