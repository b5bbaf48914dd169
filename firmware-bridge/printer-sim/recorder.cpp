#include "recorder.hpp"

#include <algorithm>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

Recorder::Recorder(std::string path, const std::string& stack, const Machine& machine,
                   TimedModel& model, const Job& job)
    : path_(std::move(path)), machine_(machine), model_(model), job_(job) {
  if (path_.empty() || stack.empty()) return;
  const StackInfo info = StackReader::read_info(stack);
  if (!info.process || !info.resin) {
    throw InputError(stack, "", "says nothing of resin and process; expected a corrected stack");
  }
  begin(info, info.grid.layers, machine.stage.home_um, light_exponent(*info.resin, *info.process));
}

void Recorder::begin(const WireHello& hello) {
  StackInfo info;
  info.format = "uvj";
  info.kind = StackKind::corrected;
  const Printer& printer = machine_.printer;
  info.grid.width_px = printer.width_px;
  info.grid.height_px = printer.height_px;
  info.grid.layers = hello.slices;
  info.grid.pixel_x_um = printer.pixel_x_um;
  info.grid.pixel_y_um = printer.pixel_y_um;
  info.grid.layer_um = hello.layer_um;
  info.orientation = printer.orientation.value_or(Orientation{});
  info.orientation_known = true;
  // What comes over the wire lies as the display shows it.
  info.for_display = true;
  info.printer = hello.setup.printer;
  info.resin = hello.setup.resin;
  info.process = hello.setup.process;
  info.target_layers = hello.target_layers;
  begin(info, hello.slices, hello.start_um, hello.m);
}

void Recorder::begin(const StackInfo& print, int slices, double start_um, double m) {
  process_ = *print.process;
  layer_um_ = print.grid.layer_um;
  slices_ = slices;
  writer_.reset();
  if (!path_.empty()) writer_ = std::make_unique<RecordingWriter>(path_, print, job_);
  model_.with([&](PrinterModel& model) {
    model.record({layer_um_, start_um, m, process_.mode == ExposureMode::layerwise});
    model.tell_images([this](int, const std::shared_ptr<const Frame>& frame) {
      if (writer_) {
        writer_->add_image(frame->blue.data(), frame->uv.empty() ? nullptr : frame->uv.data());
      }
    });
  });
}

bool Recorder::finish() {
  if (!writer_) return false;
  Recording recording;
  model_.with([&](PrinterModel& model) {
    model.tell_images({});
    const auto& exposures = model.exposures();
    const int slices = std::max(slices_, static_cast<int>(exposures.size()));
    std::vector<Recording::Part> parts;
    for (int n = 0; n < slices; ++n) {
      parts.clear();
      if (n < static_cast<int>(exposures.size())) {
        const double planned_s = planned_light_s(process_, layer_um_, n);
        for (const auto& p : exposures[static_cast<std::size_t>(n)].parts) {
          parts.push_back({p.image, p.light_s / planned_s, p.uv_mw_cm2, p.from_um, p.to_um,
                           p.speed_um_s, p.blue_share});
        }
      }
      recording.add_slice(parts);
    }
  });
  writer_->finish(std::move(recording));
  writer_.reset();
  return true;
}

}  // namespace slicecorr::bridge
