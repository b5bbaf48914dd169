// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Elegoo's GOO: a head of fixed size, then layers one behind the other. All numbers are big-endian.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/version.hpp"
#include "stack/formats/binary_block.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

using namespace std::string_view_literals;

constexpr std::uint64_t kHeadBytes = 0x2fb95, kLayerHeadBytes = 0x46;
constexpr std::string_view kEnd = "\0\0\0\x07\0\0\0DLP\0"sv, kBreak = "\r\n"sv;
constexpr std::string_view kStart = "V3.0\x07\0\0\0DLP\0"sv;

// Places in the head.
constexpr std::size_t kProgram = 0x0c, kProgramVersion = 0x2c, kPrinter = 0x5c, kPrinterType = 0x7c,
                      kResin = 0x9c, kAntiAliasing = 0xbc, kSmall = 0xc2, kLarge = 0x69e4,
                      kLayers = 0x2faee, kWidth = 0x2faf2, kHeight = 0x2faf4, kMirrorX = 0x2faf6,
                      kMirrorY = 0x2faf7, kDisplay = 0x2faf8, kLayerMm = 0x2fb04,
                      kExposure = 0x2fb08, kMode = 0x2fb0c, kLightOff = 0x2fb0d, kWaits = 0x2fb11,
                      kBottomExposure = 0x2fb29, kBottomLayers = 0x2fb2d, kLifts = 0x2fb31,
                      kBottomLight = 0x2fb71, kLight = 0x2fb73, kLayerFlag = 0x2fb75,
                      kPrintTime = 0x2fb76, kVolume = 0x2fb7a, kWeight = 0x2fb7e, kPrice = 0x2fb82,
                      kLayersAt = 0x2fb8e, kGreyRange = 0x2fb92, kTransition = 0x2fb93;
// Places in the head of a layer.
constexpr std::size_t kZ = 0x06, kLayerExposure = 0x0a, kLayerLightOff = 0x0e, kLayerWaits = 0x12,
                      kLayerLift = 0x1e, kLayerLight = 0x3e, kLayerBreak = 0x40, kLayerBytes = 0x42;
// Pairs of a way, mm, and a speed, mm/min, behind kLifts and, without bottom layers, behind kLayerLift.
constexpr std::size_t kPairBytes = 8;

constexpr int kSmallPx = 116, kLargePx = 290;

struct GooFile {
  BinaryBlock head;
  std::vector<BinaryBlock> layers;  ///< heads
  std::uint64_t end = 0;            ///< of the last layer
  std::uint64_t bytes_of(std::size_t n) const { return layers[n].u32(kLayerBytes); }
};

bool says_break(const BinaryBlock& block, std::size_t at) {
  return block.u8(at) == '\r' && block.u8(at + 1) == '\n';
}

GooFile read_goo(const BinaryFile& file) {
  GooFile goo;
  goo.head = BinaryBlock(file, 0, kHeadBytes, "head", ByteOrder::big);
  const BinaryBlock& head = goo.head;
  for (const std::size_t at : {kLarge - 2, kLayers - 2}) {
    if (!says_break(head, at)) head.fail(at, "expected the bytes 0D 0A behind a preview");
  }
  const std::uint32_t at_first = head.u32(kLayersAt), count = head.u32(kLayers);
  if (at_first < kHeadBytes || at_first >= file.size()) {
    head.fail(kLayersAt,
              fmt::format("says that layers start at byte {}, expected {} to {}: maybe a "
                          "file whose numbers are little-endian, which is not known well "
                          "enough",
                          at_first, kHeadBytes, file.size()));
  }
  check_image_size(file, head.u16(kWidth), head.u16(kHeight));
  check_layer_count(file, count);
  std::uint64_t at = at_first;
  double last_mm = -1;
  for (std::uint32_t n = 0; n < count; ++n) {
    const std::string name = fmt::format("layer {}", n);
    BinaryBlock layer(file, at, kLayerHeadBytes, name, ByteOrder::big);
    if (!says_break(layer, kLayerBreak)) layer.fail(kLayerBreak, "expected the bytes 0D 0A");
    const double z_mm = layer.real(kZ, "a layer's place", 1e5);
    if (z_mm < last_mm) {
      layer.fail(kZ,
                 fmt::format("is at {:g} mm, below the one before it, at {:g} mm", z_mm, last_mm));
    }
    last_mm = z_mm;
    layer.real(kLayerExposure, "the exposure", 1e6);
    const std::uint64_t bytes = layer.u32(kLayerBytes);
    const BinaryBlock after(file, at + kLayerHeadBytes + bytes, 2, name + "'s end", ByteOrder::big);
    if (!says_break(after, 0)) after.fail(0, "expected the bytes 0D 0A behind the layer's data");
    at = after.offset() + 2;
    goo.layers.push_back(std::move(layer));
  }
  goo.end = at;
  const BinaryBlock end(file, at, kEnd.size(), "end", ByteOrder::big);
  if (!std::equal(kEnd.begin(), kEnd.end(), end.bytes().begin(),
                  [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; })) {
    end.fail(0, "expected the end mark of the format behind the last layer");
  }
  return goo;
}

std::vector<double> times_of(const GooFile& goo) {
  std::vector<double> times_s;
  for (const BinaryBlock& layer : goo.layers) {
    times_s.push_back(layer.real(kLayerExposure, "the exposure", 1e6));
  }
  return times_s;
}

/// How bright each layer is lit: as it says itself where printers heed that, else as the head does.
std::vector<double> light_of(const GooFile& goo) {
  std::vector<double> light;
  for (std::size_t n = 0; n < goo.layers.size(); ++n) {
    const bool bottom = n < goo.head.u32(kBottomLayers);
    light.push_back(goo.head.u8(kLayerFlag) != 0 ? goo.layers[n].u16(kLayerLight)
                                                 : goo.head.u16(bottom ? kBottomLight : kLight));
  }
  return light;
}

/// Ways and speeds: a stage up, the second one, and the same back, each at its place.
LiftMotion motion_at(LiftNumbers& n, std::size_t up, std::size_t up_2, std::size_t back,
                     std::size_t back_2) {
  LiftMotion m;
  m.up_mm = n.at(up);
  m.up_mm_s = n.mm_s(up + 4);
  m.up_2_mm = n.at(up_2);
  m.up_2_mm_s = n.mm_s(up_2 + 4);
  m.back_mm_s = n.mm_s(back + 4);
  m.back_2_mm = n.at(back_2);
  m.back_2_mm_s = n.mm_s(back_2 + 4);
  return m;
}

void take_waits(LiftNumbers& n, std::size_t at, LiftMotion& m) {
  m.before_lift_s = n.at(at);
  m.after_lift_s = n.at(at + 4);
  m.before_light_s = n.at(at + 8);
}

void take_lifts_of(const GooFile& goo, StackInfo& info) {
  const BinaryBlock& head = goo.head;
  LiftNumbers n(head);
  LiftTimes lifts;
  const auto pairs = [&](std::size_t first) {
    const auto at = [&](std::size_t i) { return kLifts + (2 * i + first) * kPairBytes; };
    return motion_at(n, at(0), at(2), at(1), at(3));
  };
  lifts.bottom = pairs(0);
  lifts.normal = pairs(1);
  lifts.bottom_layers = info.bottom_layers;
  const bool waits = head.u8(kMode) != 0;
  if (waits) {
    take_waits(n, kWaits, lifts.bottom);
    take_waits(n, kWaits + 12, lifts.normal);
  } else {
    lifts.bottom.light_off_s = lifts.normal.light_off_s = n.at(kLightOff);
  }
  bool known = n.known();
  if (head.u8(kLayerFlag) != 0) {
    for (const BinaryBlock& layer : goo.layers) {
      LiftNumbers own(layer);
      constexpr std::size_t at = kLayerLift;
      LiftMotion m = motion_at(own, at, at + kPairBytes, at + 2 * kPairBytes, at + 3 * kPairBytes);
      if (waits) {
        take_waits(own, kLayerWaits, m);
      } else {
        m.light_off_s = own.at(kLayerLightOff);
      }
      known = known && own.known();
      lifts.layers.push_back(m);
    }
  }
  if (known) take_lifts(std::move(lifts), info);
}

void add_facts(const GooFile& goo, const BinaryFile& file, ArchiveContents& contents) {
  const BinaryBlock& head = goo.head;
  const auto add = [&](const char* name, const std::string& value) {
    contents.facts.emplace_back(name, value);
  };
  add("version", "V3.0");
  add("program", head.text(kProgram, 32) + " " + head.text(kProgramVersion, 24));
  add("display", fmt::format("{:g} x {:g} mm, {:g} mm high", head.f32(kDisplay),
                             head.f32(kDisplay + 4), head.f32(kDisplay + 8)));
  add("time shown", fmt::format("{} s", head.u32(kPrintTime)));
  add(head.u8(kMode) == 0 ? "light off" : "waits instead of light off",
      fmt::format("{:g} s", head.f32(kLightOff)));
  add("light",
      fmt::format("{} of 255, {} for bottom layers", head.u16(kLight), head.u16(kBottomLight)));
  const auto pair = [&](std::size_t i) {
    return fmt::format("{:g} mm at {:g} mm/min", head.f32(kLifts + i * kPairBytes),
                       head.f32(kLifts + i * kPairBytes + 4));
  };
  add("lift", fmt::format("{}, bottom {}, back {}, bottom {}", pair(1), pair(0), pair(3), pair(2)));
  bool two_stages = false;
  for (std::size_t i = 4; i < 8; ++i) two_stages |= head.f32(kLifts + i * kPairBytes) > 0;
  if (two_stages) {
    add("second lift",
        fmt::format("{}, bottom {}, back {}, bottom {}", pair(5), pair(4), pair(7), pair(6)));
  }
  // Before lifts, after them, after the way back: first those of bottom layers.
  const auto waits = [&](std::size_t first) {
    return fmt::format("{:g} s, {:g} s, {:g} s", head.f32(kWaits + 4 * first),
                       head.f32(kWaits + 4 * first + 4), head.f32(kWaits + 4 * first + 8));
  };
  add("waits", waits(3) + " before and after lifts and before light, bottom " + waits(0));
  add("anti-aliasing", fmt::format("{}, grey {}, blur {}", head.u16(kAntiAliasing),
                                   head.u16(kAntiAliasing + 2), head.u16(kAntiAliasing + 4)));
  add("times of single layers", head.u8(kLayerFlag) != 0 ? "heeded" : "not heeded");
  add("transition layers", std::to_string(head.u16(kTransition)));
  add("resin used", fmt::format("{:g} ml, {:g} g, cost {:g}", head.f32(kVolume) / 1000,
                                head.f32(kWeight), head.f32(kPrice)));
  const std::uint64_t rest = file.size() - goo.end - kEnd.size();
  if (rest > 0) add("bytes behind the end", std::to_string(rest));
}

std::uint32_t u32_of(double value) { return static_cast<std::uint32_t>(std::min(value, 4e9)); }

void change_goo(const ArchiveRequest& r, BinaryOutput& output) {
  const BinaryFile& file = binary_file(*r.kept);
  GooFile goo = read_goo(file);
  BinaryBlock& head = goo.head;
  const auto layers = static_cast<std::size_t>(r.info.grid.layers), old = goo.layers.size();
  FileChange changed(file);
  const std::size_t head_span = changed.replace(0, head.size(), head.size());
  const auto whole = [](std::uint64_t bytes) { return kLayerHeadBytes + bytes + kBreak.size(); };
  std::vector<std::size_t> spans;
  for (std::size_t n = 0; n < std::max(layers, old); ++n) {
    const bool added = n >= old;
    spans.push_back(changed.replace(added ? goo.end : goo.layers[n].offset(),
                                    added ? 0 : whole(goo.bytes_of(n)),
                                    n < layers ? whole(r.layers->sizes[n]) : 0));
  }
  changed.lay_out();
  head.set_u32(kLayers, static_cast<std::uint32_t>(layers));
  head.set_u32(kPrintTime,
               changed_print_time_s(head.u32(kPrintTime), r.kept_contents->info, r.info));
  if (r.exposure_changes) {
    const ExposureSummary s = head_summary(r.info);
    if (head.u8(kLayerFlag) == 0) {
      require_even_times(r, s,
                         "the file's mark that printers heed times of single layers is not set");
    }
    head.set_f32(kExposure, s.normal_s);
    head.set_f32(kBottomExposure, s.bottom_s);
    if (!s.uneven || s.bottom_layers > 0) {
      head.set_u32(kBottomLayers, static_cast<std::uint32_t>(s.bottom_layers));
      head.set_u16(kTransition, static_cast<std::uint32_t>(s.fade_layers));
    }
  }
  std::vector<unsigned> light;
  if (r.light_changes) {
    const LightSteps steps = light_steps(r, file.path(), static_cast<int>(head.u32(kBottomLayers)));
    if (head.u8(kLayerFlag) == 0 && steps.uneven) {
      throw InputError(
          file.path(), "",
          "the file's mark that printers heed settings of single layers is not set, so "
          "layers can't have light of their own; expected one share for the bottom layers "
          "and one for all others");
    }
    light = steps.layers;
    head.set_u16(kBottomLight, steps.bottom);
    head.set_u16(kLight, steps.usual);
  }
  changed.fill(head_span, head.bytes());
  const CodedLayers* const coded = r.layers;
  for (std::size_t n = 0; n < layers; ++n) {
    BinaryBlock layer = goo.layers[std::min(n, old - 1)];
    if (n >= old) {
      const double last_um =
          layer_height_um(r.kept_contents->info, r.kept_contents->info.grid.layers);
      layer.set_f32(kZ, layer.f32(kZ) + static_cast<double>(n - old + 1) * last_um * 1e-3);
    }
    if (r.exposure_changes) {
      layer.set_f32(kLayerExposure, light_on_of_layer(r.info, static_cast<int>(n)));
    }
    if (!light.empty()) layer.set_u16(kLayerLight, light[n]);
    layer.set_u32(kLayerBytes, static_cast<std::uint32_t>(coded->sizes[n]));
    changed.fill(
        spans[n],
        [coded, its = std::move(layer.bytes())](std::size_t i, std::vector<std::uint8_t>& out) {
          out = its;
          coded->append(i, out);
          out.insert(out.end(), kBreak.begin(), kBreak.end());
        },
        n);
  }
  changed.add_to(output);
}

/// Ways and speeds, each stage at its place: as `motion_at` reads them. First stages back have what second
/// ones leave.
void set_motion(BinaryBlock& block, const LiftMotion& m, const std::array<std::size_t, 4>& places) {
  const auto [up, up_2, back, back_2] = places;
  const auto set = [&](std::size_t at, double way_mm, double mm_s) {
    block.set_f32(at, way_mm);
    block.set_f32(at + 4, 60 * mm_s);
  };
  set(up, m.up_mm, m.up_mm_s);
  set(up_2, m.up_2_mm, m.up_2_mm_s);
  set(back, std::max(0.0, m.up_mm + m.up_2_mm - m.back_2_mm), m.back_mm_s);
  set(back_2, m.back_2_mm, m.back_2_mm_s);
}

/// Light that stays off for longer than moves and rests take is a rest before light.
void set_waits(BinaryBlock& block, std::size_t at, const LiftMotion& m) {
  LiftMotion without = m;
  without.light_off_s = 0;
  const double more_s = dark_time(m, 0).all_s() - dark_time(without, 0).all_s();
  block.set_f32(at, m.before_lift_s);
  block.set_f32(at + 4, m.after_lift_s);
  block.set_f32(at + 8, m.before_light_s + more_s);
}

void write_new(const ArchiveRequest& r, BinaryOutput& output) {
  const StackInfo& info = r.info;
  const Grid& grid = info.grid;
  const ExposureSummary s = head_summary(info);
  const NewLift lift = new_lift(info);
  tell_new_lift(r, "GOO", lift);
  BinaryBlock head(kHeadBytes, ByteOrder::big);
  head.set_bytes(0, kStart);
  head.set_text(kProgram, 32, "slicecorr");
  head.set_text(kProgramVersion, 24, version);
  // No clock time: the same input gives the same bytes.
  head.set_text(0x44, 24, "1980-01-01 00:00:00");
  head.set_text(kPrinter, 32, info.printer ? info.printer->name : info.profiles.printer);
  head.set_text(kPrinterType, 32, "DLP");
  head.set_text(kResin, 32, info.resin ? info.resin->name : info.profiles.material);
  head.set_u16(kAntiAliasing, 8);
  const auto small = rgb565_bytes(r.preview, kSmallPx, kSmallPx);
  const auto large = rgb565_bytes(r.preview, kLargePx, kLargePx);
  std::copy(small.begin(), small.end(), head.bytes().begin() + kSmall);
  std::copy(large.begin(), large.end(), head.bytes().begin() + kLarge);
  head.set_bytes(kLarge - 2, kBreak);
  head.set_bytes(kLayers - 2, kBreak);
  head.set_u32(kLayers, static_cast<std::uint32_t>(grid.layers));
  head.set_u16(kWidth, static_cast<std::uint32_t>(grid.width_px));
  head.set_u16(kHeight, static_cast<std::uint32_t>(grid.height_px));
  head.set_u8(kMirrorX, info.orientation.mirror_x);
  head.set_u8(kMirrorY, info.orientation.mirror_y);
  const double total_mm = stack_height_um(info, grid.layers) * 1e-3;
  const LightSteps light = light_steps(r, r.stem, s.bottom_layers);
  const bool own = s.uneven || light.uneven || lift.differs_from_head(s.bottom_layers, true);
  if (own) tell_own_settings(r, "GOO");
  head.set_f32(kDisplay, grid.width_px * grid.pixel_x_um * 1e-3);
  head.set_f32(kDisplay + 4, grid.height_px * grid.pixel_y_um * 1e-3);
  head.set_f32(kDisplay + 8, new_machine_height_mm(info, total_mm));
  head.set_f32(kLayerMm, grid.layer_um * 1e-3);
  head.set_f32(kExposure, s.normal_s);
  head.set_u8(kMode, 1);
  head.set_f32(kBottomExposure, s.bottom_s);
  head.set_u32(kBottomLayers, static_cast<std::uint32_t>(s.bottom_layers));
  // Of bottom layers and of the others.
  for (const std::size_t which : {0, 1}) {
    const LiftMotion& m = lift.times.of(which == 0 ? 0 : grid.layers - 1);
    const auto pair = [&](std::size_t i) { return kLifts + (2 * i + which) * kPairBytes; };
    set_motion(head, m, {pair(0), pair(2), pair(1), pair(3)});
    set_waits(head, kWaits + 12 * which, m);
  }
  head.set_u16(kBottomLight, light.bottom);
  head.set_u16(kLight, light.usual);
  head.set_u8(kLayerFlag, own);
  const std::vector<double> times_s = layer_times(info);
  double print_time_s = 0;
  for (std::size_t n = 0; n < times_s.size(); ++n) {
    print_time_s += times_s[n] + lift.dark_s(static_cast<int>(n));
  }
  head.set_u32(kPrintTime, u32_of(print_time_s));
  head.set_f32(kVolume, info.part_volume_mm3);
  head.set_bytes(kPrice + 4, "$");
  head.set_u32(kLayersAt, static_cast<std::uint32_t>(kHeadBytes));
  head.set_u8(kGreyRange, 1);
  head.set_u16(kTransition, static_cast<std::uint32_t>(s.fade_layers));
  output.add_piece(head.bytes());
  const CodedLayers* const coded = r.layers;
  double z_um = 0;
  const bool own_heights = has_own_heights(info);
  for (std::size_t n = 0; n < times_s.size(); ++n) {
    BinaryBlock layer(kLayerHeadBytes, ByteOrder::big);
    z_um = own_heights ? z_um + layer_height_um(info, static_cast<int>(n))
                       : static_cast<double>(n + 1) * grid.layer_um;
    layer.set_f32(kZ, z_um * 1e-3);
    layer.set_f32(kLayerExposure, times_s[n]);
    const LiftMotion& m = lift.times.of(static_cast<int>(n));
    set_waits(layer, kLayerWaits, m);
    const auto pair = [](std::size_t i) { return kLayerLift + i * kPairBytes; };
    set_motion(layer, m, {pair(0), pair(1), pair(2), pair(3)});
    layer.set_u16(kLayerLight, light.layers[n]);
    layer.set_bytes(kLayerBreak, kBreak);
    layer.set_u32(kLayerBytes, static_cast<std::uint32_t>(coded->sizes[n]));
    output.add_piece(
        kLayerHeadBytes + coded->sizes[n] + kBreak.size(),
        [coded, its = std::move(layer.bytes())](std::size_t i, std::vector<std::uint8_t>& out) {
          out = its;
          coded->append(i, out);
          out.insert(out.end(), kBreak.begin(), kBreak.end());
        },
        n);
  }
  output.add_piece({kEnd.begin(), kEnd.end()});
}

class Goo final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "goo"; }
  std::string_view what() const override { return "Elegoo GOO, and Phrozen's PRZ"; }
  std::vector<std::string_view> endings() const override { return {".goo", ".prz"}; }
  ContainerKind container() const override { return ContainerKind::binary; }
  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }
  bool says_lifts() const override { return true; }
  bool changes_exposures() const override { return true; }
  LayerCodecPtr new_codec(const Grid& grid) const override {
    return goo_code(grid.width_px, grid.height_px, false);
  }
  bool recognises(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    if (file.size() < kStart.size()) return false;
    std::vector<std::uint8_t> start;
    file.read_at(0, kStart.size(), start, "head");
    return std::string_view(reinterpret_cast<const char*>(start.data()), start.size()) == kStart;
  }

  std::vector<std::uint8_t> preview(const Container& archive) const override {
    const auto side = static_cast<std::size_t>(kLargePx);
    const BinaryBlock large(binary_file(archive), kLarge, 2 * side * side, "large preview",
                            ByteOrder::big);
    GreyImage image{kLargePx, kLargePx, std::vector<std::uint8_t>(side * side)};
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
      image.pixels[i] = grey_of_rgb565(large.u16(2 * i));
    }
    return encode_png(image);
  }

  ArchiveContents read(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    const GooFile goo = read_goo(file);
    const BinaryBlock& head = goo.head;
    ArchiveContents contents;
    StackInfo& info = contents.info;
    Grid& grid = info.grid;
    grid.width_px = head.u16(kWidth);
    grid.height_px = head.u16(kHeight);
    grid.layers = info.target_layers = static_cast<int>(goo.layers.size());
    grid.pixel_x_um =
        pixel_um(head.real(kDisplay, "the display's width", 1e4) / grid.width_px, file, "head");
    grid.pixel_y_um = pixel_um(
        head.real(kDisplay + 4, "the display's height", 1e4) / grid.height_px, file, "head");
    grid.layer_um = layer_um(head.real(kLayerMm, "the layer height", 100), file, "head");
    info.machine_height_mm = machine_height_of(head.f32(kDisplay + 8));
    info.exposure_s = head.real(kExposure, "the exposure", 1e6);
    info.bottom_exposure_s = head.real(kBottomExposure, "the exposure of bottom layers", 1e6);
    info.bottom_layers =
        static_cast<int>(std::min<std::size_t>(head.u32(kBottomLayers), goo.layers.size()));
    const std::vector<double> times_s = times_of(goo);
    if (head.u8(kLayerFlag) != 0) {
      take_layer_times(times_s, info);
    } else {
      // Printers then go by the head alone, and fade from it evenly.
      if (info.bottom_layers > 0) {
        info.fade_layers =
            static_cast<int>(std::min<std::size_t>(head.u16(kTransition), goo.layers.size()));
      }
      tell_unheeded_times(times_s, info, contents.warnings);
    }
    take_light(light_of(goo), 255, file.path(), "head", info, &contents.warnings);
    for (const BinaryBlock& layer : goo.layers) contents.z_mm.push_back(layer.f32(kZ));
    take_lifts_of(goo, info);
    info.own_print_time_s = head.u32(kPrintTime);
    info.orientation.mirror_x = head.u8(kMirrorX) != 0;
    info.orientation.mirror_y = head.u8(kMirrorY) != 0;
    info.orientation_known = true;
    info.profiles.printer = head.text(kPrinter, 32);
    info.profiles.material = head.text(kResin, 32);
    contents.codec = goo_code(grid.width_px, grid.height_px, head.u8(kGreyRange) == 0);
    for (std::size_t n = 0; n < goo.layers.size(); ++n) {
      contents.places.push_back({goo.layers[n].offset() + kLayerHeadBytes, goo.bytes_of(n)});
    }
    add_facts(goo, file, contents);
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.kept == nullptr || r.exposure_changes) warn_of_mode(r, "GOO", printers_lift());
    if (r.kept != nullptr) {
      change_goo(r, binary_output(output));
    } else {
      write_new(r, binary_output(output));
    }
    return {};
  }
};

}  // namespace

const ArchiveFormat& goo_format() {
  static const Goo format;
  return format;
}

}  // namespace slicecorr::detail
