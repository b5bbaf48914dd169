// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file pass_over.hpp
/// What a jobs file says for all jobs and what one of them has no place for is left out of that one.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// Leaves a default out of a request and notes why, in its `passed_over`. False, and nothing changes, where
/// `key` was not said, or the job says it itself.
bool pass_over(JobRequest& request, const std::string& key, const std::string& why);

/// What `resolve` gives of the request, without the defaults that it refuses as misfits (misfit.hpp).
Setup resolve_passing_over(JobRequest& request,
                           const std::function<Setup(const JobRequest&)>& resolve);

/// The message, and where a default that it names was said: errors stand at the line of a job.
std::string with_defaults_named(const JobRequest& request, std::string message);

/// Refuses defaults that fit none of the requests: they were meant otherwise.
void check_defaults(const std::vector<JobRequest>& requests, std::vector<SubmitError>& errors);

/// Does `work` for each request that is not refused yet, and adds what it throws to `errors`. `Cancelled` goes
/// through.
void for_each_sound(std::vector<JobRequest>& requests, std::vector<SubmitError>& errors,
                    const std::function<void(JobRequest&)>& work);

}  // namespace slicecorr::farm::detail
