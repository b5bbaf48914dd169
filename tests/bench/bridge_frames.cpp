// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How many frames a second each step from a stack to a display sustains, beside copying memory,
// measured in the same run. Not timed asserts: numbers to read.
//
// A frame a second counts what a step takes by itself, on one thread. Decoding runs on threads of
// the ring, beside the rest; packing, upload and present follow each other on the display's thread.
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <thread>

#include "display/drm_sink.hpp"
#include "display/pixels.hpp"
#include "drm_substitute.hpp"
#include "frames/wire.hpp"
#include "lattice.hpp"
#include "models.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"

namespace {

using namespace slicecorr;
using namespace slicecorr::bridge;

struct Size {
  int width_px, height_px;
  int cells_x, cells_y;  ///< of the lattice that fills most of the display
};
constexpr std::array<Size, 2> kSizes{{{1280, 800, 11, 7}, {3840, 2400, 36, 22}}};

const Size& size_of(const benchmark::State& state) {
  return kSizes.at(static_cast<std::size_t>(state.range(0)));
}

Machine machine_of(const Size& size) {
  Machine m;
  m.printer = test::linear_printer(1, 100);
  m.printer.width_px = size.width_px;
  m.printer.height_px = size.height_px;
  return m;
}

/// A corrected stack of 100 slices, as a file in the folder for scratch; gone with the program.
class Stack {
 public:
  explicit Stack(const Size& size)
      : path_(std::filesystem::temp_directory_path() /
              ("slicecorr-bench-" + std::to_string(::getpid()) + "-" +
               std::to_string(size.width_px) + ".uvj")) {
    const Machine machine = machine_of(size);
    const Printer& printer = machine.printer;
    const MeshSlices target(test::lattice(size.cells_x, size.cells_y, 1, 5, 0.4), printer,
                            SliceOptions{});
    correct_stack(target, {printer, test::resin(230, 1500), test::process(800)}, path_.string(),
                  {});
    reader_ = std::make_unique<StackReader>(path_.string(), path_.parent_path().string());
    frames_ = make_frame_source(*reader_, machine, false);
  }
  ~Stack() { std::filesystem::remove(path_); }
  const FrameSource& frames() const { return *frames_; }
  static const Stack& of(const Size& size) {
    static std::map<int, std::unique_ptr<Stack>> all;
    auto& stack = all[size.width_px];
    if (!stack) stack = std::make_unique<Stack>(size);
    return *stack;
  }
  std::vector<std::shared_ptr<const Frame>> some() const {
    std::vector<std::shared_ptr<const Frame>> all;
    for (int n = 40; n < 48; ++n) all.push_back(frames_->make(n));
    return all;
  }

 private:
  std::filesystem::path path_;
  std::unique_ptr<StackReader> reader_;
  std::unique_ptr<FrameSource> frames_;
};

/// Bytes copied a second, of pictures far larger than caches; the best of some.
double copied_per_s() {
  static const double best = [] {
    std::vector<char> from(128 << 20, 1), to(128 << 20, 2);
    double rate = 0;
    for (int i = 0; i < 30; ++i) {
      const auto start = std::chrono::steady_clock::now();
      std::memcpy(to.data(), from.data(), from.size());
      benchmark::DoNotOptimize(to.data());
      const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
      rate = std::max(rate, static_cast<double>(from.size()) / took.count());
    }
    return rate;
  }();
  return best;
}

/// `bytes`: written for a frame.
void count(benchmark::State& state, double bytes) {
  const auto frames = static_cast<double>(state.iterations());
  state.counters["frames/s"] = benchmark::Counter(frames, benchmark::Counter::kIsRate);
  state.counters["of_memcpy"] =
      benchmark::Counter(frames * bytes / copied_per_s(), benchmark::Counter::kIsRate);
  const Size& size = size_of(state);
  state.SetLabel(std::to_string(size.width_px) + "x" + std::to_string(size.height_px));
}

double pixels(const Size& size) { return 1.0 * size.width_px * size.height_px; }

void copy(benchmark::State& state) {
  const Size& size = size_of(state);
  const auto bytes = static_cast<std::size_t>(pixels(size)) * 4;
  std::vector<char> from(bytes, 1), to(bytes, 2);
  for (auto _ : state) {
    std::memcpy(to.data(), from.data(), bytes);
    benchmark::DoNotOptimize(to.data());
  }
  count(state, static_cast<double>(bytes));
}
BENCHMARK(copy)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// From the archive: PNG, checksum.
void decode(benchmark::State& state) {
  const Size& size = size_of(state);
  const FrameSource& frames = Stack::of(size).frames();
  int n = 0;
  for (auto _ : state) {
    const auto frame = frames.make(n++ % frames.frames());
    benchmark::DoNotOptimize(frame->crc32);
  }
  count(state, pixels(size));
}
BENCHMARK(decode)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Through the ring, with as many threads.
void decode_ahead(benchmark::State& state) {
  const Size& size = size_of(state);
  class Endless final : public FrameSource {
   public:
    explicit Endless(const FrameSource& of) : of_(of) {}
    int frames() const override { return 1 << 30; }
    std::shared_ptr<const Frame> make(int n) const override { return of_.make(n % of_.frames()); }
    std::size_t frame_bytes() const override { return of_.frame_bytes(); }

   private:
    const FrameSource& of_;
  } endless(Stack::of(size).frames());
  FrameRing ring(endless, 16, static_cast<int>(state.range(1)));
  int n = 0;
  for (auto _ : state) {
    ring.wait_ready(n, 1);
    if (!ring.take(n++)) throw Error("the ring lost a frame");
  }
  count(state, pixels(size));
}
BENCHMARK(decode_ahead)
    ->ArgsProduct({{0, 1}, {1, 2}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Into 32 bits to a pixel, in memory.
void pack_frame(benchmark::State& state) {
  const Size& size = size_of(state);
  const auto frames = Stack::of(size).some();
  std::vector<std::uint32_t> out(static_cast<std::size_t>(pixels(size)));
  std::size_t n = 0;
  for (auto _ : state) {
    pack(frames[n++ % frames.size()].get(), {}, size.width_px, size.height_px, out.data(),
         static_cast<std::size_t>(size.width_px));
    benchmark::DoNotOptimize(out.data());
  }
  count(state, 4 * pixels(size));
}
BENCHMARK(pack_frame)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Blue in one channel, UV in another.
void pack_blue_and_uv(benchmark::State& state) {
  const Size& size = size_of(state);
  auto frames = Stack::of(size).some();
  for (auto& frame : frames) {
    auto both = std::make_shared<Frame>(*frame);
    both->uv = both->blue;
    frame = both;
  }
  std::vector<std::uint32_t> out(static_cast<std::size_t>(pixels(size)));
  std::size_t n = 0;
  for (auto _ : state) {
    pack(frames[n++ % frames.size()].get(), {Channel::blue, Channel::red, ""}, size.width_px,
         size.height_px, out.data(), static_cast<std::size_t>(size.width_px));
    benchmark::DoNotOptimize(out.data());
  }
  count(state, 4 * pixels(size));
}
BENCHMARK(pack_blue_and_uv)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// All of what a sink does for a frame that is due.
void show_all(benchmark::State& state, FrameSink& sink) {
  const Size& size = size_of(state);
  const auto frames = Stack::of(size).some();
  std::size_t n = 0;
  double upload_s = 0, present_s = 0;
  for (auto _ : state) {
    const Shown shown = sink.show(frames[n++ % frames.size()], 0);
    upload_s += shown.times.upload_s;
    present_s += shown.times.present_s;
  }
  const auto average = [](double sum) {
    return benchmark::Counter(sum * 1e3, benchmark::Counter::kAvgIterations);
  };
  state.counters["upload_ms"] = average(upload_s);
  state.counters["present_ms"] = average(present_s);
  count(state, 4 * pixels(size));
}

/// Ends with this program.
class Xvfb {
 public:
  explicit Xvfb(const Size& size) {
    int out[2];
    if (::pipe2(out, O_CLOEXEC) != 0) return;
    const std::string screen =
        std::to_string(size.width_px) + "x" + std::to_string(size.height_px) + "x24";
    child_ = ::fork();
    if (child_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::dup2(out[1], STDOUT_FILENO);
      const int nothing = ::open("/dev/null", O_WRONLY);
      ::dup2(nothing, STDERR_FILENO);
      ::execl("/usr/bin/Xvfb", "Xvfb", "-displayfd", "1", "-screen", "0", screen.c_str(),
              "-nolisten", "tcp", nullptr);
      ::_exit(127);
    }
    ::close(out[1]);
    char c = 0;
    while (::read(out[0], &c, 1) == 1 && c != '\n') name_ += c;
    ::close(out[0]);
    if (!name_.empty()) ::setenv("DISPLAY", (":" + name_).c_str(), 1);
  }
  ~Xvfb() {
    ::kill(child_, SIGTERM);
    ::waitpid(child_, nullptr, 0);
  }
  bool runs() const { return !name_.empty(); }

 private:
  pid_t child_ = 0;
  std::string name_;
};

void window(benchmark::State& state) {
  const Xvfb server(size_of(state));
  if (!server.runs()) return state.SkipWithError("Xvfb is not installed");
  const auto clock = make_real_clock();
  const auto sink = make_window_sink("", machine_of(size_of(state)), *clock);
  show_all(state, *sink);
}
BENCHMARK(window)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Page flips of a card whose vertical blanks cost no time: what is left is ours.
void drm_stand_in(benchmark::State& state) {
  const Size& size = size_of(state);
  test::DrmCard card;
  bridge::detail::DrmConnector connector;
  connector.id = 1;
  connector.name = "HDMI-A-1";
  connector.connected = true;
  connector.modes = {test::drm_mode(size.width_px, size.height_px, 60)};
  connector.crtcs = {1};
  card.connectors = {connector};
  test::CardClock clock(card);
  const auto sink = bridge::detail::make_drm_sink(std::make_unique<test::SubstituteDrm>(card), "",
                                                  machine_of(size), clock);
  show_all(state, *sink);
  // Its times are those of the card's own clock.
  state.counters.erase("upload_ms");
  state.counters.erase("present_ms");
}
BENCHMARK(drm_stand_in)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

/// To another program on this computer that checks and answers: both ends' checksums.
void wire(benchmark::State& state) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("slicecorr-bench-" + std::to_string(::getpid()) + ".socket");
  const std::string address = "unix:" + path.string();
  const WireListener listener = listen_wire(address);
  std::thread display([&] {
    const WireSocket client(::accept(listener.socket.get(), nullptr, nullptr));
    WireMessage message;
    std::int64_t shown = 0;
    while (receive_message(client, message, -1)) {
      WireMessage answer;
      answer.kind = WireKind::answer;
      answer.number = message.number;
      answer.count = ++shown;
      send_message(client, answer, 2);
    }
  });
  {
    const auto clock = make_real_clock();
    WireHello hello;
    hello.setup = {machine_of(size_of(state)).printer, test::resin(230, 1500), test::process(800)};
    hello.layer_um = 50;
    hello.slices = hello.target_layers = 100;
    const auto sink = make_wire_sink(address, hello, *clock);
    const auto frames = Stack::of(size_of(state)).some();
    std::size_t n = 0;
    for (auto _ : state) sink->show(frames[n++ % frames.size()], 0);
  }
  display.join();
  std::filesystem::remove(path);
  count(state, pixels(size_of(state)));
}
BENCHMARK(wire)->DenseRange(0, 1)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
