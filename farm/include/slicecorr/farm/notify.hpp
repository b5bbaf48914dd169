// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file notify.hpp
/// Tells somebody when something happened: webhooks and commands, from DIR/notify.toml.
///
/// What is to be told follows from the record's events. It is written into DIR/notify.json before
/// anything is sent, and taken out after it was: each message arrives at least once, with an id
/// that stays the same, so that receivers can drop what they have had. One process of a farm sends;
/// others stand by. Sending never waits for, nor holds up, the work. Functions are
/// thread-safe, but a `ReadModel` belongs to one thread; so does a `Notifier`. What throws says so.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm {

/// What can be told.
inline constexpr const char* kNoticeKinds[] = {"job_failed", "batch_done",    "queue_empty",
                                               "disk_low",   "machine_ended", "machine_trouble",
                                               "scan_beyond"};

/// Who is told.
struct NotifyTarget {
  std::string name;                  ///< for messages; no secrets
  std::vector<std::string> kinds;    ///< empty: all
  std::string url;                   ///< of a webhook
  std::vector<std::string> headers;  ///< of a webhook, "Name: value"
  std::string ca_file;  ///< PEM that signs a webhook's certificate; empty: the system's
  std::vector<std::string> command;  ///< program and arguments, run without a shell
  double timeout_s = 10;             ///< of one try, > 0
  int most_tries = 12;               ///< with delays of 1, 2, 4 ... s, ten minutes at most
};

/// Reads DIR/notify.toml; none when there is no such file. Throws `InputError` with the line.
std::vector<NotifyTarget> read_notify_file(const std::string& path);

/// One message to be sent.
struct Notice {
  std::string id, kind;
  std::int64_t seq = 0;    ///< event that made it
  std::int64_t at_ms = 0;  ///< wall clock, since 1970
  std::string json;        ///< what is sent
  /// As environment: FARM_KIND, FARM_ID, FARM_TEXT, FARM_JOB ...
  std::vector<std::pair<std::string, std::string>> variables;
};

/// What has to be told of the events after `after`, and the last event looked at. `farm`: begins
/// all ids. Failures of one look beyond twenty are told as one message.
struct Notices {
  std::vector<Notice> list;
  std::int64_t seen = 0;  ///< seq of the last event looked at
};
Notices notices_since(ReadModel& model, const std::string& farm, std::int64_t after);

/// Sends one message; gives an empty text when it was taken, else why not. Gives up when `stop_fd`
/// becomes readable (-1: never). Does not throw.
std::string deliver(const NotifyTarget& target, const Notice& notice, const int stop_fd);

struct NotifyOptions {
  double look_s = 1;         ///< between two looks at the record
  double first_delay_s = 1;  ///< before the second try
  const FarmClock* clock = &system_clock();
};

/// Looks and sends in threads of its own until it goes out of scope, which takes no longer than a
/// moment: what is on its way is given up and sent again later. Errors in notify.toml are thrown by
/// the constructor; a later change of the file is taken up, or told as an event when it is wrong.
class Notifier {
 public:
  explicit Notifier(const FarmFolder& folder, NotifyOptions options = {});
  ~Notifier();
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;
  /// Whether this is the process that sends.
  bool sends() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace slicecorr::farm
