/// A stack and the target it is measured against must be of the same printer and slice height.
#pragma once

#include "slicecorr/grid.hpp"

namespace slicecorr::detail {

/// Throws `InputError` when pixels or scale differ; the numbers of layers may.
void check_same(const Grid& stack, const Grid& target);

}  // namespace slicecorr::detail
