// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/notify.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using slicecorr::detail::errno_message;

namespace {

constexpr double kLongestDelayS = 600;
/// Nobody reads a million messages at once; the oldest are dropped, and the record says so.
constexpr std::size_t kMostPending = 10'000;

/// One message for one receiver.
struct Pending {
  Notice notice;
  std::string target;
  int tries = 0;
  std::int64_t due_steady_ms = 0;
  bool on_its_way = false;
};

using slicecorr::detail::member_of, slicecorr::detail::text_in, slicecorr::detail::whole_in;

/// What outlives the process: how far the record was read, and what is still to be sent.
class Outbox {
 public:
  Outbox(std::string path, std::int64_t last_event) : path_(std::move(path)), seen_(last_event) {
    const auto text = text_of_file(path_);
    if (!text) {
      // What was before the first start is history.
      farm_ = random_token().substr(0, 12);
      save();
      return;
    }
    const Json json = slicecorr::detail::try_json<Json>(*text);
    farm_ = text_in(json, "farm");
    const Json& seen = member_of(json, "seen");
    if (farm_.empty() || !seen.is_number_integer()) {
      throw InputError(path_, "",
                       "is damaged; remove it to begin anew with what happens from now on");
    }
    seen_ = seen.get<std::int64_t>();
    const auto number = [](const Json& of, const char* key) {
      const Json& member = member_of(of, key);
      return member.is_number_integer() ? member.get<std::int64_t>() : std::int64_t{0};
    };
    for (const Json& p : member_of(json, "pending")) {
      Pending one;
      one.target = text_in(p, "target");
      one.tries = whole_in(p, "tries", 0);
      Notice& n = one.notice;
      n.id = text_in(p, "id");
      n.kind = text_in(p, "kind");
      n.seq = number(p, "seq");
      n.at_ms = number(p, "at_ms");
      n.json = text_in(p, "json");
      for (const auto& [name, value] : member_of(p, "variables").items()) {
        if (value.is_string()) n.variables.emplace_back(name, value.get<std::string>());
      }
      list.push_back(std::move(one));
    }
  }

  const std::string& farm() const { return farm_; }
  std::int64_t seen() const { return seen_; }
  void set_seen(std::int64_t seen) { seen_ = seen; }

  void save() const {
    Json json = {{"farm", farm_}, {"seen", seen_}, {"pending", Json::array()}};
    for (const Pending& p : list) {
      Json variables = Json::object();
      for (const auto& [name, value] : p.notice.variables) variables[name] = value;
      json["pending"].push_back({{"target", p.target},
                                 {"tries", p.tries},
                                 {"id", p.notice.id},
                                 {"kind", p.notice.kind},
                                 {"seq", p.notice.seq},
                                 {"at_ms", p.notice.at_ms},
                                 {"json", p.notice.json},
                                 {"variables", variables}});
    }
    slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(path_)};
    {
      std::ofstream out(part.path, std::ios::binary);
      out << json.dump(1, ' ', false, Json::error_handler_t::replace) << "\n";
      if (!out.flush()) throw DeviceError(errno_message(path_, "can't be written"));
    }
    slicecorr::detail::put_in_place(part, path_);
  }

  std::vector<Pending> list;

 private:
  std::string path_, farm_;
  std::int64_t seen_;
};

}  // namespace

struct Notifier::Parts {
  FarmFolder folder;
  NotifyOptions options;
  std::string config;
  int stop_fd = -1, lock_file = -1;
  std::atomic<bool> sends{false};

  std::mutex mutex;  ///< of what follows
  std::vector<NotifyTarget> targets;
  std::unique_ptr<Outbox> outbox;
  std::map<std::string, std::thread> senders;  ///< by target: one that hangs holds up no other
  std::thread looker;

  bool stopped(double wait_s) const {
    pollfd fd{stop_fd, POLLIN, 0};
    return ::poll(&fd, 1, static_cast<int>(wait_s * 1000)) > 0;
  }

  bool take_lock() {
    if (sends) return true;
    if (::flock(lock_file, LOCK_EX | LOCK_NB) != 0) return false;
    sends = true;
    return true;
  }

  void tell(const std::string& kind, const std::string& text, JobId job = 0) {
    try {
      Queue(folder.database(), *options.clock).add_event(kind, text, job);
    } catch (const Error&) {
      // The message itself matters more than its line in the record.
    }
  }

  static bool wants(const NotifyTarget& target, const std::string& kind) {
    return target.kinds.empty() ||
           std::find(target.kinds.begin(), target.kinds.end(), kind) != target.kinds.end();
  }

  void start_senders() {
    for (const NotifyTarget& t : targets) {
      if (!senders.contains(t.name)) {
        senders.emplace(t.name, std::thread([this, name = t.name] { send_to(name); }));
      }
    }
  }

  /// The record's news into the outbox, on the disk before anything is sent.
  void look(ReadModel& model) {
    const std::int64_t seen = outbox->seen();
    const Notices found = notices_since(model, outbox->farm(), seen);
    if (found.seen == seen) return;
    const std::scoped_lock lock(mutex);
    for (const Notice& n : found.list) {
      for (const NotifyTarget& t : targets) {
        if (wants(t, n.kind)) outbox->list.push_back({n, t.name, 0, 0, false});
      }
    }
    if (outbox->list.size() > kMostPending) {
      outbox->list.erase(outbox->list.begin(),
                         outbox->list.end() - static_cast<std::ptrdiff_t>(kMostPending));
    }
    outbox->set_seen(found.seen);
    // Looked at again after a crash, events that gave nothing give nothing.
    if (!found.list.empty()) outbox->save();
  }

  void look_forever() {
    try {
      while (!take_lock()) {
        if (stopped(options.look_s)) return;
      }
      ReadModel model(folder.database(), *options.clock);
      std::error_code error;
      auto changed = fs::last_write_time(config, error);
      std::string last_trouble;
      do {
        try {
          const auto now = fs::last_write_time(config, error);
          if (now != changed) {
            changed = now;
            std::vector<NotifyTarget> fresh = read_notify_file(config);
            const std::scoped_lock lock(mutex);
            targets = std::move(fresh);
          }
          // Who tells nobody keeps no account.
          if (!targets.empty()) {
            if (!outbox) {
              const std::scoped_lock lock(mutex);
              outbox = std::make_unique<Outbox>(folder.root + "/notify.json",
                                                model.summary().last_event);
            }
            start_senders();
            look(model);
          }
          last_trouble.clear();
        } catch (const Error& e) {
          // Said once; the next look may find the file mended, or room on the disk.
          if (last_trouble != e.what()) tell("notify_failed", last_trouble = e.what());
        }
      } while (!stopped(options.look_s));
    } catch (const std::exception& e) {
      tell("notify_failed", e.what());
    }
  }

  void send_to(const std::string& name) {
    do {
      for (;;) {
        Notice notice;
        NotifyTarget target;
        int tries = 0;
        {
          const std::scoped_lock lock(mutex);
          const auto t = std::find_if(targets.begin(), targets.end(),
                                      [&](const NotifyTarget& x) { return x.name == name; });
          const std::int64_t now = options.clock->steady_ms();
          const auto p =
              std::find_if(outbox->list.begin(), outbox->list.end(), [&](const Pending& x) {
                return x.target == name && !x.on_its_way && x.due_steady_ms <= now;
              });
          if (p == outbox->list.end() || t == targets.end()) break;
          p->on_its_way = true;
          tries = ++p->tries;
          notice = p->notice;
          target = *t;
        }
        const std::string trouble = deliver(target, notice, stop_fd);
        if (!trouble.empty() && stopped(0)) return;  // sent again after the next start
        const bool over = trouble.empty() || tries >= target.most_tries;
        {
          const std::scoped_lock lock(mutex);
          const auto p = std::find_if(
              outbox->list.begin(), outbox->list.end(),
              [&](const Pending& x) { return x.target == name && x.notice.id == notice.id; });
          if (p != outbox->list.end()) {
            if (over) {
              outbox->list.erase(p);
            } else {
              const double delay_s =
                  std::min(kLongestDelayS, options.first_delay_s * std::pow(2.0, tries - 1));
              p->on_its_way = false;
              p->due_steady_ms =
                  options.clock->steady_ms() + static_cast<std::int64_t>(delay_s * 1000);
            }
          }
          try {
            outbox->save();
          } catch (const Error&) {
            // Sent twice at worst, with the same id.
          }
        }
        if (over) {
          tell(trouble.empty() ? "notified" : "notify_failed",
               fmt::format("{} to {}{}{} (id {})", notice.kind, target.name,
                           tries > 1 ? fmt::format(", try {}", tries) : "",
                           trouble.empty() ? "" : ", given up: " + trouble, notice.id));
        } else if (tries == 1) {
          tell("notify_failed", fmt::format("{} to {}: {}; tried again (id {})", notice.kind,
                                            target.name, trouble, notice.id));
        }
        if (stopped(0)) return;
      }
    } while (!stopped(std::min(0.2, options.look_s)));
  }
};

Notifier::Notifier(const FarmFolder& folder, NotifyOptions options)
    : parts_(std::make_unique<Parts>()) {
  Parts& p = *parts_;
  p.folder = folder;
  p.options = options;
  p.config = folder.root + "/notify.toml";
  p.targets = read_notify_file(p.config);
  const std::string lock = folder.root + "/notify.lock";
  p.lock_file = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (p.lock_file < 0) throw DeviceError(errno_message(lock, "can't be made"));
  p.stop_fd = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  p.looker = std::thread([&p] { p.look_forever(); });
}

Notifier::~Notifier() {
  Parts& p = *parts_;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(p.stop_fd, &one, sizeof one);
  p.looker.join();
  for (auto& [name, sender] : p.senders) sender.join();
  ::close(p.stop_fd);
  ::close(p.lock_file);
}

bool Notifier::sends() const { return parts_->sends; }

}  // namespace slicecorr::farm
