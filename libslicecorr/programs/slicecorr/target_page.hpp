// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Pages that say what to do with the pictures of `tomo target`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/tomo/targets.hpp"

namespace slicecorr::cli {

/// A page that needs nothing else: what to put into the vial, what to show, what to measure, and
/// where to enter it, with the pictures small.
std::string target_page(tomo::TargetKind kind, const Printer& printer,
                        const std::vector<tomo::TargetPicture>& pictures);

}  // namespace slicecorr::cli
