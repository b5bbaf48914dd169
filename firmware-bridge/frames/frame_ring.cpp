// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "frames/turned_image.hpp"
#include "frames/vector_state.hpp"
#include "frames/wire.hpp"
#include "slicecorr/bridge/frames.hpp"
#include "support/process/threads.hpp"

namespace slicecorr::bridge {

std::vector<std::uint8_t> turned_image(std::vector<std::uint8_t> image, const Turn& turn,
                                       int width_px, int height_px) {
  if (turn.is_identity()) return image;
  std::vector<std::uint8_t> out(image.size());
  const std::uint8_t* from = image.data();
  const int row_px = turn.swap_axes ? height_px : width_px;
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      const Pixel to = turned(Pixel{x, y}, turn, width_px, height_px);
      out[static_cast<std::size_t>(to.y) * static_cast<std::size_t>(row_px) +
          static_cast<std::size_t>(to.x)] = *from++;
    }
  }
  return out;
}

namespace {

class StackFrames final : public FrameSource {
 public:
  StackFrames(const StackReader& stack, const Machine& machine, bool uv_patterned)
      : stack_(stack),
        images_uv_(uv_patterned),
        shows_uv_(uv_patterned || (machine.printer.uv && machine.printer.uv->patterned)),
        blue_(stack, machine.printer) {
    if (machine.uv_display) uv_.emplace(stack, uv_display_machine(machine).printer);
  }
  int frames() const override { return stack_.grid().layers; }
  std::size_t frame_bytes() const override { return pixels() * (shows_uv_ ? 2 : 1); }
  std::shared_ptr<const Frame> make(int number) const override {
    auto frame = std::make_shared<Frame>(empty(number, blue_));
    frame->blue = image(number, false, blue_);
    if (shows_uv_ && !uv_) frame->uv = image(number, true, blue_);
    frame->crc32 = crc32_of(*frame);
    if (uv_) {
      auto other = std::make_shared<Frame>(empty(number, *uv_));
      other->blue = image(number, true, *uv_);
      other->crc32 = crc32_of(*other);
      frame->on_uv_display = std::move(other);
    }
    return frame;
  }

 private:
  /// How a display turns the stack's images.
  struct Shown {
    Turn turn;
    Grid grid;
    Shown(const StackReader& stack, const Printer& printer)
        : turn(turn_to_display(image_frame(stack.info()), printer)),
          grid(turned(stack.grid(), turn)) {}
  };
  std::size_t pixels() const {
    return static_cast<std::size_t>(blue_.grid.width_px) *
           static_cast<std::size_t>(blue_.grid.height_px);
  }
  static Frame empty(int number, const Shown& shown) {
    Frame frame;
    frame.number = number;
    frame.width_px = shown.grid.width_px;
    frame.height_px = shown.grid.height_px;
    return frame;
  }
  std::vector<std::uint8_t> image(int number, bool uv, const Shown& shown) const {
    std::vector<std::uint8_t> image(pixels());
    if (uv && !images_uv_) return image;
    if (uv) {
      stack_.read_uv_slice(number, image.data());
    } else {
      stack_.read_slice(number, image.data());
    }
    slicecorr::detail::clear_vector_state();
    return turned_image(std::move(image), shown.turn, stack_.grid().width_px,
                        stack_.grid().height_px);
  }

  const StackReader& stack_;
  const bool images_uv_, shows_uv_;  ///< the stack has UV images; some display shows such
  const Shown blue_;
  std::optional<Shown> uv_;
};

class JobFrames final : public FrameSource {
 public:
  JobFrames(const tomo::TomoFrames& job, int turns, const Printer& printer)
      : job_(job),
        turns_(turns),
        turn_(turn_from_plate(printer.orientation.value_or(Orientation{}))),
        bytes_(static_cast<std::size_t>(printer.width_px) *
               static_cast<std::size_t>(printer.height_px)) {}
  int frames() const override { return turns_ * job_.angles(); }
  std::size_t frame_bytes() const override { return bytes_; }
  std::shared_ptr<const Frame> make(int number) const override {
    GreyImage image = job_.read(number % job_.angles());
    slicecorr::detail::clear_vector_state();
    auto frame = std::make_shared<Frame>();
    frame->number = number;
    frame->width_px = image.width_px;
    frame->height_px = image.height_px;
    frame->blue = turned_image(std::move(image.pixels), turn_, image.width_px, image.height_px);
    frame->crc32 = crc32_of(*frame);
    return frame;
  }

 private:
  const tomo::TomoFrames& job_;
  const int turns_;
  const Turn turn_;
  const std::size_t bytes_;
};

}  // namespace

std::unique_ptr<FrameSource> make_frame_source(const tomo::TomoFrames& job, int turns,
                                               const Printer& printer) {
  return std::make_unique<JobFrames>(job, turns, printer);
}

std::unique_ptr<FrameSource> make_frame_source(const StackReader& stack, const Machine& machine,
                                               bool uv_patterned) {
  return std::make_unique<StackFrames>(stack, machine, uv_patterned);
}

struct FrameRing::Impl {
  const FrameSource& source;
  const int frames, most;
  mutable std::mutex mutex;
  std::condition_variable room, made;
  struct Slot {
    std::shared_ptr<const Frame> frame;
    std::exception_ptr error;
    bool ready() const { return frame || error; }
  };
  std::deque<Slot> slots;  ///< of frames first, first + 1 ...
  int first = 0, next = 0;
  std::atomic<int> ready{0};  ///< slots with a frame: who asks must not hold up who shows
  bool ending = false;
  std::vector<std::thread> threads;

  Impl(const FrameSource& s, int ring)
      : source(s), frames(s.frames()), most(room_for(s.frame_bytes(), std::max(ring, 1))) {}

  static int room_for(std::size_t frame_bytes, int ring) {
    constexpr int least = 3;
    if (frame_bytes == 0 || ring <= least) return ring;
    const auto fit = FrameRing::kMostBytes / frame_bytes;
    return static_cast<int>(std::clamp<std::size_t>(fit, least, static_cast<std::size_t>(ring)));
  }

  void work() {
    std::unique_lock lock(mutex);
    while (true) {
      room.wait(lock, [&] { return ending || (next < frames && next < first + most); });
      if (ending) return;
      const int number = next++;
      slots.resize(static_cast<std::size_t>(next - first));
      lock.unlock();
      Slot slot;
      try {
        slot.frame = source.make(number);
      } catch (...) {
        slot.error = std::current_exception();
      }
      lock.lock();
      if (number >= first) {
        if (slot.frame) ++ready;
        slots[static_cast<std::size_t>(number - first)] = std::move(slot);
      }
      made.notify_all();
    }
  }

  Slot* slot(int number) {
    const int at = number - first;
    return at >= 0 && at < static_cast<int>(slots.size()) ? &slots[static_cast<std::size_t>(at)]
                                                          : nullptr;
  }
};

FrameRing::FrameRing(const FrameSource& source, int ring, int threads)
    : impl_(std::make_unique<Impl>(source, ring)) {
  impl_->threads =
      slicecorr::detail::start_threads(std::max(threads, 1), [this] { impl_->work(); });
}

FrameRing::~FrameRing() {
  {
    const std::scoped_lock lock(impl_->mutex);
    impl_->ending = true;
  }
  impl_->room.notify_all();
  for (std::thread& t : impl_->threads) t.join();
}

std::shared_ptr<const Frame> FrameRing::take(int number) {
  const std::scoped_lock lock(impl_->mutex);
  Impl& s = *impl_;
  while (s.first < number && !s.slots.empty()) {
    if (s.slots.front().frame) --s.ready;
    s.slots.pop_front();
    ++s.first;
  }
  s.room.notify_all();
  Impl::Slot* const slot = s.slot(number);
  if (slot == nullptr) return nullptr;
  if (slot->error) std::rethrow_exception(slot->error);
  return slot->frame;
}

void FrameRing::wait_ready(int number, int count) {
  std::unique_lock lock(impl_->mutex);
  Impl& s = *impl_;
  const int until = std::min({number + count, s.frames, s.first + s.most});
  for (int n = number; n < until; ++n) {
    s.made.wait(lock, [&] {
      const Impl::Slot* const slot = s.slot(n);
      return slot != nullptr && slot->ready();
    });
    if (s.slot(n)->error) std::rethrow_exception(s.slot(n)->error);
  }
}

int FrameRing::ready() const { return impl_->ready; }

int FrameRing::capacity() const { return impl_->most; }

}  // namespace slicecorr::bridge
