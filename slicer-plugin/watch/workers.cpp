// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/workers.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

#include "support/files/errno_message.hpp"
#include "support/process/command.hpp"
#include "support/process/threads.hpp"

namespace slicecorr::post {

namespace {
/// A correction takes as long as it takes.
constexpr std::chrono::hours kNoEnd{24 * 365};
}  // namespace

Workers::Workers(int count, const PostRequest& request, const ExecutionContext& context)
    : context_(context), event_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (event_ < 0) throw DeviceError(detail::errno_message("watching folders", "not possible"));
  std::error_code error;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) throw DeviceError("/proc/self/exe: can't be read: " + error.message());
  command_ = {own.string(), "--quiet", "--threads",
              std::to_string(std::max(1, thread_count(context) / count)), kDoneFlag};
  if (!request.config.path.empty()) command_.push_back("--config=" + request.config.path);
  for (const auto& [name, value] : request.given) {
    command_.push_back(fmt::format("--{}={}", name, value));
  }
  command_.insert(command_.end(), request.part_options.begin(), request.part_options.end());
  command_.emplace_back("--");
  // Signals are for the thread that waits for events: it would sleep on otherwise.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  threads_ = slicecorr::detail::start_threads(count, [this] { work(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

Workers::~Workers() {
  {
    const std::lock_guard lock(mutex_);
    end_ = true;
    waiting_.clear();
  }
  more_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  ::close(event_);
}

void Workers::put(const std::string& path) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(path);
  }
  more_.notify_one();
}

std::vector<Done> Workers::take() {
  std::uint64_t count = 0;
  [[maybe_unused]] const ssize_t n = ::read(event_, &count, sizeof count);
  const std::lock_guard lock(mutex_);
  return std::exchange(done_, {});
}

void Workers::work() {
  for (;;) {
    std::unique_lock lock(mutex_);
    more_.wait(lock, [&] { return end_ || !waiting_.empty(); });
    if (end_) return;
    const std::string path = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    Done done = correct(path);
    lock.lock();
    done_.push_back(std::move(done));
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t n = ::write(event_, &one, sizeof one);
  }
}

Done Workers::correct(const std::string& path) const {
  std::vector<std::string> arguments = command_;
  arguments.push_back(path);
  const auto start = std::chrono::steady_clock::now();
  Command command(arguments, kNoEnd);
  bool asked = false;
  while (!command.wait(std::chrono::milliseconds(200))) {
    if (asked || context_.cancel == nullptr || !*context_.cancel) continue;
    command.ask_to_end();
    asked = true;
  }
  Done done = done_in(command.result(), path);
  if (asked && done.kind == Done::Kind::killed) done.kind = Done::Kind::cancelled;
  const auto took = std::chrono::steady_clock::now() - start;
  done.seconds = std::chrono::duration<double>(took).count();
  return done;
}

}  // namespace slicecorr::post
