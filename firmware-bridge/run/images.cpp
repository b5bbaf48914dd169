// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

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

void ImageNewsBox::add(const FrameReport& report) {
  const std::scoped_lock lock(mutex_);
  news_.reports.push_back(report);
}

void ImageNewsBox::fault(Fault what, const std::string& detail) {
  const std::scoped_lock lock(mutex_);
  if (news_.fault != Fault::none) return;
  news_.fault = what;
  news_.detail = detail;
}

ImageNews ImageNewsBox::take() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(news_, {});
}

Images::Images(FrameRing& ring, FrameSink& sink, BridgeClock& clock, ImageNewsBox& news,
               bool lockstep, bool uv_display)
    : ring_(ring),
      sink_(sink),
      clock_(clock),
      news_(news),
      lockstep_(lockstep),
      uv_display_(uv_display) {
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

std::optional<double> Images::next_s() const {
  return request_ ? std::optional(request_->at_s) : std::nullopt;
}

void Images::show_next() { show_one(*std::exchange(request_, {})); }

void Images::tick(double at_s) {
  try {
    sink_.tick(at_s);
  } catch (const std::exception& e) {
    fault(Fault::display_gone, e.what());
  }
}

void Images::fault(Fault what, const std::string& detail) {
  news_.fault(what, (uv_display_ ? "the UV display: " : "") + detail);
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
      if (!frame) return news_.add({request.number, clock_.now_s(), true, {}, uv_display_});
      if (uv_display_) frame = frame->on_uv_display;
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
    news_.add({shown.number, shown.at_s, false, shown.times, uv_display_});
  } catch (const DeviceError& e) {
    fault(Fault::display_gone, e.what());
  } catch (const std::exception& e) {
    fault(Fault::defect, e.what());
  }
}

}  // namespace slicecorr::bridge
