// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "work/reporter.hpp"

#include <unistd.h>

#include <algorithm>
#include <climits>
#include <utility>

#include "slicecorr/error.hpp"
#include "work/files.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm::detail {

namespace {
constexpr auto kProgressInterval = std::chrono::milliseconds(300);
}

std::string host_name() {
  char name[HOST_NAME_MAX + 1] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "";
}

Reporter::Reporter(const std::string& folder, const WorkOrder& order, std::vector<Phase> phases)
    : folder_(folder), order_(order), phases_(std::move(phases)) {
  note_.node = host_name();
}

void Reporter::begin(std::size_t phase) {
  const std::lock_guard lock(mutex_);
  phase_ = phase;
  told_working_ = false;
  move(0, true);
  if (phase != kWorkPhase) tell_work_stage(phases_[phase].name, order_);
}

void Reporter::progress(double done) {
  const std::lock_guard lock(mutex_);
  move(done, false);
  if (phase_ == kWorkPhase && !told_working_ && done >= 0.3) {
    told_working_ = true;
    tell_work_stage(phases_[phase_].name, order_);
  }
}

void Reporter::set_layers(int layers) {
  const std::lock_guard lock(mutex_);
  layers_ = layers;
}

void Reporter::move(double done, bool always) {
  const Phase& p = phases_[phase_];
  note_.stage = p.name;
  note_.fraction =
      std::max(note_.fraction, p.from + (p.until - p.from) * std::clamp(done, 0.0, 1.0));
  note_.layers_done = static_cast<int>(layers_ * note_.fraction);
  const auto now = std::chrono::steady_clock::now();
  if (!always && now - told_ < kProgressInterval) return;
  told_ = now;
  ++note_.beat;
  try {
    write_progress(folder_, note_);
  } catch (const DeviceError&) {
    // The work itself will say that the disk is full.
  }
}

}  // namespace slicecorr::farm::detail
