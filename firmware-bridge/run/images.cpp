#include "run/images.hpp"

#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "run/priority.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Real-time priority of the thread that shows images: below that of the control thread.
constexpr int kImagePriority = 40;
/// Between looks at a display that has nothing new to show.
constexpr std::chrono::milliseconds kCheckEvery{20};

}  // namespace

Images::Images(FrameRing& ring, FrameSink& sink, BridgeClock& clock, bool lockstep)
    : ring_(ring), sink_(sink), clock_(clock), lockstep_(lockstep) {
  if (!lockstep_) thread_ = std::thread([this] { work(); });
}

Images::~Images() { end(); }

void Images::end() {
  {
    const std::scoped_lock lock(mutex_);
    ending_ = true;
  }
  asked_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void Images::show(int number, double at_s) {
  {
    const std::scoped_lock lock(mutex_);
    request_ = Request{number, at_s};
  }
  asked_.notify_all();
}

void Images::show_due(double until_s) {
  if (!request_ || request_->at_s >= until_s) return;
  show_one(*std::exchange(request_, {}));
}

void Images::tick(double at_s) {
  try {
    sink_.tick(at_s);
  } catch (const std::exception& e) {
    fault(Fault::display_gone, e.what());
  }
}

ImageNews Images::news() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(news_, {});
}

void Images::fault(Fault what, const std::string& detail) {
  const std::scoped_lock lock(mutex_);
  if (news_.fault != Fault::none) return;
  news_.fault = what;
  news_.detail = detail;
}

void Images::work() {
  raise_priority(kImagePriority);
  std::unique_lock lock(mutex_);
  while (true) {
    if (!asked_.wait_for(lock, kCheckEvery, [&] { return ending_ || request_; })) {
      lock.unlock();
      check();
      lock.lock();
      continue;
    }
    if (!request_) return;  // what was asked before the end is still shown
    const Request request = *std::exchange(request_, {});
    lock.unlock();
    show_one(request);
    lock.lock();
  }
}

void Images::check() {
  try {
    sink_.check();
  } catch (const DeviceError& e) {
    fault(Fault::display_gone, e.what());
  } catch (const std::exception& e) {
    fault(Fault::defect, e.what());
  }
}

void Images::show_one(const Request& request) {
  const auto report = [&](const FrameReport& r) {
    const std::scoped_lock lock(mutex_);
    news_.reports.push_back(r);
  };
  try {
    std::shared_ptr<const Frame> frame;
    if (request.number >= 0) {
      if (lockstep_) ring_.wait_ready(request.number, 1);
      frame = ring_.take(request.number);
      // It may still come in time.
      while (!frame && clock_.now_s() < request.at_s) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        frame = ring_.take(request.number);
      }
      if (!frame) return report({request.number, clock_.now_s(), true, {}});
    }
    const Shown shown = sink_.show(frame, request.at_s);
    if (shown.number != request.number || (count_ >= 0 && shown.count != count_ + 1)) {
      fault(Fault::wrong_frame,
            fmt::format("the display shows image {} (no. {} of all), expected {} (no. {})",
                        shown.number, shown.count, request.number, count_ + 1));
      count_ = shown.count;
      return;
    }
    count_ = shown.count;
    report({shown.number, shown.at_s, false, shown.times});
  } catch (const DeviceError& e) {
    fault(Fault::display_gone, e.what());
  } catch (const std::exception& e) {
    fault(Fault::defect, e.what());
  }
}

}  // namespace slicecorr::bridge
