// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/watch.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <map>
#include <optional>
#include <set>

#include "post/files.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/verdict.hpp"
#include "support/files/errno_message.hpp"
#include "support/text/ascii.hpp"
#include "watch/commands.hpp"
#include "watch/folders.hpp"
#include "watch/text_beside.hpp"
#include "watch/workers.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

using SteadyTime = std::chrono::steady_clock;

constexpr const char* kNotifier = "notify-send";

/// What somebody sees who reads nothing else.
std::string title_of(const Done& done) {
  if (done.verdict == name_of(Outcome::fails))
    return "Slices corrected, but will not print as designed";
  if (done.verdict == name_of(Outcome::look)) return "Slices corrected; look at some places";
  return "Slices corrected";
}

SteadyTime::duration seconds(double s) {
  return std::chrono::duration_cast<SteadyTime::duration>(std::chrono::duration<double>(s));
}

/// Whether a program has the file open for writing: the kernel then gives no read lease. Where it
/// gives none for other reasons (someone else's file, network), nothing is known.
bool is_being_written(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) return false;
  const bool refused = ::fcntl(file, F_SETLEASE, F_RDLCK) != 0 && errno == EAGAIN;
  ::close(file);  // and with it the lease
  return refused;
}

/// Ends of names that archives have, in lower case.
std::vector<std::string> endings() {
  std::vector<std::string> all;
  for (const FormatInfo& format : archive_formats()) {
    all.insert(all.end(), format.endings.begin(), format.endings.end());
  }
  std::erase(all, "");
  return all;
}

/// Gives a file a name that is no archive's, and gives that; empty where it can't be.
std::string set_aside(const std::string& path) {
  for (int n = 1; n < 100; ++n) {
    const std::string to = path + (n == 1 ? ".set-aside" : fmt::format("-{}.set-aside", n));
    if (::renameat2(AT_FDCWD, path.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) {
      return fs::path(to).filename().string();
    }
    if (errno != EEXIST) return {};
  }
  return {};
}

class Watcher {
 public:
  Watcher(const WatchOptions& options, const PostRequest& request, Log& log,
          const ExecutionContext& context)
      : options_(options), log_(log), context_(context), workers_(options.jobs, request, context) {}

  WatchResult run() {
    // From here on signals only come while waiting, so none is missed between looking and waiting.
    sigset_t stop, before;
    sigemptyset(&stop);
    sigaddset(&stop, SIGINT);
    sigaddset(&stop, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &stop, &before);
    ::signal(SIGIO, SIG_IGN);  // a lease that is asked back while we have it
    for (const std::string& folder : options_.folders) add_root(folder);
    while (!idle()) {
      context_.check_cancelled();
      wait(before);
      context_.check_cancelled();
      for (const Folders::FileEvent& event : folders_.take()) handle(event);
      for (const Done& done : workers_.take()) finished(done);
      look_at_due();
      reap();
    }
    wait_for_notifications();
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    return result_;
  }

 private:
  /// A file that is not settled: it waits for its time, or is in work.
  struct Candidate {
    FileIdentity seen;
    SteadyTime::time_point due;
    SteadyTime::time_point give_up;  ///< when it is no whole archive until then
    bool in_work = false;
    bool touched = false;  ///< written again while in work
  };

  SteadyTime::duration patience() const {
    return seconds(std::max(options_.settle_s, options_.patience_s));
  }
  bool idle() const { return options_.once && candidates_.empty(); }

  void wait(const sigset_t& mask) {
    std::optional<SteadyTime::time_point> next;
    for (const auto& [path, c] : candidates_) {
      if (!c.in_work && (!next || c.due < *next)) next = c.due;
    }
    // Nothing else tells when a program that was started ends.
    const auto soon = SteadyTime::now() + std::chrono::milliseconds(200);
    if (commands_.any() && (!next || soon < *next)) next = soon;
    timespec timeout{};
    if (next) {
      const auto left = std::max(SteadyTime::duration::zero(), *next - SteadyTime::now());
      const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(left).count();
      timeout.tv_sec = static_cast<time_t>(ns / 1000000000);
      timeout.tv_nsec = static_cast<long>(ns % 1000000000);
    }
    std::array<pollfd, 2> files{
        {{folders_.descriptor(), POLLIN, 0}, {workers_.descriptor(), POLLIN, 0}}};
    if (::ppoll(files.data(), files.size(), next ? &timeout : nullptr, &mask) < 0 &&
        errno != EINTR) {
      throw DeviceError(detail::errno_message("watching folders", "failed"));
    }
  }

  void add_root(const std::string& given) {
    std::error_code ec;
    const fs::path folder = fs::canonical(given, ec);
    if (ec || !fs::is_directory(folder, ec)) {
      throw InputError(given, "", "is not a folder that can be watched");
    }
    if (!folders_.add(folder.string())) {
      throw InputError(given, "", "is watched by another slicecorr-post");
    }
    const std::size_t before = candidates_.size();
    enter(folder.string(), options_.new_only);
    const std::size_t found = candidates_.size() - before;
    log_.add({"watching", folder.string(),
              options_.new_only ? std::string("what is there already is left alone")
              : found == 1      ? std::string("1 archive is there to be looked at")
                                : fmt::format("{} archives are there to be looked at", found),
              -1, -1});
  }

  /// What is in a watched folder already. `half_done_only`: nothing but what a kill cut short.
  void enter(const std::string& folder, bool half_done_only) {
    for (const std::string& name : WorkFolder::remove_stale(folder)) {
      log_.add({"resumed", folder + "/" + name, "a run that had it was cut short", -1, -1});
      consider(folder + "/" + name);
    }
    std::error_code ec;
    for (const auto& entry : fs::directory_iterator(folder, ec)) {
      std::error_code gone;
      if (entry.is_directory(gone) && !entry.is_symlink(gone)) {
        enter_below(entry.path().string(), half_done_only);
      } else if (!half_done_only) {
        consider(entry.path().string());
      }
    }
  }

  void enter_below(const std::string& folder, bool half_done_only) {
    if (!options_.recursive || fs::path(folder).filename().string().front() == '.') return;
    try {
      if (folders_.add(folder)) {
        enter(folder, half_done_only);
      } else if (fs::exists(folder)) {
        log_.add({"skipped", folder, "is watched by another slicecorr-post", -1, -1, true});
      }
    } catch (const DeviceError& e) {
      log_.add({"skipped", folder, e.what(), -1, -1, true});
    }
  }

  bool is_archive_name(const std::string& path) const {
    const std::string name = lower_case(fs::path(path).filename().string());
    if (name.empty() || name.front() == '.') return false;
    return std::any_of(endings_.begin(), endings_.end(), [&](const std::string& ending) {
      return name.size() > ending.size() && name.ends_with(ending);
    });
  }

  /// A file that was written, or may have been.
  void consider(const std::string& path) {
    if (!is_archive_name(path)) return;
    const auto identity = identity_of(path);
    if (!identity) return;
    const auto known = settled_.find(path);
    if (known != settled_.end() && known->second == *identity) return;
    Candidate& c = candidates_[path];
    if (c.in_work) {
      c.touched = true;
      return;
    }
    c.seen = *identity;
    c.due = SteadyTime::now() + seconds(options_.settle_s);
    c.give_up = SteadyTime::now() + patience();
  }

  void handle(const Folders::FileEvent& event) {
    using Kind = Folders::FileEvent::Kind;
    switch (event.kind) {
      case Kind::written:
        consider(event.path);
        break;
      case Kind::gone:
        settled_.erase(event.path);
        break;
      case Kind::new_folder:
        enter_below(event.path, false);
        break;
      case Kind::lost:
        for (const std::string& folder : folders_.paths()) enter(folder, false);
        break;
      case Kind::unwatched:
        log_.add({"unwatched", event.path, "the folder is gone", -1, -1, true});
        if (folders_.count() == 0) throw DeviceError("all watched folders are gone");
        break;
    }
  }

  void look_at_due() {
    const auto now = SteadyTime::now();
    for (auto it = candidates_.begin(); it != candidates_.end();) {
      Candidate& c = it->second;
      if (c.in_work || c.due > now) {
        ++it;
        continue;
      }
      const auto identity = identity_of(it->first);
      if (!identity) {
        it = candidates_.erase(it);
        continue;
      }
      if (*identity != c.seen) {
        // Still growing.
        c.seen = *identity;
        c.due = now + seconds(options_.settle_s);
        c.give_up = now + patience();
      } else if (is_being_written(it->first)) {
        // Its closing will be told.
        it = candidates_.erase(it);
        continue;
      } else {
        c.in_work = true;
        workers_.put(it->first);
      }
      ++it;
    }
  }

  void finished(const Done& done) {
    using Kind = Done::Kind;
    const auto it = candidates_.find(done.path);
    const Candidate c = it->second;
    candidates_.erase(it);
    if (done.kind == Kind::cancelled) return;
    if (done.kind == Kind::corrected) {
      // What a slicer may have put there since is not this file.
      settled_[done.path] = done.made;
      ++result_.corrected;
      log_.add({"corrected", done.path, done.message, done.seconds, 0, false, done.verdict});
      tell(options_.on_done, title_of(done), done.path, done.message);
      if (c.touched) consider(done.path);
      return;
    }
    const auto identity = identity_of(done.path);
    if (!identity) return;
    if (*identity != c.seen) {
      consider(done.path);
      return;
    }
    // Perhaps its writer closes it between pieces, or another run is about to end.
    const bool later = done.kind == Kind::not_readable && SteadyTime::now() < c.give_up;
    if (later || done.kind == Kind::in_use) {
      Candidate again = c;
      again.in_work = again.touched = false;
      again.due = later ? c.give_up : SteadyTime::now() + patience();
      candidates_[done.path] = again;
      return;
    }
    if (done.kind == Kind::killed) {
      // Met again, after a restart too, it would do the same again.
      failed(done.code);
      const std::string kept = set_aside(done.path);
      if (kept.empty()) settled_[done.path] = c.seen;
      const std::string why = done.message + (kept.empty() ? "; it can't be set aside"
                                                           : "; it is set aside as " + kept);
      log_.add({"failed", done.path, why, done.seconds, done.code, true});
      tell(options_.on_fail, "Slices not corrected", done.path, why);
      return;
    }
    settled_[done.path] = c.seen;
    if (done.kind == Kind::left_alone) {
      log_.add({"left-alone", done.path, done.message, -1, 0});
    } else if (done.kind != Kind::already) {
      failed(done.code);
      // The line names the file already.
      const std::string prefix = done.path + ": ";
      const std::string why =
          done.message.starts_with(prefix) ? done.message.substr(prefix.size()) : done.message;
      log_.add({"failed", done.path, why, done.seconds, done.code, true});
      tell(options_.on_fail, "Slices not corrected", done.path, why);
    }
  }

  void failed(int code) {
    const bool alike = result_.failed == 0 || code == result_.code;
    result_.code = alike ? code : cli::kInput;
    ++result_.failed;
  }

  /// A moment, so that one that fails is told: other programs may run for long.
  void wait_for_notifications() {
    const auto most = SteadyTime::now() + std::chrono::seconds(5);
    while (commands_.runs(kNotifier) && SteadyTime::now() < most) {
      ::poll(nullptr, 0, 10);
      reap();
    }
  }

  /// A notification needs a desktop, which a service may not have.
  void reap() {
    for (const Commands::Failed& failed : commands_.reap()) {
      log_.add({"not-told", failed.about, failed.program + " failed", -1, -1, true});
    }
  }

  void tell(const std::string& program, const std::string& title, const std::string& path,
            const std::string& message) {
    if (options_.text_beside) {
      const std::string problem = write_text_beside(path, title, message);
      if (!problem.empty()) log_.add({"not-told", path, problem, -1, -1, true});
    }
    const auto start = [&](const std::vector<std::string>& command) {
      const std::string problem = commands_.start(command, path);
      if (problem.empty()) return;
      log_.add({"not-told", path, fmt::format("{} can't be run: {}", command[0], problem), -1, -1,
                true});
    };
    if (!program.empty()) start({program, path});
    if (options_.notify) {
      std::string text = fs::path(path).filename().string();
      if (!message.empty()) text += "\n" + message;
      start({kNotifier, "--app-name=slicecorr", "--", title, text});
    }
  }

  const WatchOptions& options_;
  Log& log_;
  const ExecutionContext& context_;
  const std::vector<std::string> endings_ = endings();
  Folders folders_;
  Commands commands_;
  std::map<std::string, Candidate> candidates_;
  /// Files that need nothing more, as they were then: corrected, or failed and not changed since.
  std::map<std::string, FileIdentity> settled_;
  WatchResult result_;
  Workers workers_;  // ends first
};

}  // namespace

WatchResult watch(const WatchOptions& options, const PostRequest& request, Log& log,
                  const ExecutionContext& context) {
  return Watcher(options, request, log, context).run();
}

}  // namespace slicecorr::post
