// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Two bridges that begin to drive one machine at much the same time, again and again: never do both
// go on.
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <random>
#include <set>
#include <thread>

#include "slicecorr/bridge/link.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Time of several threads of which one runs at a time, that which is due first: the same race each
/// time.
class SharedTime {
 public:
  explicit SharedTime(int threads) : due_s_(static_cast<std::size_t>(threads), 0) {}
  /// Until it is the turn of `who`, at `time_s`.
  void sleep(std::size_t who, double time_s) {
    std::unique_lock lock(mutex_);
    due_s_[who] = std::max(time_s, now_s_);
    asleep_.insert(who);
    changed_.notify_all();
    changed_.wait(lock, [&] { return asleep_.size() == due_s_.size() - gone_ && next() == who; });
    asleep_.erase(who);
    now_s_ = due_s_[who];
  }
  void leave(std::size_t who) {
    const std::scoped_lock lock(mutex_);
    ++gone_;
    due_s_[who] = 1e300;
    changed_.notify_all();
  }
  double now_s() {
    const std::scoped_lock lock(mutex_);
    return now_s_;
  }

 private:
  std::size_t next() const {
    return static_cast<std::size_t>(std::min_element(due_s_.begin(), due_s_.end()) -
                                    due_s_.begin());
  }
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<double> due_s_;
  std::set<std::size_t> asleep_;
  std::size_t gone_ = 0;
  double now_s_ = 0;
};

/// Sleeps longer than asked now and then, as a busy computer does.
class Clock final : public BridgeClock {
 public:
  Clock(SharedTime& time, std::size_t who, unsigned seed) : time_(time), who_(who), random_(seed) {}
  double now_s() const override { return time_.now_s(); }
  void sleep_until(double time_s) override {
    const double late_s = random_() % 4 == 0 ? 0.03 * (random_() % 1000) / 1000 : 0.0005;
    time_.sleep(who_, time_s + late_s);
  }

 private:
  SharedTime& time_;
  std::size_t who_;
  std::minstd_rand random_;
};

struct Wire {
  std::uint16_t echo = 0;
};

/// Writes and reads at once (function code 23), or one after the other with time between them.
class WireLink final : public Link {
 public:
  WireLink(Wire& wire, BridgeClock& clock, bool at_once)
      : wire_(wire), clock_(clock), at_once_(at_once) {}
  std::optional<Status> exchange(const SetPoints& out) override {
    wire_.echo = out.sequence;
    sent.insert(out.sequence);
    lit = lit || out.blue_share > 0 || out.uv_mw_cm2 > 0 || out.command != Command::off;
    if (!at_once_) clock_.sleep_until(clock_.now_s() + 0.001);
    return look();
  }
  bool write_alone(const SetPoints&, Alone) override { return false; }
  std::optional<Status> look() override {
    Status status;
    status.sequence_echo = wire_.echo;
    return status;
  }
  std::string last_error() const override { return {}; }
  std::set<std::uint16_t> sent;
  bool lit = false;

 private:
  Wire& wire_;
  BridgeClock& clock_;
  bool at_once_;
};

TEST(BridgeRace, TwoNeverDriveOneMachine) {
  std::mt19937 random(54);
  int one = 0, none = 0;
  for (int round = 0; round < 1000; ++round) {
    Machine machine;
    machine.limits.cycle_s = 0.02;
    Wire wire;
    SharedTime time(2);
    const bool at_once = round % 2 == 0;
    int went_on = 0;
    std::vector<std::thread> bridges;
    // What one of them has begun it goes on with: the other must see that.
    const double offset_s = 0.3 * (random() % 1000) / 1000;
    for (std::size_t who = 0; who < 2; ++who) {
      const unsigned seed = random();
      const auto first = static_cast<std::uint16_t>(1 + random() % 0xffff);
      bridges.emplace_back([&, who, seed, first] {
        Clock clock(time, who, seed);
        WireLink link(wire, clock, at_once);
        time.sleep(who, who == 0 ? 0 : offset_s);
        try {
          take_over(link, clock, machine, first);
          ++went_on;
          SetPoints out;
          for (std::uint16_t n = 0; n < 40; ++n) {
            out.sequence = static_cast<std::uint16_t>(first + 20 + n);
            link.exchange(out);
            clock.sleep_until(clock.now_s() + machine.limits.cycle_s);
          }
        } catch (const InputError&) {
        }
        EXPECT_FALSE(link.lit);
        time.leave(who);
      });
    }
    for (std::thread& bridge : bridges) bridge.join();
    EXPECT_LE(went_on, 1) << "round " << round << ", " << offset_s << " s apart";
    ++(went_on == 1 ? one : none);
  }
  // Neither that both always refuse.
  EXPECT_GT(one, 50);
  EXPECT_EQ(one + none, 1000);
}

TEST(BridgeRace, AMachineByWhateverName) {
  RegisterMap map;
  map.port = 15021;
  const MachineLock lock(map);
  const auto refused = [](const RegisterMap& other) {
    try {
      const MachineLock again(other);
      return false;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find("another bridge"), std::string::npos);
      return true;
    }
  };
  EXPECT_TRUE(refused(map));
  RegisterMap other = map;
  other.host = "localhost";
  EXPECT_TRUE(refused(other));
  other.host = "127.0.0.2";
  EXPECT_TRUE(refused(other)) << "all of them may be this computer";
  other = map;
  other.port = 15022;
  EXPECT_FALSE(refused(other));
  other = map;
  other.unit = 2;
  EXPECT_FALSE(refused(other)) << "another machine behind one gateway";
  other.transport = Transport::rtu;
  other.device = "/dev/null";
  EXPECT_FALSE(refused(other));
  const MachineLock line(other);
  RegisterMap linked = other;
  linked.device = "/dev/../dev/null";
  linked.unit = 3;
  EXPECT_TRUE(refused(linked)) << "a line has one master";
}

}  // namespace
}  // namespace slicecorr::bridge
