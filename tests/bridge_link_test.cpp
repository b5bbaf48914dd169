// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The wire to a machine that answers as a test wants it to: what is sent, in which order, for how
// long, and what is believed.

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <thread>

#include "sim_fixture.hpp"
#include "slicecorr/bridge/link.hpp"

namespace slicecorr::bridge {
namespace {

using slicecorr::test::kSmallMachine;
using slicecorr::test::machine_of;
using slicecorr::test::replaced;
using testing::ElementsAre;
using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

/// Runs of registers: 4-9 motion, 40-43 lamps, 60-62 command, watchdog and heartbeat, 80 sequence.
const std::string kGaps = [] {
  std::string text = kSmallMachine;
  for (const auto& [what, by] : std::vector<std::pair<std::string, std::string>>{
           {"exchange = \"fc23\"", "exchange = \"fc16+fc3\""},
           {"response_timeout_s = 0.04", "response_timeout_s = 0.03"},
           {"sequence = { address = 0 }", "sequence = { address = 80 }"},
           {"heartbeat = { address = 1 }", "heartbeat = { address = 62 }"},
           {"command = { address = 2 }", "command = { address = 60 }"},
           {"watchdog_s = { address = 3,", "watchdog_s = { address = 61,"},
           {"blue_share = { address = 10,", "blue_share = { address = 40,"},
           {"uv_mw_cm2 = { address = 12,", "uv_mw_cm2 = { address = 42,"},
           {"frame = { address = 14, type = \"i32\" }\n", ""}}) {
    text = replaced(text, what, by);
  }
  return text;
}();

int word(const Bytes& b, std::size_t at) { return b[at] << 8 | b[at + 1]; }

/// A request, and what the machine does with it.
struct Asked {
  int function = 0, address = 0, count = 0;
  Bytes values;  ///< that are written
};
struct Reply {
  Bytes pdu;  ///< empty: none
  int transaction_by = 0, protocol = 0, length_by = 0, unit_by = 0;
  bool close = false;
  double each_byte_s = 0;
};

/// Listens on a free port; every request goes through `answer`.
class Peer {
 public:
  explicit Peer(std::function<Reply(const Asked&, const Bytes& right)> answer)
      : answer_(std::move(answer)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof a;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&a), size) != 0) std::abort();
    ::listen(listener_, 32);
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&a), &size);
    port = ntohs(a.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  ~Peer() {
    ending_ = true;
    thread_.join();
    ::close(listener_);
  }

  std::vector<Asked> asked() {
    const std::scoped_lock lock(mutex_);
    return asked_;
  }
  void forget() {
    const std::scoped_lock lock(mutex_);
    asked_.clear();
  }
  int port = 0;
  std::atomic<int> connections{0};

 private:
  /// What a machine that is well answers: idle, dark, and the sequence number that it was given.
  Bytes right(const Asked& a) {
    if (a.function == 16 || a.function == 23) {
      for (int i = 0; i < a.count; ++i) {
        const int value = word(a.values, static_cast<std::size_t>(2 * i));
        if (a.address + i == 80 || (a.function == 23 && a.address + i == 0)) echo_ = value;
      }
    }
    if (a.function == 16) {
      return {16, static_cast<std::uint8_t>(a.address >> 8), static_cast<std::uint8_t>(a.address),
              static_cast<std::uint8_t>(a.count >> 8), static_cast<std::uint8_t>(a.count)};
    }
    Bytes pdu{static_cast<std::uint8_t>(a.function), 28};
    pdu.resize(30);
    pdu[2] = static_cast<std::uint8_t>(echo_ >> 8);
    pdu[3] = static_cast<std::uint8_t>(echo_);
    return pdu;
  }

  void serve() {
    std::vector<pollfd> all{{listener_, POLLIN, 0}};
    while (!ending_) {
      ::poll(all.data(), all.size(), 5);
      if ((all[0].revents & POLLIN) != 0) {
        all.push_back({::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC), POLLIN, 0});
        const int on = 1;
        ::setsockopt(all.back().fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        ++connections;
      }
      for (std::size_t i = 1; i < all.size();) {
        if (all[i].revents != 0 && !one(all[i].fd)) {
          ::close(all[i].fd);
          all.erase(all.begin() + static_cast<std::ptrdiff_t>(i));
        } else {
          ++i;
        }
      }
    }
    for (std::size_t i = 1; i < all.size(); ++i) ::close(all[i].fd);
  }

  bool one(int s) {
    Bytes head(7);
    if (::recv(s, head.data(), head.size(), MSG_WAITALL) != 7) return false;
    Bytes pdu(static_cast<std::size_t>(word(head, 4)) - 1);
    if (::recv(s, pdu.data(), pdu.size(), MSG_WAITALL) != static_cast<ssize_t>(pdu.size())) {
      return false;
    }
    Asked a;
    a.function = pdu[0];
    const std::size_t at = a.function == 23 ? 5 : 1;
    a.address = word(pdu, at);
    a.count = word(pdu, at + 2);
    if (a.function == 16 || a.function == 23) {
      a.values.assign(pdu.begin() + static_cast<std::ptrdiff_t>(at) + 5, pdu.end());
    }
    Reply reply;
    {
      const std::scoped_lock lock(mutex_);
      asked_.push_back(a);
      reply = answer_(a, right(a));
    }
    if (!reply.pdu.empty()) {
      const int transaction = word(head, 0) + reply.transaction_by,
                length = static_cast<int>(reply.pdu.size()) + 1 + reply.length_by;
      Bytes frame;
      for (const int value : {transaction, reply.protocol, length}) {
        frame.push_back(static_cast<std::uint8_t>(value >> 8));
        frame.push_back(static_cast<std::uint8_t>(value));
      }
      frame.push_back(static_cast<std::uint8_t>(head[6] + reply.unit_by));
      frame.insert(frame.end(), reply.pdu.begin(), reply.pdu.end());
      if (reply.each_byte_s > 0) {
        for (const std::uint8_t byte : frame) {
          if (::send(s, &byte, 1, MSG_NOSIGNAL) != 1) return false;
          std::this_thread::sleep_for(std::chrono::duration<double>(reply.each_byte_s));
        }
      } else if (::send(s, frame.data(), frame.size(), MSG_NOSIGNAL) !=
                 static_cast<ssize_t>(frame.size())) {
        return false;
      }
    }
    return !reply.close;
  }

  std::function<Reply(const Asked&, const Bytes&)> answer_;
  int listener_ = -1, echo_ = 0;
  std::atomic<bool> ending_{false};
  std::mutex mutex_;
  std::vector<Asked> asked_;
  std::thread thread_;
};

Bytes exception(const Asked& a, int code) {
  return {static_cast<std::uint8_t>(a.function | 0x80), static_cast<std::uint8_t>(code)};
}

struct Wire {
  explicit Wire(const std::string& text, int port) : machine(machine_of(text)) {
    machine.modbus->port = port;
    // A test's computer is busy; where time matters the test says so.
    machine.limits.response_timeout_s = 2;
    link = make_modbus_link(*machine.modbus, machine.limits);
  }
  Machine machine;
  std::unique_ptr<Link> link;
};

SetPoints bright(std::uint16_t sequence) {
  SetPoints s;
  s.sequence = s.heartbeat = sequence;
  s.command = Command::run;
  s.blue_share = 1;
  s.uv_mw_cm2 = 100;
  return s;
}

std::vector<int> addresses(const std::vector<Asked>& asked) {
  std::vector<int> all;
  for (const Asked& a : asked) {
    if (a.function != 3) all.push_back(a.address);
  }
  return all;
}

TEST(BridgeLink, InLockstepABusyComputerLosesNoExchange) {
  // Answers that take five response timeouts, now and then: in real time they are lost, in lockstep
  // no time passes.
  std::atomic<bool> silent{false}, busy{true};
  Peer peer([&](const Asked&, const Bytes& right) {
    if (silent) return Reply{};
    if (busy.exchange(false)) std::this_thread::sleep_for(std::chrono::milliseconds(200));
    return Reply{right};
  });
  Wire w(kGaps, peer.port);
  w.machine.limits.response_timeout_s = 0.04;
  const auto link = [&](bool lockstep) {
    return make_modbus_link(*w.machine.modbus, w.machine.limits, lockstep);
  };
  EXPECT_FALSE(link(false)->look());
  const auto patient = link(true);
  for (int n = 0; n < 3; ++n) {
    busy = true;
    EXPECT_TRUE(patient->look()) << n;
    EXPECT_TRUE(patient->look()) << n;
  }
  // A machine that says nothing at all is waited for once only.
  silent = true;
  EXPECT_FALSE(patient->look());
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_FALSE(patient->look());
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(8));
  silent = false;
  w.machine.limits.response_timeout_s = 2;
  EXPECT_TRUE(link(true)->look());
}

TEST(BridgeLink, LampsGoFirstAndARunThatFailsKeepsNoOtherFromBeingSent) {
  Peer peer([](const Asked& a, const Bytes& right) {
    return Reply{a.address == 4 ? exception(a, 4) : right};
  });
  Wire w(kGaps, peer.port);
  EXPECT_FALSE(w.link->exchange(bright(7)));
  EXPECT_THAT(w.link->last_error(), AllOf(HasSubstr("exception 4"), HasSubstr("registers 4 to 9")));
  EXPECT_THAT(addresses(peer.asked()), ElementsAre(40, 4, 60, 80));
  // An exception is an answer: the connection stays.
  EXPECT_FALSE(w.link->exchange(bright(8)));
  EXPECT_EQ(peer.connections, 1);
}

TEST(BridgeLink, LampsAreWrittenAlone) {
  // In a map of one run, where that run is refused, and function 16 is not known either.
  for (const bool only_23 : {false, true}) {
    Peer peer([&](const Asked& a, const Bytes& right) {
      if (only_23 && a.function == 16) return Reply{exception(a, 1)};
      return Reply{a.count > 4 ? exception(a, 3) : right};
    });
    Wire w(kSmallMachine, peer.port);
    SetPoints off = bright(9);
    EXPECT_FALSE(w.link->exchange(off));
    off.blue_share = off.uv_mw_cm2 = 0;
    peer.forget();
    EXPECT_TRUE(w.link->write_alone(off, Alone::lamps)) << w.link->last_error();
    const auto asked = peer.asked();
    EXPECT_EQ(asked.back().address, 10);
    EXPECT_EQ(asked.back().count, 4);
    EXPECT_EQ(asked.back().values, Bytes(8, 0));
    EXPECT_EQ(asked.back().function, only_23 ? 23 : 16);
    EXPECT_TRUE(w.link->write_alone(off, Alone::command));
    EXPECT_FALSE(w.link->exchange(off)) << "and the rest is refused all the same";
  }
  // Lamps that lie apart are two requests; one that is refused is not confirmed, the other is sent.
  Peer apart([](const Asked& a, const Bytes& right) {
    return Reply{a.address == 42 ? exception(a, 4) : right};
  });
  Wire w(replaced(replaced(kGaps, "blue_share = { address = 40,", "blue_share = { address = 50,"),
                  "response_timeout_s = 0.03", "response_timeout_s = 0.02"),
         apart.port);
  EXPECT_FALSE(w.link->write_alone(SetPoints{}, Alone::lamps));
  EXPECT_THAT(addresses(apart.asked()), ElementsAre(42, 50));
}

TEST(BridgeLink, AMachineThatClosesAfterEachAnswerIsDriven) {
  Peer peer([](const Asked&, const Bytes& right) {
    Reply r{right};
    r.close = true;
    return r;
  });
  Wire w(kGaps, peer.port);
  for (std::uint16_t n = 1; n <= 20; ++n) {
    const auto status = w.link->exchange(bright(n));
    ASSERT_TRUE(status) << w.link->last_error();
    EXPECT_EQ(status->sequence_echo, n);
  }
  EXPECT_TRUE(w.link->write_alone(SetPoints{}, Alone::lamps));
}

TEST(BridgeLink, AnExchangeThatFailedFeedsNoWatchdog) {
  std::atomic<bool> refuses{false};
  Peer peer([&](const Asked& a, const Bytes& right) {
    return Reply{refuses && a.address == 4 ? exception(a, 4) : right};
  });
  Wire w(kGaps, peer.port);
  ASSERT_TRUE(w.link->exchange(bright(1)));
  refuses = true;
  peer.forget();
  EXPECT_FALSE(w.link->exchange(bright(2)));
  for (const Asked& a : peer.asked()) {
    if (a.address == 60) {
      EXPECT_EQ(word(a.values, 4), 1) << "the heartbeat of the last that was good";
    }
  }
}

TEST(BridgeLink, TheTimeoutIsThatOfAWholeAnswer) {
  Peer peer([](const Asked&, const Bytes& right) {
    Reply r{right};
    r.each_byte_s = 0.03;
    return r;
  });
  Wire w(kSmallMachine, peer.port);
  // Far above what a busy computer delays a first byte by, far below the 1.1 s that the 37 bytes of the
  // answer take, each within the timeout.
  w.machine.limits.response_timeout_s = 0.35;
  w.link = make_modbus_link(*w.machine.modbus, w.machine.limits);
  using Time = std::chrono::steady_clock;
  const auto begin = Time::now();
  EXPECT_FALSE(w.link->exchange(bright(1)));
  const double took_s = std::chrono::duration<double>(Time::now() - begin).count();
  EXPECT_GE(took_s, 0.35);
  EXPECT_LT(took_s, 1.1);
  EXPECT_THAT(w.link->last_error(), HasSubstr("bytes of an answer in time"));
}

TEST(BridgeLink, AnswersOfOthersAreNotTaken) {
  const std::vector<std::pair<const char*, Reply>> wrong{
      {"answers request", {{}, 1, 0, 0, 0, false, 0}},
      {"protocol 7", {{}, 0, 7, 0, 0, false, 0}},
      {"expected 31", {{}, 0, 0, 4, 0, false, 0}},
      {"expected 31", {{}, 0, 0, -2, 0, false, 0}},
      {"unit 3 answers, asked was 1", {{}, 0, 0, 0, 2, false, 0}}};
  for (const auto& [why, how] : wrong) {
    SCOPED_TRACE(why);
    std::atomic<bool> badly{true};
    Peer peer([&, how = how](const Asked&, const Bytes& right) {
      Reply r = badly ? how : Reply{};
      r.pdu = right;
      return r;
    });
    Wire w(kSmallMachine, peer.port);
    EXPECT_FALSE(w.link->exchange(bright(1)));
    EXPECT_THAT(w.link->last_error(), AllOf(HasSubstr("answers wrongly"), HasSubstr(why)));
    badly = false;
    const auto status = w.link->exchange(bright(2));
    ASSERT_TRUE(status) << w.link->last_error();
    EXPECT_EQ(status->sequence_echo, 2);
  }
}

TEST(BridgeLink, ConnectsAgainAtGrowingIntervals) {
  std::atomic<bool> badly{true};
  Peer peer([&](const Asked&, const Bytes& right) {
    Reply r{right};
    r.transaction_by = badly ? 1 : 0;
    return r;
  });
  Wire w(kSmallMachine, peer.port);
  for (std::uint16_t n = 1; n <= 200; ++n) EXPECT_FALSE(w.link->exchange(bright(n)));
  // 0, 0, 1, 2, 4, 8 exchanges between them, then 16.
  EXPECT_LE(peer.connections, 18);
  EXPECT_GE(peer.connections, 12);
  // Lamps don't wait for the next attempt.
  badly = false;
  EXPECT_TRUE(w.link->write_alone(SetPoints{}, Alone::lamps)) << w.link->last_error();
  EXPECT_TRUE(w.link->exchange(SetPoints{}));
}

TEST(BridgeLink, SaysWhatTheMachineDid) {
  Peer peer([](const Asked&, const Bytes& right) {
    Bytes unknown = right;
    unknown[5] = 77;
    return Reply{unknown};
  });
  Wire w(kSmallMachine, peer.port);
  EXPECT_EQ(w.link->last_error(), "was asked nothing");
  EXPECT_FALSE(w.link->exchange(bright(1)));
  EXPECT_THAT(w.link->last_error(), HasSubstr("answers, but register 101: 77 is no state"));
}

TEST(BridgeLink, TimesCountEachRequest) {
  // 4 to write and one to read, twice, 0.04 s each: 0.4 s.
  const auto with = [](const char* timeout, const char* beat, const char* watchdog) {
    std::string text = replaced(kGaps, "response_timeout_s = 0.03", timeout);
    text = replaced(text, "heartbeat_timeout_s = 0.3", beat);
    return replaced(text, "watchdog_s = 0.3\nmax", std::string(watchdog) + "\nmax");
  };
  EXPECT_NO_THROW(machine_of(
      with("response_timeout_s = 0.04", "heartbeat_timeout_s = 0.4", "watchdog_s = 0.4")));
  for (const auto& text :
       {with("response_timeout_s = 0.04", "heartbeat_timeout_s = 0.39", "watchdog_s = 0.4"),
        with("response_timeout_s = 0.04", "heartbeat_timeout_s = 0.4", "watchdog_s = 0.39")}) {
    try {
      machine_of(text);
      ADD_FAILURE() << "taken";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("two exchanges of 5 requests"));
    }
  }
}

}  // namespace
}  // namespace slicecorr::bridge
