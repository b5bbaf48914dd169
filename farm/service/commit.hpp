// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file commit.hpp
/// From a worker's end to the record: the steps that must be right wherever the service is killed.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/work.hpp"

namespace slicecorr::farm::detail {

enum class Settled { done, put_back, failed, cancelled, lost };

/// Commits a success: cache, delivery, record. Without room or with damaged files the attempt is
/// given up.
Settled commit_result(const FarmFolder& folder, Queue& queue, const Job& job,
                      const Attempt& attempt, const WorkOutcome& outcome);

/// Ends an attempt without a result, and clears away what it left.
Settled give_up_attempt(const FarmFolder& folder, Queue& queue, const Job& job,
                        const Attempt& attempt, AttemptEnd end);

/// Folders of attempts that have ended, or that nobody knows. An attempt is in the record before it
/// has a folder, so none of these is about to be used.
std::vector<std::string> ended_attempt_folders(const FarmFolder& folder, Queue& queue);

/// Files among the stored inputs that the record does not know: a submission failed, or was killed.
/// The caller must hold an exclusive `InputLock` (`InputLock::alone`).
std::vector<std::string> stray_inputs(const FarmFolder& folder, Queue& queue);
/// Folders of scans that no record names, a day old or more.
std::vector<std::string> stray_scans(const FarmFolder& folder, Queue& queue);

}  // namespace slicecorr::farm::detail
