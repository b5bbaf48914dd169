// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a window must do for the sink behind it. The real one (window/sdl_window.cpp) is in a
/// module that is loaded when a window is asked for: with SDL2 come 50 shared libraries, which
/// would take each `printbridge status` as long again to start, and which a print without a window
/// does without.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace slicecorr::bridge::detail {

struct WindowWanted {
  std::string display;  ///< number or name; empty: the first
  int width_px = 0, height_px = 0;
  /// Called when the connection to the display server breaks, with the reason, by the thread that
  /// the window belongs to. That thread does not come back from the call that it is in.
  std::function<void(const std::string&)> died;
};

struct WindowFound {
  std::string words;   ///< what was opened, for people
  std::string wrong;   ///< why there is no window; empty: there is one
  bool input = false;  ///< whether the printer or display that was asked for is to blame
};

/// Belongs to the thread that opened it. What gives a text gives what is wrong, empty: nothing.
class Window {
 public:
  /// Closes it; what is on it then is black.
  virtual ~Window() = default;
  struct Pixels {
    std::uint32_t* first = nullptr;
    std::size_t pitch_px = 0;
  };
  /// Memory for the next picture, all of which is to be written; what is shown stays.
  virtual std::string begin(Pixels& pixels) = 0;
  /// The picture is complete.
  virtual std::string finish() = 0;
  /// Shows the picture; returns when it is shown, as far as can be told.
  virtual std::string present() = 0;
  /// Looks at what the display server says; to be called often.
  virtual std::string check() = 0;
};

/// The caller owns what it returns.
using OpenWindow = Window* (*)(const WindowWanted& wanted, WindowFound& found);

/// Name of the module's function, an `OpenWindow`.
inline constexpr const char* kWindowModuleEntry = "slicecorr_open_window";

}  // namespace slicecorr::bridge::detail
