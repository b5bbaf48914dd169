// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What is said of a print and does not count in it.
#pragma once

#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Throws `InputError` naming the first choice that changes nothing in this setup.
void check_counts(const Setup& setup, const SetupChoices& choices, ChoiceNames names);

}  // namespace slicecorr::detail
