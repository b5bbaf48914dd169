// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/npy.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"
#include "support/numpy/npy_input.hpp"

namespace slicecorr::tomo {

using slicecorr::detail::kNpyMagic;
using slicecorr::detail::NpyInput;

namespace {

/// The size of `box`, checked.
template <class T>
void shape(const NpyInput& in, Box<T>& box) {
  const auto [nz, ny, nx] = in.size({kMostAlongAxis, kMostInBox});
  box.nz = nz;
  box.ny = ny;
  box.nx = nx;
  box.values.resize(static_cast<std::size_t>(nz) * static_cast<std::size_t>(ny) *
                    static_cast<std::size_t>(nx));
}

template <class T>
void write(const std::string& path, const char* type, const Box<T>& box) {
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}, {}, {}), }}", type,
                  box.nz, box.ny, box.nx);
  // The numbers begin at a multiple of 64 bytes.
  constexpr std::size_t start = 10, line = 64;
  header.resize((start + header.size() + 1 + line - 1) / line * line - start - 1, ' ');
  header += '\n';
  std::string head(kNpyMagic);
  head += '\1';
  head += '\0';
  head += static_cast<char>(header.size() & 0xFF);
  head += static_cast<char>(header.size() >> 8);
  slicecorr::detail::Temporary temporary{slicecorr::detail::make_temporary(path)};
  std::ofstream out(temporary.path, std::ios::binary);
  out << head << header;
  out.write(reinterpret_cast<const char*>(box.values.data()),
            static_cast<std::streamsize>(box.values.size() * sizeof(T)));
  out.close();
  if (!out) throw DeviceError(slicecorr::detail::errno_message(path, "can't be written"));
  slicecorr::detail::put_in_place(temporary, path);
}

}  // namespace

Box<std::uint8_t> read_part_npy(const std::string& path) {
  NpyInput in(path);
  const std::string& type = in.header().type;
  const bool truth = type == "|b1";
  if (type != "|u1" && !truth) {
    in.wrong(fmt::format("holds '{}'; expected unsigned bytes (255 part, 0 empty), or truth values",
                         type));
  }
  Box<std::uint8_t> box;
  shape(in, box);
  in.numbers(box.values.data(), box.values.size());
  in.finish();
  if (truth) {
    for (std::uint8_t& v : box.values) v = v != 0 ? 255 : 0;
  }
  return box;
}

Box<float> read_dose_npy(const std::string& path) {
  NpyInput in(path);
  const std::string& type = in.header().type;
  Box<float> box;
  shape(in, box);
  if (type == "<f4") {
    in.numbers(box.values.data(), box.values.size());
  } else if (type == "<f8") {
    std::vector<double> row(static_cast<std::size_t>(box.nx));
    for (std::size_t at = 0; at < box.values.size(); at += row.size()) {
      in.numbers(row.data(), row.size());
      for (std::size_t i = 0; i < row.size(); ++i) box.values[at + i] = static_cast<float>(row[i]);
    }
  } else {
    in.wrong(fmt::format("holds '{}'; expected numbers of 32 bits, '<f4'", type));
  }
  in.finish();
  for (std::size_t i = 0; i < box.values.size(); ++i) {
    if (std::isfinite(box.values[i])) continue;
    in.wrong(fmt::format("number {} is not finite", i));
  }
  return box;
}

void write_npy(const std::string& path, const Box<std::uint8_t>& box) { write(path, "|u1", box); }
void write_npy(const std::string& path, const Box<float>& box) { write(path, "<f4", box); }

}  // namespace slicecorr::tomo
