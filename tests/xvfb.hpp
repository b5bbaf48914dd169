// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A display server without a display.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "bridge_fixture.hpp"
#include "onlooker.hpp"

namespace slicecorr::test {

class Xvfb {
 public:
  static constexpr const char* kPath = "/usr/bin/Xvfb";
  static bool installed() { return ::access(kPath, X_OK) == 0; }
  /// On a free display number, which $DISPLAY then names.
  Xvfb(int width_px, int height_px, int depth = 24)
      : server_({kPath, "-displayfd", "1", "-screen", "0",
                 std::to_string(width_px) + "x" + std::to_string(height_px) + "x" +
                     std::to_string(depth),
                 "-nolisten", "tcp", "-noreset"}) {
    name_ = ":" + server_.line();
    if (name_ == ":") ADD_FAILURE() << "Xvfb does not start";
    ::setenv("DISPLAY", name_.c_str(), 1);
    ::unsetenv("SDL_VIDEODRIVER");
    ::unsetenv("WAYLAND_DISPLAY");
  }
  const std::string& name() const { return name_; }
  Child& server() { return server_; }

 private:
  Child server_;
  std::string name_;
};

}  // namespace slicecorr::test
