// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file display.hpp
/// Displays behind `FrameSink`: a window by way of SDL2, a display's scan-out by way of DRM/KMS,
/// and several of them at once. Pixels are shown 1:1 or not at all. Each display is black before
/// its first image and on every way out. A sink belongs to one thread; sinks may be made by
/// several.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "slicecorr/bridge/frames.hpp"

namespace slicecorr::bridge {

/// A borderless window that covers a display, for X11, Wayland and Xvfb ($SDL_VIDEODRIVER counts).
/// `display`: its number from 0 or its name, "HDMI-1"; empty: that of [projector], else the first.
/// SDL lives in a thread of its own, which takes over the priority of who calls `show`. The window
/// may not be closed, hidden, covered or moved: `DeviceError`. So is a display server that dies:
/// the process lives on, but it can't open another window. One window to a process at a time.
/// Throws `InputError` when the display's mode is not the printer's or it would be scaled,
/// `DeviceError` when there is none. `clock` must outlive the sink.
std::unique_ptr<FrameSink> make_window_sink(const std::string& display, const Machine& machine,
                                            BridgeClock& clock);

/// Page flips of the kernel's own (DRM/KMS), for machines without a desktop. `card`:
/// "/dev/dri/card0", "card0", "0" or empty, the first one with a display; `connector`: "HDMI-A-1"
/// or empty, that of [projector], else the first that is connected. Times are those of the vertical
/// blank at which an image's scan-out began. Throws `InputError` when there is no mode of the
/// printer's size, `DeviceError` when another program has the display. `clock` must outlive the
/// sink.
std::unique_ptr<FrameSink> make_drm_sink(const std::string& card, const std::string& connector,
                                         const Machine& machine, BridgeClock& clock);

/// The answers are those of the first sink, of which there must be one. The others get the same
/// images right after it. When one display is gone, all count as gone; black goes to all.
std::unique_ptr<FrameSink> make_several_sinks(std::vector<std::unique_ptr<FrameSink>> sinks);

/// What can be said against all of a print's sinks together without opening one: names that are
/// none, two windows, the same display twice. Throws `InputError`.
void check_sinks(const std::vector<std::string>& names, bool lockstep);

/// Sinks as they are named on the command line: window[:DISPLAY], drm[:CARD[:CONNECTOR]],
/// unix:PATH, tcp:HOST:PORT, null. No names mean null. Throws `InputError` and `DeviceError`.
std::unique_ptr<FrameSink> open_sinks(const std::vector<std::string>& names, const Machine& machine,
                                      const WireHello& hello, BridgeClock& clock);

}  // namespace slicecorr::bridge
