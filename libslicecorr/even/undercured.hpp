// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How much of a part columns can't print with the even light of a setup. Private to the module.
#pragma once

#include <cstdint>

#include "slicecorr/setup.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Voxels of coverage 1 that do not print when columns are corrected with the light of `setup`, as
/// `correct_stack` will tell of them. Throws as it does.
std::uint64_t undercured_voxels(const SliceSource& target, const Setup& setup,
                                const ExecutionContext& context);

}  // namespace slicecorr::detail
