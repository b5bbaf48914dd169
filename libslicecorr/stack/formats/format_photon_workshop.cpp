// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Anycubic Photon Workshop: tables of which the start of the file says where they are.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/binary_block.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {
namespace workshop {  // its places have names that others have, too

using namespace std::string_view_literals;

constexpr std::uint64_t kMarkBytes = 0x30, kTableHeadBytes = 0x10, kRecordBytes = 0x20;
// Offsets at the start of the file.
constexpr std::size_t kVersion = 0x0c, kHeaderAt = 0x14, kPreviewAt = 0x1c, kColourAt = 0x20,
                      kLayersAt = 0x24, kExtraAt = 0x28, kMachineAt = 0x2c, kSecondListAt = 0x38;
// Places in HEADER, behind its own head.
constexpr std::size_t kPixelUm = 0x10, kLayerMm = 0x14, kExposure = 0x18, kWait = 0x1c,
                      kBottomExposure = 0x20, kBottomLayers = 0x24, kLift = 0x28, kSpeed = 0x2c,
                      kBackSpeed = 0x30, kVolume = 0x34, kAntiAliasing = 0x38, kWidth = 0x3c,
                      kHeight = 0x40, kWeight = 0x44, kPrice = 0x48, kLayerFlag = 0x50,
                      kPrintTime = 0x54, kTransition = 0x58, kHeaderBytes = 0x60,
                      kExtraBytes = 0x48;
// Places in a record of LAYERDEF.
constexpr std::size_t kOffset = 0, kBytes = 4, kRecordLift = 8, kRecordSpeed = 0x0c,
                      kRecordExposure = 0x10, kThickness = 0x14, kLit = 0x18;
/// The second list of layers of version 518, SUBIMGS: its head, then records of offset, bytes and lit pixels.
constexpr std::uint64_t kSecondHeadBytes = 0x18, kSecondRecordBytes = 0x2c;
/// In HEADER of version 518: the printer chooses exposures by itself.
constexpr std::size_t kPrinterChooses = 0x6c;
constexpr std::uint32_t kMostPasses = 64;

struct WorkshopFile {
  std::uint32_t version = 0;
  BinaryBlock mark, header, layers;  ///< `layers` with its head and its count
  std::optional<BinaryBlock> machine, second_list;
  std::size_t images_at = 0;  ///< in `mark`, where the images' offset stands
  std::array<std::uint8_t, 16> colours{};
  bool has_colours = false;
  std::uint32_t count = 0;
  std::size_t record(std::size_t n) const { return kTableHeadBytes + 4 + n * kRecordBytes; }
  std::uint64_t offset(std::size_t n) const { return layers.u32(record(n) + kOffset); }
  std::uint64_t bytes(std::size_t n) const { return layers.u32(record(n) + kBytes); }
  /// Any code but black shines full.
  bool is_black_and_white() const {
    return header.u32(kAntiAliasing) <= 1 ||
           (has_colours &&
            std::all_of(colours.begin(), colours.end(), [](int v) { return v == 255; }));
  }
};

BinaryBlock table(const BinaryFile& file, const BinaryBlock& mark, std::size_t at,
                  std::string_view name, std::uint64_t bytes) {
  const std::uint32_t offset = mark.u32(at);
  if (offset == 0) mark.fail(at, fmt::format("says that there is no table {}", name));
  BinaryBlock block(file, offset, bytes, std::string(name));
  if (block.text(0, 12) != name) block.fail(0, fmt::format("expected the name {}", name));
  return block;
}

void read_second_list(const BinaryFile& file, WorkshopFile& w, std::vector<NamedSpan>& spans) {
  if (w.version < 518 || w.mark.u32(kSecondListAt) == 0) return;
  const std::uint64_t bytes = kSecondHeadBytes + w.count * kSecondRecordBytes;
  const BinaryBlock start = table(file, w.mark, kSecondListAt, "SUBIMGS", kSecondHeadBytes);
  if (start.u32(0x10) != w.count || start.u32(12) != bytes) {
    start.fail(0x0c,
               fmt::format("has {} layers in {} bytes, expected as many as LAYERDEF, {} in {}",
                           start.u32(0x10), start.u32(12), w.count, bytes));
  }
  w.second_list = BinaryBlock(file, start.offset(), bytes, "SUBIMGS");
  for (std::size_t n = 0; n < w.count; ++n) {
    const std::size_t at = kSecondHeadBytes + n * kSecondRecordBytes;
    if (w.second_list->u32(at) != w.offset(n) || w.second_list->u32(at + 4) != w.bytes(n)) {
      w.second_list->fail(at, fmt::format("has layer {} elsewhere than LAYERDEF", n));
    }
  }
  spans.push_back({start.offset(), bytes, "SUBIMGS"});
}

/// The printer chooses exposures by itself, whatever the file says.
bool printer_chooses_exposures(const BinaryFile& file, const WorkshopFile& w) {
  constexpr std::uint32_t says_it = 0x60;  // length of HEADER
  return w.version >= 518 && w.header.u32(12) >= says_it &&
         BinaryBlock(file, w.header.offset() + kPrinterChooses, 4, "HEADER").u32(0) != 0;
}

WorkshopFile read_workshop(const BinaryFile& file) {
  WorkshopFile w;
  w.mark = BinaryBlock(file, 0, kMarkBytes, "start of the file");
  w.version = w.mark.u32(kVersion);
  constexpr std::uint32_t known[] = {1, 515, 516, 517, 518};
  if (std::find(std::begin(known), std::end(known), w.version) == std::end(known)) {
    w.mark.fail(kVersion, fmt::format("is version {}, which is not known", w.version));
  }
  // Later versions have more offsets.
  const std::uint64_t mark_bytes = w.version >= 518   ? kMarkBytes + 16
                                   : w.version == 517 ? kMarkBytes + 8
                                   : w.version == 516 ? kMarkBytes + 4
                                                      : kMarkBytes;
  w.mark = BinaryBlock(file, 0, mark_bytes, "start of the file");
  w.images_at = w.version >= 516 ? 0x30 : 0x2c;
  w.header = table(file, w.mark, kHeaderAt, "HEADER", kHeaderBytes);
  const std::uint32_t width = w.header.u32(kWidth), height = w.header.u32(kHeight);
  check_image_size(file, width, height);
  if (w.header.u32(kAntiAliasing) > kMostPasses) {
    w.header.fail(kAntiAliasing, fmt::format("says anti-aliasing of {}, expected at most {}",
                                             w.header.u32(kAntiAliasing), kMostPasses));
  }
  std::vector<NamedSpan> spans{{0, w.mark.size(), "start of the file"},
                               {w.header.offset(), w.header.size(), "HEADER"}};
  if (w.mark.u32(kColourAt) != 0) {
    const BinaryBlock colours(file, w.mark.u32(kColourAt), 0x1c, "colour table");
    if (colours.u32(4) != w.colours.size()) {
      colours.fail(4, fmt::format("has {} colours, expected 16", colours.u32(4)));
    }
    std::copy_n(colours.bytes().begin() + 8, w.colours.size(), w.colours.begin());
    w.has_colours = true;
    spans.push_back({colours.offset(), colours.size(), "colour table"});
  }
  if (w.mark.u32(kPreviewAt) != 0) {
    const BinaryBlock preview = table(file, w.mark, kPreviewAt, "PREVIEW", 0x1c);
    spans.push_back({preview.offset(), preview.u32(12), "PREVIEW"});
  }
  if (w.version >= 516 && w.mark.u32(kMachineAt) != 0) {
    w.machine = table(file, w.mark, kMachineAt, "MACHINE", 0x9c);
    spans.push_back({w.machine->offset(), w.machine->size(), "MACHINE"});
  }
  const BinaryBlock start = table(file, w.mark, kLayersAt, "LAYERDEF", kTableHeadBytes + 4);
  w.count = start.u32(kTableHeadBytes);
  check_layer_count(file, w.count);
  w.layers =
      BinaryBlock(file, start.offset(), kTableHeadBytes + 4 + w.count * kRecordBytes, "LAYERDEF");
  if (w.layers.u32(12) != 4 + w.count * kRecordBytes) {
    w.layers.fail(12, fmt::format("says that it has {} bytes, expected {} for {} layers",
                                  w.layers.u32(12), 4 + w.count * kRecordBytes, w.count));
  }
  spans.push_back({w.layers.offset(), w.layers.size(), "LAYERDEF"});
  read_second_list(file, w, spans);
  for (std::size_t n = 0; n < w.count; ++n) {
    const std::size_t at = w.record(n);
    if (w.bytes(n) == 0) w.layers.fail(at + kBytes, fmt::format("layer {} has no data", n));
    w.layers.real(at + kRecordExposure, "a layer's exposure", 1e6);
    if (w.layers.real(at + kThickness, "a layer's thickness", 100) == 0) {
      w.layers.fail(at + kThickness, fmt::format("layer {} is 0 mm thick", n));
    }
    spans.push_back({w.offset(n), w.bytes(n), fmt::format("layer {}", n), Sharing::layers});
  }
  check_spans(file, std::move(spans));
  return w;
}

/// Which of the two codes a file has, it does not say in every version: the one that its first layer
/// is whole in.
bool is_pw0(const BinaryFile& file, const WorkshopFile& w) {
  if (w.machine) {
    const std::string code = w.machine->text(0x70, 16);
    if (code == "pw0Img" || code == "pwsImg") return code == "pw0Img";
    w.machine->fail(0x70,
                    "says that layers are coded as \"" + code + "\", expected pw0Img or pwsImg");
  }
  if (w.version != 1) return true;
  const auto width = static_cast<int>(w.header.u32(kWidth)),
             height = static_cast<int>(w.header.u32(kHeight));
  const LayerCodecPtr pw0 = pw0_code(width, height, false);
  std::vector<std::vector<std::uint8_t>> code(1);
  file.read_at(w.offset(0), w.bytes(0), code[0], "layer 0");
  std::vector<std::uint8_t> pixels(pw0->pixel_count());
  try {
    return pw0->decode(code, pixels.data(), {file.path(), 0}) == 0;
  } catch (const InputError&) {
    return false;
  }
}

LayerCodecPtr codec_of(const BinaryFile& file, const WorkshopFile& w) {
  const auto width = static_cast<int>(w.header.u32(kWidth)),
             height = static_cast<int>(w.header.u32(kHeight));
  if (is_pw0(file, w)) return pw0_code(width, height, w.is_black_and_white());
  const int passes = static_cast<int>(std::max<std::uint32_t>(1, w.header.u32(kAntiAliasing)));
  return bit_sets_code(width, height, passes, true);
}

/// Of version 516 on lifts may have two stages, in a table of their own, which counts where HEADER says so.
std::optional<BinaryBlock> extra_of(const BinaryFile& file, const WorkshopFile& w) {
  constexpr std::size_t advanced = 0x60, advanced_ends = 0x54;
  if (w.version < 516 || w.mark.u32(kExtraAt) == 0 || w.header.u32(12) < advanced_ends) {
    return std::nullopt;
  }
  if (BinaryBlock(file, w.header.offset() + advanced, 4, "HEADER").u32(0) == 0) return std::nullopt;
  BinaryBlock extra(file, w.mark.u32(kExtraAt), kExtraBytes, "EXTRA");
  if (extra.text(0, 12) != "EXTRA" || extra.u32(0x10) != 2 || extra.u32(0x2c) != 2) {
    return std::nullopt;
  }
  return extra;
}

/// Two stages of three numbers each. The way back goes the stages in the other order, and each one's
/// speed back stands at the other's place.
LiftMotion stages_at(LiftNumbers& n, std::size_t at) {
  LiftMotion m;
  m.up_mm = n.at(at);
  m.up_mm_s = n.at(at + 4);
  m.up_2_mm = n.at(at + 0x0c);
  m.up_2_mm_s = n.at(at + 0x10);
  m.back_2_mm = m.up_mm;
  m.back_2_mm_s = n.at(at + 8);
  m.back_mm_s = n.at(at + 0x14);
  return m;
}

void take_lifts_of(const BinaryFile& file, const WorkshopFile& w, StackInfo& info) {
  LiftNumbers h(w.header);
  LiftTimes lifts;
  bool known = true;
  if (const auto extra = extra_of(file, w)) {
    LiftNumbers n(*extra);
    lifts.bottom = stages_at(n, 0x14);
    lifts.normal = stages_at(n, 0x30);
    known = n.known();
  } else {
    lifts.normal.up_mm = h.at(kLift);
    lifts.normal.up_mm_s = h.at(kSpeed);
    lifts.normal.back_mm_s = h.at(kBackSpeed);
    lifts.bottom = lifts.normal;
  }
  lifts.normal.before_light_s = lifts.bottom.before_light_s = h.at(kWait);
  lifts.bottom_layers = info.bottom_layers;
  if (w.header.u32(kLayerFlag) != 0) {
    LiftNumbers n(w.layers);
    for (std::size_t i = 0; i < w.count; ++i) {
      LiftMotion m = lifts.of(static_cast<int>(i));
      m.up_mm = n.at(w.record(i) + kRecordLift);
      m.up_mm_s = n.at(w.record(i) + kRecordSpeed);
      m.back_2_mm = std::min(m.back_2_mm, m.up_mm);
      lifts.layers.push_back(m);
    }
    known = known && n.known();
  }
  if (known && h.known()) take_lifts(std::move(lifts), info);
}

void add_facts(const WorkshopFile& w, bool pw0, ArchiveContents& contents) {
  const BinaryBlock& h = w.header;
  const auto add = [&](const char* name, const std::string& value) {
    contents.facts.emplace_back(name, value);
  };
  add("version", std::to_string(w.version));
  add("code of layers", pw0 ? "pw0Img" : "pwsImg");
  if (w.machine) {
    add("display", fmt::format("{:g} x {:g} mm, {:g} mm high", w.machine->f32(0x88),
                               w.machine->f32(0x8c), w.machine->f32(0x90)));
  }
  if (w.version >= 516) add("time shown", fmt::format("{} s", h.u32(kPrintTime)));
  add("wait before light", fmt::format("{:g} s", h.f32(kWait)));
  add("lift", fmt::format("{:g} mm at {:g} mm/s, back at {:g} mm/s", h.f32(kLift), h.f32(kSpeed),
                          h.f32(kBackSpeed)));
  add("anti-aliasing", std::to_string(h.u32(kAntiAliasing)));
  add("times of single layers", h.u32(kLayerFlag) != 0 ? "heeded" : "not heeded");
  if (w.version >= 516) add("transition layers", std::to_string(h.u32(kTransition)));
  add("resin used",
      fmt::format("{:g} ml, {:g} g, cost {:g}", h.f32(kVolume), h.f32(kWeight), h.f32(kPrice)));
}

/// The second list with what the new records of the first one say.
std::vector<std::uint8_t> changed_second_list(const BinaryBlock& old, const BinaryBlock& records,
                                              const WorkshopFile& w) {
  const std::uint32_t layers = records.u32(kTableHeadBytes);
  BinaryBlock list(kSecondHeadBytes + layers * kSecondRecordBytes, ByteOrder::little);
  std::copy_n(old.bytes().begin(), kSecondHeadBytes, list.bytes().begin());
  list.set_u32(12, static_cast<std::uint32_t>(list.size()));
  list.set_u32(0x10, layers);
  for (std::size_t n = 0; n < layers; ++n) {
    const std::size_t to = kSecondHeadBytes + n * kSecondRecordBytes, last = w.count - 1;
    const std::size_t from = kSecondHeadBytes + std::min(n, last) * kSecondRecordBytes;
    std::copy_n(old.bytes().begin() + static_cast<std::ptrdiff_t>(from), kSecondRecordBytes,
                list.bytes().begin() + static_cast<std::ptrdiff_t>(to));
    list.set_u32(to, records.u32(w.record(n) + kOffset));
    list.set_u32(to + 4, records.u32(w.record(n) + kBytes));
    // One that is told otherwise there stays as it is with its layer.
    if (n > last || old.u32(from + 8) == w.layers.u32(w.record(n) + kLit)) {
      list.set_u32(to + 8, records.u32(w.record(n) + kLit));
    }
  }
  return std::move(list.bytes());
}

void change_workshop(const ArchiveRequest& r, BinaryOutput& output) {
  const BinaryFile& file = binary_file(*r.kept);
  WorkshopFile w = read_workshop(file);
  const auto layers = static_cast<std::size_t>(r.info.grid.layers);
  const std::size_t old = w.count;
  if (r.exposure_changes && printer_chooses_exposures(file, w)) {
    throw InputError(file.path(), "HEADER", kPrinterChoosesWords);
  }
  FileChange changed(file);
  const std::size_t mark = changed.replace(0, w.mark.size(), w.mark.size());
  const std::size_t header = changed.replace(w.header.offset(), w.header.size(), w.header.size());
  const std::size_t table = changed.replace(w.layers.offset(), w.layers.size(), w.record(layers));
  const std::size_t second_table =
      w.second_list ? changed.replace(w.second_list->offset(), w.second_list->size(),
                                      kSecondHeadBytes + layers * kSecondRecordBytes)
                    : 0;
  const CodedLayers* const coded = r.layers;
  std::vector<ArchiveContents::Place> kept;
  for (std::size_t n = 0; n < old; ++n) kept.push_back({w.offset(n), w.bytes(n)});
  const std::vector<PieceSpan> spans = replace_layers(changed, *coded, 0, kept, layers);
  changed.lay_out();
  check_offsets_fit(changed, file);
  if (r.exposure_changes) {
    const ExposureSummary s = head_summary(r.info);
    if (w.header.u32(kLayerFlag) == 0) {
      require_even_times(r, s,
                         "the file's mark that printers heed times of single layers is not set");
    }
    if (s.fade_layers > 0 && !s.uneven && w.version < 516) {
      throw InputError(
          file.path(), "",
          "can't say that exposures fade from bottom layers to the others; expected no "
          "fade layers");
    }
    w.header.set_f32(kExposure, s.normal_s);
    w.header.set_f32(kBottomExposure, s.bottom_s);
    if (!s.uneven || s.bottom_layers > 0) {
      w.header.set_f32(kBottomLayers, s.bottom_layers);
      if (w.version >= 516) {
        w.header.set_u32(kTransition, static_cast<std::uint32_t>(s.fade_layers));
      }
    }
  }
  if (w.version >= 516) {
    w.header.set_u32(kPrintTime,
                     changed_print_time_s(w.header.u32(kPrintTime), r.kept_contents->info, r.info));
  }
  BinaryBlock records(w.record(layers), ByteOrder::little);
  std::copy_n(w.layers.bytes().begin(), kTableHeadBytes, records.bytes().begin());
  records.set_u32(12, static_cast<std::uint32_t>(4 + layers * kRecordBytes));
  records.set_u32(kTableHeadBytes, static_cast<std::uint32_t>(layers));
  std::vector<std::uint8_t> before, now;
  const auto stays = [&](std::size_t n) {
    if (n >= old || coded->sizes[n] != w.bytes(n)) return false;
    file.read_at(w.offset(n), w.bytes(n), before, "layer");
    now.clear();
    coded->append(n, now);
    return now == before;
  };
  for (std::size_t n = 0; n < layers; ++n) {
    const std::size_t to = w.record(n);
    std::copy_n(
        w.layers.bytes().begin() + static_cast<std::ptrdiff_t>(w.record(std::min(n, old - 1))),
        kRecordBytes, records.bytes().begin() + static_cast<std::ptrdiff_t>(to));
    records.set_u32(to + kOffset, static_cast<std::uint32_t>(changed.place(spans[n].span)));
    records.set_u32(to + kBytes, static_cast<std::uint32_t>(coded->sizes[n]));
    if (!stays(n)) records.set_u32(to + kLit, static_cast<std::uint32_t>(coded->lit_pixels[n]));
    if (r.exposure_changes) {
      records.set_f32(to + kRecordExposure, light_on_of_layer(r.info, static_cast<int>(n)));
    }
  }
  if (w.second_list) changed.fill(second_table, changed_second_list(*w.second_list, records, w));
  // Everything that an offset leads to may have moved.
  for (std::size_t at = kHeaderAt; at < w.mark.size(); at += 4) {
    const std::uint32_t offset = w.mark.u32(at);
    if (offset != 0) w.mark.set_u32(at, static_cast<std::uint32_t>(changed.moved(offset)));
  }
  changed.fill(mark, w.mark.bytes());
  changed.fill(header, w.header.bytes());
  changed.fill(table, records.bytes());
  for (std::size_t n = 0; n < layers; ++n) {
    if (!spans[n].owns) continue;
    changed.fill(
        spans[n].span,
        [coded](std::size_t i, std::vector<std::uint8_t>& out) {
          out.clear();
          coded->append(i, out);
        },
        n);
  }
  changed.add_to(output);
}

class PhotonWorkshop final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "photon-workshop"; }
  std::string_view what() const override { return "Anycubic Photon Workshop"; }
  std::vector<std::string_view> endings() const override {
    return {".pwmx", ".pwmo", ".pwms", ".pwma", ".pwmb", ".pws",  ".pw0",  ".pwx",
            ".pmsq", ".pmx2", ".px6s", ".pm3",  ".pm3m", ".pm3r", ".pm3n", ".pm4n",
            ".pm5",  ".pm5s", ".m5sp", ".dlp",  ".dl2p", ".pwc"};
  }
  ContainerKind container() const override { return ContainerKind::binary; }
  bool made_new() const override { return false; }
  bool recognises(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    return file.size() >= kMarkBytes &&
           BinaryBlock(file, 0, 12, "start of the file").text(0, 12) == "ANYCUBIC";
  }

  ArchiveContents read(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    const WorkshopFile w = read_workshop(file);
    const BinaryBlock& h = w.header;
    ArchiveContents contents;
    StackInfo& info = contents.info;
    Grid& grid = info.grid;
    grid.width_px = static_cast<int>(h.u32(kWidth));
    grid.height_px = static_cast<int>(h.u32(kHeight));
    grid.layers = info.target_layers = static_cast<int>(w.count);
    const double pixel = h.real(kPixelUm, "the size of a pixel", 1000);
    grid.pixel_x_um = grid.pixel_y_um = pixel_um(pixel * 1e-3, file, "HEADER");
    if (w.machine && w.machine->f32(0x88) > 0 && w.machine->f32(0x8c) > 0) {
      grid.pixel_x_um = pixel_um(w.machine->real(0x88, "the display's width", 1e4) / grid.width_px,
                                 file, "MACHINE");
      grid.pixel_y_um = pixel_um(
          w.machine->real(0x8c, "the display's height", 1e4) / grid.height_px, file, "MACHINE");
    }
    grid.layer_um = layer_um(h.real(kLayerMm, "the layer height", 100), file, "HEADER");
    info.exposure_s = h.real(kExposure, "the exposure", 1e6);
    info.bottom_exposure_s = h.real(kBottomExposure, "the exposure of bottom layers", 1e6);
    info.bottom_layers = static_cast<int>(std::min<double>(
        std::round(h.real(kBottomLayers, "the number of bottom layers", 1e5)), w.count));
    if (w.version >= 516)
      info.fade_layers = static_cast<int>(std::min(h.u32(kTransition), w.count));
    std::vector<double> times_s;
    for (std::size_t n = 0; n < w.count; ++n) {
      times_s.push_back(w.layers.real(w.record(n) + kRecordExposure, "a layer's exposure", 1e6));
      contents.z_mm.push_back(w.layers.f32(w.record(n) + kThickness) +
                              (n > 0 ? contents.z_mm.back() : 0));
    }
    if (h.u32(kLayerFlag) != 0) {
      take_layer_times(std::move(times_s), info);
    } else {
      if (info.bottom_layers == 0) info.fade_layers = 0;
      tell_unheeded_times(times_s, info, contents.warnings);
    }
    if (printer_chooses_exposures(file, w)) contents.warnings.emplace_back(kPrinterChoosesWords);
    take_lifts_of(file, w, info);
    if (w.version >= 516) info.own_print_time_s = h.u32(kPrintTime);
    if (w.machine) {
      info.profiles.printer = w.machine->text(0x10, 96);
      info.machine_height_mm = machine_height_of(w.machine->f32(0x90));
    }
    contents.codec = codec_of(file, w);
    const std::uint32_t aa = h.u32(kAntiAliasing);
    const bool pw0 = is_pw0(file, w);
    if (pw0 && !w.is_black_and_white() && aa != 16) {
      contents.warnings.push_back(
          fmt::format("is for anti-aliasing of {}: its table shows other grey levels than sixteen "
                      "equal steps, which are not taken into account; expected a slice with 16",
                      aa));
    }
    for (std::size_t n = 0; n < w.count; ++n) contents.places.push_back({w.offset(n), w.bytes(n)});
    add_facts(w, pw0, contents);
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.exposure_changes) warn_of_mode(r, "Photon Workshop", printers_lift());
    change_workshop(r, binary_output(output));
    return {};
  }
};

}  // namespace workshop
}  // namespace

const ArchiveFormat& photon_workshop_format() {
  static const workshop::PhotonWorkshop format;
  return format;
}

}  // namespace slicecorr::detail
