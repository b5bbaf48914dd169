// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file terminal_screen.hpp
/// Programs at a terminal of their own.
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <functional>
#include <regex>
#include <string>
#include <vector>

namespace slicecorr::test {

/// A program at a terminal of its own; what it writes is put on a screen.
class Terminal {
 public:
  Terminal(const std::vector<std::string>& command, int columns, int rows)
      : columns_(columns), rows_(rows) {
    winsize size{};
    size.ws_col = static_cast<unsigned short>(columns);
    size.ws_row = static_cast<unsigned short>(rows);
    std::vector<char*> argv;
    for (const std::string& s : command) argv.push_back(const_cast<char*>(s.c_str()));
    argv.push_back(nullptr);
    child_ = ::forkpty(&master_, nullptr, nullptr, &size);
    if (child_ == 0) {
      ::setenv("TERM", "xterm-256color", 1);
      ::unsetenv("NO_COLOR");
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    clear();
  }
  ~Terminal() {
    if (!ended_) {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    ::close(master_);
  }
  /// Reads until the screen, or all that was written, holds; false when it does not in time.
  bool until(const std::function<bool()>& holds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!holds()) {
      if (std::chrono::steady_clock::now() > end) return false;
      pollfd fd{master_, POLLIN, 0};
      if (::poll(&fd, 1, 50) <= 0) continue;
      char buffer[4096];
      const ssize_t n = ::read(master_, buffer, sizeof buffer);
      if (n <= 0) return holds();
      raw.append(buffer, static_cast<std::size_t>(n));
      feed(std::string(buffer, static_cast<std::size_t>(n)));
    }
    return true;
  }
  void type(const std::string& keys) {
    ASSERT_EQ(::write(master_, keys.data(), keys.size()), static_cast<ssize_t>(keys.size()));
  }
  void resize(int columns, int rows) {
    columns_ = columns;
    rows_ = rows;
    winsize size{};
    size.ws_col = static_cast<unsigned short>(columns);
    size.ws_row = static_cast<unsigned short>(rows);
    ::ioctl(master_, TIOCSWINSZ, &size);
  }
  /// Waits for the program's end; its exit code, 128 + signal.
  int end() {
    until([] { return false; });
    int status = 0;
    ::waitpid(child_, &status, 0);
    ended_ = true;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  pid_t child() const { return child_; }
  std::string screen() const {
    std::string text;
    for (const std::string& line : lines_) text += line + "\n";
    return text;
  }
  std::string raw;
  bool second_screen = false, cursor = true;

 private:
  void clear() { lines_.assign(200, ""); }
  /// The few sequences that the program uses; anything else fails the test.
  void feed(const std::string& text) {
    rest_ += text;
    for (;;) {
      const std::size_t escape = rest_.find('\033');
      put(rest_.substr(0, escape));
      if (escape == std::string::npos) {
        rest_.clear();
        return;
      }
      rest_.erase(0, escape);
      std::smatch m;
      if (!std::regex_search(rest_, m, std::regex("^\033\\[([?]?)([0-9;]*)([A-Za-z])"))) {
        ASSERT_LT(rest_.size(), 16U) << "an unknown sequence";
        return;
      }
      sequence(m[1].length() > 0, m[2], m[3].str()[0]);
      rest_.erase(0, static_cast<std::size_t>(m.length()));
    }
  }
  void put(const std::string& text) {
    for (const char c : text) {
      if (c == '\r') continue;
      if (c == '\n') {
        ++row_;
        continue;
      }
      if (row_ < lines_.size()) lines_[row_] += c;
    }
  }
  void sequence(bool priv, const std::string& numbers, char what) {
    if (priv) {
      if (numbers == "1049") second_screen = what == 'h';
      if (numbers == "25") cursor = what == 'h';
      return;
    }
    if (what == 'H') {
      row_ = static_cast<std::size_t>(std::stoi(numbers)) - 1;
      lines_[row_].clear();  // lines are written whole, and cleared to their end
    } else if (what == 'J' && numbers == "2") {
      clear();
    } else if (what == 'J') {
      for (std::size_t i = row_; i < lines_.size(); ++i) lines_[i].clear();
    } else {
      ASSERT_TRUE(what == 'K' || what == 'm') << numbers << what;
    }
  }

  int columns_, rows_, master_ = -1;
  pid_t child_ = 0;
  bool ended_ = false;
  std::size_t row_ = 0;
  std::vector<std::string> lines_;
  std::string rest_;
};

}  // namespace slicecorr::test
