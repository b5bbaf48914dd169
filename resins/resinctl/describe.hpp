// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Definitions as text and JSON, for people and programs.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resinctl {

/// Rows under a head, columns aligned by characters.
std::string aligned(const std::vector<std::vector<std::string>>& rows);

/// "5 mJ/cm²", or "148 (mW/cm²)^0.91·s" where intensity times time is not what counts.
std::string gel_dose_text(const resins::ResinRecord& record);
std::string aim_text(const resins::ResinRecord& record);

std::string describe_resin(const resins::ResinRecord& record);
/// `in`: the resin of which a tomographic printer's reach is told; nullptr: one of the bath's index,
/// or of 1.5 in air. Throws `InputError` when the resin's file does not say its index.
std::string describe_printer(const Printer& printer, const std::string& path, const Resin* in);
std::string printer_json(const Printer& printer, const std::string& path);

}  // namespace slicecorr::resinctl
