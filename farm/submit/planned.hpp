// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Speeds that are found for jobs in place of being said (`JobRequest::plan`).
#pragma once

#include <string>
#include <vector>

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// Gives requests that ask for it the speed, or layer by layer the exposure, that plan_print finds for the part
/// of each, a label that says it, and words about it. `scratch_folder`: for archives. Adds those for which none
/// is found to `errors`.
void plan_all(std::vector<JobRequest>& requests, const std::string& scratch_folder,
              const ExecutionContext& context, std::vector<SubmitError>& errors);

}  // namespace slicecorr::farm::detail
