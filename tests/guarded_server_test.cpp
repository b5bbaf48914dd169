// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Servers that are ended at any moment.
#include "support/http/guarded_server.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <future>

namespace slicecorr::http {
namespace {

TEST(GuardedServerTest, AStopCountsWhenItComesBeforeItListens) {
  GuardedServer server({});
  ASSERT_GT(server.bind("127.0.0.1", 0), 0);
  server.stop_now();
  std::future<void> listening = std::async(std::launch::async, [&] { server.listen_after_bind(); });
  // It would wait for ever.
  ASSERT_EQ(listening.wait_for(std::chrono::seconds(30)), std::future_status::ready);
}

TEST(GuardedServerTest, AStopCountsWhileItListens) {
  GuardedServer server({});
  ASSERT_GT(server.bind("127.0.0.1", 0), 0);
  std::future<void> listening = std::async(std::launch::async, [&] { server.listen_after_bind(); });
  server.stop_now();
  ASSERT_EQ(listening.wait_for(std::chrono::seconds(30)), std::future_status::ready);
}

}  // namespace
}  // namespace slicecorr::http
