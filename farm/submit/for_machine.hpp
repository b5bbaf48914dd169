// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file for_machine.hpp
/// Jobs that name the machine that is to print them.
#pragma once

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// Gives requests what follows from their machine: its printer and the format that it reads, where
/// the job says neither, and the label "for NAME". Adds those whose machine is not there, or reads another
/// printer's files or another format, to `errors`.
void fit_to_machines(std::vector<JobRequest>& requests, const FarmFolder& folder,
                     std::vector<SubmitError>& errors);

}  // namespace slicecorr::farm::detail
