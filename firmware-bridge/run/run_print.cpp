// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "record/left_json.hpp"
#include "run/control_socket.hpp"
#include "run/images.hpp"
#include "run/priority.hpp"
#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

constexpr int kControlPriority = 50;
constexpr double kTellEveryS = 0.25;

/// Tells the user how far the print is, from a thread of its own: a terminal that hangs must not
/// hang the print.
class Teller {
 public:
  Teller(const ExecutionContext& context, int frames)
      : context_(context), frames_(std::max(frames, 1)) {
    if (context_.progress) thread_ = std::thread([this] { work(); });
  }
  ~Teller() {
    {
      const std::scoped_lock lock(mutex_);
      ending_ = true;
    }
    wake_.notify_all();
    if (thread_.joinable()) thread_.join();
  }
  void shown(int frames) { shown_ = frames; }

 private:
  void work() {
    std::unique_lock lock(mutex_);
    while (!ending_) {
      wake_.wait_for(lock, std::chrono::milliseconds(500));
      context_.report("print", 1.0 * shown_ / frames_);
    }
  }

  const ExecutionContext& context_;
  const int frames_;
  std::atomic<int> shown_{0};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ending_ = false;
  std::thread thread_;
};

/// Set-points that do nothing, with a look at the machine after each: more than enough for two
/// bridges to find each other.
constexpr int kFirstExchanges = 10;
/// Sent numbers of which one may come back.
constexpr int kOwnNumbers = 4;

std::uint16_t by_chance() {
  std::random_device device;
  return static_cast<std::uint16_t>(1 + device() % 0xffff);
}
/// The number with which the print goes on after the first exchanges.
std::uint16_t after_looks(std::uint16_t first) {
  for (int i = 0; i < kFirstExchanges; ++i) first = next_sequence(first);
  return first;
}

[[noreturn]] void somebody_else(const Machine& machine) {
  throw InputError(machine.printer.name, "",
                   "takes set-points from somebody else: another bridge is at work with it");
}

class Run {
 public:
  Run(const FrameSource& source, const PrintPlan& plan, const Machine& machine, Link& link,
      FrameSink& sink, FrameSink* uv_sink, BridgeClock& clock, const StateFolder& folder,
      const RunOptions& options, const ExecutionContext& context)
      : plan_(plan),
        link_(link),
        sink_(sink),
        uv_sink_(uv_sink),
        clock_(clock),
        folder_(folder),
        options_(options),
        teller_(context, source.frames()),
        machine_(machine),
        first_sequence_(options.lockstep ? std::uint16_t{1} : by_chance()),
        cycle_s_(machine.limits.cycle_s),
        ring_(source, machine.limits.ring_frames, options.threads) {
    ring_.wait_ready(0, machine.limits.ring_frames);
    journal_.emplace(folder.file("journal.jsonl"), plan.um_per_deg);
    frame_log_.emplace(folder.file("frames.csv"), plan.start_um, plan.turns(), uv_sink != nullptr);
    controller_.emplace(plan, machine, options.dry_run, after_looks(first_sequence_));
    facts_ = facts_of(plan, machine);
    facts_.stack = options.stack;
    facts_.display = sink.describe();
    if (uv_sink) facts_.uv_display = uv_sink->describe();
    facts_.dry_run = options.dry_run;
    socket_.emplace(folder, counter_, [this](const PrintState& state, std::uint64_t asked) {
      // `threads_` is written before the first state is offered.
      PrintAround around;
      around.ready_frames = ring_.ready();
      around.asked = asked;
      around.threads = threads_;
      return state_json(facts_, state, around);
    });
    images_.emplace(ring_, sink, clock, news_, options.lockstep, false);
    if (uv_sink) uv_images_.emplace(ring_, *uv_sink, clock, news_, options.lockstep, true);
  }

  Ending go() {
    // What came before may have taken minutes: frames, and displays that were waited for.
    if (!options_.lockstep) take_over(link_, clock_, machine_, first_sequence_);
    journal_->add({clock_.now_s(), kJournalBegin, options_.stack, controller_->frame(),
                   controller_->stage_um(), facts_json(facts_)},
                  true);
    journal_->flush();
    if (const auto trouble = journal_->trouble(); !trouble.empty()) throw DeviceError(trouble);
    if (!options_.lockstep) {
      threads_ = raise_priority(kControlPriority) + ", " + lock_memory();
      note("threads", threads_);
    }
    next_s_ = clock_.now_s();
    for (int broken = 0;;) {
      try {
        if (cycle()) break;
      } catch (const std::exception& e) {
        // Once the controller gives the order; a controller that fails can't.
        if (++broken > 1) {
          give_order(e.what());
          break;
        }
        controller_->fail(Fault::defect, e.what());
      } catch (...) {
        give_order("something that is no error");
        break;
      }
    }
    if (!options_.lockstep) lower_priority();
    images_->end();
    if (uv_images_) uv_images_->end();
    if (controller_->fault() != Fault::none || broken_order_) {
      sink_.black();
      if (uv_sink_) uv_sink_->black();
    }
    return end();
  }

 private:
  void note(const std::string& what, const std::string& detail) {
    journal_->add({clock_.now_s(), what, detail, controller_->frame(), controller_->stage_um()},
                  true);
  }

  bool cycle() {
    const double now = clock_.now_s();
    if (now > next_s_ + cycle_s_) ++missed_;
    if (options_.stop != nullptr && *options_.stop) stop("stopped by the user");
    if (options_.lockstep) {
      images_->tick(now);
      if (uv_images_) uv_images_->tick(now);
    }
    const ImageNews news = news_.take();
    for (const FrameReport& report : news.reports) controller_->shown(report);
    if (news.fault != Fault::none) controller_->fail(news.fault, news.detail);
    serve();
    const ControlStep step = controller_->step(answer_, now);
    last_sent_ = step.set_points;
    if (step.show) images_->show(*step.show, step.show_at_s);
    if (step.show_uv && uv_images_) uv_images_->show(*step.show_uv, step.show_uv_at_s);
    for (const PrintEvent& event : step.events) journal_->add(event, true);
    for (const FrameRecord& record : step.records) frame_log_->add(record);
    if (step.lamps_alone || step.command_alone) {
      const bool lamps = step.lamps_alone && link_.write_alone(step.set_points, Alone::lamps);
      const bool command = step.command_alone && link_.write_alone(step.set_points, Alone::command);
      controller_->written_alone(lamps, command);
    }
    const double asked_s = clock_.now_s();
    auto status = link_.exchange(step.set_points);
    const bool taken = status.has_value();
    double read_s = asked_s;
    if (!taken && controller_->failing()) {
      // What is measured is known all the same where set-points are refused.
      read_s = clock_.now_s();
      status = link_.look();
    }
    if (status) {
      const double half_s = (clock_.now_s() - read_s) / 2;
      answer_ = Answer{*status, read_s + half_s, half_s, !taken};
    } else {
      answer_.reset();
    }
    if (!taken) {
      if (!controller_->failing()) lost_by_ = link_.last_error();
      // Only the first of a row: the journal is for people.
      if (!silent_) {
        journal_->add(
            {now, "no answer", link_.last_error(), controller_->frame(), controller_->stage_um()},
            false);
      }
    }
    silent_ = !taken;
    tell(now);
    if (step.finished) return true;
    next_s_ += cycle_s_;
    const double after = clock_.now_s();
    if (after > next_s_ + cycle_s_) {
      next_s_ = after;  // what is lost is lost
      ++missed_;
    }
    if (options_.lockstep) show_due();
    clock_.sleep_until(next_s_);
    return false;
  }

  /// Lockstep: what is due before the next cycle, in the order of its times; blue first where they
  /// are the same.
  void show_due() {
    const double never_s = 1e300;
    for (;;) {
      const double blue_s = images_->next_s().value_or(never_s);
      const double uv_s = uv_images_ ? uv_images_->next_s().value_or(never_s) : never_s;
      if (std::min(blue_s, uv_s) >= next_s_) return;
      (uv_s < blue_s ? *uv_images_ : *images_).show_next();
    }
  }

  void stop(const std::string& why) {
    if (stopped_) return;
    stopped_ = true;
    controller_->fail(Fault::stopped_by_user, why);
  }

  void serve() {
    const auto request = counter_.take();
    if (!request) return;
    PauseAnswer answer;
    if (*request == "pause") {
      answer = controller_->pause();
    } else if (*request == "resume") {
      answer = controller_->resume();
    } else {
      stop("stopped by printbridge stop");
      answer = {true, "lamps go off, the stage stops"};
    }
    journal_->add({clock_.now_s(), *request, (answer.accepted ? "" : "refused: ") + answer.why,
                   controller_->frame(), controller_->stage_um()},
                  true);
    nlohmann::ordered_json json;
    json["accepted"] = answer.accepted;
    json["why"] = answer.why;
    counter_.answer(json.dump());
  }

  PrintState state(double now) {
    PrintState state = state_of(*controller_, now, missed_);
    if (state.frames_shown > newest_) newest_at_s_ = now;
    newest_ = state.frames_shown;
    state.newest_at_s = newest_at_s_;
    state.told = told_;
    return state;
  }

  /// Whoever asks or watches: numbers only, their text is made by the thread that is asked.
  void tell(double now) {
    if (now < told_s_ + kTellEveryS) return;
    PrintState state = this->state(now);
    ++state.told;
    if (!counter_.offer(state)) return;  // with the next cycle
    ++told_;
    told_s_ = now;
    teller_.shown(controller_->frames_shown());
  }

  /// The order of a fault without the controller.
  void give_order(const std::string& what) noexcept {
    broken_order_ = true;
    broken_detail_ = what;
    SetPoints out = last_sent_;
    // Each by itself, so that one that throws keeps no other from being tried.
    const auto attempt = [](const auto& what) {
      try {
        return static_cast<bool>(what());
      } catch (...) {
        return false;
      }
    };
    const auto send = [&](Alone alone) {
      for (int i = 0; i < 3; ++i) {
        out.sequence = next_sequence(out.sequence);
        const bool written = attempt([&] { return link_.write_alone(out, alone); });
        if (attempt([&] { return link_.exchange(out).has_value(); }) || written) return;
      }
    };
    out.blue_share = out.uv_mw_cm2 = 0;
    send(Alone::lamps);
    out.command = Command::stop;
    send(Alone::command);
  }

  Ending end() {
    Ending e;
    e.phase = broken_order_ ? Phase::failed : controller_->phase();
    e.fault = controller_->fault();
    e.detail = controller_->fault_detail();
    e.left = controller_->left();
    if (e.fault == Fault::heartbeat_lost) e.detail += ": it " + lost_by_;
    e.left.time = utc_now();
    if (broken_order_) {
      e.fault = Fault::defect;
      e.detail = broken_detail_;
      e.left.touched = true;
      e.left.heard = false;
    }
    e.frames = static_cast<int>(plan_.frames.size());
    e.frames_shown = controller_->frames_shown();
    e.frame = e.frames_shown - 1;
    e.late_frames = controller_->late_frames();
    e.worst_late_um = controller_->worst_late_um();
    e.worst_stage_error_um = controller_->worst_stage_error_um();
    e.seconds = clock_.now_s();
    e.stage_um = controller_->fault() == Fault::none ? controller_->stage_um()
                                                     : controller_->fault_stage_um();
    e.missed_cycles = missed_;
    e.lateness = controller_->lateness();
    e.light_off = controller_->light_off();
    try {
      if (e.fault != Fault::none && (controller_->begun() || broken_order_)) {
        write_latch(folder_, {e.fault, e.detail, options_.stack, e.frame, e.stage_um,
                              e.stage_um - plan_.start_um, e.left});
        e.latched = true;
        note("latched", std::string(name_of(e.fault)));
      }
      if (e.fault != Fault::none) {
        journal_->add({e.seconds, kJournalLeft, in_words(e.left), controller_->frame(),
                       controller_->stage_um(), left_json(e.left).dump()},
                      true);
      }
      PrintState last = state(e.seconds);
      last.phase = e.phase;
      last.fault = e.fault;
      last.detail = e.detail;
      if (e.fault != Fault::none) last.left = e.left;
      PrintAround around;
      around.seconds = e.seconds;
      around.threads = threads_;
      write_whole(folder_.file("status.json"), state_json(facts_, last, around) + "\n");
    } catch (const Error& error) {
      // The journal without an end latches, too.
      e.trouble = error.what();
      return e;
    }
    frame_log_->flush();
    if (const auto trouble = frame_log_->trouble(); !trouble.empty()) {
      note("not recorded", trouble);
      e.trouble = trouble;
    }
    note(kJournalEnd, std::string(name_of(e.phase)));
    journal_->flush();
    if (const auto trouble = journal_->trouble(); !trouble.empty()) e.trouble = trouble;
    return e;
  }

  const PrintPlan& plan_;
  Link& link_;
  FrameSink& sink_;
  FrameSink* const uv_sink_;
  BridgeClock& clock_;
  const StateFolder folder_;
  const RunOptions& options_;
  Teller teller_;
  const Machine& machine_;
  const std::uint16_t first_sequence_;
  const double cycle_s_;
  FrameRing ring_;
  std::optional<Journal> journal_;
  std::optional<FrameLog> frame_log_;
  std::optional<Controller> controller_;
  PrintFacts facts_;
  std::string threads_;
  Counter counter_;
  std::optional<ControlSocket> socket_;
  ImageNewsBox news_;
  std::optional<Images> images_, uv_images_;
  std::optional<Answer> answer_;
  SetPoints last_sent_;
  double next_s_ = 0, told_s_ = -1;
  std::uint64_t told_ = 0;
  int newest_ = 0;  ///< frames shown when the state was told last, and when the last of them came
  double newest_at_s_ = 0;
  int missed_ = 0;
  bool silent_ = false, stopped_ = false, broken_order_ = false;
  std::string broken_detail_, lost_by_;
};

}  // namespace

Ending run_print(const FrameSource& frames, const PrintPlan& plan, const Machine& machine,
                 Link& link, FrameSink& sink, BridgeClock& clock, const StateFolder& folder,
                 const RunOptions& options, const ExecutionContext& context, FrameSink* uv_sink) {
  return Run(frames, plan, machine, link, sink, uv_sink, clock, folder, options, context).go();
}

Status check_alone(Link& link, BridgeClock& clock, const Machine& machine) {
  constexpr double wait_s = 3, look_s = 0.1;
  constexpr int looks = 5;
  const double begin_s = clock.now_s();
  std::optional<double> first_s;
  std::uint16_t echo = 0;
  std::optional<Status> last;
  for (int seen = 0; seen < looks || clock.now_s() < *first_s + look_s;) {
    if (const auto status = link.look()) {
      if (seen > 0 && status->sequence_echo != echo) somebody_else(machine);
      echo = status->sequence_echo;
      last = status;
      if (!first_s) first_s = clock.now_s();
      ++seen;
    } else if (clock.now_s() > begin_s + wait_s) {
      throw DeviceError("the machine " + link.last_error());
    }
    clock.sleep_until(clock.now_s() + 2 * machine.limits.cycle_s);
  }
  return *last;
}

void take_over(Link& link, BridgeClock& clock, const Machine& machine, std::uint16_t first) {
  check_alone(link, clock, machine);
  SetPoints out;
  out.watchdog_s = machine.limits.watchdog_s;
  std::deque<std::uint16_t> own;
  bool taken = false;
  double next_s = clock.now_s();
  const auto judge = [&](const std::optional<Status>& status) {
    if (!status) return;
    const bool is_own = std::find(own.begin(), own.end(), status->sequence_echo) != own.end();
    if (taken && !is_own) somebody_else(machine);
    taken = taken || is_own;
  };
  for (std::uint16_t number = first, n = 0; n < kFirstExchanges; ++n) {
    out.sequence = number;
    number = next_sequence(number);
    ++out.heartbeat;
    own.push_back(out.sequence);
    if (own.size() > kOwnNumbers) own.pop_front();
    judge(link.exchange(out));
    clock.sleep_until(next_s += machine.limits.cycle_s);
    judge(link.look());
  }
}

Status reset_machine(Link& link, BridgeClock& clock, const Machine& machine) {
  SetPoints out;
  out.watchdog_s = machine.limits.watchdog_s;
  out.sequence = by_chance();
  double next_s = clock.now_s();
  std::optional<Status> status;
  const auto exchange = [&](Command command, double seconds, const auto& enough) {
    const double until_s = clock.now_s() + seconds;
    out.command = command;
    while (clock.now_s() < until_s) {
      out.sequence = next_sequence(out.sequence);
      ++out.heartbeat;
      if (auto answer = link.exchange(out)) {
        status = answer;
        if (answer->sequence_echo == out.sequence && enough(*answer)) return true;
      }
      clock.sleep_until(next_s += machine.limits.cycle_s);
    }
    return false;
  };
  // Lamps first, whatever else the machine refuses.
  link.write_alone(out, Alone::lamps);
  if (!exchange(Command::off, 2, [](const Status&) { return true; })) {
    if (!status) throw DeviceError("the machine " + link.last_error());
    throw DeviceError(
        fmt::format("the machine answers, but does not take set-points over: it gives back "
                    "sequence number {}, sent was {}",
                    status->sequence_echo, out.sequence));
  }
  const auto refuse = [&](const std::string& why) {
    if (!why.empty()) {
      throw DeviceError("the machine can't be reset: " + why + "; see to it, then reset again");
    }
  };
  refuse(impossible(machine, *status));
  refuse(interlocks(machine, *status));
  // Lamps that were on have their time to go dark.
  const double dark_s = 1 + 5 * std::max(machine.blue.settle_s, machine.uv.settle_s);
  const auto dark = [&](const Status& s) { return lit(machine, s).empty(); };
  const auto told_off = [&] {
    const std::string shines = lit(machine, *status);
    return shines.empty() ? shines : shines + " that is told to be off: switch the machine off";
  };
  if (!exchange(Command::off, dark_s, dark)) refuse(told_off());
  const auto fine = [&](const Status& s) {
    return s.state == MachineState::idle && interlocks(machine, s).empty() && !s.lamp_failed &&
           !s.stage_failed && !s.watchdog_tripped && !s.latched.value_or(false) &&
           !s.job_kept.value_or(false);
  };
  if (exchange(Command::reset, 2, fine) && exchange(Command::off, 1, fine)) {
    // A relay that has closed again shows a driver that never obeyed.
    if (!exchange(Command::off, dark_s, dark)) refuse(told_off());
    return *status;
  }
  const std::string open = interlocks(machine, *status);
  throw DeviceError(
      fmt::format("the machine stays as it is after a reset: {}{}{}; end the cause at the machine, "
                  "then reset again",
                  status->lamp_failed    ? "a lamp failed"
                  : status->stage_failed ? "the stage failed"
                  : status->latched.value_or(false) || status->job_kept.value_or(false)
                      ? "it still says that a print has failed on it"
                      : "not idle",
                  open.empty() ? "" : ", ", open));
}

}  // namespace slicecorr::bridge
