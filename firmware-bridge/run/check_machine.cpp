// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A controller on the bench, driven through every command without light.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Longer than it takes any controller to do what it is told, besides moving.
constexpr double kSoonS = 1, kHoldS = 0.3;
constexpr double kMostWayUm = 1000, kCalmSpeedUmS = 500;
/// Of a stage that turns.
constexpr double kMostWayDeg = 90, kCalmSpeedDegS = 30;
/// A stage without an encoder stands still below this share of the speed that it was told.
constexpr double kStill = 0.02;

using Found = MachineCheck::Found;

class Bench {
 public:
  Bench(const LinkMaker& connect, BridgeClock& clock, const Machine& machine,
        const std::function<void(const MachineCheck&)>& tell)
      : connect_(connect), clock_(clock), machine_(machine), tell_(tell), link_(connect()) {
    out_.watchdog_s = machine.limits.watchdog_s;
    out_.acceleration_um_s2 = machine.stage.acceleration_um_s2;
    out_.speed_um_s = speed();
  }

  /// False: what comes after makes no sense.
  bool all() {
    if (!begins()) return false;
    const bool taken = take_off();
    lamps_alone();
    if (!taken) return false;
    if (!machine_.has_encoder()) to_index();
    run_and_hold();
    moves();
    stops_alone();
    watchdog("heartbeat", "a heartbeat that stands still switches it off", [&] { stand_still(); });
    watchdog("cable", "a connection that is lost switches it off", [&] {
      link_.reset();
      clock_.sleep_until(clock_.now_s() + watchdog_within_s());
      link_ = connect_();
    });
    remembers();
    say("at the end", exchange_until(Command::off, kSoonS, is(MachineState::idle)), "off, idle");
    return true;
  }

 private:
  using Test = std::function<bool(const Status&)>;

  static Test is(MachineState state) {
    return [state](const Status& s) { return s.state == state; };
  }
  double speed() const {
    const double fastest = machine_.stage.max_speed_um_s;
    const double calm =
        machine_.stage.turns() ? kCalmSpeedDegS * machine_.stage.um_per_deg : kCalmSpeedUmS;
    return fastest > 0 ? std::min(calm, fastest) : calm;
  }
  std::string place(double um) const {
    return machine_.stage.turns() ? fmt::format("{:.2f}°", um / machine_.stage.um_per_deg)
                                  : fmt::format("{:.3f} mm", um * 1e-3);
  }
  double watchdog_within_s() const { return 2 * machine_.limits.watchdog_s + kSoonS; }

  void say(const std::string& what, bool good, const std::string& detail) {
    tell_({good ? Found::good : Found::bad, what,
           good ? detail : detail + ": " + (trouble_.empty() ? in_words() : trouble_)});
    trouble_.clear();
  }
  void leave(const std::string& what, const std::string& why) {
    tell_({Found::not_tested, what, why});
  }
  std::string in_words() const {
    constexpr const char* states[] = {"idle", "running", "stopped", "fault"};
    if (!status_) return "the machine " + (link_ ? link_->last_error() : "was not asked");
    return fmt::format("it is {}, its stage at {}, sequence number {} given back, {} sent",
                       states[static_cast<int>(status_->state)], place(status_->stage_um),
                       status_->sequence_echo, out_.sequence);
  }

  /// What the machine says; without an encoder the stage's place is what its speed adds up to.
  void take(const Status& status) {
    const double now_s = clock_.now_s();
    const double speed_um_s = status.stage_speed_um_s.value_or(0);
    added_um_ += (speed_um_s + last_speed_um_s_) / 2 * (now_s - taken_s_);
    last_speed_um_s_ = speed_um_s;
    taken_s_ = now_s;
    status_ = status;
    if (!machine_.has_encoder()) status_->stage_um = added_um_;
  }

  bool exchange(bool beats = true) {
    out_.sequence = next_sequence(out_.sequence);
    if (beats) ++out_.heartbeat;
    const auto answer = link_->exchange(out_);
    if (answer) {
      take(*answer);
      const std::string shines = lit(machine_, *answer);
      if (!shines.empty()) shone_ = shines;
    } else {
      trouble_ = "the machine " + link_->last_error();
    }
    clock_.sleep_until(clock_.now_s() + machine_.limits.cycle_s);
    return answer.has_value();
  }
  /// Until an answer to what was sent fits.
  bool exchange_until(Command command, double seconds, const Test& fits) {
    out_.command = command;
    const double until_s = clock_.now_s() + seconds;
    do {
      if (exchange() && status_->sequence_echo == out_.sequence && fits(*status_)) {
        trouble_.clear();
        return true;
      }
    } while (clock_.now_s() < until_s);
    return false;
  }
  /// As long, every answer fits; one that is lost counts for nothing.
  bool exchange_while(double seconds, const Test& fits) {
    const double until_s = clock_.now_s() + seconds;
    while (clock_.now_s() < until_s) {
      if (exchange() && !fits(*status_)) return false;
    }
    return true;
  }

  bool begins() {
    try {
      take(check_alone(*link_, clock_, machine_));
    } catch (const Error& e) {
      trouble_ = e.what();
      say("answers", false, "its status can be read, and nobody else drives it");
      return false;
    }
    say("answers", true, "its status can be read, and nobody else drives it");
    trouble_ = impossible(machine_, *status_);
    const bool possible = trouble_.empty();
    say("measures", possible, "stage, lamps and temperature are said to be what they can be");
    trouble_ = interlocks(machine_, *status_);
    const bool closed = trouble_.empty();
    say("interlocks", closed, "door, stop button and temperature say that all is well");
    trouble_ = lit(machine_, *status_);
    const bool dark = trouble_.empty();
    say("dark", dark, "lamps are measured dark");
    return possible && closed && dark;
  }

  bool take_off() {
    const bool taken = exchange_until(Command::off, kSoonS, [](const Status&) { return true; });
    say("sequence", taken, "it gives back the sequence number of what it took over");
    if (status_->state != MachineState::idle) {
      exchange_until(Command::reset, kSoonS, is(MachineState::idle));
    }
    say("off", exchange_until(Command::off, kSoonS, is(MachineState::idle)), "off makes it idle");
    // The same set-points twice.
    const bool again = link_->exchange(out_).has_value() &&
                       exchange_until(Command::off, kSoonS, is(MachineState::idle));
    say("twice", again, "the same set-points twice do no harm");
    return taken;
  }

  void lamps_alone() {
    const bool written = link_->write_alone(out_, Alone::lamps);
    if (!written) trouble_ = "it " + link_->last_error();
    say("lamps alone", written, "registers of the lamps can be written by themselves");
  }

  /// Where angles count from: 0 of whatever the machine counts.
  void to_index() {
    out_.target_um = 0;
    out_.speed_um_s = machine_.stage.max_speed_um_s;
    const double start_s = clock_.now_s();
    exchange_until(Command::run, machine_.stage.travel_um / out_.speed_um_s + kSoonS,
                   [&](const Status& s) {
                     return clock_.now_s() > start_s + kSoonS &&
                            std::abs(s.stage_speed_um_s.value_or(0)) < kStill * out_.speed_um_s;
                   });
    out_.speed_um_s = speed();
    added_um_ = 0;
    take(*status_);
  }

  void run_and_hold() {
    out_.target_um = status_->stage_um;
    say("run", exchange_until(Command::run, kSoonS, is(MachineState::running)), "run makes it run");
    const double at_um = status_->stage_um, near_um = machine_.stage.tolerance_um;
    say("holds",
        exchange_while(kHoldS,
                       [&](const Status& s) {
                         return s.state == MachineState::running &&
                                std::abs(s.stage_um - at_um) <= near_um;
                       }),
        "told to be where it is, its stage stays there");
  }

  bool go_to(double target_um) {
    out_.target_um = target_um;
    const double way_um = std::abs(target_um - status_->stage_um);
    const double seconds =
        1.5 * (way_um / speed() + 2 * speed() / std::max(out_.acceleration_um_s2, 1.0)) + 2;
    return exchange_until(Command::run, seconds, [&](const Status& s) {
      return std::abs(s.stage_um - target_um) <= machine_.stage.tolerance_um;
    });
  }

  void moves() {
    const double from_um = status_->stage_um;
    const double most_um =
        machine_.stage.turns() ? kMostWayDeg * machine_.stage.um_per_deg : kMostWayUm;
    const double way_um = std::min(most_um, machine_.stage.travel_um / 4);
    const double to_um =
        from_um + way_um <= machine_.stage.travel_um ? from_um + way_um : from_um - way_um;
    const bool went = go_to(to_um);
    say("moves", went, "its stage goes to " + place(to_um));
    if (!went) return;
    // Back, and stopped on half the way.
    out_.target_um = from_um;
    const double half_um = (from_um + to_um) / 2;
    exchange_until(Command::run, 30, [&](const Status& s) {
      return std::abs(s.stage_um - to_um) >= std::abs(half_um - to_um);
    });
    const bool stopped = exchange_until(Command::stop, kSoonS, is(MachineState::stopped));
    say("stop", stopped, "stop makes it stopped");
    const double brakes_s = 1.5 * speed() / std::max(out_.acceleration_um_s2, 1.0);
    exchange_while(brakes_s + kHoldS, [](const Status&) { return true; });
    const double rest_um = status_->stage_um;
    const bool rests = exchange_while(kHoldS, [&](const Status& s) {
      return std::abs(s.stage_um - rest_um) <= std::max(1.0, machine_.stage.tolerance_um / 4);
    });
    const bool short_of = std::abs(rest_um - from_um) > machine_.stage.tolerance_um;
    if (rests && !short_of) trouble_ = "it went on to where it was going";
    say("stands", rests && short_of, "and its stage stands, where it came to");
    say("off after stop", exchange_until(Command::off, kSoonS, is(MachineState::idle)),
        "off makes a stopped machine idle");
    out_.target_um = status_->stage_um;
    const bool runs = exchange_until(Command::run, kSoonS, is(MachineState::running));
    say("back", runs && go_to(from_um), "and it goes back");
  }

  void stops_alone() {
    out_.target_um = status_->stage_um;
    exchange_until(Command::run, kSoonS, is(MachineState::running));
    out_.command = Command::stop;
    const bool written = link_->write_alone(out_, Alone::command);
    if (!written) trouble_ = "it " + link_->last_error();
    bool stopped = false;
    const double until_s = clock_.now_s() + machine_.limits.watchdog_s / 2;
    while (written && !stopped && clock_.now_s() < until_s) {
      clock_.sleep_until(clock_.now_s() + machine_.limits.cycle_s);
      if (const auto seen = link_->look()) take(*seen);
      stopped = status_->state == MachineState::stopped;
    }
    say("stop alone", stopped,
        "a stop that is written by itself counts at once, without a sequence number");
    exchange_until(Command::off, kSoonS, is(MachineState::idle));
  }

  void stand_still() {
    const double begin_s = clock_.now_s(), until_s = begin_s + watchdog_within_s();
    while (clock_.now_s() < until_s) {
      if (exchange(false) && status_->state != MachineState::running) return;
    }
  }

  void watchdog(const std::string& what, const std::string& text,
                const std::function<void()>& neglect) {
    out_.target_um = status_->stage_um;
    const bool ran = exchange_until(Command::run, kSoonS, is(MachineState::running)) &&
                     exchange_while(1.5 * machine_.limits.watchdog_s, is(MachineState::running));
    say(what + ", fed", ran, "it runs as long as the heartbeat changes");
    neglect();
    trouble_.clear();
    for (int i = 0; i < 100; ++i) {
      if (const auto seen = link_->look()) {
        take(*seen);
        break;
      }
      clock_.sleep_until(clock_.now_s() + machine_.limits.cycle_s);
    }
    const bool off = status_->state != MachineState::running;
    say(what, ran && off, text);
    if (!off) {
      exchange_until(Command::off, kSoonS, is(MachineState::idle));
      return;
    }
    if (machine_.modbus->read.contains(Signal::watchdog_tripped)) {
      say(what + ", said", status_->watchdog_tripped, "and it says so (watchdog_tripped)");
    }
    out_.command = Command::run;
    say(what + ", stays off",
        exchange_while(kHoldS, [](const Status& s) { return s.state != MachineState::running; }),
        "it does not run again before it is reset");
    const bool reset = exchange_until(Command::reset, kSoonS, is(MachineState::idle)) &&
                       exchange_until(Command::off, kSoonS, is(MachineState::idle));
    say(what + ", reset", reset && !status_->watchdog_tripped, "reset makes it idle");
  }

  void remembers() {
    if (machine_.modbus->write.contains(Signal::job)) {
      const auto kept = [](bool job) {
        return [job](const Status& s) { return s.job_kept == job; };
      };
      out_.job = true;
      const bool on = exchange_until(Command::off, kSoonS, kept(true));
      out_.job = false;
      say("job", on && exchange_until(Command::reset, kSoonS, kept(false)),
          "it keeps the job that is written");
      exchange_until(Command::off, kSoonS, is(MachineState::idle));
    } else {
      leave(
          "job",
          "the map has no job and no job_kept: the place of the stage must tell whether a part is "
          "on the machine");
    }
    trouble_ = shone_;
    say("no light", shone_.empty(), "no lamp was measured lit in all of it");
    leave("lamps by off, stop, watchdog and interlocks",
          "needs light: with a photodiode, and a cable that is pulled");
    leave("door, stop button, thermal cut-out", "by hand: open, press and heat each while it runs");
  }

  const LinkMaker& connect_;
  BridgeClock& clock_;
  const Machine& machine_;
  const std::function<void(const MachineCheck&)>& tell_;
  std::unique_ptr<Link> link_;
  SetPoints out_;
  std::optional<Status> status_;
  std::string trouble_, shone_;
  double added_um_ = 0, last_speed_um_s_ = 0, taken_s_ = 0;
};

}  // namespace

bool check_machine(const LinkMaker& connect, BridgeClock& clock, const Machine& machine,
                   const std::function<void(const MachineCheck&)>& tell) {
  bool good = true;
  const std::function<void(const MachineCheck&)> counting = [&](const MachineCheck& check) {
    good = good && check.found != Found::bad;
    tell(check);
  };
  return Bench(connect, clock, machine, counting).all() && good;
}

}  // namespace slicecorr::bridge
