// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "recorder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "frames/turned_image.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/recording_writer.hpp"

namespace slicecorr::bridge {

namespace {

/// Less light than this, of what is planned for a slice, is rounding: an image that comes when the
/// stage is on an edge.
constexpr double kRounding = 1e-9;

}  // namespace

Recorder::Recorder(std::string path, const std::string& stack, const Machine& machine,
                   TimedModel& model, const ExecutionContext& context)
    : path_(std::move(path)),
      first_path_(path_),
      machine_(machine),
      model_(model),
      context_(context) {
  if (path_.empty() || stack.empty()) return;
  const StackInfo info = StackReader::read_info(stack);
  if (info.kind != StackKind::corrected || !info.printer || !info.process || !info.resin) {
    throw InputError(stack, "", "is no corrected stack; expected one with printer, resin, process");
  }
  WireHello hello;
  hello.setup.printer = *info.printer;
  hello.setup.resin = *info.resin;
  hello.setup.process = *info.process;
  hello.layer_um = info.grid.layer_um;
  hello.target_layers = info.target_layers;
  hello.slices = info.grid.layers;
  hello.start_um = machine.stage.home_um;
  hello.m = light_exponent(*info.resin, *info.process);
  begin(hello);
}

bool Recorder::lit() const {
  bool light = false;
  model_.with([&](PrinterModel& model) {
    for (const auto& slice : model.exposures()) light = light || !slice.showings.empty();
  });
  return light;
}

void Recorder::begin(const WireHello& hello) {
  if (writer_ && lit()) {
    // In the background: the bridge waits for its answer.
    written_.push_back(std::async(std::launch::async,
                                  [path = path_, all = std::make_shared<Recording>(recording()),
                                   writer = std::shared_ptr<RecordingWriter>(std::move(writer_))] {
                                    writer->finish(std::move(*all));
                                    return path;
                                  }));
    ++prints_;
    const auto dot = first_path_.rfind('.');
    path_ =
        fmt::format("{}-{}{}", first_path_.substr(0, dot), prints_ + 1, first_path_.substr(dot));
  }
  StackInfo print;
  print.format = "uvj";
  print.kind = StackKind::corrected;
  const Printer& printer = machine_.printer;
  print.grid.width_px = printer.width_px;
  print.grid.height_px = printer.height_px;
  print.grid.layers = hello.slices;
  print.grid.pixel_x_um = printer.pixel_x_um;
  print.grid.pixel_y_um = printer.pixel_y_um;
  print.grid.layer_um = hello.layer_um;
  print.orientation = printer.orientation.value_or(Orientation{});
  print.orientation_known = true;
  // What comes over the wire lies as the display shows it.
  print.for_display = true;
  print.printer = hello.setup.printer;
  print.resin = hello.setup.resin;
  print.process = hello.setup.process;
  print.target_layers = hello.target_layers;
  process_ = *print.process;
  layer_um_ = hello.layer_um;
  m_ = hello.m;
  slices_ = hello.slices;
  writer_.reset();
  if (!path_.empty()) writer_ = std::make_unique<RecordingWriter>(path_, print, context_);
  model_.with([&](PrinterModel& model) {
    model.record(
        {hello.layer_um, hello.start_um, hello.m, process_.mode == ExposureMode::layerwise});
    model.tell_images([this](int, const std::shared_ptr<const Frame>& frame) {
      if (writer_) record_image(*frame);
    });
  });
}

void Recorder::record_image(const Frame& frame) {
  if (!machine_.uv_display) {
    writer_->add_image(frame.blue.data(), frame.uv.empty() ? nullptr : frame.uv.data());
    return;
  }
  // As the blue display would show it.
  std::vector<std::uint8_t> uv(frame.blue.size());
  if (const Frame* const shown = frame.on_uv_display.get()) {
    uv = turned_image(shown->blue,
                      turn_between(machine_.uv_display->orientation,
                                   machine_.printer.orientation.value_or(Orientation{})),
                      shown->width_px, shown->height_px);
  }
  const bool patterned = process_.uv.kind == UvKind::patterned;
  writer_->add_image(frame.blue.data(), patterned ? uv.data() : nullptr);
}

Recording Recorder::recording() {
  Recording recording;
  model_.with([&](PrinterModel& model) {
    model.tell_images({});
    const auto& exposures = model.exposures();
    const int slices = std::max(slices_, static_cast<int>(exposures.size()));
    std::vector<Recording::Showing> showings;
    for (int n = 0; n < slices; ++n) {
      showings.clear();
      if (n < static_cast<int>(exposures.size())) {
        const double planned_s = planned_light_s(process_, layer_um_, n, m_);
        for (const auto& p : exposures[static_cast<std::size_t>(n)].showings) {
          if (p.light_s < kRounding * planned_s) continue;
          showings.push_back({p.image, p.light_s / planned_s, p.uv_mw_cm2, p.from_um, p.to_um,
                              p.speed_um_s, p.blue_share});
        }
      }
      recording.add_slice(showings);
    }
  });
  return recording;
}

std::vector<std::string> Recorder::finish() {
  std::vector<std::string> files;
  for (auto& one : written_) files.push_back(one.get());
  written_.clear();
  // What had no light is only of interest when there is nothing else.
  if (writer_ && (prints_ == 0 || lit())) {
    writer_->finish(recording());
    files.push_back(path_);
  }
  writer_.reset();
  return files;
}

}  // namespace slicecorr::bridge
