/// The correction where light spreads from column to column.
#pragma once

#include "slicecorr/pipeline.hpp"

namespace slicecorr::detail {

/// As `correct_stack`, for light that spreads: first each column alone, then all together.
Correction correct_spread_stack(const SliceSource& target, const Setup& setup,
                                const StackFile& file, const CorrectionAsk& ask,
                                const ExecutionContext& context);

}  // namespace slicecorr::detail
