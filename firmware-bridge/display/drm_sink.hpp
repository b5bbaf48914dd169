// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `make_drm_sink` with other calls in place of the kernel's.
#pragma once

#include <memory>
#include <string>

#include "display/drm_calls.hpp"
#include "slicecorr/bridge/frames.hpp"

namespace slicecorr::bridge::detail {

std::unique_ptr<FrameSink> make_drm_sink(std::unique_ptr<DrmCalls> calls,
                                         const std::string& connector, const Machine& machine,
                                         BridgeClock& clock);

}  // namespace slicecorr::bridge::detail
