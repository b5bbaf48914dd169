// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Files of tomographic printing: volumes of NumPy.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <numeric>
#include <string>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

class Npy : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  /// A file of format 1.0 with this header and these bytes.
  std::string made(const std::string& header, const std::string& bytes, char version = 1) const {
    std::string text = "\x93NUMPY";
    text += version;
    text += '\0';
    text += static_cast<char>(header.size() & 0xFF);
    text += static_cast<char>(header.size() >> 8);
    if (version > 1) text += std::string(2, '\0');
    text += header + bytes;
    test::write_file(path("made.npy"), test::to_bytes(text));
    return path("made.npy");
  }
  template <class Read>
  std::string refused(Read read, const std::string& file) const {
    try {
      read(file);
    } catch (const InputError& e) {
      return e.what();
    }
    return "taken";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Npy, WhatIsWrittenIsReadBack) {
  Box<std::uint8_t> part{3, 4, 5, std::vector<std::uint8_t>(60)};
  std::iota(part.values.begin(), part.values.end(), std::uint8_t{0});
  write_npy(path("part.npy"), part);
  const Box<std::uint8_t> again = read_part_npy(path("part.npy"));
  EXPECT_EQ(again.nz, 3);
  EXPECT_EQ(again.ny, 4);
  EXPECT_EQ(again.nx, 5);
  EXPECT_EQ(again.values, part.values);
  EXPECT_EQ(again.values[again.at(1, 2, 3)], 33);

  Box<float> dose{1, 2, 2, {0.0F, -1.5F, 1e-30F, 3e30F}};
  write_npy(path("dose.npy"), dose);
  EXPECT_EQ(read_dose_npy(path("dose.npy")).values, dose.values);
  // The numbers begin at a multiple of 64 bytes.
  EXPECT_EQ((test::read_file(path("dose.npy")).size() - 16) % 64, 0U);
}

TEST_F(Npy, OtherWordsForTheSameAreTaken) {
  const std::string bytes("\0\1\2\3", 4);
  for (const char version : {1, 2, 3}) {
    const auto box = read_part_npy(
        made("{'fortran_order':False,\"descr\":'|u1','shape':(1,2,2)}\n", bytes, version));
    EXPECT_EQ(box.values, (std::vector<std::uint8_t>{0, 1, 2, 3}));
  }
  const auto slice =
      read_part_npy(made("{'descr': '|b1', 'fortran_order': False, 'shape': (2, 2), }", bytes));
  EXPECT_EQ(slice.nz, 1);
  EXPECT_EQ(slice.values, (std::vector<std::uint8_t>{0, 255, 255, 255}));
  const double value = 0.25;
  const std::string number(reinterpret_cast<const char*>(&value), sizeof value);
  EXPECT_EQ(
      read_dose_npy(made("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 1), }", number))
          .values,
      std::vector<float>{0.25F});
}

TEST_F(Npy, WhatCanNotBeReadIsRefusedByPlace) {
  const auto part = [](const std::string& file) { read_part_npy(file); };
  const auto dose = [](const std::string& file) { read_dose_npy(file); };
  const auto header = [](const std::string& type, const std::string& shape,
                         const std::string& order = "False") {
    return "{'descr': '" + type + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }\n";
  };
  const std::string four("\1\2\3\4", 4);
  EXPECT_THAT(refused(part, path("none.npy")), HasSubstr("none.npy: can't be read"));
  test::write_file(path("text.npy"), test::to_bytes("solid part of ten bytes"));
  EXPECT_THAT(refused(part, path("text.npy")), HasSubstr("is no file of NumPy"));
  EXPECT_THAT(refused(part, made(header("|u1", "(2, 2)"), four, 9)), HasSubstr("version 9"));
  EXPECT_THAT(refused(part, made(header("<f4", "(1, 1)"), four)), HasSubstr("unsigned bytes"));
  EXPECT_THAT(refused(dose, made(header("|u1", "(2, 2)"), four)), HasSubstr("32 bits"));
  EXPECT_THAT(refused(part, made(header(">u2", "(1, 2)"), four)), HasSubstr("'>u2'"));
  EXPECT_THAT(refused(part, made(header("|u1", "(4,)"), four)), HasSubstr("has 1 axes"));
  EXPECT_THAT(refused(part, made(header("|u1", "(0, 4)"), four)), HasSubstr("0 x 4"));
  EXPECT_THAT(refused(part, made(header("|u1", "(2, 99999)"), four)), HasSubstr("1 to 65536"));
  EXPECT_THAT(refused(part, made(header("|u1", "(65536, 65536, 65536)"), four)),
              HasSubstr("too large"));
  EXPECT_THAT(refused(part, made(header("|u1", "(2, 2)", "True"), four)),
              HasSubstr("ascontiguousarray"));
  EXPECT_THAT(refused(part, made(header("|u1", "(2, 3)"), four)), HasSubstr("ends too early"));
  EXPECT_THAT(refused(part, made(header("|u1", "(1, 3)"), four)), HasSubstr("holds more"));
  for (const std::string wrong :
       {"", "{", "{'descr': '|u1'}", "{'descr': '|u1', 'shape': (2,2)}",
        "{'descr': [('a', '|u1')], 'shape': (2, 2), 'fortran_order': False}",
        "{'descr': '|u1', 'descr': '|u1', 'shape': (2, 2)}",
        "{'descr': '|u1', 'shape': (2 2), 'fortran_order': False}",
        "{'descr': '|u1', 'shape': (2, 2), 'fortran_order': False} x"}) {
    EXPECT_THAT(refused(part, made(wrong, four)), HasSubstr("header: can't be read")) << wrong;
  }
  const float bad[] = {1, std::numeric_limits<float>::infinity()};
  EXPECT_THAT(refused(dose, made(header("<f4", "(1, 2)"),
                                 std::string(reinterpret_cast<const char*>(bad), sizeof bad))),
              HasSubstr("number 1 is not finite"));
}

}  // namespace
}  // namespace slicecorr::tomo
