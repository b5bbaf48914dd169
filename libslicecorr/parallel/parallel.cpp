// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/parallel.hpp"

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <chrono>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <vector>

#include "slicecorr/error.hpp"

#ifdef __SANITIZE_THREAD__
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#define SLICECORR_NOT_TSAN __attribute__((no_sanitize("thread")))
#else
#define SLICECORR_NOT_TSAN
#endif

namespace slicecorr {
namespace {

/// Tells ThreadSanitizer what it can't see, TBB being built without it: all that came before a loop
/// happens before its bodies, and these before all that comes after. Bodies stay unordered among
/// themselves, so races between them are found.
class LoopOrder {
 public:
#ifdef __SANITIZE_THREAD__
  LoopOrder() { __tsan_release(&before_); }
  ~LoopOrder() { __tsan_acquire(&after_); }
  void body_begins() { __tsan_acquire(&before_); }
  void body_ended() { __tsan_release(&after_); }

 private:
  char before_ = 0, after_ = 0;
#else
  void body_begins() {}
  void body_ended() {}
#endif
};

using Clock = std::chrono::steady_clock;

constexpr auto kProgressInterval = std::chrono::milliseconds(50);

/// One lock for all callbacks, because progress and notices must not come at once either.
/// Recursive, so that a callback may use the library.
std::recursive_mutex& callback_mutex() {
  static std::recursive_mutex mutex;
  return mutex;
}

/// Counts finished items and reports them now and then.
class Progress {
 public:
  Progress(const ExecutionContext& context, std::string_view stage, std::size_t count)
      : context_(context), stage_(stage), count_(count) {
    if (context_.progress) context_.report(stage_, 0);
  }

  void item_done() {
    if (!context_.progress) return;
    ++done_;
    // Never wait for a report that is under way: the next item will bring a newer one.
    std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || Clock::now() - last_ < kProgressInterval) return;
    const std::size_t done = done_;
    if (done == count_) return;  // left to finish()
    context_.report(stage_, static_cast<double>(done) / static_cast<double>(count_));
    last_ = Clock::now();
  }

  void finish() {
    if (context_.progress) context_.report(stage_, 1);
  }

 private:
  const ExecutionContext& context_;
  std::string_view stage_;
  std::size_t count_;
  std::atomic<std::size_t> done_{0};
  std::mutex mutex_;
  Clock::time_point last_ = Clock::now();
};

/// As many of these threads as the system gives. TBB ends the program where one of its own can't be
/// started, so that is tried before; where fewer are to be had, TBB is told of it for good.
int obtainable(int wanted) {
  static std::mutex mutex;
  static int tried = 1, known = 1;
  static std::optional<tbb::global_control> limit;
  const std::scoped_lock lock(mutex);
  if (wanted <= tried) return std::min(wanted, known);
  std::vector<std::thread> threads;
  std::mutex waiting;
  {
    const std::scoped_lock all_at_once(waiting);
    const auto wait = [&] { const std::scoped_lock until_all_are_there(waiting); };
    try {
      while (known + static_cast<int>(threads.size()) < wanted) threads.emplace_back(wait);
    } catch (const std::system_error&) {
    }
  }
  for (std::thread& t : threads) t.join();
  tried = wanted;
  known += static_cast<int>(threads.size());
  if (known < wanted) {
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(known));
  }
  return known;
}

}  // namespace

void ExecutionContext::check_cancelled() const {
  if (cancel != nullptr && cancel->load(std::memory_order_relaxed)) throw Cancelled();
}

void ExecutionContext::tell(const std::string& text) const {
  if (!notice) return;
  const std::scoped_lock lock(callback_mutex());
  notice(text);
}

void ExecutionContext::report(std::string_view stage, double fraction) const {
  if (!progress) return;
  const std::scoped_lock lock(callback_mutex());
  progress(stage, fraction);
}

int thread_count(const ExecutionContext& context) {
  return context.threads > 0 ? context.threads
                             : std::max(1, tbb::this_task_arena::max_concurrency());
}

void parallel_for(const ExecutionContext& context, std::string_view stage, std::size_t count,
                  const std::function<void(std::size_t)>& body) {
  context.check_cancelled();
  Progress progress(context, stage, count);
  const auto item = [&](std::size_t i) {
    context.check_cancelled();
    body(i);
    progress.item_done();
  };
  const int threads = count <= 1 ? 1 : obtainable(thread_count(context));
  if (threads == 1) {
    for (std::size_t i = 0; i < count; ++i) item(i);
  } else {
    // TBB starts no more workers than there are cores unless told so.
    std::optional<tbb::global_control> more_workers;
    if (threads > tbb::info::default_concurrency()) {
      more_workers.emplace(tbb::global_control::max_allowed_parallelism,
                           static_cast<std::size_t>(threads));
    }
    tbb::task_arena arena(threads);
    // Own context, not the caller's: an exception here cancels this loop only, until it is
    // rethrown.
    tbb::task_group_context context(tbb::task_group_context::isolated);
    LoopOrder order;
    arena.execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, count, 1),
          // Its captures and its range reach a worker through TBB, unseen: not checked for races.
          [&](const tbb::blocked_range<std::size_t>& range) SLICECORR_NOT_TSAN {
            struct Body {
              LoopOrder& order;
              explicit Body(LoopOrder& o) : order(o) { order.body_begins(); }
              ~Body() { order.body_ended(); }
            } body_order(order);
            for (std::size_t i = range.begin(); i != range.end(); ++i) item(i);
          },
          tbb::simple_partitioner(), context);
    });
  }
  progress.finish();
}

}  // namespace slicecorr
