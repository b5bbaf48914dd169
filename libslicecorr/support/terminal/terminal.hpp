// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A terminal that shows frames: takes it over, gives it back however the program ends.
#pragma once

#include <termios.h>

#include <string>
#include <vector>

namespace slicecorr::cli {

class FrameTerminal {
 public:
  /// Whether stdin and stdout are a terminal that can move its cursor.
  static bool possible();
  FrameTerminal();
  ~FrameTerminal();
  FrameTerminal(const FrameTerminal&) = delete;
  FrameTerminal& operator=(const FrameTerminal&) = delete;

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// Writes what differs from the frame before.
  void show(const std::vector<std::string>& lines);

  enum class Key { none, quit, interrupt };
  /// Waits for a key, a change of size or the end of the time. Ctrl-Z gives the terminal back until
  /// the program goes on.
  Key wait(int milliseconds);

 private:
  void enter();
  void leave();
  void measure();

  termios before_{};
  std::vector<std::string> shown_;
  int columns_ = 80, rows_ = 24;
  bool fresh_ = true;  ///< nothing of what was shown is there any more
};

}  // namespace slicecorr::cli
