// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file print_file_fixture.hpp
/// Small binary print files made past the library, byte by byte after docs/print-files.md, and the real ones.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <bit>
#include <cstring>
#include <functional>
#include <map>

#include "cxdlp_sum.hpp"
#include "stack/layer_code/codes.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

/// Bytes with numbers at places.
class FileMaker {
 public:
  explicit FileMaker(bool big = false) : big_(big) {}
  Bytes bytes;
  std::size_t size() const { return bytes.size(); }
  FileMaker& zeros(std::size_t n) {
    bytes.resize(bytes.size() + n);
    return *this;
  }
  FileMaker& text(const std::string& t) {
    bytes.insert(bytes.end(), t.begin(), t.end());
    return *this;
  }
  FileMaker& add(const Bytes& more) {
    bytes.insert(bytes.end(), more.begin(), more.end());
    return *this;
  }
  FileMaker& u8(unsigned v) {
    bytes.push_back(static_cast<std::uint8_t>(v));
    return *this;
  }
  FileMaker& u16(unsigned v) { return number(v, 2); }
  FileMaker& u32(std::uint32_t v) { return number(v, 4); }
  FileMaker& f32(double v) { return u32(std::bit_cast<std::uint32_t>(static_cast<float>(v))); }
  void set_u32(std::size_t at, std::uint32_t v) {
    FileMaker part(big_);
    part.u32(v);
    std::copy(part.bytes.begin(), part.bytes.end(),
              bytes.begin() + static_cast<std::ptrdiff_t>(at));
  }
  void set_f32(std::size_t at, double v) {
    set_u32(at, std::bit_cast<std::uint32_t>(static_cast<float>(v)));
  }

 private:
  FileMaker& number(std::uint32_t v, int count) {
    for (int i = 0; i < count; ++i) u8(v >> (8 * (big_ ? count - 1 - i : i)) & 0xff);
    return *this;
  }
  bool big_;
};

/// A small file of a format and what it shows.
struct SmallFile {
  std::string name;  ///< of the file
  std::string format;
  Bytes bytes;
  std::vector<Bytes> slices;
};

inline constexpr int kFileWidth = 40, kFileHeight = 30, kFileLayers = 4;

/// Images of the values that a code knows.
inline std::vector<Bytes> small_slices(const detail::LayerCodec& codec) {
  std::vector<Bytes> slices = random_images(kFileWidth, kFileHeight, kFileLayers, 5).slices;
  slices[0].assign(slices[0].size(), 255);
  for (Bytes& slice : slices) {
    for (std::uint8_t& v : slice) v = codec.shown()[v];
  }
  return slices;
}

inline std::vector<Bytes> coded(const detail::LayerCodec& codec, int layer, const Bytes& slice) {
  std::vector<Bytes> pieces;
  codec.encode(layer, slice.data(), pieces);
  return pieces;
}

/// cbddlp of version 2 with `sets` images a layer; of version 1 with one.
inline SmallFile small_photon(int sets) {
  const auto codec = detail::bit_sets_code(kFileWidth, kFileHeight, sets, false);
  SmallFile file{"small" + std::to_string(sets) + ".cbddlp", "photon", {}, small_slices(*codec)};
  FileMaker m;
  m.zeros(0x70 + 0x3c);
  m.set_u32(0, 0x12fd0019);
  m.set_u32(4, 2);
  m.set_f32(0x08, kFileWidth * 0.05);
  m.set_f32(0x0c, kFileHeight * 0.05);
  m.set_f32(0x1c, kFileLayers * 0.05);
  m.set_f32(0x20, 0.05);
  m.set_f32(0x24, 8);
  m.set_f32(0x28, 60);
  m.set_u32(0x30, 2);
  m.set_u32(0x34, kFileWidth);
  m.set_u32(0x38, kFileHeight);
  m.set_u32(0x40, 0x70 + 0x3c);
  m.set_u32(0x44, kFileLayers);
  m.set_u32(0x4c, 500);
  m.set_u32(0x54, 0x70);
  m.set_u32(0x58, 0x3c);
  m.set_u32(0x5c, static_cast<std::uint32_t>(sets));
  std::size_t at = m.size() + static_cast<std::size_t>(sets * kFileLayers) * 0x24;
  Bytes data;
  for (int s = 0; s < sets; ++s) {
    for (int n = 0; n < kFileLayers; ++n) {
      const Bytes piece =
          coded(*codec, n, file.slices[static_cast<std::size_t>(n)])[static_cast<std::size_t>(s)];
      m.f32(0.05 * (n + 1)).f32(n < 2 ? 60 : 8).f32(0);
      m.u32(static_cast<std::uint32_t>(at + data.size()))
          .u32(static_cast<std::uint32_t>(piece.size()));
      m.zeros(16);
      data.insert(data.end(), piece.begin(), piece.end());
    }
  }
  file.bytes = m.add(data).bytes;
  return file;
}

/// PHZ or FDG.
inline SmallFile small_phz(bool fdg) {
  constexpr std::uint32_t key = 0x1234567;
  const auto codec = detail::phz_code(kFileWidth, kFileHeight, key,
                                      fdg ? detail::PhzCipher::fdg : detail::PhzCipher::phz);
  SmallFile file{fdg ? "small.fdg" : "small.phz", fdg ? "fdg" : "phz", {}, small_slices(*codec)};
  FileMaker m;
  m.zeros(0xd8);
  m.set_u32(0, fdg ? 0xbd3c7ac8 : 0x9fda83ae);
  m.set_u32(4, 2);
  const std::size_t layer = fdg ? 0x20 : 0x08, bed = fdg ? 0x50 : 0x4c, table = fdg ? 0x34 : 0x24;
  m.set_f32(layer, 0.05);
  m.set_f32(fdg ? 0x24 : 0x0c, 8);
  m.set_f32(fdg ? 0x28 : 0x10, 60);
  m.set_u32(fdg ? 0x0c : 0x14, 2);
  m.set_u32(fdg ? 0x14 : 0x64, 2);
  m.set_u32(0x18, kFileWidth);
  m.set_u32(0x1c, kFileHeight);
  m.set_u32(fdg ? 0x08 : 0x28, kFileLayers);
  m.set_u32(fdg ? 0x38 : 0x30, 500);
  m.set_f32(fdg ? 0x4c : 0x48, kFileLayers * 0.05);
  m.set_f32(bed, kFileWidth * 0.05);
  m.set_f32(bed + 4, kFileHeight * 0.05);
  m.set_u32(fdg ? 0x5c : 0x58, key);
  m.set_u32(fdg ? 0x74 : 0x90, 0xd8);
  m.set_u32(fdg ? 0x78 : 0x94, 5);
  m.text("Sonic");
  m.set_u32(table, static_cast<std::uint32_t>(m.size()));
  std::size_t at = m.size() + kFileLayers * 0x24;
  Bytes data;
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes piece = coded(*codec, n, file.slices[static_cast<std::size_t>(n)])[0];
    m.f32(0.05 * (n + 1)).f32(n < 2 ? 60 : 8).f32(0);
    m.u32(static_cast<std::uint32_t>(at + data.size()))
        .u32(static_cast<std::uint32_t>(piece.size()));
    m.zeros(16);
    data.insert(data.end(), piece.begin(), piece.end());
  }
  file.bytes = m.add(data).bytes;
  return file;
}

/// Photon Workshop of version 1 with the code PWS, or of 516 with PW0 and anti-aliasing of 16.
inline SmallFile small_workshop(bool pws) {
  const auto codec = pws ? detail::bit_sets_code(kFileWidth, kFileHeight, 4, true)
                         : detail::pw0_code(kFileWidth, kFileHeight, false);
  SmallFile file{pws ? "small.pws" : "small.pwmx", "photon-workshop", {}, small_slices(*codec)};
  FileMaker m;
  m.text("ANYCUBIC").zeros(4).u32(pws ? 1 : 516).u32(pws ? 4 : 8).zeros(pws ? 28 : 32);
  const auto here = [&](std::size_t at) { m.set_u32(at, static_cast<std::uint32_t>(m.size())); };
  here(0x14);
  m.text("HEADER").zeros(6).u32(0x54);
  m.f32(50).f32(0.05).f32(2).f32(0.5).f32(40).f32(1).f32(6).f32(6).f32(4).f32(1);
  m.u32(pws ? 4 : 16)
      .u32(kFileWidth)
      .u32(kFileHeight)
      .f32(1)
      .f32(2)
      .u32(36)
      .u32(0)
      .u32(500)
      .zeros(12);
  if (!pws) {
    here(0x20);
    m.u32(0).u32(16);
    for (unsigned k = 1; k <= 16; ++k) m.u8(k * 255 / 16);
    m.u32(0);
    here(0x2c);
    m.text("MACHINE")
        .zeros(5)
        .u32(0x9c)
        .text("Small")
        .zeros(91)
        .text("pw0Img")
        .zeros(10)
        .u32(16)
        .zeros(4);
    m.f32(kFileWidth * 0.05).f32(kFileHeight * 0.05).f32(100).u32(516).u32(0);
  }
  here(0x24);
  m.text("LAYERDEF").zeros(4).u32(4 + kFileLayers * 0x20).u32(kFileLayers);
  std::size_t at = m.size() + kFileLayers * 0x20;
  m.set_u32(pws ? 0x2c : 0x30, static_cast<std::uint32_t>(at));
  Bytes data;
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes& slice = file.slices[static_cast<std::size_t>(n)];
    const Bytes piece = coded(*codec, n, slice)[0];
    m.u32(static_cast<std::uint32_t>(at + data.size()))
        .u32(static_cast<std::uint32_t>(piece.size()));
    m.f32(6).f32(6).f32(n < 1 ? 40 : 2).f32(0.05);
    m.u32(static_cast<std::uint32_t>(
        std::count_if(slice.begin(), slice.end(), [](int v) { return v != 0; })));
    m.u32(0);
    data.insert(data.end(), piece.begin(), piece.end());
  }
  file.bytes = m.add(data).bytes;
  return file;
}

/// CXDLP of version 1, 2 or 3.
inline SmallFile small_cxdlp(int version) {
  const auto codec = detail::cxdlp_code(kFileWidth, kFileHeight);
  SmallFile file{"small" + std::to_string(version) + ".cxdlp", "cxdlp", {}, small_slices(*codec)};
  FileMaker m(true);
  const std::string magic =
      version == 1 ? std::string("CXSW3D\0", 7) : std::string("CXSW3DV2\0", 9);
  const auto text = [&](const std::string& t) {
    m.u32(static_cast<std::uint32_t>(t.size())).text(t);
  };
  const auto wide = [&](const std::string& t) {
    m.u32(static_cast<std::uint32_t>(2 * t.size()));
    for (const char c : t) m.u8(0).u8(static_cast<unsigned char>(c));
  };
  text(magic);
  if (version >= 2) {
    m.u16(static_cast<unsigned>(version));
    text(std::string("CL-60\0", 6));
  }
  m.u16(kFileLayers).u16(kFileWidth).u16(kFileHeight).zeros(version >= 2 ? 64 : 0);
  for (const std::size_t side : {116, 290, 290}) m.zeros(2 * side * side).text("\r\n");
  wide("2.0");
  wide("1.5");
  wide("0.05");
  for (const unsigned v : {25, 1, 40, 1, 5, 1, 5, 1, 2, 255, 255}) m.u16(v);
  for (int n = 0; n < kFileLayers; ++n) m.u32(100);
  m.text("\r\n");
  if (version >= 3) {
    text(std::string("program\0", 8));
    text(std::string("resin\0", 6));
    m.zeros(20).text("\r\n");
  }
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes piece = coded(*codec, n, file.slices[static_cast<std::size_t>(n)])[0];
    m.u32(100).u32(static_cast<std::uint32_t>(piece.size() / 6)).add(piece).text("\r\n");
  }
  text(magic);
  if (version == 2) {
    unsigned all = 0;
    for (const std::uint8_t byte : m.bytes) all ^= byte;
    m.u32(all);
  } else if (version == 3) {
    m.u32(cxdlp_sum(m.bytes.data(), m.size()));
  }
  file.bytes = m.bytes;
  return file;
}

inline SmallFile small_lgs() {
  const auto codec = detail::lgs_code(kFileWidth, kFileHeight);
  SmallFile file{"small.lgs", "lgs", {}, small_slices(*codec)};
  FileMaker m;
  m.text("Longer3D").zeros(0xb4 - 8);
  m.set_u32(0x10, 10);
  m.set_f32(0x1c, 20);
  m.set_f32(0x20, 20);
  m.set_f32(0x24, kFileHeight);
  m.set_f32(0x28, kFileWidth);
  m.set_f32(0x2c, 0.05);
  m.set_f32(0x30, 6000);
  m.set_f32(0x34, 40000);
  m.set_f32(0x44, 0.1);
  m.set_u32(0xa4, kFileLayers);
  m.set_u32(0xac, 4);
  m.set_u32(0xb0, 3);
  m.zeros(24);
  for (int n = 0; n < kFileLayers; ++n) {
    const Bytes piece = coded(*codec, n, file.slices[static_cast<std::size_t>(n)])[0];
    m.u32(static_cast<std::uint32_t>(piece.size())).add(piece);
  }
  file.bytes = m.bytes;
  return file;
}

/// A new file of a format that is made from nothing.
inline SmallFile small_new(const std::string& format, const detail::LayerCodec& codec) {
  SmallFile file{"small." + format, format, {}, small_slices(codec)};
  const TemporaryFolder folder;
  Images images{{kFileWidth, kFileHeight, kFileLayers, 50, 50, 50}, file.slices};
  StackInfo info = info_of(images.grid);
  info.kind = StackKind::foreign;
  info.exposure_s = 2.5;
  info.bottom_exposure_s = 30;
  info.bottom_layers = 1;
  write_stack(folder / file.name, images, info);
  file.bytes = read_file(folder / file.name);
  return file;
}

inline std::vector<SmallFile> small_print_files() {
  return {small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0)),
          small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false)),
          small_photon(1),
          small_photon(4),
          small_phz(false),
          small_phz(true),
          small_workshop(true),
          small_workshop(false),
          small_cxdlp(1),
          small_cxdlp(2),
          small_cxdlp(3),
          small_lgs()};
}

/// A real file, unpacked where it lies packed; empty when it is not there.
inline Bytes real_print_file(const std::string& name) {
  const std::string path = real_file("slices/binary/" + name);
  Bytes bytes;
  if (gzFile file = gzopen(path.c_str(), "rb")) {
    Bytes piece(1 << 20);
    while (true) {
      const int n = gzread(file, piece.data(), static_cast<unsigned>(piece.size()));
      if (n <= 0) break;
      bytes.insert(bytes.end(), piece.begin(), piece.begin() + n);
    }
    gzclose(file);
  }
  return bytes;
}

}  // namespace slicecorr::test
