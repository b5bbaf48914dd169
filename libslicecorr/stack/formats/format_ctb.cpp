// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Chitubox' CTB, cbddlp and photon before it, and PHZ and FDG, which have the same tables.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/ctb_file.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

std::vector<double> times_of(const CtbFile& ctb) {
  std::vector<double> times_s;
  for (std::size_t n = 0; n < ctb.layers; ++n) {
    times_s.push_back(ctb.table.real(n * kCtbRecordBytes + 4, "a layer's exposure", 1e6));
  }
  return times_s;
}

/// How bright each layer is lit: as it says itself where printers heed that, else as the head does.
std::vector<double> light_of(const CtbFile& ctb) {
  if (ctb.version < 2) return {};
  const bool own = ctb.has_layer_flag() && ctb.heads.size() == ctb.layers;
  std::vector<double> light;
  for (std::size_t n = 0; n < ctb.layers; ++n) {
    const bool bottom = n < ctb.head.u32(ctb.fields.bottom_layers);
    const double of_head = ctb.head.u16(ctb.fields.light + (bottom ? 2 : 0));
    const double its = own ? ctb.heads[n].f32(0x50) : 0;
    light.push_back(its > 0 ? its : of_head);
  }
  return light;
}

void add_facts(const CtbFile& ctb, ArchiveContents& contents) {
  const auto add = [&](const char* name, const std::string& value) {
    contents.facts.emplace_back(name, value);
  };
  const BinaryBlock& head = ctb.head;
  const CtbFields& f = ctb.fields;
  add("version", std::to_string(ctb.version));
  add("display", fmt::format("{:g} x {:g} mm, {:g} mm high", head.f32(f.bed_mm),
                             head.f32(f.bed_mm + 4), head.f32(f.bed_mm + 8)));
  add("time shown", fmt::format("{} s", head.u32(f.print_time_s)));
  add("light off", fmt::format("{:g} s", head.f32(f.light_off_s)));
  if (ctb.version >= 2) {
    add("light",
        fmt::format("{} of 255, {} for bottom layers", head.u16(f.light), head.u16(f.light + 2)));
  }
  if (ctb.sets > 1) add("sets of images", std::to_string(ctb.sets));
  if (ctb.family != CtbFamily::photon) add("ciphered", ctb.key != 0 ? "yes" : "no");
  if (ctb.print) {
    add("lift",
        fmt::format("{:g} mm at {:g} mm/min, bottom {:g} mm at {:g} mm/min, back at {:g} mm/min",
                    ctb.print->f32(8), ctb.print->f32(12), ctb.print->f32(0), ctb.print->f32(4),
                    ctb.print->f32(16)));
    add("resin used", fmt::format("{:g} ml, {:g} g, cost {:g}", ctb.print->f32(0x14),
                                  ctb.print->f32(0x18), ctb.print->f32(0x1c)));
  }
  if (ctb.slicer) {
    const BinaryBlock& its = *ctb.slicer;
    if (its.f32(0) > 0 || its.f32(8) > 0) {
      add("second lift", fmt::format("{:g} mm at {:g} mm/min, bottom {:g} mm at {:g} mm/min, back "
                                     "{:g} mm at {:g} mm/min",
                                     its.f32(8), its.f32(0x0c), its.f32(0), its.f32(4),
                                     its.f32(0x10), its.f32(0x14)));
    }
    // Of version 4 on in a block of its own.
    const BinaryBlock* const v4 = ctb.v4 ? &*ctb.v4 : nullptr;
    add("waits", fmt::format("{:g} s before lifts, {:g} s after them, {:g} s before light",
                             v4 ? v4->f32(0x20) : 0, v4 ? v4->f32(0x1c) : its.f32(0x18),
                             v4 ? v4->f32(0x18) : its.f32(0x34)));
    if (!ctb.resin_name.empty()) add("resin", ctb.resin_name);
    const std::uint32_t program = its.u32(0x30);
    if (program > 0) {
      add("program version", fmt::format("{}.{}.{}.{}", program >> 24, program >> 16 & 0xff,
                                         program >> 8 & 0xff, program & 0xff));
    }
    add("anti-aliasing", fmt::format("{}, level {}", ctb.slicer->u8(0x24) == 0x0f ? "on" : "off",
                                     ctb.slicer->u32(0x2c)));
    add("times of single layers", ctb.has_layer_flag() ? "heeded" : "not heeded");
    add("transition layers", std::to_string(ctb.slicer->u32(0x3c)));
  }
}

/// Of version 4 on lifts are told as a whole, and the second stage beside them.
double first_stage(const CtbFile& ctb, double lift_mm, double second_mm) {
  return ctb.version >= 4 ? std::max(0.0, lift_mm - second_mm) : lift_mm;
}

/// What the head, or in CTB files the blocks of settings, say of lifts.
void take_head_lifts(const CtbFile& ctb, LiftTimes& lifts, bool& known) {
  LiftMotion &normal = lifts.normal, &bottom = lifts.bottom;
  const bool in_head = ctb.family == CtbFamily::phz || ctb.family == CtbFamily::fdg;
  if (!in_head && !ctb.print) {
    known = false;
    return;
  }
  LiftNumbers n(in_head ? ctb.head : *ctb.print);
  const std::size_t at = ctb.family == CtbFamily::phz   ? 0x6c
                         : ctb.family == CtbFamily::fdg ? 0x88
                                                        : 0;
  bottom.up_mm = n.at(at);
  bottom.up_mm_s = n.mm_s(at + 4);
  normal.up_mm = n.at(at + 8);
  normal.up_mm_s = n.mm_s(at + 0x0c);
  normal.back_mm_s = bottom.back_mm_s = n.mm_s(at + 0x10);
  const std::size_t off = ctb.family == CtbFamily::phz   ? 0x5c
                          : ctb.family == CtbFamily::fdg ? 0x7c
                                                         : 0x20;
  bottom.light_off_s = n.at(off);
  normal.light_off_s = n.at(off + 4);
  known = known && n.known();
}

/// What else CTB files say in their blocks of settings.
void take_slicer_lifts(const CtbFile& ctb, LiftTimes& lifts, bool& known) {
  if (!ctb.slicer) return;
  LiftMotion &normal = lifts.normal, &bottom = lifts.bottom;
  LiftNumbers s(*ctb.slicer);
  bottom.up_2_mm = s.at(0);
  bottom.up_2_mm_s = s.mm_s(4);
  normal.up_2_mm = s.at(8);
  normal.up_2_mm_s = s.mm_s(0x0c);
  bottom.up_mm = first_stage(ctb, bottom.up_mm, bottom.up_2_mm);
  normal.up_mm = first_stage(ctb, normal.up_mm, normal.up_2_mm);
  normal.back_2_mm = bottom.back_2_mm = s.at(0x10);
  normal.back_2_mm_s = bottom.back_2_mm_s = s.mm_s(0x14);
  normal.after_lift_s = bottom.after_lift_s = s.at(0x18);
  normal.before_light_s = bottom.before_light_s = s.at(0x34);
  known = known && s.known();
  if (!ctb.v4) return;
  LiftNumbers v4(*ctb.v4);
  if (const double back = v4.mm_s(0); back > 0) bottom.back_mm_s = back;
  bottom.back_2_mm = v4.at(0x24);
  bottom.back_2_mm_s = v4.mm_s(4);
  normal.before_light_s = bottom.before_light_s = v4.at(0x18);
  normal.after_lift_s = bottom.after_lift_s = v4.at(0x1c);
  normal.before_lift_s = bottom.before_lift_s = v4.at(0x20);
  known = known && v4.known();
}

LiftMotion lift_of_head(const CtbFile& ctb, std::size_t layer, bool& known) {
  LiftNumbers n(ctb.heads[layer]);
  LiftMotion m;
  m.up_2_mm = n.at(0x30);
  m.up_2_mm_s = n.mm_s(0x34);
  m.up_mm = first_stage(ctb, n.at(0x28), m.up_2_mm);
  m.up_mm_s = n.mm_s(0x2c);
  m.back_mm_s = n.mm_s(0x38);
  m.back_2_mm = n.at(0x3c);
  m.back_2_mm_s = n.mm_s(0x40);
  m.before_lift_s = n.at(0x44);
  m.after_lift_s = n.at(0x48);
  m.before_light_s = n.at(0x4c);
  LiftNumbers table(ctb.table);
  m.light_off_s = table.at(layer * kCtbRecordBytes + 8);
  known = known && n.known() && table.known();
  return m;
}

void take_lifts_of(const CtbFile& ctb, StackInfo& info) {
  LiftTimes lifts;
  bool known = true;
  take_head_lifts(ctb, lifts, known);
  take_slicer_lifts(ctb, lifts, known);
  lifts.bottom_layers = info.bottom_layers;
  if (known && ctb.has_layer_flag() && ctb.heads.size() == ctb.layers) {
    for (std::size_t n = 0; n < ctb.layers; ++n) {
      lifts.layers.push_back(lift_of_head(ctb, n, known));
    }
  }
  if (known) take_lifts(std::move(lifts), info);
}

LayerCodecPtr codec_of(const CtbFile& ctb) {
  const auto width = static_cast<int>(ctb.width_px), height = static_cast<int>(ctb.height_px);
  switch (ctb.family) {
    case CtbFamily::ctb:
      return ctb_code(width, height, ctb.key);
    case CtbFamily::phz:
      return phz_code(width, height, ctb.key, PhzCipher::phz);
    case CtbFamily::fdg:
      return phz_code(width, height, ctb.key, PhzCipher::fdg);
    default:
      return bit_sets_code(width, height, static_cast<int>(ctb.sets), false, ctb.set_order);
  }
}

ArchiveContents read_family(const BinaryFile& file, CtbFamily family) {
  const CtbFile ctb = read_ctb(file, family);
  ArchiveContents contents;
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  grid.width_px = static_cast<int>(ctb.width_px);
  grid.height_px = static_cast<int>(ctb.height_px);
  grid.layers = info.target_layers = static_cast<int>(ctb.layers);
  const BinaryBlock& head = ctb.head;
  const CtbFields& f = ctb.fields;
  grid.pixel_x_um =
      pixel_um(head.real(f.bed_mm, "the display's width", 1e4) / ctb.width_px, file, "head");
  grid.pixel_y_um =
      pixel_um(head.real(f.bed_mm + 4, "the display's height", 1e4) / ctb.height_px, file, "head");
  grid.layer_um = layer_um(head.real(f.layer_mm, "the layer height", 100), file, "head");
  info.machine_height_mm = machine_height_of(head.f32(f.bed_mm + 8));
  info.exposure_s = head.real(f.exposure_s, "the exposure", 1e6);
  info.bottom_exposure_s = head.real(f.bottom_exposure_s, "the exposure of bottom layers", 1e6);
  info.bottom_layers = static_cast<int>(std::min(head.u32(f.bottom_layers), ctb.layers));
  if (ctb.slicer && ctb.version >= 4) {
    info.fade_layers = static_cast<int>(std::min(ctb.slicer->u32(0x3c), ctb.layers));
  }
  const std::vector<double> times_s = times_of(ctb);
  const bool listed = std::any_of(times_s.begin(), times_s.end(), [](double t) { return t > 0; });
  if (ctb.goes_by_head()) {
    if (info.bottom_layers == 0) info.fade_layers = 0;
    if (listed) tell_unheeded_times(times_s, info, contents.warnings);
  } else if (listed) {
    take_layer_times(times_s, info);
  }
  take_light(light_of(ctb), 255, file.path(), "head", info, &contents.warnings);
  for (std::size_t n = 0; n < ctb.layers; ++n) {
    contents.z_mm.push_back(ctb.table.f32(n * kCtbRecordBytes));
  }
  take_lifts_of(ctb, info);
  info.own_print_time_s = head.u32(f.print_time_s);
  info.orientation.mirror_x = head.u32(f.projector) == 1;
  info.orientation_known = true;
  info.profiles.printer = ctb.machine;
  info.profiles.material = ctb.resin_name;
  contents.codec = codec_of(ctb);
  for (std::size_t n = 0; n < ctb.layers; ++n) {
    for (std::size_t s = 0; s < ctb.sets; ++s) {
      const CtbFile::Layer& r = ctb.records[ctb.record(n, s)];
      contents.places.push_back({r.offset, r.bytes});
    }
  }
  add_facts(ctb, contents);
  return contents;
}

struct FamilyWords {
  const char *name, *what, *shown;
  std::vector<std::string_view> endings;
  std::vector<std::uint32_t> magics;
};
const FamilyWords& words_of(CtbFamily family) {
  static const FamilyWords words[] = {
      {"ctb",
       "Chitubox CTB, not encrypted",
       "CTB",
       {".ctb"},
       {kCtbMagic, kCtb4Magic, kCtbGkTwoMagic}},
      {"photon",
       "cbddlp and photon of Chitubox and Anycubic",
       "photon",
       {".cbddlp", ".photon"},
       {kPhotonMagic}},
      {"phz", "Chitubox PHZ of Phrozen", "PHZ", {".phz"}, {kPhzMagic}},
      {"fdg", "FDG of Voxelab", "FDG", {".fdg"}, {kFdgMagic}},
  };
  return words[static_cast<int>(family)];
}

class Ctb final : public ArchiveFormat {
 public:
  explicit Ctb(CtbFamily family) : family_(family) {}
  std::string_view name() const override { return words_of(family_).name; }
  std::string_view what() const override { return words_of(family_).what; }
  std::vector<std::string_view> endings() const override { return words_of(family_).endings; }
  ContainerKind container() const override { return ContainerKind::binary; }
  bool made_new() const override { return family_ == CtbFamily::ctb; }
  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }
  bool says_lifts() const override { return true; }
  bool changes_exposures() const override { return true; }
  LayerCodecPtr new_codec(const Grid& grid) const override {
    return made_new() ? ctb_code(grid.width_px, grid.height_px, 0) : nullptr;
  }
  bool recognises(const Container& archive) const override {
    const BinaryFile& file = binary_file(archive);
    if (file.size() < 4) return false;
    const std::uint32_t magic = BinaryBlock(file, 0, 4, "head").u32(0);
    const auto& magics = words_of(family_).magics;
    return std::find(magics.begin(), magics.end(), magic) != magics.end();
  }
  std::vector<std::uint8_t> preview(const Container& archive) const override {
    const CtbFile ctb = read_ctb(binary_file(archive), family_);
    if (ctb.previews.empty()) return {};
    return encode_png(decode_ctb_preview(binary_file(archive), ctb.previews.front()));
  }
  ArchiveContents read(const Container& archive) const override {
    return read_family(binary_file(archive), family_);
  }
  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.kept == nullptr || r.exposure_changes)
      warn_of_mode(r, words_of(family_).shown, printers_lift());
    if (r.kept != nullptr) {
      change_ctb(r, family_, binary_output(output));
    } else {
      write_new_ctb(r, binary_output(output));
    }
    return {};
  }

 private:
  CtbFamily family_;
};

const ArchiveFormat& format_of_family(CtbFamily family) {
  static const Ctb formats[] = {Ctb(CtbFamily::ctb), Ctb(CtbFamily::photon), Ctb(CtbFamily::phz),
                                Ctb(CtbFamily::fdg)};
  return formats[static_cast<int>(family)];
}

}  // namespace

const ArchiveFormat& ctb_format() { return format_of_family(CtbFamily::ctb); }
const ArchiveFormat& photon_format() { return format_of_family(CtbFamily::photon); }
const ArchiveFormat& phz_format() { return format_of_family(CtbFamily::phz); }
const ArchiveFormat& fdg_format() { return format_of_family(CtbFamily::fdg); }

}  // namespace slicecorr::detail
