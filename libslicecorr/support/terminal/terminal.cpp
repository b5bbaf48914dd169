// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/terminal/terminal.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <string_view>

#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

volatile std::sig_atomic_t resized = 0;
void on_resize(int) { resized = 1; }

void write_all(std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(STDOUT_FILENO, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) throw DeviceError("the terminal is gone");
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

}  // namespace

bool FrameTerminal::possible() {
  const char* kind = std::getenv("TERM");
  return ::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1 && kind != nullptr &&
         std::string_view(kind) != "dumb" && *kind != 0;
}

FrameTerminal::FrameTerminal() {
  if (::tcgetattr(STDIN_FILENO, &before_) != 0) throw DeviceError("the terminal is gone");
  struct sigaction action {};
  action.sa_handler = on_resize;
  ::sigaction(SIGWINCH, &action, nullptr);
  enter();
}

FrameTerminal::~FrameTerminal() {
  try {
    leave();
  } catch (...) {
    // A terminal that is gone needs nothing back.
  }
}

void FrameTerminal::enter() {
  termios raw = before_;
  // Keys come one by one and unseen; Ctrl-C and Ctrl-Z as keys, so that the screen is given back.
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO | ISIG);
  raw.c_cc[VMIN] = 0;
  raw.c_cc[VTIME] = 0;
  ::tcsetattr(STDIN_FILENO, TCSANOW, &raw);
  // Second screen, no cursor, no wrapping of long lines.
  write_all("\033[?1049h\033[?25l\033[?7l");
  fresh_ = true;
  measure();
}

void FrameTerminal::leave() {
  ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  write_all("\033[?7h\033[?25h\033[?1049l");
}

void FrameTerminal::measure() {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0)
    return;
  if (size.ws_col == columns_ && size.ws_row == rows_) return;
  columns_ = size.ws_col;
  rows_ = size.ws_row;
  fresh_ = true;
}

void FrameTerminal::show(const std::vector<std::string>& lines) {
  std::string out = fresh_ ? "\033[2J" : "";
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (!fresh_ && i < shown_.size() && shown_[i] == lines[i]) continue;
    out += fmt::format("\033[{};1H{}\033[K", i + 1, lines[i]);
  }
  if (lines.size() < shown_.size() && !fresh_) {
    out += fmt::format("\033[{};1H\033[J", lines.size() + 1);
  }
  fresh_ = false;
  shown_ = lines;
  write_all(out);
}

FrameTerminal::Key FrameTerminal::wait(int milliseconds) {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  const int ready = ::poll(&input, 1, milliseconds);
  if (resized) {
    resized = 0;
    measure();
  }
  if (ready <= 0) return Key::none;
  char key = 0;
  if (::read(STDIN_FILENO, &key, 1) <= 0) return Key::quit;  // the terminal is gone
  switch (key) {
    case 'q':
    case 'Q':
      return Key::quit;
    case 3:  // Ctrl-C
      return Key::interrupt;
    case 12:  // Ctrl-L
      fresh_ = true;
      break;
    case 26:  // Ctrl-Z
      leave();
      ::raise(SIGSTOP);
      enter();
      break;
    default:
      break;
  }
  return Key::none;
}

}  // namespace slicecorr::cli
