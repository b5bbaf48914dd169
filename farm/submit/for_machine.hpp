// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file for_machine.hpp
/// Jobs that name the machine that is to print them.
#pragma once

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// The requests with what follows from their machine: its printer and the format that it reads, where
/// the job says neither, and the label "for NAME". Throws `SubmitErrors` with all whose machine is not
/// there, or reads another printer's files or another format.
std::vector<JobRequest> for_machines(std::vector<JobRequest> requests, const FarmFolder& folder);

}  // namespace slicecorr::farm::detail
