/// @file fault.hpp
/// Where a worker lets a test break it.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/farm/work.hpp"

namespace slicecorr::farm::detail {

/// Does what the fault says when this is its stage, job and attempt.
void commit_fault(const std::optional<TestFault>& fault, const std::string& stage,
                  const Order& order);

}  // namespace slicecorr::farm::detail
