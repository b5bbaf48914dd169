// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The sink that shows images in a window: a thread of its own, because SDL2 belongs to one thread,
// and because that thread must not come back when the display server dies.

#include "display/window_sink.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <thread>
#include <utility>

#include "display/pixels.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"
#include "support/files/shared_object.hpp"

namespace slicecorr::bridge {
namespace {

using namespace detail;
using SteadyClock = std::chrono::steady_clock;
using std::chrono::duration;

/// For opening, showing and black; how often the window is looked at meanwhile.
constexpr double kOpenS = 10, kShowS = 2, kWindowBlackS = 1;
constexpr std::chrono::milliseconds kLookEvery{10};

double seconds_since(SteadyClock::time_point start) {
  return duration<double>(SteadyClock::now() - start).count();
}

/// At the end of the process libraries want locks that a thread holds which never comes back
/// (OpenGL those of Xlib), and would wait for them for ever.
void end_without_libraries(int status, void*) {
  std::fflush(nullptr);
  ::_exit(status);
}

enum class Task { none, upload, present, black, end };

/// Shared with the window's thread, which outlives the sink when it hangs.
struct Desk {
  std::mutex mutex;
  std::condition_variable asked, done;
  Task task = Task::none;
  bool busy = true;    ///< from asking until it is done; first with opening
  bool ended = false;  ///< the thread has nothing more to do
  bool dead = false;   ///< it will not come back
  std::shared_ptr<const Frame> frame;
  Projector channels;
  int width_px = 0, height_px = 0;
  WindowFound found;
  std::string trouble;  ///< first reason for which the window no longer counts
  double took_s = 0;    ///< for the last task

  void died(const std::string& why) {
    const std::scoped_lock lock(mutex);
    dead = true;
    if (trouble.empty()) trouble = why;
    done.notify_all();
  }
};

std::string upload(Window& window, Desk& desk, const Frame* frame) {
  Window::Pixels pixels;
  if (std::string wrong = window.begin(pixels); !wrong.empty()) return wrong;
  pack(frame, desk.channels, desk.width_px, desk.height_px, pixels.first, pixels.pitch_px);
  return window.finish();
}

std::string do_task(Task task, Window& window, Desk& desk) {
  std::string wrong;
  switch (task) {
    case Task::upload:
      return upload(window, desk, desk.frame.get());
    case Task::present:
      return window.present();
    case Task::black:
    case Task::end:
      wrong = upload(window, desk, nullptr);
      return wrong.empty() ? window.present() : wrong;
    case Task::none:
      break;
  }
  return "";
}

using Open = std::function<std::unique_ptr<Window>(const WindowWanted&, WindowFound&)>;

void work(const std::shared_ptr<Desk>& desk, const Open& open, const WindowWanted& wanted) {
  WindowFound found;
  std::unique_ptr<Window> window = open(wanted, found);
  std::unique_lock lock(desk->mutex);
  desk->found = found;
  while (window) {
    // What was asked while it looked after its window is still to do.
    if (desk->task == Task::none) {
      desk->busy = false;
      desk->done.notify_all();
    }
    desk->asked.wait_for(lock, kLookEvery, [&] { return desk->task != Task::none; });
    const Task task = std::exchange(desk->task, Task::none);
    lock.unlock();
    const auto start = SteadyClock::now();
    std::string wrong;
    try {
      wrong = do_task(task, *window, *desk);
      if (wrong.empty() && task != Task::end) wrong = window->check();
    } catch (const std::exception& e) {
      wrong = e.what();
    }
    const double took_s = seconds_since(start);
    if (task == Task::end) window.reset();
    lock.lock();
    if (task != Task::none) desk->took_s = took_s;
    if (desk->trouble.empty()) desk->trouble = wrong;
  }
  desk->busy = false;
  desk->ended = true;
  desk->done.notify_all();
}

class WindowSink final : public FrameSink {
 public:
  WindowSink(const std::string& display, const Machine& machine, BridgeClock& clock,
             const Open& open)
      : clock_(clock), desk_(std::make_shared<Desk>()) {
    const std::string name = display.empty() ? machine.projector.output : display;
    desk_->channels = machine.projector;
    WindowWanted wanted;
    wanted.display = name;
    wanted.width_px = desk_->width_px = machine.printer.width_px;
    wanted.height_px = desk_->height_px = machine.printer.height_px;
    wanted.died = [desk = std::weak_ptr(desk_)](const std::string& why) {
      if (const auto alive = desk.lock()) alive->died(why);
    };
    thread_ = std::thread([desk = desk_, open, wanted] { work(desk, open, wanted); });
    std::unique_lock lock(desk_->mutex);
    desk_->done.wait_for(lock, duration<double>(kOpenS),
                         [&] { return !desk_->busy || desk_->dead; });
    words_ = desk_->found.words;
    const std::string named = "window" + (name.empty() ? "" : ":" + name);
    const WindowFound found = desk_->found;
    const std::string trouble = !found.wrong.empty()      ? found.wrong
                                : !desk_->trouble.empty() ? desk_->trouble
                                : desk_->busy             ? "the display server does not answer"
                                                          : "";
    lock.unlock();
    if (trouble.empty()) return;
    leave();
    if (found.input) throw InputError(named, "", trouble);
    throw DeviceError(named + ": " + trouble);
  }
  ~WindowSink() override {
    try {
      run(Task::end, kWindowBlackS);
    } catch (...) {
      // Lamps are off by now; black is what there still was to try.
    }
    leave();
  }

  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    take_priority();
    expect_well();
    Shown shown;
    shown.number = frame ? frame->number : kBlackFrame;
    shown.times.upload_s = run(Task::upload, kShowS, frame);
    expect_well();
    clock_.sleep_until(at_s);
    shown.times.present_s = run(Task::present, kShowS);
    expect_well();
    shown.at_s = std::max(at_s, clock_.now_s());
    shown.count = ++count_;
    return shown;
  }

  void black() noexcept override {
    try {
      run(Task::black, kWindowBlackS);
      ++count_;
    } catch (...) {
      // Lamps are off by now, and the display may be what failed.
    }
  }

  void check() override { expect_well(); }
  std::string describe() const override { return words_; }

 private:
  /// Has the window's thread do it; how long that took. Throws when it does not come to an end.
  double run(Task task, double limit_s, std::shared_ptr<const Frame> frame = {}) {
    std::unique_lock lock(desk_->mutex);
    if (desk_->ended) throw DeviceError(words_ + " is closed");
    if (desk_->busy) throw DeviceError(words_ + ": " + desk_->trouble);
    desk_->task = task;
    desk_->frame = std::move(frame);
    desk_->busy = true;
    desk_->asked.notify_all();
    // A window that was moved or covered is still given its image, black above all.
    const bool answered = desk_->done.wait_for(lock, duration<double>(limit_s),
                                               [&] { return !desk_->busy || desk_->dead; });
    if (!answered && desk_->trouble.empty()) {
      desk_->trouble = fmt::format("the display server has not answered for {:g} s", limit_s);
    }
    if (!answered || desk_->dead) throw DeviceError(words_ + ": " + desk_->trouble);
    return desk_->took_s;
  }
  void expect_well() {
    const std::scoped_lock lock(desk_->mutex);
    if (!desk_->trouble.empty()) throw DeviceError(words_ + ": " + desk_->trouble);
  }
  /// The window's thread must not be slower than who waits for it.
  void take_priority() {
    // Asked of the kernel: glibc remembers what it saw first.
    sched_param parameters{};
    const int policy = sched_getscheduler(0);
    if (policy < 0 || sched_getparam(0, &parameters) != 0) return;
    if (parameters.sched_priority == priority_) return;
    priority_ = parameters.sched_priority;
    pthread_setschedparam(thread_.native_handle(), policy & ~SCHED_RESET_ON_FORK, &parameters);
  }
  void leave() {
    std::unique_lock lock(desk_->mutex);
    const bool ended = desk_->ended;
    lock.unlock();
    if (ended) return thread_.join();
    // It hangs, or waits for ever.
    thread_.detach();
    static std::once_flag once;
    std::call_once(once, [] { on_exit(end_without_libraries, nullptr); });
  }

  BridgeClock& clock_;
  const std::shared_ptr<Desk> desk_;
  std::thread thread_;
  std::string words_;
  int priority_ = 0;
  std::int64_t count_ = 0;
};

}  // namespace

std::unique_ptr<FrameSink> detail::make_window_sink(const std::string& display,
                                                    const Machine& machine, BridgeClock& clock,
                                                    const Open& open) {
  return std::make_unique<WindowSink>(display, machine, clock, open);
}

std::unique_ptr<FrameSink> make_window_sink(const std::string& display, const Machine& machine,
                                            BridgeClock& clock) {
  const auto open = reinterpret_cast<OpenWindow>(
      slicecorr::detail::module_entry("slicecorr-window.so", kWindowModuleEntry, "opens windows"));
  return detail::make_window_sink(
      display, machine, clock,
      [open](const detail::WindowWanted& wanted, detail::WindowFound& found) {
        return std::unique_ptr<detail::Window>(open(wanted, found));
      });
}

}  // namespace slicecorr::bridge
