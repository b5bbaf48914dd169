// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts of which nothing can print.
#pragma once

#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Throws `InputError`: of a target without a voxel of coverage 1 nothing prints. Reads it to say
/// what it has instead. `name`: of the target, may be empty.
[[noreturn]] void refuse_vanished(const SliceSource& target, const std::string& name = {});

/// Tells the user where nothing that is designed prints.
void tell_nothing_prints(const Prediction& prediction, const ExecutionContext& context);

}  // namespace slicecorr::detail
