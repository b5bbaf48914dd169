// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Longer's LGS: a head, a preview, layers one behind the other.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/binary_block.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint64_t kLgsHeadBytes = 0xb4;
/// Places in the head.
namespace lgs_at {
constexpr std::size_t kModel = 0x10, kPerMmY = 0x1c, kPerMmX = 0x20, kPixelsY = 0x24,
                      kPixelsX = 0x28, kLayerMm = 0x2c, kExposureMs = 0x30,
                      kBottomExposureMs = 0x34, kBottomWaitMs = 0x3c, kWaitMs = 0x40,
                      kBottomMm = 0x44, kBottomLift = 0x4c, kLift = 0x50, kLiftSpeed = 0x54,
                      kBackSpeed = 0x58, kBottomLiftSpeed = 0x5c, kBottomBackSpeed = 0x60,
                      kLayers = 0xa4, kPreviewX = 0xac, kPreviewY = 0xb0;
}  // namespace lgs_at
constexpr std::uint32_t kPngModel = 120;

struct LgsFile {
  BinaryBlock head;
  std::vector<ArchiveContents::Place> layers;  ///< of the code, behind its four bytes of size
  std::uint64_t end = 0;
};

std::uint32_t whole_number(const BinaryBlock& head, std::size_t at, const char* what) {
  const double value = head.real(at, what, 1e6);
  if (value != std::floor(value))
    head.fail(at, fmt::format("{} is {:g}, expected a whole number", what, value));
  return static_cast<std::uint32_t>(value);
}

LgsFile read_lgs(const BinaryFile& file) {
  LgsFile lgs;
  lgs.head = BinaryBlock(file, 0, kLgsHeadBytes, "head");
  const BinaryBlock& head = lgs.head;
  check_image_size(file, whole_number(head, lgs_at::kPixelsX, "the width"),
                   whole_number(head, lgs_at::kPixelsY, "the height"));
  const std::uint32_t count = head.u32(lgs_at::kLayers), model = head.u32(lgs_at::kModel);
  check_layer_count(file, count);
  std::uint64_t at = kLgsHeadBytes;
  if (model == kPngModel) {
    at += 4 + BinaryBlock(file, at, 4, "preview").u32(0) + 2;
  } else {
    const std::uint32_t width = head.u32(lgs_at::kPreviewX), height = head.u32(lgs_at::kPreviewY);
    if (width > 4096 || height > 4096) {
      head.fail(lgs_at::kPreviewX,
                fmt::format("says that the preview is {} x {} pixels, expected at most 4096 each",
                            width, height));
    }
    at += std::uint64_t{2} * width * height;
  }
  for (std::uint32_t n = 0; n < count; ++n) {
    const std::string name = fmt::format("layer {}", n);
    const std::uint64_t bytes = BinaryBlock(file, at, 4, name).u32(0);
    if (bytes == 0) throw InputError(file.path(), name, "has no data");
    if (bytes > file.size() - at - 4) {
      throw InputError(file.path(), name,
                       fmt::format("says {} bytes, but the file ends before", bytes));
    }
    lgs.layers.push_back({at + 4, bytes});
    at += 4 + bytes;
  }
  lgs.end = at;
  return lgs;
}

void change_lgs(const ArchiveRequest& r, BinaryOutput& output) {
  const BinaryFile& file = binary_file(*r.kept);
  LgsFile lgs = read_lgs(file);
  BinaryBlock& head = lgs.head;
  const auto layers = static_cast<std::size_t>(r.info.grid.layers), old = lgs.layers.size();
  if (r.exposure_changes) {
    const ExposureSummary s = exposure_summary(r.info);
    require_even_times(r, s, "the format has no times of single layers");
    if (s.fade_layers > 0) {
      throw InputError(
          file.path(), "",
          "can't say that exposures fade from bottom layers to the others; expected no "
          "fade layers");
    }
    head.set_f32(lgs_at::kExposureMs, s.normal_s * 1000);
    head.set_f32(lgs_at::kBottomExposureMs, s.bottom_s * 1000);
    head.set_f32(lgs_at::kBottomMm,
                 s.bottom_layers * static_cast<double>(head.f32(lgs_at::kLayerMm)));
  }
  head.set_u32(lgs_at::kLayers, static_cast<std::uint32_t>(layers));
  FileChange changed(file);
  const std::size_t head_span = changed.replace(0, head.size(), head.size());
  std::vector<std::size_t> spans;
  for (std::size_t n = 0; n < std::max(layers, old); ++n) {
    spans.push_back(changed.replace(n < old ? lgs.layers[n].offset - 4 : lgs.end,
                                    n < old ? lgs.layers[n].size + 4 : 0,
                                    n < layers ? r.layers->sizes[n] + 4 : 0));
  }
  changed.lay_out();
  changed.fill(head_span, head.bytes());
  const CodedLayers* const coded = r.layers;
  for (std::size_t n = 0; n < layers; ++n) {
    changed.fill(
        spans[n],
        [coded](std::size_t i, std::vector<std::uint8_t>& out) {
          BinaryBlock size(4, ByteOrder::little);
          size.set_u32(0, static_cast<std::uint32_t>(coded->sizes[i]));
          out = size.bytes();
          coded->append(i, out);
        },
        n);
  }
  changed.add_to(output);
}

class Lgs final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "lgs"; }
  std::string_view what() const override { return "Longer LGS"; }
  std::vector<std::string_view> endings() const override {
    return {".lgs", ".lgs30", ".lgs120", ".lgs4k"};
  }
  ContainerKind container() const override { return ContainerKind::binary; }
  bool made_new() const override { return false; }
  bool recognises(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    return file.size() >= kLgsHeadBytes && BinaryBlock(file, 0, 8, "head").text(0, 8) == "Longer3D";
  }

  ArchiveContents read(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    LgsFile lgs = read_lgs(file);
    const BinaryBlock& head = lgs.head;
    ArchiveContents contents;
    StackInfo& info = contents.info;
    Grid& grid = info.grid;
    grid.width_px = static_cast<int>(whole_number(head, lgs_at::kPixelsX, "the width"));
    grid.height_px = static_cast<int>(whole_number(head, lgs_at::kPixelsY, "the height"));
    grid.layers = info.target_layers = static_cast<int>(lgs.layers.size());
    const auto pitch_um = [&](std::size_t at) {
      const double per_mm = head.real(at, "the number of pixels per mm", 1000);
      return per_mm > 0 ? pixel_um(1 / per_mm, file, "head") : 0.0;
    };
    grid.pixel_x_um = pitch_um(lgs_at::kPerMmX);
    grid.pixel_y_um = pitch_um(lgs_at::kPerMmY);
    const double layer_mm = head.real(lgs_at::kLayerMm, "the layer height", 100);
    grid.layer_um = layer_um(layer_mm, file, "head");
    info.exposure_s = head.real(lgs_at::kExposureMs, "the exposure", 1e9) / 1000;
    info.bottom_exposure_s =
        head.real(lgs_at::kBottomExposureMs, "the exposure of bottom layers", 1e9) / 1000;
    const double bottom_mm = head.real(lgs_at::kBottomMm, "the height of bottom layers", 1e4);
    if (layer_mm > 0) {
      info.bottom_layers = static_cast<int>(
          std::min(std::round(bottom_mm / layer_mm), static_cast<double>(lgs.layers.size())));
    }
    info.orientation.mirror_x = true;  // the printers' firmware always does
    info.orientation_known = true;
    LiftNumbers n(head);
    LiftTimes lifts;
    lifts.bottom_layers = info.bottom_layers;
    const auto motion = [&](std::size_t lift, std::size_t up, std::size_t back, std::size_t wait) {
      LiftMotion m;
      m.up_mm = n.at(lift);
      m.up_mm_s = n.mm_s(up);
      m.back_mm_s = n.mm_s(back);
      m.before_light_s = n.at(wait) / 1000;
      return m;
    };
    lifts.normal = motion(lgs_at::kLift, lgs_at::kLiftSpeed, lgs_at::kBackSpeed, lgs_at::kWaitMs);
    lifts.bottom = motion(lgs_at::kBottomLift, lgs_at::kBottomLiftSpeed, lgs_at::kBottomBackSpeed,
                          lgs_at::kBottomWaitMs);
    if (n.known()) take_lifts(std::move(lifts), info);
    info.profiles.printer = fmt::format("Longer Orange {}", head.u32(lgs_at::kModel));
    contents.codec = lgs_code(grid.width_px, grid.height_px);
    contents.places = std::move(lgs.layers);
    contents.facts = {{"model", std::to_string(head.u32(lgs_at::kModel))},
                      {"wait", fmt::format("{:g} s", head.f32(lgs_at::kWaitMs) / 1000)},
                      {"lift", fmt::format("{:g} mm at {:g} mm/min", head.f32(lgs_at::kLift),
                                           head.f32(lgs_at::kLiftSpeed))}};
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.exposure_changes) warn_of_mode(r, "LGS", printers_lift());
    change_lgs(r, binary_output(output));
    return {};
  }
};

}  // namespace

const ArchiveFormat& lgs_format() {
  static const Lgs format;
  return format;
}

}  // namespace slicecorr::detail
