// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <functional>
#include <string_view>
#include <vector>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"

namespace slicecorr::farm {

namespace {

[[noreturn]] void refuse(const std::string& name, const std::string& text,
                         const std::string& expected) {
  throw InputError(fmt::format("{} is '{}', expected {}", name, text, expected));
}

std::int64_t whole(const std::string& name, const std::string& text, std::int64_t least,
                   std::int64_t most) {
  std::int64_t value = 0;
  const char* end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || at != end || value < least || value > most) {
    refuse(name, text, fmt::format("a whole number from {} to {}", least, most));
  }
  return value;
}

double seconds(const std::string& name, const std::string& text, double least, double most) {
  const auto value = cli::number_of(text);
  if (!value || *value < least || *value > most) {
    refuse(name, text, fmt::format("seconds from {} to {}", least, most));
  }
  return *value;
}

bool truth(const std::string& name, const std::string& text) {
  if (text == "yes") return true;
  if (text == "no") return false;
  refuse(name, text, "yes or no");
}

void set_night(FarmSettings& s, const std::string& text) {
  if (text == "off") {
    s.night_from = s.night_until = -1;
    return;
  }
  const std::size_t dash = text.find('-');
  const int from = parse_minute(text.substr(0, dash));
  const int until = dash == text.npos ? -1 : parse_minute(text.substr(dash + 1));
  if (from < 0 || until < 0 || from == until) refuse("night", text, "HH:MM-HH:MM or off");
  s.night_from = from;
  s.night_until = until;
}

constexpr std::int64_t kMany = 1'000'000'000;

struct Entry {
  const char* name;
  std::function<void(FarmSettings&, const std::string&)> set;
  std::function<std::string(const FarmSettings&)> text;
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> list = {
      {"paused", [](FarmSettings& s, const std::string& t) { s.paused = truth("paused", t); },
       [](const FarmSettings& s) { return s.paused ? "yes" : "no"; }},
      {"draining", [](FarmSettings& s, const std::string& t) { s.draining = truth("draining", t); },
       [](const FarmSettings& s) { return s.draining ? "yes" : "no"; }},
      {"night", set_night,
       [](const FarmSettings& s) {
         return s.night_from < 0 ? std::string("off")
                                 : minute_text(s.night_from) + "-" + minute_text(s.night_until);
       }},
      {"user-running",
       [](FarmSettings& s, const std::string& t) {
         s.user_running = static_cast<int>(whole("user-running", t, 0, kMany));
       },
       [](const FarmSettings& s) { return std::to_string(s.user_running); }},
      {"user-queued",
       [](FarmSettings& s, const std::string& t) {
         s.user_queued = static_cast<int>(whole("user-queued", t, 0, kMany));
       },
       [](const FarmSettings& s) { return std::to_string(s.user_queued); }},
      {"min-free-mb",
       [](FarmSettings& s, const std::string& t) {
         s.min_free_mb = whole("min-free-mb", t, 0, kMany);
       },
       [](const FarmSettings& s) { return std::to_string(s.min_free_mb); }},
      {"max-attempts",
       [](FarmSettings& s, const std::string& t) {
         s.max_attempts = static_cast<int>(whole("max-attempts", t, 1, 100));
       },
       [](const FarmSettings& s) { return std::to_string(s.max_attempts); }},
      {"hang-s",
       [](FarmSettings& s, const std::string& t) { s.hang_s = seconds("hang-s", t, 1, 1e7); },
       [](const FarmSettings& s) { return fmt::format("{}", s.hang_s); }},
      {"retry-delay-s",
       [](FarmSettings& s, const std::string& t) {
         s.retry_delay_s = seconds("retry-delay-s", t, 0, 600);
       },
       [](const FarmSettings& s) { return fmt::format("{}", s.retry_delay_s); }},
      {"cache-max-mb",
       [](FarmSettings& s, const std::string& t) {
         s.cache_max_mb = whole("cache-max-mb", t, 0, kMany);
       },
       [](const FarmSettings& s) { return std::to_string(s.cache_max_mb); }},
  };
  return list;
}

constexpr const char* kRunningOf = "user-running.";
constexpr const char* kQueuedOf = "user-queued.";
constexpr std::string_view kSlurmLabel = "slurm-label.";

void set_slurm_label(FarmSettings& settings, const std::string& name, const std::string& text) {
  const std::string label = name.substr(kSlurmLabel.size());
  if (text == "none") {
    // Kept: what is not in the list of texts would not be written over.
    settings.slurm_labels[label] = text;
    return;
  }
  const std::size_t colon = text.find(':');
  const std::string kind = text.substr(0, colon);
  const bool known = kind == "constraint" || kind == "partition" || kind == "gres";
  const bool clean = std::none_of(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) <= ' ' || c == '\'' || c == '"';
  });
  if (colon == text.npos || colon + 1 == text.size() || !known || !clean) {
    refuse(name, text, "constraint:X, partition:X, gres:X or none");
  }
  settings.slurm_labels[label] = text;
}

}  // namespace

void set_setting(FarmSettings& settings, const std::string& name, const std::string& text) {
  for (const Entry& e : entries()) {
    if (name == e.name) return e.set(settings, text);
  }
  for (const bool running : {true, false}) {
    const std::string prefix = running ? kRunningOf : kQueuedOf;
    if (!name.starts_with(prefix) || name.size() == prefix.size()) continue;
    const auto value = static_cast<int>(whole(name, text, 0, kMany));
    // A user's other number stays that of everybody until it is set, too.
    const auto [limits, added] = settings.users.try_emplace(name.substr(prefix.size()), -1, -1);
    (running ? limits->second.first : limits->second.second) = value;
    return;
  }
  if (name.starts_with(kSlurmLabel) && name.size() > kSlurmLabel.size()) {
    return set_slurm_label(settings, name, text);
  }
  std::string names;
  for (const Entry& e : entries()) names += std::string(names.empty() ? "" : ", ") + e.name;
  throw InputError(
      fmt::format("'{}' is no setting; expected one of {}, user-running.NAME, user-queued.NAME, "
                  "slurm-label.LABEL",
                  name, names));
}

std::map<std::string, std::string> setting_texts(const FarmSettings& settings) {
  std::map<std::string, std::string> texts;
  for (const Entry& e : entries()) texts[e.name] = e.text(settings);
  for (const auto& [user, limits] : settings.users) {
    if (limits.first >= 0) texts[kRunningOf + user] = std::to_string(limits.first);
    if (limits.second >= 0) texts[kQueuedOf + user] = std::to_string(limits.second);
  }
  for (const auto& [label, text] : settings.slurm_labels) {
    texts[std::string(kSlurmLabel) + label] = text;
  }
  return texts;
}

int running_limit(const FarmSettings& s, const std::string& user) {
  const auto own = s.users.find(user);
  return own != s.users.end() && own->second.first >= 0 ? own->second.first : s.user_running;
}

int queued_limit(const FarmSettings& s, const std::string& user) {
  const auto own = s.users.find(user);
  return own != s.users.end() && own->second.second >= 0 ? own->second.second : s.user_queued;
}

bool in_night_window(const FarmSettings& s, int minute) {
  if (s.night_from < 0) return true;
  return s.night_from < s.night_until ? minute >= s.night_from && minute < s.night_until
                                      : minute >= s.night_from || minute < s.night_until;
}

}  // namespace slicecorr::farm
