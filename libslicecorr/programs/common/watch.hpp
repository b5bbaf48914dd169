// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file watch.hpp
/// Commands that follow something on the terminal: their options, and their two plain ways.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace slicecorr::cli {

struct WatchOptions {
  double interval_s = 0.5;
  bool once = false;
  bool until_end = false;
  int columns = 100, rows = 30;  ///< of the frame with `once`
  /// `until`: the flag, and `until_what` its help.
  void add_to(CLI::App& app, const std::string& until, const std::string& until_what);
};

struct WatchFrame {
  std::vector<std::string> lines;
  bool ended = false;  ///< what is followed has
};
using WatchFrames = std::function<WatchFrame(int columns, int rows, bool colour)>;

/// Prints one frame without colours.
int print_frame(const WatchOptions& options, const WatchFrames& frames);
/// Shows frames until a key or the end ends it; in colours unless $NO_COLOR says no. Takes the
/// terminal, so `FrameTerminal::possible()` must hold. Returns the exit code.
int watch_terminal(const WatchOptions& options, const WatchFrames& frames);

}  // namespace slicecorr::cli
