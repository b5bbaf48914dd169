// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Speeds that are found for jobs in place of being said (`JobRequest::plan`).
#pragma once

#include <string>
#include <vector>

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// The requests with the speed, or layer by layer the exposure, that plan_print finds for the part of
/// each that asks for one, a label that says it, and words about it. `scratch_folder`: for archives.
/// Throws `SubmitErrors` with all for which none is found.
std::vector<JobRequest> planned(const std::vector<JobRequest>& requests,
                                const std::string& scratch_folder, const ExecutionContext& context);

}  // namespace slicecorr::farm::detail
