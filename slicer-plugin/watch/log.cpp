// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/log.hpp"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <nlohmann/json.hpp>

#include "support/files/errno_message.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::post {

namespace {

std::string now() {
  const std::time_t time = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&time, &local);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S%z}", local);
}

/// Names of files come from outside: a line stays one line, and moves no terminal's cursor.
/// Lines after each other: behind a full stop as a sentence of its own, else after a semicolon.
std::string in_sequence(const std::string& lines) {
  std::string text;
  for (std::size_t at = 0; at < lines.size();) {
    const std::size_t end = std::min(lines.find('\n', at), lines.size());
    if (!text.empty()) text += text.ends_with('.') ? " " : "; ";
    text += lines.substr(at, end - at);
    at = end + 1;
  }
  return text::printable(text);
}

}  // namespace

Log::Log(std::string path, bool json, bool quiet)
    : path_(std::move(path)), json_(json), quiet_(quiet && path_.empty()) {
  if (!path_.empty()) open();
}

Log::~Log() {
  if (file_ >= 0) ::close(file_);
}

void Log::open() {
  if (file_ >= 0) ::close(file_);
  file_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (file_ < 0) throw DeviceError(detail::errno_message(path_, "can't be written"));
}

void Log::add(const LogLine& line) {
  if (quiet_ && !line.trouble) return;
  std::string text;
  if (json_) {
    nlohmann::ordered_json j{{"time", now()}, {"event", line.event}};
    if (!line.file.empty()) j["file"] = line.file;
    if (!line.message.empty()) j["message"] = in_sequence(line.message);
    if (!line.verdict.empty()) j["verdict"] = line.verdict;
    if (line.seconds >= 0) j["seconds"] = line.seconds;
    if (line.code >= 0) j["code"] = line.code;
    const auto dump = [&](bool ascii) {
      return j.dump(-1, ' ', ascii, nlohmann::ordered_json::error_handler_t::replace);
    };
    // Who reads it gets the name as it is; a terminal gets nothing that moves its cursor.
    text = dump(false);
    if (text::printable(text) != text) text = dump(true);
    text += "\n";
  } else {
    text = fmt::format("{} {}", now(), line.event);
    if (!line.file.empty()) text += fmt::format(" {}", text::printable(line.file));
    if (!line.message.empty()) text += fmt::format(": {}", in_sequence(line.message));
    if (line.seconds >= 0) text += fmt::format(" ({:.1f} s)", line.seconds);
    text += "\n";
  }
  int to = STDERR_FILENO;
  if (!path_.empty()) {
    struct stat opened, named;
    if (::fstat(file_, &opened) != 0 || ::stat(path_.c_str(), &named) != 0 ||
        opened.st_ino != named.st_ino || opened.st_dev != named.st_dev) {
      open();
    }
    to = file_;
  }
  // Watching goes on when a line can't be written: the disk may have room again later.
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = ::write(to, text.data() + done, text.size() - done);
    if (n < 0 && errno != EINTR) return;
    if (n > 0) done += static_cast<std::size_t>(n);
  }
}

}  // namespace slicecorr::post
