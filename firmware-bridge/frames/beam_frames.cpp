#include "slicecorr/bridge/beam_frames.hpp"

#include <fmt/format.h>

#include <utility>

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

class GroupSink final : public FrameSink {
 public:
  GroupSink(std::vector<std::unique_ptr<FrameSink>> sinks, const tomo::BeamJob& job,
            const Printer& printer)
      : sinks_(std::move(sinks)) {
    for (const GreyImage& image : job.shown.displays) images_.push_back(frame_of(image, printer));
  }

  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    Shown last;
    for (std::size_t i = 0; i < sinks_.size(); ++i) {
      const std::shared_ptr<const Frame> own = frame ? images_[i] : nullptr;
      const Shown shown = sinks_[i]->show(own, at_s);
      const int expected = frame ? frame->number : kBlackFrame;
      if (shown.number != expected) {
        throw DeviceError(fmt::format("{} shows image {}, expected {}", sinks_[i]->describe(),
                                      shown.number, expected));
      }
      // All of them show it from when the last one does.
      if (i == 0) {
        last = shown;
      } else {
        last.at_s = std::max(last.at_s, shown.at_s);
      }
    }
    return last;
  }
  void black() noexcept override {
    for (const auto& sink : sinks_) sink->black();
  }
  void tick(double at_s) override {
    for (const auto& sink : sinks_) sink->tick(at_s);
  }
  void check() override {
    for (const auto& sink : sinks_) sink->check();
  }
  std::string describe() const override {
    std::string all;
    for (const auto& sink : sinks_) all += (all.empty() ? "" : ", ") + sink->describe();
    return all;
  }

 private:
  std::vector<std::unique_ptr<FrameSink>> sinks_;
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
