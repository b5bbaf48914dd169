// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/watch.hpp"

#include <cstdlib>

#include "programs/common/program.hpp"
#include "support/terminal/terminal.hpp"

namespace slicecorr::cli {

void WatchOptions::add_to(CLI::App& app, const std::string& until, const std::string& until_what) {
  app.add_option("--interval-s", interval_s, "Time between two looks [0.5]")
      ->check(number_in(0.05, 3600));
  app.add_flag(until, until_end, until_what);
  app.add_flag("--once", once, "Print one frame and end");
  app.add_option("--columns", columns, "Width of a frame with --once [100]")
      ->check(CLI::Range(20, 1000));
  app.add_option("--rows", rows, "Height of a frame with --once [30]")->check(CLI::Range(5, 1000));
}

int print_frame(const WatchOptions& options, const WatchFrames& frames) {
  std::string text;
  for (const std::string& line : frames(options.columns, options.rows, false).lines) {
    text += line + "\n";
  }
  print_result(text);
  return kDone;
}

int watch_terminal(const WatchOptions& options, const WatchFrames& frames) {
  const char* const plain = std::getenv("NO_COLOR");
  const bool colour = plain == nullptr || *plain == 0;
  FrameTerminal terminal;
  while (!interrupted()) {
    const WatchFrame frame = frames(terminal.columns(), terminal.rows(), colour);
    terminal.show(frame.lines);
    if (options.until_end && frame.ended) return kDone;
    switch (terminal.wait(static_cast<int>(options.interval_s * 1000))) {
      case FrameTerminal::Key::quit:
        return kDone;
      case FrameTerminal::Key::interrupt:
        return kInterrupted;
      case FrameTerminal::Key::none:
        break;
    }
  }
  return kInterrupted;
}

}  // namespace slicecorr::cli
