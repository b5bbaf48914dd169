// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file job_of_upload.hpp
/// What comes from a slicer becomes a job by the rule of a machine.
#pragma once

#include <string>

#include "slicecorr/farm/as_printer.hpp"

namespace slicecorr::farm::detail {

/// The request for one job: the machine's rule, the file, the machine.
std::string job_of_upload(const MachineSpec& machine, const std::string& part,
                          const std::string& name);
/// Throws `SubmitErrors` where the machine's rule has what jobs do not.
void check_rule(const MachineSpec& machine);
/// Why a submission was refused, in one line; empty: it was not.
std::string refusal_of(const SubmitReply& reply);

}  // namespace slicecorr::farm::detail
