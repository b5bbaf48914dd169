// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// CXDLP of version 4 (Halot Mage): numbers are little-endian, tables are like CTB's. The layout is that of
// UVtools (CrealityCXDLPv4File.cs); no file of a slicer was at hand to prove it.
#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/error.hpp"
#include "stack/formats/ctb_file.hpp"
#include "stack/formats/cxdlp_file.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

/// Places in the head.
namespace cxdlp4_at {
constexpr std::size_t kWidth = 0x00, kHeight = 0x02, kBed = 0x04, kTotalMm = 0x10, kLayerMm = 0x14,
                      kBottoms = 0x18, kSmallPreview = 0x1c, kTable = 0x20, kCount = 0x24,
                      kLargePreview = 0x28, kPrintTime = 0x2c, kProjector = 0x30, kPrint = 0x34,
                      kAntiAliasing = 0x3c, kLight = 0x40, kKey = 0x44, kSlicer = 0x48;
}  // namespace cxdlp4_at
/// Places in the settings of the print and in those of the slicer.
constexpr std::size_t kPrintBottoms = 0x28, kPrintExposure = 0x2c, kPrintBottomExposure = 0x30,
                      kSlicerMark = 0x1c, kSlicerExposure = 0x34, kSlicerBottomExposure = 0x38,
                      kSlicerTransition = 0x40;
constexpr std::uint64_t kHead4Bytes = 0x50, kPrint4Bytes = 0x44, kSlicer4Bytes = 0x4c,
                        kRecord4Bytes = 0x28, kLayer4Bytes = 0x2c, kSumBytes = 4;
/// Places in a record of the layer table, and in what stands before a layer's code.
constexpr std::size_t kRecordOffset = 0x0c, kRecordBytes4 = 0x10, kRecordType = 0x14,
                      kLayerLight = 0x28;

struct Cxdlp4File {
  BinaryBlock head, print, slicer, table;
  std::vector<CtbPreview> previews;
  std::vector<BinaryBlock> layers;  ///< what stands before the code of each
  std::uint32_t count = 0;
  std::uint64_t check_at = 0;
  static std::size_t record(std::size_t layer) { return layer * kRecord4Bytes; }
  /// Of a layer with what stands before its code.
  std::uint64_t offset(std::size_t layer) const { return table.u32(record(layer) + kRecordOffset); }
  std::uint64_t bytes(std::size_t layer) const { return table.u32(record(layer) + kRecordBytes4); }
  bool heeds_layers() const { return slicer.u32(kSlicerMark) != 0; }
};

Cxdlp4File read_tables(const BinaryFile& file, std::uint64_t head_at) {
  Cxdlp4File c;
  if (file.size() < head_at + kHead4Bytes + kSumBytes) {
    throw InputError(file.path(), "head", "the file ends before it does");
  }
  c.check_at = file.size() - kSumBytes;
  c.head = BinaryBlock(file, head_at, kHead4Bytes, "head");
  check_image_size(file, c.head.u16(cxdlp4_at::kWidth), c.head.u16(cxdlp4_at::kHeight));
  c.count = c.head.u32(cxdlp4_at::kCount);
  check_layer_count(file, c.count);
  std::vector<NamedSpan> spans{{0, head_at + kHead4Bytes, "head"},
                               {c.check_at, kSumBytes, "checksum"}};
  const auto block = [&](std::size_t at, std::uint64_t bytes, const char* name) {
    if (c.head.u32(at + 4) < bytes) {
      c.head.fail(at + 4, fmt::format("says that the {} have {} bytes, expected {}", name,
                                      c.head.u32(at + 4), bytes));
    }
    spans.push_back({c.head.u32(at), bytes, name});
    return BinaryBlock(file, c.head.u32(at), bytes, name);
  };
  c.print = block(cxdlp4_at::kPrint, kPrint4Bytes, "print settings");
  c.slicer = block(cxdlp4_at::kSlicer, kSlicer4Bytes, "slicer settings");
  c.previews =
      read_ctb_previews(file, c.head, {cxdlp4_at::kLargePreview, cxdlp4_at::kSmallPreview}, spans);
  c.table =
      BinaryBlock(file, c.head.u32(cxdlp4_at::kTable), c.count * kRecord4Bytes, "layer table");
  spans.push_back({c.table.offset(), c.table.size(), "layer table"});
  for (std::size_t n = 0; n < c.count; ++n) {
    const std::string name = fmt::format("layer {}", n);
    const std::size_t at = c.record(n);
    c.table.real(at, "a layer's place", 1e5);
    c.table.real(at + 4, "a layer's exposure", 1e6);
    if (c.table.u32(at + kRecordType) != 0) {
      c.table.fail(at + kRecordType,
                   fmt::format("{} has the type {}, which is not known; expected 0", name,
                               c.table.u32(at + kRecordType)));
    }
    if (c.bytes(n) <= kLayer4Bytes) {
      c.table.fail(at + kRecordBytes4, fmt::format("{} has no data", name));
    }
    c.layers.emplace_back(file, c.offset(n), kLayer4Bytes, name);
    spans.push_back({c.offset(n), c.bytes(n), name,
                     c.head.u32(cxdlp4_at::kKey) == 0 ? Sharing::layers : Sharing::none});
  }
  check_spans(file, std::move(spans));
  check_cxdlp_sum(file, 4, c.check_at);
  return c;
}

/// Lifts are told as a whole, and the second stage beside them. The way back has one speed for all layers
/// where they have none of their own.
void take_lifts_of(const Cxdlp4File& c, StackInfo& info) {
  LiftTimes lifts;
  LiftNumbers p(c.print), s(c.slicer);
  const auto stages = [&](std::size_t at, std::size_t off) {
    LiftMotion m;
    m.up_2_mm = s.at(at);
    m.up_2_mm_s = s.mm_s(at + 4);
    m.up_mm = std::max(0.0, p.at(at) - m.up_2_mm);
    m.up_mm_s = p.mm_s(at + 4);
    m.back_mm_s = p.mm_s(0x10);
    m.back_2_mm = s.at(0x10);
    m.back_2_mm_s = s.mm_s(0x14);
    m.after_lift_s = s.at(0x18);
    m.before_light_s = s.at(0x2c);
    m.before_lift_s = s.at(0x30);
    m.light_off_s = p.at(off);
    return m;
  };
  lifts.bottom = stages(0, 0x20);
  lifts.normal = stages(8, 0x24);
  lifts.bottom_layers = info.bottom_layers;
  bool known = p.known() && s.known();
  for (std::size_t n = 0; n < c.count && known && c.heeds_layers(); ++n) {
    LiftNumbers own(c.layers[n]), table(c.table);
    LiftMotion m;
    m.up_2_mm = own.at(0x08);
    m.up_2_mm_s = own.mm_s(0x0c);
    m.up_mm = std::max(0.0, own.at(0x00) - m.up_2_mm);
    m.up_mm_s = own.mm_s(0x04);
    m.back_mm_s = own.mm_s(0x10);
    m.back_2_mm = own.at(0x14);
    m.back_2_mm_s = own.mm_s(0x18);
    m.before_lift_s = own.at(0x1c);
    m.after_lift_s = own.at(0x20);
    m.before_light_s = own.at(0x24);
    m.light_off_s = table.at(c.record(n) + 8);
    known = own.known() && table.known();
    lifts.layers.push_back(m);
  }
  if (known) take_lifts(std::move(lifts), info);
}

void take_times_of(const BinaryFile& file, const Cxdlp4File& c, ArchiveContents& contents) {
  StackInfo& info = contents.info;
  info.exposure_s = c.print.real(kPrintExposure, "the exposure", 1e6);
  info.bottom_exposure_s = c.print.real(kPrintBottomExposure, "the exposure of bottom layers", 1e6);
  info.bottom_layers = static_cast<int>(std::min(c.head.u32(cxdlp4_at::kBottoms), c.count));
  info.fade_layers = static_cast<int>(std::min(c.slicer.u32(kSlicerTransition), c.count));
  std::vector<double> times_s, light;
  for (std::size_t n = 0; n < c.count; ++n) {
    const std::size_t at = c.record(n);
    times_s.push_back(c.table.f32(at + 4));
    contents.z_mm.push_back(c.table.f32(at));
    const bool bottom = n < static_cast<std::size_t>(info.bottom_layers);
    const double own = c.heeds_layers() ? c.layers[n].f32(kLayerLight) : 0;
    light.push_back(own > 0 ? own : c.head.u16(cxdlp4_at::kLight + (bottom ? 2 : 0)));
  }
  if (c.heeds_layers()) {
    take_layer_times(std::move(times_s), info);
  } else {
    if (info.bottom_layers == 0) info.fade_layers = 0;
    tell_unheeded_times(times_s, info, contents.warnings);
  }
  take_light(light, 255, file.path(), "head", info, &contents.warnings);
  if (c.slicer.f32(kSlicerExposure) != c.print.f32(kPrintExposure) ||
      c.slicer.f32(kSlicerBottomExposure) != c.print.f32(kPrintBottomExposure)) {
    contents.warnings.push_back(fmt::format(
        "says exposures in two places that differ: {:g} and {:g} s in the settings of the print, "
        "which count, {:g} and {:g} s in those of the slicer",
        info.exposure_s, info.bottom_exposure_s, c.slicer.f32(kSlicerExposure),
        c.slicer.f32(kSlicerBottomExposure)));
  }
}

void add_facts(const Cxdlp4File& c, const std::string& model, ArchiveContents& contents) {
  const auto add = [&](const char* name, std::string value) {
    contents.facts.emplace_back(name, std::move(value));
  };
  const BinaryBlock &head = c.head, &print = c.print, &slicer = c.slicer;
  add("version", "4");
  add("model", model);
  add("display", fmt::format("{:g} x {:g} mm, {:g} mm high", head.f32(cxdlp4_at::kBed),
                             head.f32(cxdlp4_at::kBed + 4), head.f32(cxdlp4_at::kBed + 8)));
  add("time shown", fmt::format("{} s", head.u32(cxdlp4_at::kPrintTime)));
  add("light", fmt::format("{} of 255, {} for bottom layers", head.u16(cxdlp4_at::kLight),
                           head.u16(cxdlp4_at::kLight + 2)));
  add("ciphered", head.u32(cxdlp4_at::kKey) != 0 ? "yes" : "no");
  add("lift",
      fmt::format("{:g} mm at {:g} mm/min, bottom {:g} mm at {:g} mm/min, back at {:g} mm/min",
                  print.f32(8), print.f32(0x0c), print.f32(0), print.f32(4), print.f32(0x10)));
  add("resin used",
      fmt::format("{:g} ml, {:g} g, cost {:g}", print.f32(0x14), print.f32(0x18), print.f32(0x1c)));
  add("waits", fmt::format("{:g} s before lifts, {:g} s after them, {:g} s before light",
                           slicer.f32(0x30), slicer.f32(0x18), slicer.f32(0x2c)));
  add("anti-aliasing", std::to_string(head.u32(cxdlp4_at::kAntiAliasing)));
  add("times of single layers", c.heeds_layers() ? "heeded" : "not heeded");
  add("transition layers", std::to_string(slicer.u32(kSlicerTransition)));
}

/// Number of layers, times and light, where they change. Returns the light of single layers, where that does.
std::vector<unsigned> change_settings(const ArchiveRequest& r, Cxdlp4File& c) {
  const auto layers = static_cast<std::uint32_t>(r.info.grid.layers);
  BinaryBlock &head = c.head, &slicer = c.slicer;
  if (layers != c.count) {
    head.set_u32(cxdlp4_at::kCount, layers);
    head.set_f32(
        cxdlp4_at::kTotalMm,
        head.f32(cxdlp4_at::kTotalMm) + (static_cast<double>(layers) - c.count) * last_layer_mm(r));
  }
  head.set_u32(cxdlp4_at::kPrintTime, changed_print_time_s(head.u32(cxdlp4_at::kPrintTime),
                                                           r.kept_contents->info, r.info));
  constexpr const char* unmarked =
      "the file's mark that printers heed settings of single layers is not set";
  std::vector<unsigned> light;
  if (r.light_changes) {
    const LightSteps steps =
        light_steps(r, r.kept->path(), static_cast<int>(head.u32(cxdlp4_at::kBottoms)));
    if (!c.heeds_layers() && steps.uneven) {
      throw InputError(r.kept->path(), "",
                       fmt::format("{}, so layers can't have light of their own; expected one "
                                   "share for the bottom layers and one for all others",
                                   unmarked));
    }
    head.set_u16(cxdlp4_at::kLight, steps.usual);
    head.set_u16(cxdlp4_at::kLight + 2, steps.bottom);
    light = steps.layers;
  }
  if (!r.exposure_changes) return light;
  const ExposureSummary s = head_summary(r.info);
  if (!c.heeds_layers()) require_even_times(r, s, unmarked);
  for (const auto& [block, normal, bottom] :
       {std::tuple(&c.print, kPrintExposure, kPrintBottomExposure),
        std::tuple(&slicer, kSlicerExposure, kSlicerBottomExposure)}) {
    block->set_f32(normal, s.normal_s);
    block->set_f32(bottom, s.bottom_s);
  }
  if (!s.uneven || s.bottom_layers > 0) {
    head.set_u32(cxdlp4_at::kBottoms, static_cast<std::uint32_t>(s.bottom_layers));
    c.print.set_u32(kPrintBottoms, static_cast<std::uint32_t>(s.bottom_layers));
    slicer.set_u32(kSlicerTransition, static_cast<std::uint32_t>(s.fade_layers));
  }
  return light;
}

}  // namespace

ArchiveContents read_cxdlp4(const BinaryFile& file, std::uint64_t head_at,
                            const std::string& model) {
  const Cxdlp4File c = read_tables(file, head_at);
  ArchiveContents contents;
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  const BinaryBlock& head = c.head;
  grid.width_px = head.u16(cxdlp4_at::kWidth);
  grid.height_px = head.u16(cxdlp4_at::kHeight);
  grid.layers = info.target_layers = static_cast<int>(c.count);
  grid.pixel_x_um = pixel_um(head.real(cxdlp4_at::kBed, "the display's width", 1e4) / grid.width_px,
                             file, "head");
  grid.pixel_y_um = pixel_um(
      head.real(cxdlp4_at::kBed + 4, "the display's height", 1e4) / grid.height_px, file, "head");
  grid.layer_um = layer_um(head.real(cxdlp4_at::kLayerMm, "the layer height", 100), file, "head");
  info.machine_height_mm = machine_height_of(head.f32(cxdlp4_at::kBed + 8));
  take_times_of(file, c, contents);
  take_lifts_of(c, info);
  info.own_print_time_s = head.u32(cxdlp4_at::kPrintTime);
  info.orientation.mirror_x = head.u32(cxdlp4_at::kProjector) == 1;
  info.orientation_known = true;
  info.profiles.printer = model;
  contents.codec = ctb_code(grid.width_px, grid.height_px, head.u32(cxdlp4_at::kKey));
  for (std::size_t n = 0; n < c.count; ++n) {
    contents.places.push_back({c.offset(n) + kLayer4Bytes, c.bytes(n) - kLayer4Bytes});
  }
  add_facts(c, model, contents);
  return contents;
}

void change_cxdlp4(const ArchiveRequest& r, std::uint64_t head_at, BinaryOutput& output) {
  const BinaryFile& file = binary_file(*r.kept);
  Cxdlp4File c = read_tables(file, head_at);
  const auto layers = static_cast<std::size_t>(r.info.grid.layers);
  const std::size_t old = c.count;
  FileChange changed(file);
  std::vector<std::pair<std::size_t, BinaryBlock*>> blocks;
  for (BinaryBlock* block : {&c.head, &c.print, &c.slicer}) {
    blocks.emplace_back(changed.replace(block->offset(), block->size(), block->size()), block);
  }
  for (CtbPreview& preview : c.previews) {
    BinaryBlock& its = preview.head;
    blocks.emplace_back(changed.replace(its.offset(), its.size(), its.size()), &its);
  }
  const std::size_t table =
      changed.replace(c.table.offset(), c.table.size(), layers * kRecord4Bytes);
  const std::size_t check = changed.replace(c.check_at, kSumBytes, kSumBytes);
  std::vector<ArchiveContents::Place> kept;
  for (std::size_t n = 0; n < old; ++n) kept.push_back({c.offset(n), c.bytes(n)});
  const std::vector<PieceSpan> spans =
      replace_layers(changed, *r.layers, kLayer4Bytes, kept, layers);
  changed.lay_out();
  check_offsets_fit(changed, file);
  const std::vector<unsigned> light = change_settings(r, c);
  const auto move = [&](BinaryBlock& block, std::size_t at) {
    if (block.u32(at) != 0) {
      block.set_u32(at, static_cast<std::uint32_t>(changed.moved(block.u32(at))));
    }
  };
  for (const std::size_t at : {cxdlp4_at::kSmallPreview, cxdlp4_at::kLargePreview,
                               cxdlp4_at::kTable, cxdlp4_at::kPrint, cxdlp4_at::kSlicer}) {
    move(c.head, at);
  }
  for (CtbPreview& preview : c.previews) move(preview.head, 8);
  BinaryBlock records(layers * kRecord4Bytes, ByteOrder::little);
  for (std::size_t n = 0; n < layers; ++n) {
    const std::size_t last = std::min(n, old - 1), to = c.record(n);
    std::copy_n(c.table.bytes().begin() + static_cast<std::ptrdiff_t>(c.record(last)),
                kRecord4Bytes, records.bytes().begin() + static_cast<std::ptrdiff_t>(to));
    if (n != last) {
      records.set_f32(to, records.f32(to) + static_cast<double>(n - last) * last_layer_mm(r));
    }
    if (r.exposure_changes) {
      records.set_f32(to + 4, light_on_of_layer(r.info, static_cast<int>(n)));
    }
    records.set_u32(to + kRecordOffset, static_cast<std::uint32_t>(changed.place(spans[n].span)));
    records.set_u32(to + kRecordBytes4,
                    static_cast<std::uint32_t>(kLayer4Bytes + r.layers->sizes[n]));
    if (!spans[n].owns) continue;
    BinaryBlock before = c.layers[last];
    if (!light.empty()) before.set_f32(kLayerLight, light[n]);
    changed.fill(
        spans[n].span,
        [coded = r.layers, before = std::move(before.bytes())](std::size_t i,
                                                               std::vector<std::uint8_t>& out) {
          out = before;
          coded->append(i, out);
        },
        n);
  }
  changed.fill(table, records.bytes());
  for (auto& [span, block] : blocks) changed.fill(span, block->bytes());
  fill_cxdlp_sum(changed, check, 4, output);
  changed.add_to(output);
}

}  // namespace slicecorr::detail
