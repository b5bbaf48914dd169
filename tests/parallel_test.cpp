// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/parallel.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

TEST(Parallel, CallsEveryItemOnce) {
  for (const int threads : {0, 1, 2, 8}) {
    for (const std::size_t count : {0, 1, 2, 7, 1000}) {
      ExecutionContext context;
      context.threads = threads;
      std::vector<std::atomic<int>> calls(count);
      parallel_for(context, "test", count, [&](std::size_t i) { ++calls[i]; });
      for (const auto& c : calls) EXPECT_EQ(c, 1);
    }
  }
}

TEST(Parallel, UsesNoMoreThreadsThanAsked) {
  for (const int threads : {1, 2, 3}) {
    ExecutionContext context;
    context.threads = threads;
    std::atomic<int> running{0}, most{0};
    parallel_for(context, "test", 60, [&](std::size_t) {
      const int now = ++running;
      int seen = most;
      while (seen < now && !most.compare_exchange_weak(seen, now)) {
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      --running;
    });
    EXPECT_LE(most, threads);
    EXPECT_EQ(thread_count(context), threads);
  }
  EXPECT_GE(thread_count(ExecutionContext{}), 1);
}

TEST(Parallel, RethrowsTheExceptionOfABody) {
  for (const int threads : {1, 4}) {
    ExecutionContext context;
    context.threads = threads;
    std::atomic<int> calls{0};
    const auto body = [&](std::size_t i) {
      ++calls;
      if (i == 3) throw InputError("three");
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    };
    try {
      parallel_for(context, "test", 10000, body);
      FAIL() << "nothing thrown";
    } catch (const InputError& error) {
      EXPECT_STREQ(error.what(), "three");
    }
    EXPECT_LT(calls, 10000);
  }
}

TEST(Parallel, StopsWhenCancelled) {
  for (const int threads : {1, 4}) {
    std::atomic<bool> cancel{false};
    std::atomic<int> calls{0};
    ExecutionContext context;
    context.threads = threads;
    context.cancel = &cancel;
    EXPECT_THROW(parallel_for(context, "test", 100000,
                              [&](std::size_t) {
                                if (++calls == 20) cancel = true;
                              }),
                 Cancelled);
    EXPECT_LT(calls, 20 + threads);
    EXPECT_THROW(parallel_for(context, "test", 0, [](std::size_t) {}), Cancelled);
    EXPECT_THROW(context.check_cancelled(), Cancelled);
  }
}

TEST(Parallel, ProgressNeverFallsAndIsNeverCalledTwiceAtOnce) {
  for (const int threads : {1, 8}) {
    std::vector<double> fractions;
    std::atomic<int> inside{0};
    ExecutionContext context;
    context.threads = threads;
    context.progress = [&](std::string_view stage, double fraction) {
      EXPECT_EQ(++inside, 1);
      EXPECT_EQ(stage, "test");
      fractions.push_back(fraction);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      --inside;
    };
    context.notice = [&](const std::string&) {
      EXPECT_EQ(++inside, 1);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      --inside;
    };
    parallel_for(context, "test", 300, [&](std::size_t i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(4));
      if (i % 50 == 0) context.tell("note");
    });
    ASSERT_GE(fractions.size(), 3u);
    EXPECT_LE(fractions.size(), 100u);
    EXPECT_EQ(fractions.front(), 0);
    EXPECT_EQ(fractions.back(), 1);
    for (std::size_t i = 1; i < fractions.size(); ++i) EXPECT_LE(fractions[i - 1], fractions[i]);
  }
}

TEST(Parallel, LoopsMayBeNested) {
  ExecutionContext context;
  context.threads = 4;
  std::atomic<int> calls{0};
  parallel_for(context, "outer", 10, [&](std::size_t) {
    parallel_for(context, "inner", 10, [&](std::size_t) { ++calls; });
  });
  EXPECT_EQ(calls, 100);
}

}  // namespace
}  // namespace slicecorr
