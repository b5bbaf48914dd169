// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/clock.hpp"

#include <fmt/format.h>

#include <ctime>
#include <fstream>

namespace slicecorr::farm {

namespace {

std::int64_t ms_of(clockid_t id) {
  timespec t{};
  clock_gettime(id, &t);
  return std::int64_t{t.tv_sec} * 1000 + t.tv_nsec / 1'000'000;
}

class SystemClock final : public FarmClock {
 public:
  SystemClock() {
    std::ifstream file("/proc/sys/kernel/random/boot_id");
    std::getline(file, boot_);
  }
  std::int64_t wall_ms() const override { return ms_of(CLOCK_REALTIME); }
  std::int64_t steady_ms() const override { return ms_of(CLOCK_BOOTTIME); }
  std::string boot_id() const override { return boot_; }

 private:
  std::string boot_;
};

std::tm local(std::int64_t wall_ms) {
  const std::time_t t = static_cast<std::time_t>(wall_ms / 1000);
  std::tm parts{};
  localtime_r(&t, &parts);
  return parts;
}

}  // namespace

const FarmClock& system_clock() {
  static const SystemClock clock;
  return clock;
}

int local_minute(std::int64_t wall_ms) {
  const std::tm t = local(wall_ms);
  return t.tm_hour * 60 + t.tm_min;
}

std::int64_t next_local_minute(std::int64_t wall_ms, int minute) {
  std::tm t = local(wall_ms);
  for (int day = 0;; ++day) {
    std::tm then = t;
    then.tm_mday += day;
    then.tm_hour = minute / 60;
    then.tm_min = minute % 60;
    then.tm_sec = 0;
    then.tm_isdst = -1;  // summer time may begin or end in between
    const std::int64_t ms = std::int64_t{std::mktime(&then)} * 1000;
    if (ms > wall_ms) return ms;
  }
}

int parse_minute(const std::string& text) {
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  if (text.size() != 5 || text[2] != ':' || !digit(text[0]) || !digit(text[1]) || !digit(text[3]) ||
      !digit(text[4])) {
    return -1;
  }
  const int hour = (text[0] - '0') * 10 + text[1] - '0';
  const int minute = (text[3] - '0') * 10 + text[4] - '0';
  return hour < 24 && minute < 60 ? hour * 60 + minute : -1;
}

std::string minute_text(int minute) { return fmt::format("{:02}:{:02}", minute / 60, minute % 60); }

std::string local_time_text(std::int64_t wall_ms) {
  const std::tm t = local(wall_ms);
  return fmt::format("{:04}-{:02}-{:02} {:02}:{:02}:{:02}", t.tm_year + 1900, t.tm_mon + 1,
                     t.tm_mday, t.tm_hour, t.tm_min, t.tm_sec);
}

}  // namespace slicecorr::farm
