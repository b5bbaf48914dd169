// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `make_window_sink` with another window in place of SDL2's.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "display/window.hpp"
#include "slicecorr/bridge/frames.hpp"

namespace slicecorr::bridge::detail {

std::unique_ptr<FrameSink> make_window_sink(
    const std::string& display, const Machine& machine, BridgeClock& clock,
    const std::function<std::unique_ptr<Window>(const WindowWanted&, WindowFound&)>& open);

}  // namespace slicecorr::bridge::detail
