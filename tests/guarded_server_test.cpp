// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Servers that are ended at any moment.
#include "support/http/guarded_server.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <future>
#include <vector>

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

TEST(GuardedServerTest, ManyMayComeAtOnce) {
  GuardedServer server({});
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(server.bind("127.0.0.1", 0)));
  // Nobody accepts: those for whom there is no room would never be connected.
  std::vector<pollfd> sockets;
  for (int i = 0; i < 300; ++i) {
    sockets.push_back(
        {::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), POLLOUT, 0});
    // It goes on by itself.
    static_cast<void>(
        ::connect(sockets.back().fd, reinterpret_cast<const sockaddr*>(&address), sizeof address));
  }
  for (pollfd& s : sockets) {
    EXPECT_EQ(::poll(&s, 1, 10'000), 1);
    ::close(s.fd);
    if (s.revents == 0) break;
  }
}

}  // namespace
}  // namespace slicecorr::http
