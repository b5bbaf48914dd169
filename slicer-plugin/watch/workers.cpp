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
#include <new>

#include "programs/common/program.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::post {

Workers::Workers(int count, const PostRequest& request, const ExecutionContext& context)
    : request_(request), context_(context), event_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (event_ < 0) throw DeviceError(detail::errno_message("watching folders", "not possible"));
  context_.threads = std::max(1, thread_count(context) / count);
  context_.progress = nullptr;
  // Signals are for the thread that waits for events: it would sleep on otherwise.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  for (int i = 0; i < count; ++i) threads_.emplace_back([this] { work(); });
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
  using Kind = Done::Kind;
  const auto start = std::chrono::steady_clock::now();
  Done done{path, Kind::failed, cli::kDefect, {}, 0, {}};
  const auto became = [&](Kind kind, int code, const std::string& message) {
    done.kind = kind;
    done.code = code;
    done.message = message;
  };
  try {
    ExecutionContext context = context_;
    std::string remarks;
    context.notice = [&](const std::string& text) { remarks += "; " + text; };
    const PostOutcome outcome = correct_file(path, request_, context);
    if (outcome.left_alone) {
      became(Kind::left_alone, cli::kDone, outcome.rule);
    } else {
      done.made = outcome.identity;
      const Correction& c = outcome.correction;
      const auto mean = [](const Prediction& p) {
        return p.height_error_um.count() ? fmt::format("{:.3g}", p.height_error_um.mean()) : "-";
      };
      became(Kind::corrected, cli::kDone,
             fmt::format("{} slices, {}; mean height error {} um, before {} um{}{}",
                         c.info.grid.layers,
                         in_one_line(outcome.setup.printer, outcome.setup.resin, *c.info.process),
                         mean(c.after), c.before ? mean(*c.before) : "-",
                         outcome.rule.empty() ? "" : "; " + outcome.rule, remarks));
    }
  } catch (const AlreadyCorrected&) {
    became(Kind::already, cli::kDone, {});
  } catch (const InUse& e) {
    became(Kind::in_use, cli::kInput, e.what());
  } catch (const NotReadable& e) {
    became(Kind::not_readable, cli::kInput, e.what());
  } catch (const Cancelled&) {
    became(Kind::cancelled, cli::kInterrupted, {});
  } catch (const InputError& e) {
    became(Kind::failed, cli::kInput, e.what());
  } catch (const InfeasibleError& e) {
    became(Kind::failed, cli::kInfeasible, e.what());
  } catch (const DeviceError& e) {
    became(Kind::failed, cli::kDevice, e.what());
  } catch (const std::bad_alloc&) {
    became(Kind::failed, cli::kDevice, "out of memory");
  } catch (const std::exception& e) {
    became(Kind::failed, cli::kDefect, fmt::format("a defect of the program: {}", e.what()));
  }
  const auto took = std::chrono::steady_clock::now() - start;
  done.seconds = std::chrono::duration<double>(took).count();
  return done;
}

}  // namespace slicecorr::post
