// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The run-length codes of binary print files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "print_file_fixture.hpp"
#include "rounds.hpp"

namespace slicecorr::test {
namespace {

using detail::LayerCodecPtr;
using ::testing::HasSubstr;

struct NamedCode {
  const char* name;
  std::function<LayerCodecPtr(int, int)> make;
  int levels;
};
void PrintTo(const NamedCode& code, std::ostream* out) { *out << code.name; }

const NamedCode kCodes[] = {
    {"ctb", [](int w, int h) { return detail::ctb_code(w, h, 0); }, 128},
    {"ctb_ciphered", [](int w, int h) { return detail::ctb_code(w, h, 0xdccff65e); }, 128},
    {"photon", [](int w, int h) { return detail::bit_sets_code(w, h, 1, false); }, 2},
    {"photon_8", [](int w, int h) { return detail::bit_sets_code(w, h, 8, false); }, 9},
    {"pws", [](int w, int h) { return detail::bit_sets_code(w, h, 4, true); }, 5},
    {"phz", [](int w, int h) { return detail::phz_code(w, h, 77777, detail::PhzCipher::phz); },
     125},
    {"fdg", [](int w, int h) { return detail::phz_code(w, h, 77777, detail::PhzCipher::fdg); },
     125},
    {"goo", [](int w, int h) { return detail::goo_code(w, h, false); }, 256},
    {"goo_16", [](int w, int h) { return detail::goo_code(w, h, true); }, 16},
    {"pw0", [](int w, int h) { return detail::pw0_code(w, h, false); }, 16},
    {"pw0_2", [](int w, int h) { return detail::pw0_code(w, h, true); }, 2},
    {"lgs", [](int w, int h) { return detail::lgs_code(w, h); }, 16},
    {"cxdlp", [](int w, int h) { return detail::cxdlp_code(w, h); }, 256},
};

class LayerCodes : public testing::TestWithParam<NamedCode> {};
INSTANTIATE_TEST_SUITE_P(Print, LayerCodes, testing::ValuesIn(kCodes),
                         [](const auto& info) { return std::string(info.param.name); });

const std::string kFile = "part.bin";

TEST_P(LayerCodes, HasItsLevelsAndKeepsThem) {
  const LayerCodecPtr codec = GetParam().make(8, 8);
  EXPECT_EQ(detail::levels_of(codec->shown()), GetParam().levels);
  EXPECT_EQ(codec->shown()[0], 0);
  EXPECT_EQ(codec->shown()[255], 255);
  for (const std::uint8_t v : codec->shown()) EXPECT_EQ(codec->shown()[v], v);
  for (int v = 1; v < 256; ++v) {
    EXPECT_LE(codec->shown()[static_cast<std::size_t>(v) - 1],
              codec->shown()[static_cast<std::size_t>(v)]);
  }
}

TEST_P(LayerCodes, ThereAndBackIsTheSame) {
  const int count = rounds(20);
  for (int round = 0; round < count; ++round) {
    std::mt19937 random(static_cast<unsigned>(round));
    const int width = 1 + static_cast<int>(random() % 90),
              height = 1 + static_cast<int>(random() % 70);
    const LayerCodecPtr codec = GetParam().make(width, height);
    for (int n = 0; const Bytes& image : random_images(width, height, 3, random()).slices) {
      Bytes pixels = image, back(image.size(), 7);
      for (std::uint8_t& v : pixels) v = codec->shown()[v];
      const std::vector<Bytes> pieces = coded(*codec, n, pixels);
      EXPECT_EQ(codec->decode(pieces, back.data(), {kFile, n}), 0u);
      ASSERT_EQ(back, pixels) << "round " << round;
      ++n;
    }
  }
}

/// Runs longer than any length of the code, and of all lengths around powers of two.
TEST_P(LayerCodes, LongRuns) {
  for (const int side : {125, 128, 512, 2047, 4097}) {
    const LayerCodecPtr codec = GetParam().make(side, 1100);
    Bytes pixels(codec->pixel_count(), codec->shown()[128]), back(pixels.size());
    for (const std::uint8_t value : {0, 255, 200}) {
      std::fill(pixels.begin(), pixels.end() - 3, codec->shown()[value]);
      const std::vector<Bytes> pieces = coded(*codec, 3, pixels);
      EXPECT_EQ(codec->decode(pieces, back.data(), {kFile, 3}), 0u);
      EXPECT_EQ(back, pixels);
    }
  }
}

/// Whatever bytes come: an image, or a refusal that names file and layer. Never a byte beyond.
TEST_P(LayerCodes, DamagedBytesAreRefusedOrGiveAnImage) {
  const LayerCodecPtr codec = GetParam().make(31, 17);
  const int count = rounds(400);
  std::mt19937 random(11);
  const Images images = random_images(31, 17, 4, 2);
  Bytes pixels(codec->pixel_count());
  for (int round = 0; round < count; ++round) {
    Bytes image = images.slices[static_cast<std::size_t>(round % 4)];
    for (std::uint8_t& v : image) v = codec->shown()[v];
    std::vector<Bytes> pieces = coded(*codec, 0, image);
    Bytes& piece = pieces[random() % pieces.size()];
    for (unsigned hits = 1 + random() % 4; hits > 0 && !piece.empty(); --hits) {
      switch (random() % 3) {
        case 0:
          piece[random() % piece.size()] = static_cast<std::uint8_t>(random());
          break;
        case 1:
          piece.resize(random() % piece.size());
          break;
        default:
          piece.insert(piece.begin() + static_cast<std::ptrdiff_t>(random() % piece.size()),
                       static_cast<std::uint8_t>(random()));
      }
    }
    // In memory of its own size, so that a byte beyond is one beyond the heap's block.
    for (Bytes& p : pieces) p.shrink_to_fit();
    try {
      codec->decode(pieces, pixels.data(), {kFile, 5});
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("part.bin: layer 5: "));
    }
  }
}

}  // namespace
}  // namespace slicecorr::test
