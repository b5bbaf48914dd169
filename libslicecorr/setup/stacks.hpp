// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which setups stacks allow that know how they were made.
#pragma once

#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Throws `InputError` when another printer, process or exponent is chosen for a recording: it was
/// shown by one printer in one way, and its light is relative to that.
void check_recorded(const Setup& setup, const StackInfo& info);

}  // namespace slicecorr::detail
