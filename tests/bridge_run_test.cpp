// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What lies around the controller: run_print with parts that throw, the ring of frames, the frame
// wire, journal, latch and lock.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "frames/wire.hpp"
#include "slicecorr/bridge/model.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::bridge {
namespace {

using slicecorr::test::TemporaryFolder;
using testing::HasSubstr;

class Pictures final : public FrameSource {
 public:
  explicit Pictures(int frames, int broken = -1) : frames_(frames), broken_(broken) {}
  int frames() const override { return frames_; }
  std::shared_ptr<const Frame> make(int number) const override {
    if (number == broken_) throw InputError("picture", std::to_string(number), "is broken");
    {
      const std::scoped_lock lock(mutex_);
      made_.insert(number);
    }
    auto frame = std::make_shared<Frame>();
    frame->number = number;
    frame->width_px = 2;
    frame->height_px = 1;
    frame->blue = {255, static_cast<std::uint8_t>(number)};
    frame->crc32 = crc32_of(*frame);
    return frame;
  }
  std::set<int> made() const {
    const std::scoped_lock lock(mutex_);
    return made_;
  }

 private:
  int frames_, broken_;
  mutable std::mutex mutex_;
  mutable std::set<int> made_;
};

// ---- frames ----

TEST(FrameRing, MakesAheadInOrderAndNoFurther) {
  const Pictures pictures(40);
  for (const int threads : {1, 3}) {
    FrameRing ring(pictures, 8, threads);
    ring.wait_ready(0, 8);
    EXPECT_EQ(ring.ready(), 8);
    for (int n = 0; n < 40; ++n) {
      ring.wait_ready(n, 1);
      const auto frame = ring.take(n);
      ASSERT_TRUE(frame);
      EXPECT_EQ(frame->number, n);
      EXPECT_EQ(ring.take(n), frame) << "it stays until a later one is taken";
    }
    EXPECT_EQ(ring.take(40), nullptr);
  }
  const Pictures few(3);
  FrameRing short_ring(few, 8, 2);
  short_ring.wait_ready(0, 8);  // all that there are
  EXPECT_EQ(short_ring.ready(), 3);
  EXPECT_EQ(short_ring.take(2)->number, 2);
}

TEST(FrameRing, TellsWhatMakingThrew) {
  const Pictures pictures(20, 5);
  FrameRing ring(pictures, 4, 2);
  for (int n = 0; n < 5; ++n) {
    ring.wait_ready(n, 1);
    EXPECT_TRUE(ring.take(n));
  }
  EXPECT_THROW(ring.wait_ready(5, 1), InputError);
  EXPECT_THROW(ring.take(5), InputError);
}

// ---- the frame wire ----

struct Ends {
  WireSocket a, b;
  Ends() {
    int s[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, s), 0);
    a = WireSocket(s[0]);
    b = WireSocket(s[1]);
  }
};

TEST(FrameWire, CarriesFrames) {
  Ends ends;
  Frame frame;
  frame.number = 7;
  frame.width_px = 3;
  frame.height_px = 2;
  frame.blue = {1, 2, 3, 4, 5, 6};
  frame.uv = {9, 8, 7, 6, 5, 4};
  send_message(ends.a, message_of(&frame, 1.25), 1);
  send_message(ends.a, message_of(nullptr, 2.5), 1);
  WireMessage m;
  ASSERT_TRUE(receive_message(ends.b, m, 1));
  EXPECT_EQ(m.at_s, 1.25);
  const auto got = frame_of(std::move(m));
  ASSERT_TRUE(got);
  EXPECT_EQ(got->number, 7);
  EXPECT_EQ(got->blue, frame.blue);
  EXPECT_EQ(got->uv, frame.uv);
  EXPECT_EQ(got->crc32, crc32_of(frame));
  ASSERT_TRUE(receive_message(ends.b, m, 1));
  EXPECT_EQ(frame_of(std::move(m)), nullptr);
  // Without a payload, received into what had one and into what had none.
  WireMessage tick;
  tick.at_s = 3;
  for (WireMessage into : {message_of(&frame, 0), WireMessage{}}) {
    send_message(ends.a, tick, 1);
    ASSERT_TRUE(receive_message(ends.b, into, 1));
    EXPECT_EQ(into.kind, WireKind::tick);
    EXPECT_TRUE(into.payload.empty());
  }
  ends.a = WireSocket();
  EXPECT_FALSE(receive_message(ends.b, m, 1)) << "closed between messages";
}

TEST(FrameWire, RefusesWhatIsWrong) {
  Frame frame;
  frame.number = 0;
  frame.width_px = 2;
  frame.height_px = 2;
  frame.blue = {1, 2, 3, 4};
  // The bytes of a good message, each time with one changed.
  std::vector<std::uint8_t> bytes(kWireHeaderBytes + 4);
  {
    Ends ends;
    send_message(ends.a, message_of(&frame, 0), 1);
    ASSERT_EQ(::recv(ends.b.get(), bytes.data(), bytes.size(), MSG_WAITALL),
              static_cast<ssize_t>(bytes.size()));
  }
  const auto receive = [&](const std::vector<std::uint8_t>& sent) {
    Ends ends;
    EXPECT_EQ(::send(ends.a.get(), sent.data(), sent.size(), 0), static_cast<ssize_t>(sent.size()));
    ends.a = WireSocket();
    WireMessage m;
    return receive_message(ends.b, m, 1);
  };
  EXPECT_TRUE(receive(bytes));
  // Magic, version, kind, number, sizes, flags, checksum, length, pixels.
  for (const std::size_t at : {0U, 4U, 6U, 11U, 12U, 15U, 16U, 20U, 40U, 44U, 47U, 48U, 51U}) {
    auto changed = bytes;
    changed[at] ^= 0x40;
    EXPECT_THROW(receive(changed), DeviceError) << "byte " << at;
  }
  for (std::size_t size = 1; size < bytes.size(); ++size) {
    EXPECT_THROW(receive({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}),
                 DeviceError)
        << size;
  }
  // Nobody answers.
  Ends ends;
  WireMessage m;
  EXPECT_THROW(receive_message(ends.b, m, 0.01), DeviceError);
}

TEST(FrameWire, AddressesAreChecked) {
  for (const char* address : {"", "unix:", "tcp:", "tcp:localhost", "tcp:localhost:x",
                              "tcp:localhost:70000", "file:/tmp/x", "tcp::80"}) {
    EXPECT_THROW(connect_wire(address), InputError) << address;
  }
  EXPECT_THROW(connect_wire("unix:/tmp/" + std::string(200, 'a')), InputError);
  const TemporaryFolder folder;
  EXPECT_THROW(connect_wire("unix:" + (folder / "nobody")), DeviceError);
  const WireListener listener = listen_wire("tcp:127.0.0.1:0");
  EXPECT_THAT(listener.address, testing::StartsWith("tcp:127.0.0.1:"));
  EXPECT_TRUE(connect_wire(listener.address));
  const WireListener named = listen_wire("unix:" + (folder / "s"));
  EXPECT_THROW(listen_wire(named.address), InputError) << "somebody listens";
}

// ---- run_print ----

/// A machine in the same process, in the time of a step clock.
class ModelLink final : public Link {
 public:
  ModelLink(PrinterModel& model, const Machine& machine, BridgeClock& clock)
      : model_(model), machine_(machine), clock_(clock) {}
  std::optional<Status> exchange(const SetPoints& out) override {
    sent.push_back(out);
    if (static_cast<int>(sent.size()) >= throws_from) {
      throw std::runtime_error("a defect of the link");
    }
    if (static_cast<int>(sent.size()) == throws_once) {
      throw std::runtime_error("a defect of the link, once");
    }
    model_.advance(clock_.now_s());
    model_.take(decode_set_points(*machine_.modbus, encode(*machine_.modbus, out)));
    return decode_status(*machine_.modbus, encode(*machine_.modbus, model_.status()));
  }
  bool write_alone(const SetPoints& out, Alone what) override {
    alone.push_back({what, out});
    if (static_cast<int>(sent.size()) >= throws_from) {
      throw std::runtime_error("a defect of the link");
    }
    return false;
  }
  std::optional<Status> look() override {
    return decode_status(*machine_.modbus, encode(*machine_.modbus, model_.status()));
  }
  std::string last_error() const override { return "none"; }
  int throws_from = 1 << 30, throws_once = -1;
  std::vector<SetPoints> sent;
  std::vector<std::pair<Alone, SetPoints>> alone;

 private:
  PrinterModel& model_;
  const Machine& machine_;
  BridgeClock& clock_;
};

class ModelSink final : public FrameSink {
 public:
  explicit ModelSink(PrinterModel& model) : model_(model) {}
  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    if (frame && frame->number == throws_at) throw std::runtime_error("a defect of the sink");
    if (frame && frame->number == gone_at) throw DeviceError("the display is gone");
    model_.advance(at_s);
    model_.show(frame);
    return {model_.display().number, model_.display().since_s, model_.display().count, {}};
  }
  void black() noexcept override {
    model_.show(nullptr);
    ++blacks;
  }
  void tick(double at_s) override { model_.advance(at_s); }
  std::string describe() const override { return "model"; }
  int throws_at = -1, gone_at = -1, blacks = 0;

 private:
  PrinterModel& model_;
};

class RunPrint : public testing::Test {
 protected:
  RunPrint() {
    machine = load_machine(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
    machine.stage.travel_um = 3000;
    plan.layer_um = 50;
    plan.speed_um_s = 1000 / 3.6;
    plan.acceleration_um_s2 = machine.stage.acceleration_um_s2;
    plan.ramp = Ramp::outside;
    plan.ramp_um = plan.speed_um_s * plan.speed_um_s / (2 * plan.acceleration_um_s2);
    plan.run_up_um = plan.ramp_um + 4 * machine.limits.cycle_s * plan.speed_um_s;
    plan.uv_max_mw_cm2 = machine.printer.uv->max_mw_cm2();
    plan.frames.resize(20, FramePlan{true, 0, 0, 0});
    plan.start_um = plan.run_up_um;
    plan.end_um = plan.start_um + 20 * plan.layer_um;
    state = StateFolder::of(folder.path(), machine.printer);
    options.lockstep = true;
    options.stack = "part.uvj";
  }

  Ending run(const std::function<void(ModelLink&, ModelSink&)>& prepare = {}, int broken = -1) {
    model = std::make_unique<PrinterModel>(machine, std::vector<SimFault>{}, 50, 1);
    clock = make_step_clock();
    link = std::make_unique<ModelLink>(*model, machine, *clock);
    sink = std::make_unique<ModelSink>(*model);
    if (prepare) prepare(*link, *sink);
    const Pictures pictures(20, broken);
    return run_print(pictures, plan, machine, *link, *sink, *clock, state, options, {});
  }
  std::vector<std::string> journal() const {
    std::vector<std::string> what;
    std::ifstream in(state.file("journal.jsonl"));
    for (std::string line; std::getline(in, line);) {
      what.push_back(nlohmann::json::parse(line).value("what", ""));
    }
    return what;
  }
  /// Lamps at 0 with the stage going on, before the first stop.
  void expect_order() const {
    const auto& sent = link->sent;
    std::size_t stop = 0;
    while (stop < sent.size() && sent[stop].command != Command::stop) ++stop;
    ASSERT_LT(stop, sent.size());
    ASSERT_GT(stop, 0U);
    EXPECT_EQ(sent[stop - 1].command, Command::run);
    EXPECT_EQ(sent[stop - 1].blue_share, 0);
    for (std::size_t i = stop; i < sent.size(); ++i) EXPECT_EQ(sent[i].blue_share, 0);
  }

  TemporaryFolder folder;
  Machine machine;
  PrintPlan plan;
  StateFolder state;
  RunOptions options;
  std::unique_ptr<PrinterModel> model;
  std::unique_ptr<BridgeClock> clock;
  std::unique_ptr<ModelLink> link;
  std::unique_ptr<ModelSink> sink;
};

TEST_F(RunPrint, EndsWellAndLeavesItsRecord) {
  const Ending end = run();
  EXPECT_EQ(end.fault, Fault::none) << end.detail;
  EXPECT_EQ(end.phase, Phase::done);
  EXPECT_EQ(end.frames_shown, 20);
  EXPECT_FALSE(end.latched);
  EXPECT_EQ(end.trouble, "");
  const auto events = journal();
  EXPECT_EQ(events.front(), kJournalBegin);
  EXPECT_EQ(events.back(), kJournalEnd);
  EXPECT_FALSE(read_latch(state, false));
  std::ifstream csv(state.file("frames.csv"));
  int rows = -1;
  for (std::string line; std::getline(csv, line);) ++rows;
  EXPECT_EQ(rows, 20);
}

TEST_F(RunPrint, ExceptionsEndInTheOrder) {
  // Once: the controller gives the order.
  Ending end = run([](ModelLink& l, ModelSink&) { l.throws_once = 300; });
  EXPECT_EQ(end.fault, Fault::defect);
  EXPECT_THAT(end.detail, HasSubstr("once"));
  EXPECT_TRUE(end.latched);
  EXPECT_TRUE(model->lamps_dark());
  EXPECT_EQ(model->display().number, -1);
  expect_order();
  // The sink, as a defect and as a device.
  end = run([](ModelLink&, ModelSink& s) { s.throws_at = 8; });
  EXPECT_EQ(end.fault, Fault::defect);
  EXPECT_TRUE(model->lamps_dark());
  expect_order();
  end = run([](ModelLink&, ModelSink& s) { s.gone_at = 8; });
  EXPECT_EQ(end.fault, Fault::display_gone);
  EXPECT_TRUE(model->lamps_dark());
  EXPECT_GT(sink->blacks, 0);
  expect_order();
  // A frame that can't be made.
  end = run({}, 17);
  EXPECT_EQ(end.fault, Fault::defect);
  EXPECT_THAT(end.detail, HasSubstr("17"));
  expect_order();
  EXPECT_EQ(read_latch(state, false)->fault, Fault::defect);
  // Before anything moves it is only said.
  EXPECT_THROW(run({}, 3), InputError);
}

TEST_F(RunPrint, ALinkThatAlwaysThrowsIsGivenTheOrderAllTheSame) {
  const Ending end = run([](ModelLink& l, ModelSink&) { l.throws_from = 300; });
  EXPECT_EQ(end.fault, Fault::defect);
  EXPECT_EQ(end.phase, Phase::failed);
  EXPECT_TRUE(end.latched);
  ASSERT_GE(link->sent.size(), 300U);
  EXPECT_EQ(link->sent.back().command, Command::stop);
  expect_order();
  EXPECT_GT(sink->blacks, 0);
}

TEST_F(RunPrint, StopIsTheOrderToo) {
  std::atomic<bool> stop{true};
  options.stop = &stop;
  const Ending end = run();
  EXPECT_EQ(end.fault, Fault::stopped_by_user);
  EXPECT_FALSE(end.latched) << "nothing had moved";
}

TEST_F(RunPrint, InRealTimeWithThreads) {
  options.lockstep = false;
  machine.limits.heartbeat_timeout_s = 10;
  machine.limits.max_late_um = 500;
  machine.stage.tolerance_um = 400;
  machine.stage.travel_um = 1200;
  machine.uv.warm_up_s = 0;
  model = std::make_unique<PrinterModel>(machine, std::vector<SimFault>{}, 50, 1);
  clock = make_real_clock();
  link = std::make_unique<ModelLink>(*model, machine, *clock);
  const auto display = make_null_sink(*clock);
  const Pictures pictures(20);
  // Somebody asks all the time.
  std::atomic<bool> over{false};
  int asked = 0;
  std::thread asker([&] {
    while (!over) {
      if (const auto answer = ask_running(state, "status")) {
        EXPECT_TRUE(nlohmann::json::parse(*answer, nullptr, false).is_object());
        ++asked;
      }
      ask_running(state, "pause");  // refused: lamps don't follow
    }
  });
  const Ending end =
      run_print(pictures, plan, machine, *link, *display, *clock, state, options, {});
  over = true;
  asker.join();
  EXPECT_EQ(end.fault, Fault::none) << end.detail;
  EXPECT_EQ(end.frames_shown, 20);
  EXPECT_GT(asked, 10);
  EXPECT_FALSE(ask_running(state, "status"));
}

// ---- record ----

TEST_F(RunPrint, APrintThatWasKilledLatches) {
  EXPECT_FALSE(read_latch(state, false));
  {
    Journal journal(state.file("journal.jsonl"));
    journal.add({0, kJournalBegin, "part.uvj", -1, 0}, true);
    journal.add({1, "phase printing", "", 3, 200}, true);
  }
  {
    // The power failed while a line was written.
    std::ofstream out(state.file("journal.jsonl"), std::ios::app);
    out << R"({"time":"2024-01-01T00:00:00Z","what":"print en)";
  }
  {
    const PrintLock printing(state);
    EXPECT_FALSE(read_latch(state, false)) << "it prints";
    EXPECT_TRUE(PrintLock::held(state));
    EXPECT_THROW(PrintLock{state}, InputError);
  }
  EXPECT_FALSE(PrintLock::held(state));
  const auto latch = read_latch(state, false);
  ASSERT_TRUE(latch);
  EXPECT_THAT(latch->detail, HasSubstr("phase printing"));
  EXPECT_EQ(latch->stack, "part.uvj");
  EXPECT_EQ(latch->frame, 3);
  EXPECT_EQ(latch->stage_um, 200);
  clear_latch(state);
  EXPECT_FALSE(read_latch(state, false));
}

TEST_F(RunPrint, LatchesAreKept) {
  write_latch(state, {Fault::lamp_mismatch, "too \"bright\"", "a.uvj", 12, 600.5});
  const auto latch = read_latch(state, true);
  ASSERT_TRUE(latch);
  EXPECT_EQ(latch->fault, Fault::lamp_mismatch);
  EXPECT_EQ(latch->detail, "too \"bright\"");
  EXPECT_EQ(latch->frame, 12);
  EXPECT_EQ(latch->stage_um, 600.5);
  // One that can't be read still latches.
  std::ofstream(state.file("latch.json")) << "{";
  EXPECT_TRUE(read_latch(state, true));
  clear_latch(state);
  EXPECT_FALSE(read_latch(state, true));
}

TEST(StateFolders, NamesThatAreNoFolders) {
  const TemporaryFolder folder;
  Printer printer;
  for (const char* name : {"", "..", ".hidden", "a/b"}) {
    printer.name = name;
    EXPECT_THROW(StateFolder::of(folder.path(), printer), InputError) << name;
  }
}

}  // namespace
}  // namespace slicecorr::bridge
