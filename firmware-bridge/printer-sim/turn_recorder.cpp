// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "turn_recorder.hpp"

#include <fmt/format.h>

#include <utility>

#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

TurnRecorder::TurnRecorder(std::string path, const Machine& machine, TimedModel& model)
    : path_(std::move(path)), machine_(machine), model_(model) {}

void TurnRecorder::begin(const WireHello& hello) {
  write();
  angles_ = hello.angles;
  start_um_ = hello.start_um;
  frames_.clear();
  if (path_.empty()) return;
  model_.with([&](PrinterModel& model) {
    model.record({hello.layer_um, hello.start_um, 1, false});
    model.tell_images([this](int, const std::shared_ptr<const Frame>& frame) {
      frames_.push_back(frame->number % angles_);
    });
  });
}

std::string TurnRecorder::table() {
  std::string text;
  const double um_per_deg = machine_.stage.um_per_deg;
  model_.with([&](PrinterModel& model) {
    for (const SliceExposure& slice : model.exposures()) {
      for (const SliceExposure::Showing& s : slice.showings) {
        if (!(s.light_s > 0)) continue;
        const int frame = s.image < 0 ? kBlackFrame : frames_[static_cast<std::size_t>(s.image)];
        text += fmt::format("{},{:.6f},{:.6f},{:.9f},{:.9f}\n", frame,
                            (start_um_ + s.from_um) / um_per_deg,
                            (start_um_ + s.to_um) / um_per_deg, s.time_s, s.light_s / s.time_s);
      }
    }
  });
  return text;
}

void TurnRecorder::write() {
  if (path_.empty() || angles_ == 0) return;
  const std::string rows = table();
  // What had no light is only of interest when there is nothing else.
  if (rows.empty() && !written_.empty()) return;
  std::string path = path_;
  if (!written_.empty()) {
    path.insert(path.rfind('.'), fmt::format("-{}", written_.size() + 1));
  }
  write_whole(path, "job_frame,from_deg,to_deg,exposed_s,blue_measured\n" + rows);
  written_.push_back(path);
}

std::vector<std::string> TurnRecorder::finish() {
  write();
  angles_ = 0;
  return written_;
}

}  // namespace slicecorr::bridge
