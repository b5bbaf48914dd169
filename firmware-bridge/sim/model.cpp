// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The printer over time: what holds between two events follows from closed forms, and `advance`
// goes from event to event.
#include "slicecorr/bridge/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "sim/exposures.hpp"
#include "sim/lamp.hpp"
#include "sim/motion.hpp"

namespace slicecorr::bridge {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kRoomTemperatureC = 25;
/// Less than a thousandth of what a stage takes for a wobble.
constexpr double kWobbleStepS = 0.001;
/// What is on the display, but not lit since it came.
constexpr int kUnlitImage = -2;

bool is_wire(const std::string& what) {
  return what == "late-reply" || what == "wrong-reply" || what == "drop" || what == "disconnect";
}
bool is_display(const std::string& what) {
  return what == "freeze-display" || what == "late-frame" || what == "display-gone";
}
bool is_uv_display(const std::string& what) {
  return what == "freeze-uv-display" || what == "late-uv-frame" || what == "uv-display-gone";
}
/// Of an image: begins when one is shown.
bool is_late(const std::string& what) { return what == "late-frame" || what == "late-uv-frame"; }

}  // namespace

struct PrinterModel::Impl {
  Impl(Machine m, std::vector<SimFault> f)
      : machine(std::move(m)), blue(machine.blue), uv(uv_drive(machine)) {
    drive.at_um = machine.stage.home_um;
    course.acceleration_um_s2 = machine.stage.acceleration_um_s2;
    for (SimFault& fault : f) {
      const double times = fault.what == "drop" || fault.what == "wrong-reply" ? fault.value : 1;
      faults.push_back({std::move(fault), false, times});
    }
  }

  static LampDrive uv_drive(const Machine& m) {
    LampDrive drive = m.uv;
    drive.max_share = 1;
    return drive;
  }

  struct Due {
    SimFault fault;
    bool done = false;
    double times = 1;
  };
  /// A cause that keeps the machine from running, until it is gone.
  struct Interlock {
    bool on = false;
    double until_s = kInfinity;
  };

  Machine machine;
  double now = 0;
  detail::Lamp blue, uv;

  // What the drive does, and where the stage really is.
  detail::Motion drive;
  detail::Course course;
  double slipped_um = 0;
  /// Of its speed, the more and the less in turn; 0: it goes steadily.
  double wobble = 0;
  bool moving = false, stage_failed = false;
  bool stuck = false;
  double stuck_at_um = 0, stuck_until_s = kInfinity;

  MachineState state = MachineState::idle;
  Command command = Command::off;
  std::uint16_t echo = 0, heartbeat = 0;
  bool heard = false;         ///< a heartbeat to compare with
  bool wait_for_off = false;  ///< started anew: runs only after an order that is not to run
  double fed_s = 0, watchdog_s = 0, began_s = 0;
  bool watchdog_tripped = false;
  bool job = false, failed_job = false;  ///< kept over a restart of the controller
  double temperature_c = kRoomTemperatureC;
  Interlock door, button;
  std::vector<Due> faults;
  int reached_frame = -1;

  Display display, uv_display;
  bool frozen = false, uv_frozen = false;
  std::shared_ptr<const Frame> frame, later_frame;        ///< of blue light
  std::shared_ptr<const Frame> uv_frame, later_uv_frame;  ///< on the UV display
  int image =
      kBlackImage;  ///< of `frame` in the order of what was lit, `kBlackImage` or `kUnlitImage`
  int images = 0;
  ImageSink sink;

  detail::Exposures exposures;
  bool tracked = false;  ///< the stage's slice is followed
  std::vector<SimEvent> events;

  detail::Motion stage() const {
    if (stuck) return {stuck_at_um, 0};
    return {drive.at_um + slipped_um + wobble_um(), wobble_speed()};
  }
  double wobble_period_um() const {
    constexpr double screw_um = 1000;
    return machine.stage.turns() ? machine.stage.turn_um() : screw_um;
  }
  double wobble_rad() const { return 2 * std::numbers::pi * drive.at_um / wobble_period_um(); }
  /// The integral of the speed's.
  double wobble_um() const {
    return wobble == 0
               ? 0
               : wobble * wobble_period_um() / (2 * std::numbers::pi) * std::sin(wobble_rad());
  }
  double wobble_speed() const {
    return wobble == 0 ? drive.speed_um_s
                       : drive.speed_um_s * (1 + wobble * std::cos(wobble_rad()));
  }
  double uv_max() const { return machine.printer.uv ? machine.printer.uv->max_mw_cm2() : 0; }
  void tell(const std::string& what) { events.push_back({now, what, stage().at_um}); }

  /// Off is told blue first and on UV first: the order in which they are switched.
  template <typename Change>
  void change_lamps(const Change& change) {
    const bool blue_was = blue.on(), uv_was = uv.on();
    change();
    if (blue_was && !blue.on()) tell("blue off");
    if (uv_was && !uv.on()) tell("uv off");
    if (!uv_was && uv.on()) tell("uv on");
    if (!blue_was && blue.on()) tell("blue on");
  }
  void lamps_off() {
    change_lamps([&] {
      blue.ask(0);
      uv.ask(0);
    });
  }
  void note_moving() {
    const bool moves = drive.speed_um_s != 0 || next_piece(drive, course).duration_s < kInfinity;
    if (moves != moving) tell(moves ? "stage moves" : "stage stops");
    moving = moves;
  }

  /// The machine's own reaction to whatever must not be: relay off, stage stops, latched.
  void latch() {
    change_lamps([&] {
      blue.cut();
      uv.cut();
    });
    course.moving = false;
    failed_job = failed_job || job;
    if (state != MachineState::fault) {
      state = MachineState::fault;
      tell("fault");
    }
    note_moving();
  }
  bool cause_is_there() const {
    return door.on || button.on || temperature_c > machine.limits.max_temperature_c;
  }
  bool dark() const { return blue.light() == 0 && uv.light() == 0; }
  /// Also where nothing runs, but a lamp shines all the same.
  double watchdog_at() const {
    const bool watched = state == MachineState::running || (heard && !dark());
    return watched && state != MachineState::fault ? fed_s + watchdog_s : kInfinity;
  }

  void restart() {
    change_lamps([&] {
      blue.cut();
      uv.cut();
    });
    drive.speed_um_s = 0;
    course.moving = false;
    note_moving();
    state = MachineState::idle;
    command = Command::off;
    echo = 0;
    heard = false;
    wait_for_off = true;
    watchdog_tripped = false;
    began_s = now;
  }

  void free_stage() {
    slipped_um = stuck_at_um - drive.at_um - wobble_um();
    stuck = false;
  }

  double end_of(double seconds) const { return seconds > 0 ? now + seconds : kInfinity; }

  void begin_fault(const SimFault& f) {
    tell(f.what);
    if (f.what == "stuck-stage" && !stuck) {
      stuck_at_um = stage().at_um;
      stuck = true;
      stuck_until_s = end_of(f.value);
    } else if (f.what == "stage-slips") {
      const double um = f.value * (machine.stage.turns() ? machine.stage.um_per_deg : 1);
      (stuck ? stuck_at_um : slipped_um) += um;
      tracked = false;
    } else if (f.what == "stage-wobbles") {
      const double before_um = wobble_um();
      wobble = f.value;
      slipped_um += before_um - wobble_um();  // it does not jump
    } else if (f.what == "stage-fails") {
      stage_failed = true;
      drive.speed_um_s = 0;
      course.moving = false;
      note_moving();
    } else if (f.what == "lamp-fails") {
      blue.fail();
    } else if (f.what == "lamp-drifts") {
      blue.drift(f.value);
    } else if (f.what == "lamp-sticks") {
      blue.stick();
    } else if (f.what == "uv-fails") {
      uv.fail();
    } else if (f.what == "door") {
      door = {true, end_of(f.value)};
      latch();
    } else if (f.what == "stop-button") {
      button = {true, end_of(f.value)};
      latch();
    } else if (f.what == "hot") {
      temperature_c = f.value;
      if (cause_is_there()) latch();
    } else if (f.what == "restart") {
      restart();
    } else if (f.what == "freeze-display") {
      frozen = true;
    } else if (f.what == "display-gone") {
      display.gone = true;
    } else if (f.what == "freeze-uv-display") {
      uv_frozen = true;
    } else if (f.what == "uv-display-gone") {
      uv_display.gone = true;
    }
  }

  bool is_due(const Due& due) const {
    if (due.done) return false;
    if (due.fault.at_s) return *due.fault.at_s <= now;
    if (due.fault.at_frame) return *due.fault.at_frame <= reached_frame;
    return true;
  }
  /// Begins what is due of the machine and of the display; a late image waits for one to come.
  void begin_due() {
    for (Due& due : faults) {
      if (is_wire(due.fault.what) || is_late(due.fault.what) || !is_due(due)) continue;
      due.done = true;
      begin_fault(due.fault);
    }
  }

  double next_event_s() const {
    double next = watchdog_at();
    for (const Due& due : faults) {
      if (!due.done && due.fault.at_s && !is_wire(due.fault.what) && !is_late(due.fault.what)) {
        next = std::min(next, *due.fault.at_s);
      }
    }
    if (stuck) next = std::min(next, stuck_until_s);
    if (door.on) next = std::min(next, door.until_s);
    if (button.on) next = std::min(next, button.until_s);
    if (display.later_s) next = std::min(next, *display.later_s);
    if (uv_display.later_s) next = std::min(next, *uv_display.later_s);
    return next;
  }
  void happen() {
    if (watchdog_at() <= now) {
      watchdog_tripped = true;
      tell("watchdog");
      latch();
    }
    begin_due();
    if (stuck && stuck_until_s <= now) {
      free_stage();
      tell("stage follows");
    }
    if (door.on && door.until_s <= now) {
      door.on = false;
      tell("door closed");
    }
    if (button.on && button.until_s <= now) {
      button.on = false;
      tell("stop button released");
    }
    if (display.later_s && *display.later_s <= now) {
      display.later_s.reset();
      appear(std::move(later_frame));
    }
    if (uv_display.later_s && *uv_display.later_s <= now) {
      uv_display.later_s.reset();
      uv_appear(std::move(later_uv_frame));
    }
  }

  void advance(double until) {
    happen();
    while (now < until) {
      const detail::MotionPiece piece = next_piece(drive, course);
      const bool lit = exposures.recording() && blue.on() && !blue.failed();
      if (lit && !tracked) exposures.find(stage());
      if (!lit) exposures.interrupt();
      tracked = lit;

      double next = std::min(until, next_event_s());
      const double piece_end = now + piece.duration_s;
      next = std::min(next, piece_end);
      // Its speed is taken as constant for so long, s.
      if (lit && wobble != 0 && moving) next = std::min(next, now + kWobbleStepS);
      double edge = kInfinity;
      if (lit) {
        edge = now + exposures.until_edge(stage(), stuck ? 0 : piece.acceleration_um_s2);
        next = std::min({next, edge, now + blue.steady_for_s(), now + uv.steady_for_s()});
      }
      next = std::max(next, now);
      pass(next, piece, lit);
      if (piece_end <= next) drive = piece.end;
      now = next;
      if (edge <= now) exposures.cross(stage());
      note_moving();
      happen();
    }
  }

  void pass(double next, const detail::MotionPiece& piece, bool lit) {
    const double time = next - now;
    detail::Exposures::Lit part;
    if (lit) {
      if (image == kUnlitImage) {
        image = images++;
        if (sink) sink(image, lit_image());
      }
      part = {image,
              time,
              blue.integral(time, exposures.facts().m),
              blue.integral(time, 1),
              uv_max() * uv.integral(time, 1),
              stage().at_um,
              0};
    }
    drive = within(drive, piece, time);
    blue.advance(time);
    uv.advance(time);
    if (lit) {
      part.to_um = stage().at_um;
      exposures.add(part);
    }
  }

  void take(const SetPoints& s) {
    happen();
    echo = s.sequence;
    if (!heard || s.heartbeat != heartbeat) fed_s = now;
    heard = true;
    heartbeat = s.heartbeat;
    job = s.job;
    // Nobody talks the machine out of its own limit.
    watchdog_s = s.watchdog_s > 0 ? std::min(s.watchdog_s, machine.limits.watchdog_s)
                                  : machine.limits.watchdog_s;
    if (s.command != command) {
      command = s.command;
      tell(command == Command::off    ? "off"
           : command == Command::run  ? "run"
           : command == Command::stop ? "stop"
                                      : "reset");
    }
    if (command != Command::run) wait_for_off = false;
    if (state == MachineState::fault) {
      if (command == Command::reset && !cause_is_there()) {
        state = MachineState::idle;
        watchdog_tripped = stage_failed = failed_job = false;
      }
      return;
    }
    if (command == Command::reset) failed_job = false;
    if (command == Command::stop && job) failed_job = true;
    if (command == Command::run && !wait_for_off) {
      run(s);
    } else {
      lamps_off();
      course.moving = false;
      state = command == Command::stop ? MachineState::stopped : MachineState::idle;
    }
    note_moving();
  }

  void run(const SetPoints& s) {
    if (state != MachineState::running) fed_s = now;
    state = MachineState::running;
    const Stage& limits = machine.stage;
    if (!stage_failed) {
      course.moving = true;
      course.target_um = std::clamp(s.target_um, 0.0, limits.travel_um);
      course.speed_um_s = std::clamp(s.speed_um_s, 0.0, limits.fastest_um_s());
      course.acceleration_um_s2 = s.acceleration_um_s2 > 0
                                      ? std::min(s.acceleration_um_s2, limits.acceleration_um_s2)
                                      : limits.acceleration_um_s2;
    }
    change_lamps([&] {
      blue.ask(s.blue_share);
      uv.ask(uv_max() > 0 ? s.uv_mw_cm2 / uv_max() : 0);
    });
  }

  /// What is due when an image is shown on a display whose faults `of_display` knows: by how much it
  /// is late.
  template <typename OfDisplay>
  double begin_shown(int number, const OfDisplay& of_display) {
    double late_s = 0;
    for (Due& due : faults) {
      const bool here = is_due(due) || (!due.done && due.fault.at_frame && number >= 0 &&
                                        *due.fault.at_frame <= number);
      if (!here || !of_display(due.fault.what)) continue;
      due.done = true;
      if (is_late(due.fault.what)) {
        tell(due.fault.what);
        late_s = std::max(late_s, due.fault.value);
      } else {
        begin_fault(due.fault);
      }
    }
    return late_s;
  }

  void show(const std::shared_ptr<const Frame>& next) {
    happen();
    const double late_s = begin_shown(next ? next->number : kBlackFrame, is_display);
    if (frozen || display.gone) return;
    if (late_s > 0) {
      later_frame = next;
      display.later_s = now + late_s;
      return;
    }
    // What comes now replaces what was to come.
    display.later_s.reset();
    appear(next);
  }

  void show_uv(const std::shared_ptr<const Frame>& next) {
    happen();
    const double late_s = begin_shown(next ? next->number : kBlackFrame, is_uv_display);
    if (uv_frozen || uv_display.gone) return;
    if (late_s > 0) {
      later_uv_frame = next;
      uv_display.later_s = now + late_s;
      return;
    }
    uv_display.later_s.reset();
    uv_appear(next);
  }

  static bool alike(const std::shared_ptr<const Frame>& a, const std::shared_ptr<const Frame>& b) {
    if (!a || !b) return !a && !b;
    return a->number == b->number && a->crc32 == b->crc32 && a->blue.size() == b->blue.size();
  }

  /// For recorders: what both displays show.
  std::shared_ptr<const Frame> lit_image() const {
    if (!machine.uv_display) return frame;
    auto both = std::make_shared<Frame>(*frame);
    both->on_uv_display = uv_frame;
    return both;
  }

  void uv_appear(std::shared_ptr<const Frame> next) {
    const bool same = alike(uv_frame, next);
    uv_frame = std::move(next);
    if (!same && frame) image = kUnlitImage;
    uv_display.number = uv_frame ? uv_frame->number : kBlackFrame;
    uv_display.since_s = now;
    ++uv_display.count;
    tell(uv_frame ? fmt::format("uv frame {}", uv_display.number) : "uv black");
  }

  void appear(std::shared_ptr<const Frame> next) {
    const bool same = frame && next && alike(frame, next);
    frame = std::move(next);
    if (!same) image = frame ? kUnlitImage : kBlackImage;
    display.number = frame ? frame->number : kBlackFrame;
    display.since_s = now;
    ++display.count;
    reached_frame = std::max(reached_frame, display.number);
    tell(frame ? fmt::format("frame {}", display.number) : "black");
    begin_due();
  }
};

PrinterModel::PrinterModel(Machine machine, std::vector<SimFault> faults, double layer_um, double m)
    : impl_(std::make_unique<Impl>(std::move(machine), std::move(faults))) {
  record({layer_um, impl_->machine.stage.home_um, m, false});
}
PrinterModel::~PrinterModel() = default;

void PrinterModel::record(const SliceFacts& facts) {
  impl_->exposures.begin(facts);
  // Images are counted anew, too; what is on the display has not been lit in this record.
  impl_->images = 0;
  impl_->image = impl_->frame ? kUnlitImage : kBlackImage;
  impl_->tracked = false;
}
void PrinterModel::advance(double time_s) { impl_->advance(time_s); }
double PrinterModel::now_s() const { return impl_->now; }
void PrinterModel::take(const SetPoints& set_points) { impl_->take(set_points); }
void PrinterModel::show(const std::shared_ptr<const Frame>& frame) { impl_->show(frame); }
const PrinterModel::Display& PrinterModel::display() const { return impl_->display; }
void PrinterModel::show_uv(const std::shared_ptr<const Frame>& frame) { impl_->show_uv(frame); }
const PrinterModel::Display& PrinterModel::uv_display() const { return impl_->uv_display; }

Status PrinterModel::status() const {
  const Impl& i = *impl_;
  Status s;
  s.sequence_echo = i.echo;
  s.state = i.state;
  const detail::Motion stage = i.stage();
  s.stage_um = stage.at_um;
  s.stage_speed_um_s = stage.speed_um_s;
  s.blue_measured = i.blue.light();
  s.uv_measured = i.uv.light() * i.uv_max();
  s.temperature_c = i.temperature_c;
  s.machine_time_s = i.now - i.began_s;
  s.door_open = i.door.on;
  s.stop_pressed = i.button.on;
  s.lamp_failed = i.blue.failed();
  s.stage_failed = i.stage_failed;
  s.over_temperature = i.temperature_c > i.machine.limits.max_temperature_c;
  s.watchdog_tripped = i.watchdog_tripped;
  s.latched = i.failed_job;
  s.job_kept = i.job;
  return s;
}

std::optional<SimFault> PrinterModel::wire_fault() {
  for (Impl::Due& due : impl_->faults) {
    if (!is_wire(due.fault.what) || !impl_->is_due(due)) continue;
    impl_->tell(due.fault.what);
    if (--due.times <= 0) due.done = true;
    return due.fault;
  }
  return std::nullopt;
}

const std::vector<SimEvent>& PrinterModel::events() const { return impl_->events; }
void PrinterModel::tell_images(ImageSink sink) { impl_->sink = std::move(sink); }
const std::vector<SliceExposure>& PrinterModel::exposures() const {
  return impl_->exposures.slices();
}
bool PrinterModel::lamps_dark() const { return impl_->dark(); }
bool PrinterModel::at_rest() const { return !impl_->moving; }
std::optional<double> PrinterModel::watchdog_at_s() const {
  const double at = impl_->watchdog_at();
  return at < kInfinity ? std::optional(at) : std::nullopt;
}

}  // namespace slicecorr::bridge
