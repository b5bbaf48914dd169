// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file newer_print_file_fixture.hpp
/// Small print files of newer printers, made past the library after the published layouts: their pixels are
/// coded here, too.
#pragma once

#include "print_file_fixture.hpp"

namespace slicecorr::test {

/// Pixels in runs: of each the value and how many, at most `most`.
inline std::vector<std::pair<int, int>> runs_of(const Bytes& pixels, int shift, int most) {
  std::vector<std::pair<int, int>> runs;
  for (const std::uint8_t pixel : pixels) {
    const int value = pixel >> shift;
    if (!runs.empty() && runs.back().first == value && runs.back().second < most) {
      ++runs.back().second;
    } else {
      runs.emplace_back(value, 1);
    }
  }
  return runs;
}

/// Photon Workshop's PW0: a nibble of grey and one of length; black and white have a byte more.
inline Bytes pw0_bytes(const Bytes& pixels) {
  FileMaker m(true);
  for (const auto& [value, count] : runs_of(pixels, 4, 0xfff)) {
    if (value == 0 || value == 15) {
      m.u16(static_cast<unsigned>(value << 12 | count));
      continue;
    }
    for (int left = count; left > 0; left -= 15) {
      m.u8(static_cast<unsigned>(value << 4 | std::min(left, 15)));
    }
  }
  return m.bytes;
}

/// Chitubox' code: seven bits of grey, and a length where it is more than one; then the cipher.
inline Bytes ctb_bytes(const Bytes& pixels, std::uint32_t key, std::uint32_t layer) {
  FileMaker m(true);
  for (const auto& [value, count] : runs_of(pixels, 1, 0x1fffff)) {
    m.u8(static_cast<unsigned>(count > 1 ? value | 0x80 : value));
    if (count >= 0x4000) {
      m.u8(static_cast<unsigned>(0xc0 | count >> 16)).u16(static_cast<unsigned>(count & 0xffff));
    } else if (count >= 0x80) {
      m.u16(static_cast<unsigned>(0x8000 | count));
    } else if (count > 1) {
      m.u8(static_cast<unsigned>(count));
    }
  }
  const std::uint32_t step = key * 0x2d83cdacu + 0xd8a83423u;
  std::uint32_t word = (layer * 0x1e1530cdu + 0xec3d47cdu) * step;
  for (std::size_t i = 0; key != 0 && i < m.size(); ++i) {
    m.bytes[i] ^= static_cast<std::uint8_t>(word >> (8 * (i % 4)));
    if (i % 4 == 3) word += step;
  }
  return m.bytes;
}

/// Random slices of the values that come back from 16 levels, or from seven bits; the first is all white.
inline std::vector<Bytes> slices_of_16() {
  std::vector<Bytes> slices = random_images(kFileWidth, kFileHeight, kFileLayers, 5).slices;
  slices[0].assign(slices[0].size(), 255);
  for (Bytes& slice : slices) {
    for (std::uint8_t& v : slice) v = static_cast<std::uint8_t>((v >> 4) * 17);
  }
  return slices;
}
inline std::vector<Bytes> slices_of_128() {
  std::vector<Bytes> slices = random_images(kFileWidth, kFileHeight, kFileLayers, 5).slices;
  slices[0].assign(slices[0].size(), 255);
  for (Bytes& slice : slices) {
    for (std::uint8_t& v : slice) v = static_cast<std::uint8_t>(v < 2 ? 0 : v | 1);
  }
  return slices;
}

inline std::uint32_t lit_pixels(const Bytes& slice) {
  return static_cast<std::uint32_t>(
      std::count_if(slice.begin(), slice.end(), [](int v) { return v != 0; }));
}

/// The entries of Anycubic's zip, with their slices; as text where they are texts.
inline Entries anycubic_entries(const std::vector<Bytes>& slices) {
  std::string list = "{\n    \"count\": " + std::to_string(slices.size()) + ",\n    \"paras\": [";
  FileMaker scene;
  scene.text("ANYCUBIC-PWSZ").zeros(3).text("a slicer").zeros(56);
  scene.u32(3).u32(1).u32(0).u32(0).f32(1).u32(static_cast<std::uint32_t>(slices.size()));
  scene.f32(-1).f32(-0.75).f32(0).f32(1).f32(0.75).f32(0.05 * static_cast<double>(slices.size()));
  scene.u32(0).zeros(256).text("<---").u32(static_cast<std::uint32_t>(slices.size()));
  Entries entries;
  for (std::size_t n = 0; n < slices.size(); ++n) {
    list += std::string(n > 0 ? "," : "") +
            "\n        {\"exposure_time\": " + (n < 1 ? "40" : "2.5") +
            ", \"layer_index\": " + std::to_string(n) +
            ", \"layer_minheight\": " + std::to_string(0.05 * static_cast<double>(n)) +
            ", \"layer_thickness\": 0.05000000074505806, \"zup_height\": 6, \"zup_speed\": 3}";
    scene.f32(0.05 * static_cast<double>(n + 1)).f32(3).f32(-1).f32(-0.75).f32(1).f32(0.75);
    scene.u32(1).f32(3).zeros(32);
    entries.emplace_back("layer_images/layer_" + std::to_string(n) + ".pw0Img",
                         pw0_bytes(slices[n]));
  }
  scene.text("--->");
  const std::string settings =
      R"({"version": "3", "machine_type": {"version": "3", "name": "Small", "key_suffix": "pm7",
 "key_image_format": "pwszImg", "res_x": 40, "res_y": 30, "xy_pixel": 50, "xy_pixel_y": 50,
 "print_xsize": 2, "print_ysize": 1.5, "print_zsize": 100, "max_file_version": 518},
 "machine_extern": {"version": "3", "active_resins": ["mine"], "factory_resins": [],
  "user_resins": [{"version": "2", "property": {"name": "other"}, "slicepara": {}, "slice_extpara": {}},
   {"version": "2", "property": {"name": "mine", "resin_name": "Grey"},
    "slicepara": {"anti_count": 16, "bott_layers": 1, "bott_time": 40, "bott_time_dual": 40,
     "exposure_time": 2.5, "off_time": 0.5, "use_indivi_layerpara": 0, "zthick": 0.05000000074505806,
     "zup_height": 6, "zup_speed": 3, "zdown_speed": 4, "wait_after_lift": 0.25},
    "slice_extpara": {"multi_state_used": 0, "transition_layercount": 0, "intelli_mode": 0,
     "multi_state_paras": {"bott_0": {"height": 2, "up_speed": 1, "down_speed": 1.5},
      "bott_1": {"height": 4, "up_speed": 3, "down_speed": 5},
      "normal_0": {"height": 1, "up_speed": 2, "down_speed": 2.5},
      "normal_1": {"height": 3, "up_speed": 4, "down_speed": 6}}}}]}}
)";
  entries.emplace_back("preview_images/preview_0.png", to_bytes("no picture"));
  entries.emplace_back("anycubic_photon_resins.pwsp", to_bytes(settings));
  entries.emplace_back("layers_controller.conf", to_bytes(list + "\n    ]\n}\n"));
  entries.emplace_back(
      "print_info.json",
      to_bytes("{\"print_time\": 500, \"volume\": 1.25, \"model_layers_count\": 4,\n"
               "\"sub_estimated_infos\": [{\"model_layers_count\": 4, "
               "\"estimated_time\": 500}]}"));
  entries.emplace_back("scene.slice", scene.bytes);
  entries.emplace_back("software_info.conf", to_bytes("{\"mark\": \"a slicer\"}"));
  return entries;
}
inline Bytes zip_bytes(const Entries& entries) {
  const TemporaryFolder folder;
  make_zip(folder / "a.zip", entries, true);
  return read_file(folder / "a.zip");
}
inline SmallFile small_anycubic_zip() {
  const std::vector<Bytes> slices = slices_of_16();
  return {"small.pm7", "anycubic-zip", zip_bytes(anycubic_entries(slices)), slices};
}

/// Where the head of the file below starts, behind the model.
inline constexpr std::size_t kCxdlp4Head = 27;
/// CXDLP of version 4: CTB's tables behind a head of CXDLP's kind, with a checksum at the end. `key`: of the
/// cipher; 0: none. `change`: what is changed before the checksum is made.
inline SmallFile small_cxdlp4(
    std::uint32_t key, const std::function<void(FileMaker&)>& change = [](FileMaker&) {}) {
  SmallFile file{key != 0 ? "small4c.cxdlpv4" : "small4.cxdlp", "cxdlp", {}, slices_of_128()};
  FileMaker big(true), m;
  big.u32(9).text("CXSW3DV2").zeros(1).u16(4).u32(8).text("CL-103L").zeros(1);
  const std::size_t head = kCxdlp4Head, head_bytes = 0x50;
  EXPECT_EQ(big.size(), head);
  m.add(big.bytes).zeros(head_bytes);
  const auto here = [&](std::size_t at) {
    m.set_u32(head + at, static_cast<std::uint32_t>(m.size()));
  };
  m.bytes[head] = kFileWidth;
  m.bytes[head + 2] = kFileHeight;
  m.set_f32(head + 0x04, kFileWidth * 0.05);
  m.set_f32(head + 0x08, kFileHeight * 0.05);
  m.set_f32(head + 0x0c, 180);
  m.set_f32(head + 0x10, kFileLayers * 0.05);
  m.set_f32(head + 0x14, 0.05);
  m.set_u32(head + 0x18, 1);
  m.set_u32(head + 0x24, kFileLayers);
  m.set_u32(head + 0x2c, 500);
  m.set_u32(head + 0x30, 1);
  m.set_u32(head + 0x3c, 8);
  m.bytes[head + 0x40] = 255;
  m.bytes[head + 0x42] = 255;
  m.set_u32(head + 0x44, key);
  for (const std::size_t at : {0x1c, 0x28}) {
    here(at);
    const auto pixels = static_cast<std::uint32_t>(m.size() + 0x20);
    m.u32(4).u32(2).u32(pixels).u32(4).zeros(16).u16(0x20).u16(0x3007);
  }
  here(0x34);
  m.set_u32(head + 0x38, 0x44);
  for (const double v : {6.0, 60.0, 5.0, 80.0, 150.0, 1.0, 1.1, 0.1, 0.0, 0.0}) m.f32(v);
  m.u32(1).f32(2.5).f32(40).zeros(16);
  here(0x48);
  m.set_u32(head + 0x4c, 0x4c);
  for (const double v : {2.0, 120.0, 1.0, 180.0, 2.0, 200.0, 0.25}) m.f32(v);
  m.u32(0).u32(28'000'000).u32(8).u32(0x02000000).f32(0.5).f32(0.75).f32(2.5).f32(40).f32(0.25);
  m.u32(0).zeros(8);
  here(0x20);
  std::size_t at = m.size() + kFileLayers * 0x28;
  FileMaker data;
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes code =
        ctb_bytes(file.slices[static_cast<std::size_t>(n)], key, static_cast<std::uint32_t>(n));
    m.f32(0.05 * (n + 1)).f32(n < 1 ? 40 : 2.5).f32(0);
    m.u32(static_cast<std::uint32_t>(at + data.size()));
    m.u32(static_cast<std::uint32_t>(code.size() + 0x2c)).u32(0).u32(7).u32(9).zeros(8);
    for (const double v : {5.0, 80.0, 1.0, 180.0, 150.0, 2.0, 200.0, 0.75, 0.25, 0.5, 255.0}) {
      data.f32(v);
    }
    data.add(code);
  }
  m.add(data.bytes);
  change(m);
  FileMaker sum(true);
  file.bytes = m.add(sum.u32(cxdlp_sum(m.bytes.data(), m.size())).bytes).bytes;
  return file;
}

/// Photon Workshop of version 518, which lists the layers twice. The tables that have offsets at the end of
/// the file's start lie behind the list of layers, as UVtools writes them.
inline SmallFile small_workshop_518() {
  SmallFile file{"small.pm5s", "photon-workshop", {}, slices_of_16()};
  FileMaker m;
  m.text("ANYCUBIC").zeros(4).u32(518).u32(11).zeros(0x40 - 0x14);
  const auto here = [&](std::size_t at) { m.set_u32(at, static_cast<std::uint32_t>(m.size())); };
  here(0x14);
  m.text("HEADER").zeros(6).u32(96);
  m.f32(50).f32(0.05).f32(2.5).f32(0.5).f32(40).f32(1).f32(6).f32(6).f32(4).f32(1);
  m.u32(16).u32(kFileWidth).u32(kFileHeight).f32(1).f32(2).u32(36).u32(0).u32(500);
  m.u32(0).u32(0).u32(1).u16(0).u16(0).u32(0).u32(0);
  here(0x1c);
  m.text("PREVIEW").zeros(5).u32(28 + 16).u32(4).text("x").zeros(3).u32(2).zeros(16);
  here(0x20);
  m.u32(0).u32(16);
  for (unsigned k = 1; k <= 16; ++k) m.u8(k * 255 / 16);
  m.u32(0);
  std::vector<Bytes> code;
  for (const Bytes& slice : file.slices) code.push_back(pw0_bytes(slice));
  constexpr std::size_t extra = 0x48, machine = 224, software = 164, model = 48,
                        second = 24 + kFileLayers * 44, preview2 = 28 + 16;
  here(0x24);
  std::size_t at =
      m.size() + 20 + kFileLayers * 0x20 + extra + machine + software + model + second + preview2;
  m.set_u32(0x30, static_cast<std::uint32_t>(at));
  m.text("LAYERDEF").zeros(4).u32(4 + kFileLayers * 0x20).u32(kFileLayers);
  FileMaker list;
  for (std::size_t n = 0; n < kFileLayers; ++n) {
    const auto size = static_cast<std::uint32_t>(code[n].size());
    m.u32(static_cast<std::uint32_t>(at)).u32(size);
    m.f32(6).f32(6).f32(n < 1 ? 40 : 2.5).f32(0.05).u32(lit_pixels(file.slices[n])).u32(0);
    list.u32(static_cast<std::uint32_t>(at)).u32(size).u32(lit_pixels(file.slices[n])).zeros(32);
    at += size;
  }
  here(0x28);
  m.text("EXTRA").zeros(7).u32(24).u32(2);
  for (const double v : {2.0, 1.0, 5.0, 4.0, 3.0, 1.5}) m.f32(v);
  m.u32(2);
  for (const double v : {1.0, 2.0, 6.0, 3.0, 4.0, 2.5}) m.f32(v);
  here(0x2c);
  m.text("MACHINE").zeros(5).u32(224).text("Small").zeros(91).text("pw0Img").zeros(10);
  m.u32(16).u32(15).f32(kFileWidth * 0.05).f32(kFileHeight * 0.05).f32(200).u32(518).u32(0);
  m.f32(50).f32(50).zeros(32).u32(1).u32(0).u16(kFileWidth).u16(kFileHeight).zeros(16);
  here(0x18);
  m.text("a slicer").zeros(24).u32(164).text("1.0").zeros(29).text("linux").zeros(59).zeros(32);
  here(0x34);
  m.text("MODEL").zeros(7).u32(48).f32(-1).f32(-0.75).f32(0).f32(1).f32(0.75).f32(0.2).u32(1).f32(
      0);
  here(0x38);
  m.text("SUBIMGS").zeros(5).u32(second).u32(kFileLayers).u32(1).add(list.bytes);
  here(0x3c);
  m.text("PREVIEW2").zeros(4).u32(preview2).u32(4).u16(4293).u16(0).u32(2).zeros(16);
  for (const Bytes& c : code) m.add(c);
  file.bytes = m.bytes;
  return file;
}

/// CTB of version 5 without encryption: that of version 4 with a block for the resin. As some programs do, the
/// texts of that block lie behind the layers.
inline SmallFile small_ctb5() {
  SmallFile file{"small5.ctb", "ctb", {}, slices_of_128()};
  FileMaker m;
  m.zeros(0x70);
  const auto here = [&](std::size_t at) { m.set_u32(at, static_cast<std::uint32_t>(m.size())); };
  m.set_u32(0x00, 0x12fd0106);
  m.set_u32(0x04, 5);
  m.set_f32(0x08, kFileWidth * 0.05);
  m.set_f32(0x0c, kFileHeight * 0.05);
  m.set_f32(0x10, 180);
  m.set_f32(0x1c, kFileLayers * 0.05);
  m.set_f32(0x20, 0.05);
  m.set_f32(0x24, 2.5);
  m.set_f32(0x28, 40);
  m.set_u32(0x30, 1);
  m.set_u32(0x34, kFileWidth);
  m.set_u32(0x38, kFileHeight);
  m.set_u32(0x44, kFileLayers);
  m.set_u32(0x4c, 500);
  m.set_u32(0x5c, 1);
  m.set_u32(0x60, 0x00ff00ff);
  here(0x54);
  m.set_u32(0x58, 0x3c);
  for (const double v : {6.0, 60.0, 5.0, 80.0, 150.0, 1.0, 1.1, 0.1, 0.0, 0.0}) m.f32(v);
  m.u32(1).zeros(16);
  const std::size_t slicer = m.size();
  here(0x68);
  m.set_u32(0x6c, 0x4c);
  m.zeros(0x4c).text("Small").zeros(1);
  m.set_u32(slicer + 0x1c, static_cast<std::uint32_t>(slicer + 0x4c));
  m.set_u32(slicer + 0x20, 6);
  m.bytes[slicer + 0x24] = 0x0f;
  m.set_u32(slicer + 0x2c, 8);
  m.set_u32(slicer + 0x30, 0x02000000);
  here(slicer + 0x40);
  const std::size_t v4 = m.size();
  m.zeros(464);
  m.set_f32(v4, 150);
  m.set_u32(v4 + 0x34, kFileLayers - 1);
  here(v4 + 0x50);
  const std::size_t resin = m.size();
  m.zeros(4).u32(0xff808080).zeros(24).f32(1.1).zeros(4);
  here(0x40);
  std::size_t at = m.size() + kFileLayers * 0x24;
  FileMaker data;
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes code = ctb_bytes(file.slices[static_cast<std::size_t>(n)], 0, 0);
    FileMaker record;
    record.f32(0.05 * (n + 1)).f32(n < 1 ? 40 : 2.5).f32(0);
    record.u32(static_cast<std::uint32_t>(at + data.size() + 0x54));
    record.u32(static_cast<std::uint32_t>(code.size())).u32(0).u32(0x54).zeros(8);
    m.add(record.bytes);
    data.add(record.bytes).u32(static_cast<std::uint32_t>(code.size() + 0x54));
    for (const double v : {5.0, 80.0, 0.0, 0.0, 150.0, 0.0, 0.0, 0.0, 0.0, 0.0, 255.0}) data.f32(v);
    data.add(code);
  }
  m.add(data.bytes);
  const auto name = [&](std::size_t where, std::size_t length, const std::string& text) {
    here(resin + where);
    m.set_u32(resin + length, static_cast<std::uint32_t>(text.size()));
    m.text(text);
  };
  name(0x10, 0x0c, "Standard");
  name(0x18, 0x14, "Grey");
  name(0x08, 0x1c, "Small");
  file.bytes = m.bytes;
  return file;
}

/// All that are one binary block.
inline std::vector<SmallFile> small_binary_files() {
  std::vector<SmallFile> files = small_print_files();
  for (SmallFile& file :
       std::vector{small_cxdlp4(0), small_cxdlp4(0x1234567), small_workshop_518(), small_ctb5()}) {
    files.push_back(std::move(file));
  }
  return files;
}

}  // namespace slicecorr::test
