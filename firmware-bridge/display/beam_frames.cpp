// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/beam_frames.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "display/several_sinks.hpp"
#include "frames/turned_image.hpp"
#include "frames/vector_state.hpp"
#include "frames/wire.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

std::shared_ptr<const Frame> frame_of(const GreyImage& image, const Printer& printer) {
  auto frame = std::make_shared<Frame>();
  frame->number = 0;
  frame->width_px = image.width_px;
  frame->height_px = image.height_px;
  frame->blue =
      turned_image(image.pixels, turn_from_plate(printer.orientation.value_or(Orientation{})),
                   image.width_px, image.height_px);
  frame->crc32 = crc32_of(*frame);
  return frame;
}

class BeamFrames final : public FrameSource {
 public:
  BeamFrames(const tomo::BeamJob& job, const Printer& printer)
      : first_(frame_of(job.shown.displays.front(), printer)) {}
  int frames() const override { return 1; }
  std::size_t frame_bytes() const override { return first_->blue.size(); }
  std::shared_ptr<const Frame> make(int /*number*/) const override { return first_; }

 private:
  std::shared_ptr<const Frame> first_;
};

/// Each display has an image of its own.
class GroupSink final : public SeveralSinks {
 public:
  GroupSink(std::vector<std::unique_ptr<FrameSink>> sinks, const tomo::BeamJob& job,
            const Printer& printer)
      : SeveralSinks(std::move(sinks)) {
    for (const GreyImage& image : job.shown.displays) images_.push_back(frame_of(image, printer));
  }

  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    const int expected = frame ? frame->number : kBlackFrame;
    Shown last;
    for (std::size_t i = 0; i < sinks_.size(); ++i) {
      const Shown shown = sinks_[i]->show(frame ? images_[i] : nullptr, at_s);
      if (shown.number != expected) {
        throw DeviceError(fmt::format("{} shows image {}, expected {}", sinks_[i]->describe(),
                                      shown.number, expected));
      }
      // All of them show it from when the last one does.
      const double before_s = i > 0 ? last.at_s : shown.at_s;
      if (i == 0) last = shown;
      last.at_s = std::max(before_s, shown.at_s);
    }
    return last;
  }

 private:
  std::vector<std::shared_ptr<const Frame>> images_;
};

}  // namespace

std::unique_ptr<FrameSource> make_frame_source(const tomo::BeamJob& job, const Printer& printer) {
  return std::make_unique<BeamFrames>(job, printer);
}

std::unique_ptr<FrameSink> make_group_sink(std::vector<std::unique_ptr<FrameSink>> sinks,
                                           const tomo::BeamJob& job, const Printer& printer) {
  if (sinks.size() != job.shown.displays.size()) {
    throw InputError(
        fmt::format("the job has images for {} displays, and there are {}; expected a "
                    "--sink for each, in their order",
                    job.shown.displays.size(), sinks.size()));
  }
  return std::make_unique<GroupSink>(std::move(sinks), job, printer);
}

}  // namespace slicecorr::bridge
