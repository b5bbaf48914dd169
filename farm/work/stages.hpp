// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file stages.hpp
/// Where workers and services tell that they come to a stage. Nobody listens in the programs that
/// are shipped; a program that is built for tests listens, and breaks the farm there
/// (tests/farm_faults.cpp).
#pragma once

#include <string>

#include "slicecorr/farm/work.hpp"

namespace slicecorr::farm::detail {

/// Called by a worker at "start", "read", "correct" (when it is 30 % done), "report", "check" and
/// "end", of a tomographic print "solve" in place of "correct", and "judge" before "check", with what it
/// was ordered to do; null: nobody listens. Set before `main` begins and not
/// changed after, so that any thread may read it.
extern void (*work_stage_listener)(const std::string& stage, const WorkOrder& order);
/// Called by a service's main thread at "claimed", "ordered", "started", "ended", "committing",
/// "cached", "delivered" and "finished"; else as above.
extern void (*service_stage_listener)(const char* stage);

inline void tell_work_stage(const std::string& stage, const WorkOrder& order) {
  if (work_stage_listener) work_stage_listener(stage, order);
}
inline void tell_service_stage(const char* stage) {
  if (service_stage_listener) service_stage_listener(stage);
}

}  // namespace slicecorr::farm::detail
