#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "run/control_socket.hpp"
#include "run/images.hpp"
#include "run/priority.hpp"
#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

constexpr int control_priority = 50;
constexpr double tell_every_s = 0.25;

/// Tells the user how far the print is, from a thread of its own: a terminal that hangs must not
/// hang the print.
class Teller {
 public:
  Teller(const Job& job, int frames) : job_(job), frames_(std::max(frames, 1)) {
    if (job_.progress) thread_ = std::thread([this] { work(); });
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
      job_.report("print", 1.0 * shown_ / frames_);
    }
  }

  const Job& job_;
  const int frames_;
  std::atomic<int> shown_{0};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ending_ = false;
  std::thread thread_;
};

class Run {
 public:
  Run(const FrameSource& source, const PrintPlan& plan, const Machine& machine, Link& link,
      FrameSink& sink, Clock& clock, const StateFolder& folder, const RunOptions& options,
      const Job& job)
      : plan_(plan),
        machine_(machine),
        link_(link),
        sink_(sink),
        clock_(clock),
        folder_(folder),
        options_(options),
        teller_(job, source.frames()),
        cycle_s_(machine.limits.cycle_s),
        ring_(source, machine.limits.ring_frames, options.threads) {
    ring_.wait_ready(0, machine.limits.ring_frames);
    journal_.emplace(folder.file("journal.jsonl"));
    frame_log_.emplace(folder.file("frames.csv"), plan.start_um);
    controller_.emplace(plan, machine, options.dry_run);
    facts_ = facts_of(plan, machine);
    facts_.stack = options.stack;
    facts_.display = sink.describe();
    facts_.dry_run = options.dry_run;
    socket_.emplace(folder, counter_, [this](const PrintState& state, std::uint64_t asked) {
      // `threads_` is written before the first state is offered.
      PrintAround around;
      around.ready_frames = ring_.ready();
      around.asked = asked;
      around.threads = threads_;
      return state_json(facts_, state, around);
    });
    images_.emplace(ring_, sink, clock, options.lockstep);
  }

  Ending go() {
    journal_->add({clock_.now_s(), journal_begin, options_.stack, controller_->frame(),
                   controller_->stage_um(), facts_json(facts_)},
                  true);
    journal_->flush();
    if (const auto trouble = journal_->trouble(); !trouble.empty()) throw DeviceError(trouble);
    if (!options_.lockstep) {
      threads_ = raise_priority(control_priority) + ", " + lock_memory();
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
    if (controller_->fault() != Fault::none || broken_order_) sink_.black();
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
    if (options_.lockstep) images_->tick(now);
    ImageNews news = images_->news();
    for (const FrameReport& report : news.reports) controller_->shown(report);
    if (news.fault != Fault::none) controller_->fail(news.fault, news.detail);
    serve();
    const Step step = controller_->step(answer_, now);
    last_sent_ = step.set_points;
    if (step.show >= -1) images_->show(step.show, step.show_at_s);
    for (const Event& event : step.events) journal_->add(event, true);
    for (const FrameRecord& record : step.records) frame_log_->add(record);
    const double asked_s = clock_.now_s();
    const auto status = link_.exchange(step.set_points);
    if (status) {
      answer_ = Answer{*status, (asked_s + clock_.now_s()) / 2};
    } else {
      answer_.reset();
      // Only the first of a row: the journal is for people.
      if (!silent_) {
        journal_->add(
            {now, "no answer", link_.last_error(), controller_->frame(), controller_->stage_um()},
            false);
      }
    }
    silent_ = !status;
    tell(now);
    if (step.finished) return true;
    next_s_ += cycle_s_;
    const double after = clock_.now_s();
    if (after > next_s_ + cycle_s_) {
      next_s_ = after;  // what is lost is lost
      ++missed_;
    }
    if (options_.lockstep) images_->show_due(next_s_);
    clock_.sleep_until(next_s_);
    return false;
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

  PrintState state(double now) const {
    PrintState state = state_of(*controller_, now, missed_);
    state.told = told_;
    return state;
  }

  /// Whoever asks or watches: numbers only, their text is made by the thread that is asked.
  void tell(double now) {
    if (now < told_s_ + tell_every_s) return;
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
    const auto send = [&] {
      for (int i = 0; i < 2; ++i) {
        ++out.sequence;
        ++out.heartbeat;
        try {
          if (link_.exchange(out)) return;
        } catch (...) {
          // Nothing is left to try but the next one.
        }
      }
    };
    out.blue_share = out.uv_mw_cm2 = 0;
    send();
    out.command = Command::stop;
    send();
  }

  Ending end() {
    Ending e;
    e.phase = broken_order_ ? Phase::failed : controller_->phase();
    e.fault = controller_->fault();
    e.detail = controller_->fault_detail();
    e.left = controller_->left();
    if (e.fault == Fault::heartbeat_lost) e.detail += ": " + link_.last_error();
    if (broken_order_) {
      e.fault = Fault::defect;
      e.detail = broken_detail_;
      e.left = "NOT CONFIRMED that lamps are off and the stage stands: go and look";
    }
    e.frames = static_cast<int>(plan_.frames.size());
    e.frames_shown = controller_->frames_shown();
    e.frame = e.frames_shown - 1;
    e.late_frames = controller_->late_frames();
    e.worst_late_um = controller_->worst_late_um();
    e.worst_stage_error_um = controller_->worst_stage_error_um();
    e.seconds = clock_.now_s();
    e.stage_um = controller_->stage_um();
    e.missed_cycles = missed_;
    e.lateness = controller_->lateness();
    try {
      if (e.fault != Fault::none && (controller_->begun() || broken_order_)) {
        write_latch(folder_, {e.fault, e.detail, options_.stack, e.frame, e.stage_um,
                              e.stage_um - plan_.start_um});
        e.latched = true;
        note("latched", std::string(name_of(e.fault)));
      }
      PrintState last = state(e.seconds);
      last.phase = e.phase;
      last.fault = e.fault;
      last.detail = e.detail;
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
    note(journal_end, std::string(name_of(e.phase)));
    journal_->flush();
    if (const auto trouble = journal_->trouble(); !trouble.empty()) e.trouble = trouble;
    return e;
  }

  const PrintPlan& plan_;
  const Machine& machine_;
  Link& link_;
  FrameSink& sink_;
  Clock& clock_;
  const StateFolder folder_;
  const RunOptions& options_;
  Teller teller_;
  const double cycle_s_;
  FrameRing ring_;
  std::optional<Journal> journal_;
  std::optional<FrameLog> frame_log_;
  std::optional<Controller> controller_;
  PrintFacts facts_;
  std::string threads_;
  Counter counter_;
  std::optional<ControlSocket> socket_;
  std::optional<Images> images_;
  std::optional<Answer> answer_;
  SetPoints last_sent_;
  double next_s_ = 0, told_s_ = -1;
  std::uint64_t told_ = 0;
  int missed_ = 0;
  bool silent_ = false, stopped_ = false, broken_order_ = false;
  std::string broken_detail_;
};

}  // namespace

Ending run_print(const FrameSource& frames, const PrintPlan& plan, const Machine& machine,
                 Link& link, FrameSink& sink, Clock& clock, const StateFolder& folder,
                 const RunOptions& options, const Job& job) {
  return Run(frames, plan, machine, link, sink, clock, folder, options, job).go();
}

void check_alone(Link& link, Clock& clock, const Machine& machine) {
  constexpr double wait_s = 3, look_s = 0.1;
  constexpr int looks = 5;
  const double begin_s = clock.now_s();
  std::optional<double> first_s;
  std::uint16_t echo = 0;
  for (int seen = 0; seen < looks || clock.now_s() < *first_s + look_s;) {
    if (const auto status = link.look()) {
      if (seen > 0 && status->sequence_echo != echo) {
        throw InputError(machine.printer.name, "",
                         "takes set-points from somebody else: another bridge is at work with it");
      }
      echo = status->sequence_echo;
      if (!first_s) first_s = clock.now_s();
      ++seen;
    } else if (clock.now_s() > begin_s + wait_s) {
      throw DeviceError("the machine does not answer: " + link.last_error());
    }
    clock.sleep_until(clock.now_s() + 2 * machine.limits.cycle_s);
  }
}

void reset_machine(Link& link, Clock& clock, const Machine& machine) {
  SetPoints out;
  out.watchdog_s = machine.limits.watchdog_s;
  double next_s = clock.now_s();
  std::optional<Status> status;
  const auto exchange = [&](Command command, double seconds, const auto& enough) {
    const double until_s = clock.now_s() + seconds;
    out.command = command;
    while (clock.now_s() < until_s) {
      ++out.sequence;
      if (out.sequence == 0) out.sequence = 1;
      ++out.heartbeat;
      if (auto answer = link.exchange(out)) {
        status = answer;
        if (answer->sequence_echo == out.sequence && enough(*answer)) return true;
      }
      clock.sleep_until(next_s += machine.limits.cycle_s);
    }
    return false;
  };
  if (!exchange(Command::off, 2, [](const Status&) { return true; })) {
    throw DeviceError("the machine does not answer: " + link.last_error());
  }
  const auto against = [&](const Status& s) {
    std::string why;
    const auto add = [&](bool is, const char* text) {
      if (is) why += std::string(why.empty() ? "" : ", ") + text;
    };
    add(s.door_open, "a door or cover is open");
    add(s.stop_pressed, "the stop button is pressed");
    add(s.over_temperature ||
            (s.temperature_c && *s.temperature_c > machine.limits.max_temperature_c),
        "it is too hot");
    return why;
  };
  if (const auto why = against(*status); !why.empty()) {
    throw DeviceError("the machine can't be reset: " + why + "; see to it, then reset again");
  }
  const auto fine = [&](const Status& s) {
    return s.state == MachineState::idle && against(s).empty() && !s.lamp_failed &&
           !s.stage_failed && !s.watchdog_tripped;
  };
  if (exchange(Command::reset, 2, fine) && exchange(Command::off, 1, fine)) return;
  throw DeviceError(
      fmt::format("the machine stays as it is after a reset: {}{}{}; end the cause at "
                  "the machine, then reset again",
                  status->lamp_failed    ? "a lamp failed"
                  : status->stage_failed ? "the stage failed"
                                         : "not idle",
                  against(*status).empty() ? "" : ", ", against(*status)));
}

}  // namespace slicecorr::bridge
