// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Creality's CXDLP, versions 1 to 3: all numbers big-endian, texts with a length, layers of vertical
// lines, a checksum of the whole file at its end. Version 4 begins like them (cxdlp4_file.cpp).

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/binary_block.hpp"
#include "stack/formats/cxdlp_file.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/isa_l.hpp"

namespace slicecorr::detail {
namespace {

constexpr auto kBig = ByteOrder::big;
constexpr std::uint32_t kMostTextBytes = 1024;
constexpr std::size_t kSettings = 11;
/// Numbers of the settings, u16 each, in their order.
enum CxdlpSetting {
  exposure_tenths,
  wait_s,
  bottom_exposure_s,
  bottom_layers,
  bottom_lift,
  bottom_speed,
  lift,
  lift_speed,
  back_speed,
  bottom_light,
  light
};

struct CxdlpFile {
  int version = 1;
  std::string model, program, resin;
  std::uint64_t head_at = 0;      ///< of what follows the model
  std::uint64_t count_at = 0;     ///< of the number of layers, u16
  std::uint64_t settings_at = 0;  ///< of `kSettings` numbers
  std::uint64_t areas_at = 0;     ///< of an area for each layer, u32
  BinaryBlock settings;
  std::uint32_t layers = 0, width_px = 0, height_px = 0;
  std::string width_mm, height_mm, layer_mm;
  std::vector<ArchiveContents::Place> lines;  ///< of each layer
  std::uint64_t layers_end = 0, check_at = 0;
};

/// Reads a file from its start on.
class Cursor {
 public:
  explicit Cursor(const BinaryFile& file) : file_(file) {}
  std::uint64_t at = 0;
  BinaryBlock take(std::uint64_t bytes, const char* what) {
    BinaryBlock block(file_, at, bytes, what, kBig);
    at += bytes;
    return block;
  }
  std::uint32_t u32(const char* what) { return take(4, what).u32(0); }
  std::uint32_t u16(const char* what) { return take(2, what).u16(0); }
  std::string text(const char* what, bool wide) {
    const std::uint32_t bytes = u32(what);
    if (bytes > kMostTextBytes) {
      throw InputError(file_.path(), what,
                       fmt::format("has {} bytes, expected at most {}", bytes, kMostTextBytes));
    }
    const BinaryBlock block = take(bytes, what);
    std::string text;
    for (std::size_t i = wide ? 1 : 0; i < bytes && block.u8(i) != 0; i += wide ? 2 : 1) {
      text.push_back(static_cast<char>(block.u8(i)));
    }
    return shown_name(text);
  }
  void need_break(const char* what) {
    const BinaryBlock block = take(2, what);
    if (block.u16(0) != 0x0d0a)
      block.fail(0, fmt::format("expected the bytes 0D 0A behind {}", what));
  }

 private:
  const BinaryFile& file_;
};

double number_of(const std::string& text, const BinaryFile& file, const char* what) {
  KeyValueText value(std::string(what) + "=" + text, '=', file.path(), "head");
  return value.need_number(what, 0, 1e4);
}

/// Of version 4 only model and place of the head.
CxdlpFile read_cxdlp(const BinaryFile& file) {
  CxdlpFile c;
  Cursor in(file);
  const std::string magic = in.text("head", false);
  if (magic == "CXSW3DV2") {
    c.version = static_cast<int>(in.u16("version"));
    if (c.version < 2 || c.version > 4) {
      throw InputError(file.path(), "version", fmt::format("is {}, expected 2 to 4", c.version));
    }
    c.model = in.text("model", false);
    c.head_at = in.at;
    if (c.version == 4) return c;
  } else if (magic != "CXSW3D") {
    throw InputError(file.path(), "head", "is of a version of CXDLP that is not known");
  }
  c.count_at = in.at;
  c.layers = in.u16("number of layers");
  c.width_px = in.u16("width");
  c.height_px = in.u16("height");
  check_layer_count(file, c.layers);
  check_image_size(file, c.width_px, c.height_px);
  if (c.width_px > 0x4000 || c.height_px > 0x2000) {
    throw InputError(
        file.path(), "head",
        fmt::format("says {} x {} pixels, expected at most 16384 x 8192", c.width_px, c.height_px));
  }
  if (c.version >= 2) in.take(64, "head");
  for (const std::uint64_t side : {116, 290, 290}) {
    in.take(2 * side * side, "preview");
    in.need_break("a preview");
  }
  c.width_mm = in.text("display's width", true);
  c.height_mm = in.text("display's height", true);
  c.layer_mm = in.text("layer height", true);
  c.settings_at = in.at;
  c.settings = in.take(2 * kSettings, "settings");
  c.areas_at = in.at;
  in.take(std::uint64_t{4} * c.layers, "areas of layers");
  in.need_break("the areas of layers");
  if (c.version >= 3) {
    c.program = in.text("program", false);
    c.resin = in.text("resin", false);
    in.take(20, "switches");
    in.need_break("the switches");
  }
  for (std::uint32_t n = 0; n < c.layers; ++n) {
    const std::string name = fmt::format("layer {}", n);
    in.take(4, name.c_str());
    const std::uint64_t bytes = std::uint64_t{in.u32(name.c_str())} * kCxdlpLineBytes;
    if (bytes > file.size() - in.at) {
      throw InputError(
          file.path(), name,
          fmt::format("says {} lines, but the file ends before", bytes / kCxdlpLineBytes));
    }
    c.lines.push_back({in.at, bytes});
    in.at += bytes;
    in.need_break(name.c_str());
  }
  c.layers_end = in.at;
  const std::string end = in.text("end", false);
  // Files that start with CXSW3DV2 end with either.
  if (end != "CXSW3D" && end != "CXSW3DV2") {
    throw InputError(file.path(), "end", "is not the mark of the format");
  }
  c.check_at = in.at;
  if (c.version >= 2) in.take(4, "checksum");
  if (in.at != file.size()) {
    throw InputError(file.path(), "end",
                     fmt::format("{} bytes follow, expected none", file.size() - in.at));
  }
  check_cxdlp_sum(file, c.version, c.check_at);
  return c;
}

void change_cxdlp(const ArchiveRequest& r, BinaryOutput& output) {
  const BinaryFile& file = binary_file(*r.kept);
  CxdlpFile c = read_cxdlp(file);
  if (c.version == 4) return change_cxdlp4(r, c.head_at, output);
  const auto layers = static_cast<std::size_t>(r.info.grid.layers);
  const std::size_t old = c.layers;
  if (layers > 65535) throw InputError(file.path(), "", "can't hold more than 65535 layers");
  if (r.exposure_changes) {
    const ExposureSummary s = exposure_summary(r.info);
    require_even_times(r, s, "the format has no times of single layers");
    if (s.fade_layers > 0) {
      throw InputError(
          file.path(), "",
          "can't say that exposures fade from bottom layers to the others; expected no "
          "fade layers");
    }
    const double tenths = std::round(s.normal_s * 10), bottom_s = std::round(s.bottom_s);
    if (std::abs(tenths / 10 - s.normal_s) > 0.005 || std::abs(bottom_s - s.bottom_s) > 0.005) {
      throw InputError(
          file.path(), "",
          fmt::format("says exposures in tenths of a second and those of bottom layers in "
                      "seconds, so it can't say {:g} and {:g} s{}",
                      s.normal_s, s.bottom_s,
                      s.normal_s == s.bottom_s ? "; expected whole seconds of layers alike" : ""));
    }
    constexpr double most = 65535;
    if (tenths > most || bottom_s > most || s.bottom_layers > most) {
      throw InputError(file.path(), "",
                       fmt::format("says exposures of at most {:g} s, {:g} s of bottom layers, and "
                                   "{:g} of these; so it can't say {:g} s, {:g} s and {}",
                                   most / 10, most, most, s.normal_s, s.bottom_s, s.bottom_layers));
    }
    c.settings.set_u16(std::size_t{2} * exposure_tenths, static_cast<std::uint32_t>(tenths));
    c.settings.set_u16(std::size_t{2} * bottom_exposure_s, static_cast<std::uint32_t>(bottom_s));
    c.settings.set_u16(std::size_t{2} * bottom_layers, static_cast<std::uint32_t>(s.bottom_layers));
  }
  if (r.light_changes) {
    const auto bottoms = static_cast<int>(c.settings.u16(std::size_t{2} * bottom_layers));
    const LightSteps steps = light_steps(r, file.path(), bottoms);
    if (steps.uneven) {
      throw InputError(
          file.path(), "",
          "can't say light of single layers; expected one share for the bottom layers and "
          "one for all others");
    }
    c.settings.set_u16(std::size_t{2} * bottom_light, steps.bottom);
    c.settings.set_u16(std::size_t{2} * light, steps.usual);
  }
  // What the areas mean is not known: they stay, and added layers get the last one's.
  const BinaryBlock areas(file, c.areas_at, std::uint64_t{4} * old, "areas", kBig);
  BinaryBlock new_areas(4 * layers, kBig), count(2, kBig);
  for (std::size_t n = 0; n < layers; ++n)
    new_areas.set_u32(4 * n, areas.u32(4 * std::min(n, old - 1)));
  count.set_u16(0, static_cast<std::uint32_t>(layers));
  FileChange changed(file);
  const std::size_t count_span = changed.replace(c.count_at, 2, 2);
  const std::size_t settings = changed.replace(c.settings_at, c.settings.size(), c.settings.size());
  const std::size_t area_span = changed.replace(c.areas_at, areas.size(), new_areas.size());
  const auto whole = [](std::uint64_t bytes) { return 8 + bytes + 2; };
  std::vector<std::size_t> spans;
  for (std::size_t n = 0; n < std::max(layers, old); ++n) {
    spans.push_back(changed.replace(n < old ? c.lines[n].offset - 8 : c.layers_end,
                                    n < old ? whole(c.lines[n].size) : 0,
                                    n < layers ? whole(r.layers->sizes[n]) : 0));
  }
  const std::size_t check = c.version >= 2 ? changed.replace(c.check_at, 4, 4) : 0;
  changed.lay_out();
  changed.fill(count_span, count.bytes());
  changed.fill(settings, c.settings.bytes());
  changed.fill(area_span, new_areas.bytes());
  const CodedLayers* const coded = r.layers;
  for (std::size_t n = 0; n < layers; ++n) {
    const std::uint32_t area =
        BinaryBlock(file, c.lines[std::min(n, old - 1)].offset - 8, 4, "area of a layer", kBig)
            .u32(0);
    changed.fill(
        spans[n],
        [coded, area](std::size_t i, std::vector<std::uint8_t>& out) {
          BinaryBlock head(8, kBig);
          head.set_u32(0, area);
          head.set_u32(4, static_cast<std::uint32_t>(coded->sizes[i] / kCxdlpLineBytes));
          out = head.bytes();
          coded->append(i, out);
          out.insert(out.end(), {0x0d, 0x0a});
        },
        n);
  }
  if (c.version >= 2) fill_cxdlp_sum(changed, check, c.version, output);
  changed.add_to(output);
}

class Cxdlp final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "cxdlp"; }
  std::string_view what() const override { return "Creality CXDLP"; }
  std::vector<std::string_view> endings() const override { return {".cxdlp", ".cxdlpv4"}; }
  ContainerKind container() const override { return ContainerKind::binary; }
  bool made_new() const override { return false; }
  bool says_light() const override { return true; }
  bool recognises(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    return file.size() > 16 && BinaryBlock(file, 0, 16, "head").text(4, 6) == "CXSW3D";
  }

  ArchiveContents read(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    CxdlpFile c = read_cxdlp(file);
    if (c.version == 4) return read_cxdlp4(file, c.head_at, c.model);
    ArchiveContents contents;
    StackInfo& info = contents.info;
    Grid& grid = info.grid;
    grid.width_px = static_cast<int>(c.width_px);
    grid.height_px = static_cast<int>(c.height_px);
    grid.layers = info.target_layers = static_cast<int>(c.layers);
    grid.pixel_x_um = pixel_um(number_of(c.width_mm, file, "width") / grid.width_px, file, "head");
    grid.pixel_y_um =
        pixel_um(number_of(c.height_mm, file, "height") / grid.height_px, file, "head");
    grid.layer_um = layer_um(number_of(c.layer_mm, file, "layer height"), file, "head");
    const auto number = [&](CxdlpSetting s) {
      return c.settings.u16(2 * static_cast<std::size_t>(s));
    };
    info.exposure_s = number(exposure_tenths) / 10.0;
    info.bottom_exposure_s = number(bottom_exposure_s);
    info.bottom_layers = std::min<int>(number(bottom_layers), grid.layers);
    std::vector<double> shines(static_cast<std::size_t>(grid.layers), number(light));
    std::fill_n(shines.begin(), info.bottom_layers, number(bottom_light));
    take_light(shines, 255, file.path(), "settings", info, &contents.warnings);
    LiftTimes lifts;
    lifts.bottom_layers = info.bottom_layers;
    const auto motion = [&](CxdlpSetting way, CxdlpSetting speed) {
      LiftMotion m;
      m.up_mm = number(way);
      m.up_mm_s = number(speed);
      m.back_mm_s = number(back_speed);
      m.before_light_s = number(wait_s);
      return m;
    };
    lifts.normal = motion(lift, lift_speed);
    lifts.bottom = motion(bottom_lift, bottom_speed);
    take_lifts(std::move(lifts), info);
    info.profiles.printer = c.model;
    info.profiles.material = c.resin;
    contents.codec = cxdlp_code(grid.width_px, grid.height_px);
    contents.places = std::move(c.lines);
    contents.facts = {
        {"version", std::to_string(c.version)},
        {"model", c.model},
        {"program", c.program},
        {"display", fmt::format("{} x {} mm", c.width_mm, c.height_mm)},
        {"wait before light", fmt::format("{} s", number(wait_s))},
        {"lift", fmt::format("{} mm at {} mm/s, bottom {} mm at {} mm/s, back at {} mm/s",
                             number(lift), number(lift_speed), number(bottom_lift),
                             number(bottom_speed), number(back_speed))},
        {"light",
         fmt::format("{} of 255, {} for bottom layers", number(light), number(bottom_light))}};
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.exposure_changes) warn_of_mode(r, "CXDLP", printers_lift());
    change_cxdlp(r, binary_output(output));
    return {};
  }
};

}  // namespace

void check_cxdlp_sum(const BinaryFile& file, int version, std::uint64_t check_at) {
  if (version == 1) return;
  const std::uint32_t said = BinaryBlock(file, check_at, 4, "checksum", kBig).u32(0);
  std::uint32_t crc = 0xffffffff, all = 0;
  std::vector<std::uint8_t> piece;
  for (std::uint64_t at = 0; at < check_at; at += piece.size()) {
    file.read_at(at, std::min<std::uint64_t>(std::uint64_t{1} << 20, check_at - at), piece, "");
    crc = isal::crc32(crc, piece.data(), piece.size());
    for (const std::uint8_t byte : piece) all ^= byte;
  }
  const std::uint32_t right = version == 2 ? all : ~crc;
  if (said != right) {
    throw InputError(file.path(), "checksum",
                     fmt::format("is {:08X}, expected {:08X}: the file was changed or is not whole",
                                 said, right));
  }
}

void fill_cxdlp_sum(FileChange& change, std::size_t span, int version, const BinaryOutput& output) {
  change.fill(
      span,
      [&output, version](std::size_t, std::vector<std::uint8_t>& out) {
        BinaryBlock sum(4, kBig);
        sum.set_u32(0, version == 2 ? output.xor_of_bytes() : output.plain_crc32());
        out = sum.bytes();
      },
      0);
}

const ArchiveFormat& cxdlp_format() {
  static const Cxdlp format;
  return format;
}

}  // namespace slicecorr::detail
