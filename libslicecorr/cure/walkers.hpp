/// The workings of BandDose, one per model.
#pragma once

#include <cstddef>
#include <memory>

#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

/// Needs `model.inhibited`.
std::unique_ptr<BandDose::Walker> make_inhibited_walker(const CureModel& model,
                                                        std::size_t columns);

}  // namespace slicecorr::detail
