// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Servers that are ended at any moment, and clients that are slow or many.
#include "support/http/guarded_server.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "support/http/answers.hpp"
#include "support/http/guard.hpp"

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

constexpr std::size_t kLarge = 64 << 20;  // more than the system keeps of an answer
const std::string kQuick = "GET /quick HTTP/1.1\r\nHost: x\r\n\r\n";

/// A server with an answer that is quick, a large one, one that takes a body, and one that waits until it is allowed to end.
struct Served {
  explicit Served(const ConnectionLimits& limits) : server(limits) {
    server.set_pre_routing_handler([](const httplib::Request& request, httplib::Response&) {
      if (GuardedStream* stream = GuardedStream::current()) {
        stream->allow_body(body_bytes(request, std::int64_t{1} << 30));
      }
      return httplib::Server::HandlerResponse::Unhandled;
    });
    server.Get("/quick", [](const httplib::Request&, httplib::Response& response) {
      send(response, 200, "quick", kTextType);
    });
    server.Get("/large", [](const httplib::Request&, httplib::Response& response) {
      send(response, 200, std::string(kLarge, 'x'), kTextType);
    });
    server.Get("/busy", [this](const httplib::Request&, httplib::Response& response) {
      std::unique_lock lock(mutex);
      ++busy;
      changed.notify_all();
      changed.wait(lock, [this] { return done < allowed; });
      ++done;
      send(response, 200, "done", kTextType);
    });
    server.Put("/body", [](const httplib::Request&, httplib::Response& response,
                           const httplib::ContentReader& body) {
      std::size_t bytes = 0;
      try {
        const bool whole = body([&](const char*, std::size_t size) {
          bytes += size;
          return true;
        });
        if (!whole) GuardedStream::fail_body();
        send(response, 200, std::to_string(bytes), kTextType);
      } catch (const ApiError& e) {
        send_error(response, e.status, e.code, e.what());
      }
    });
    server.set_payload_max_length(std::size_t{1} << 30);
    port = server.bind("127.0.0.1", 0);
    thread = std::thread([this] { server.listen_after_bind(); });
  }
  ~Served() {
    release();
    server.stop_now();
    thread.join();
  }
  void release() { allow(1'000'000); }
  /// So many of those that are busy end.
  void allow(int count) {
    const std::scoped_lock lock(mutex);
    allowed += count;
    changed.notify_all();
  }
  /// Whether so many requests are busy at the same time, in the end.
  bool wait_for_busy(int count) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, std::chrono::seconds(30), [&] { return busy >= count; });
  }

  GuardedServer server;
  int port = 0;
  std::mutex mutex;
  std::condition_variable changed;
  int busy = 0, allowed = 0, done = 0;
  std::thread thread;
};

/// A client whose address is one of loopback.
class Client {
 public:
  explicit Client(int port, const char* from = "127.0.0.1")
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const int small = 4096;  // so that little of an answer is kept here
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    ::inet_pton(AF_INET, from, &address.sin_addr);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    ::inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~Client() { ::close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void send(const std::string& text) const {
    ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL);
  }
  /// The status of the answer; 0: the connection ended without one, -1: nothing came in time.
  int status(int wait_ms = 30'000) const {
    std::string text;
    while (text.size() < 12) {
      pollfd fd{socket_, POLLIN, 0};
      if (::poll(&fd, 1, wait_ms) <= 0) return -1;
      char piece[12];
      const ssize_t n = ::recv(socket_, piece, sizeof piece - text.size(), 0);
      if (n <= 0) return 0;
      text.append(piece, static_cast<std::size_t>(n));
    }
    return std::stoi(text.substr(9));
  }
  /// Whether something of an answer comes, which stays to be read.
  bool hears(int wait_ms = 30'000) const {
    pollfd fd{socket_, POLLIN, 0};
    return ::poll(&fd, 1, wait_ms) == 1;
  }
  /// How many bytes more come until the connection ends.
  std::size_t rest() const {
    std::size_t bytes = 0;
    std::vector<char> piece(1 << 16);
    for (;;) {
      pollfd fd{socket_, POLLIN, 0};
      if (::poll(&fd, 1, 30'000) <= 0) return 0;
      const ssize_t n = ::recv(socket_, piece.data(), piece.size(), 0);
      if (n <= 0) return bytes;
      bytes += static_cast<std::size_t>(n);
    }
  }

 private:
  int socket_;
};

using Clients = std::vector<std::unique_ptr<Client>>;

/// `count` clients that send `text`.
Clients many(const Served& served, int count, const std::string& text,
             const char* from = "127.0.0.1") {
  Clients list;
  for (int i = 0; i < count; ++i) {
    list.push_back(std::make_unique<Client>(served.port, from));
    list.back()->send(text);
  }
  return list;
}

int ask(const Served& served, const std::string& text, const char* from = "127.0.0.1") {
  const Client client(served.port, from);
  client.send(text);
  return client.status();
}

/// They would hold the one thread for a minute.
ConnectionLimits one_thread() {
  ConnectionLimits limits;
  limits.threads = 1;
  limits.request_s = limits.stall_s = 60;
  return limits;
}

TEST(GuardedServerTest, HalfARequestHoldsNoThread) {
  const Served served(one_thread());
  const Clients half = many(served, 100, "GET /quick HT");
  EXPECT_EQ(ask(served, kQuick), 200);
  for (const auto& client : half) {
    client->send("TP/1.1\r\n");
    client->send("Host: x\r\n\r\n");
  }
  for (const auto& client : half) EXPECT_EQ(client->status(), 200);
}

TEST(GuardedServerTest, WhoHasMostConnectionsGivesWay) {
  ConnectionLimits limits = one_thread();
  limits.most_waiting = 8;
  const Served served(limits);
  const Clients many_here = many(served, 7, "GET /quick HT");
  const Clients few = many(served, 3, "GET /quick HT", "127.0.0.2");
  // 10 of 8 came: the two oldest of the address that has most were told to come again.
  EXPECT_EQ(many_here[0]->status(), 503);
  EXPECT_EQ(many_here[1]->status(), 503);
  // And whoever comes from there takes the room of the next one.
  EXPECT_EQ(ask(served, kQuick), 200);
  EXPECT_EQ(many_here[2]->status(), 503);
  for (const auto& client : few) client->send("TP/1.1\r\nHost: x\r\n\r\n");
  for (const auto& client : few) EXPECT_EQ(client->status(), 200);
  for (std::size_t i = 3; i < 7; ++i) {
    many_here[i]->send("TP/1.1\r\nHost: x\r\n\r\n");
    EXPECT_EQ(many_here[i]->status(), 200);
  }
}

TEST(GuardedServerTest, WhoReadsSlowlyHoldsNoThreadThatWorks) {
  const Served served(one_thread());
  const Clients deaf = many(served, 10, "GET /large HTTP/1.1\r\nHost: x\r\n\r\n");
  for (const auto& client : deaf) EXPECT_EQ(client->status(), 200);
  EXPECT_EQ(ask(served, kQuick), 200);
  // Who reads on in the end gets it whole.
  EXPECT_GT(deaf[3]->rest(), kLarge);
}

TEST(GuardedServerTest, WhoSendsSlowlyHoldsNoThreadThatWorks) {
  const Served served(one_thread());
  // Short bodies, and long ones, of which part came.
  Clients slow = many(served, 6, "PUT /body HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n\r\nab");
  for (auto& client :
       many(served, 6, "PUT /body HTTP/1.1\r\nHost: x\r\nContent-Length: 10000000\r\n\r\nab")) {
    slow.push_back(std::move(client));
  }
  EXPECT_EQ(ask(served, kQuick), 200);
  for (const auto& client : slow) client->send("cde");
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(slow[i]->status(), 200);
  EXPECT_EQ(slow[6]->status(100), -1);
}

TEST(GuardedServerTest, OfSlowClientsTheOneThatMovesNothingGivesWay) {
  ConnectionLimits limits = one_thread();
  limits.most_slow = 8;  // of one address four
  const Served served(limits);
  const std::string upload = "PUT /body HTTP/1.1\r\nHost: x\r\nContent-Length: 10000000\r\n\r\n";
  Clients slow;
  for (int i = 0; i < 4; ++i) {
    slow.push_back(std::make_unique<Client>(served.port));
    slow.back()->send(upload);
    // One after the other has its thread.
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  // From elsewhere there is room.
  const Client other(served.port, "127.0.0.2");
  other.send(upload);
  EXPECT_EQ(other.status(1500), -1);
  // The first has sent nothing for more than a second: the fifth of its address has its room.
  const Client fifth(served.port);
  fifth.send(upload);
  EXPECT_EQ(slow[0]->status(), 503);
  // The next one has no better right than those who send.
  std::atomic<bool> end{false};
  std::thread sender([&] {
    while (!end) {
      for (const auto& client : slow) client->send("x");
      fifth.send("x");
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(ask(served, upload), 503);
  end = true;
  sender.join();
  EXPECT_EQ(slow[1]->status(0), -1);
  EXPECT_EQ(other.status(0), -1);
  EXPECT_EQ(ask(served, kQuick), 200);
}

TEST(GuardedServerTest, OneAddressHasNotAllThreads) {
  ConnectionLimits limits = one_thread();
  limits.threads = 4;
  Served served(limits);
  const std::string busy = "GET /busy HTTP/1.1\r\nHost: x\r\n\r\n";
  const Clients here = many(served, 10, busy);
  ASSERT_TRUE(served.wait_for_busy(3));
  // The fourth thread is for others, at once, however many wait.
  EXPECT_EQ(ask(served, kQuick, "127.0.0.2"), 200);
  EXPECT_EQ(served.busy, 3);
  served.release();
  for (const auto& client : here) EXPECT_EQ(client->status(), 200);
}

TEST(GuardedServerTest, AddressesAreServedInTurns) {
  Served served(one_thread());
  const Client first(served.port);
  first.send("GET /busy HTTP/1.1\r\nHost: x\r\n\r\n");
  ASSERT_TRUE(served.wait_for_busy(1));
  const Clients here = many(served, 50, "GET /busy HTTP/1.1\r\nHost: x\r\n\r\n");
  const Client other(served.port, "127.0.0.2");
  other.send(kQuick);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  // All of them wait for the one thread, and each of the fifty would keep it.
  served.allow(1);
  EXPECT_EQ(other.status(), 200);
}

TEST(GuardedServerTest, ToldToComeAgainArrivesWhateverIsSentOn) {
  ConnectionLimits limits = one_thread();
  limits.most_waiting = 1;
  const Served served(limits);
  const Client half(served.port);
  half.send("GET /quick HT");
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  const Client next(served.port);
  next.send("GET /qu");
  ASSERT_TRUE(half.hears());
  // Bytes that nobody reads would have the system reset the connection, and the answer lost.
  for (int i = 0; i < 50; ++i) half.send(std::string(1000, 'x'));
  EXPECT_EQ(half.status(), 503);
}

}  // namespace
}  // namespace slicecorr::http
