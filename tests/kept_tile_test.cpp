// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tiles in a store: what is put from either end comes back, and pieces are shared.
#include "correct/kept_tile.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using detail::Kept;
using detail::KeptTile;
using detail::kPieceSlices;
using detail::TileReader;
using detail::TileWriter;
using test::Bytes;
using test::TemporaryFolder;

constexpr std::size_t kColumns = 300;
using Slices = std::vector<Bytes>;

/// Slices that stay, change here and there, or altogether, with black ones between them.
Slices some_slices(int count, unsigned seed) {
  std::mt19937 random(seed);
  Slices slices;
  Bytes bytes(kColumns, 0);
  for (int n = 0; n < count; ++n) {
    const unsigned kind = static_cast<unsigned>(random()) % 8;
    if (kind == 0) std::fill(bytes.begin(), bytes.end(), std::uint8_t{0});
    if (kind == 1) std::fill(bytes.begin() + 40, bytes.end() - 7, std::uint8_t{255});
    if (kind > 5) {
      for (int k = 0; k < 9; ++k) bytes[random() % kColumns] = static_cast<std::uint8_t>(random());
    }
    // A piece and more without light.
    const bool dark = n >= 2 * kPieceSlices - 5 && n < 3 * kPieceSlices + 9;
    slices.push_back(dark ? Bytes(kColumns, 0) : bytes);
  }
  return slices;
}

KeptTile kept(BlobStore& store, const Slices& slices, TileWriter::From from,
              const KeptTile* before = nullptr) {
  const int count = static_cast<int>(slices.size());
  TileWriter writer(store, kColumns, count, from, before);
  for (int k = 0; k < count; ++k) {
    const int n = from == TileWriter::From::first ? k : count - 1 - k;
    const int last = from == TileWriter::From::first ? n - 1 : n + 1;
    const Bytes& slice = slices[static_cast<std::size_t>(n)];
    const bool black = std::count(slice.begin(), slice.end(), 0) == static_cast<long>(kColumns);
    if (k > 0 && k % 3 == 0 && slice == slices[static_cast<std::size_t>(last)]) {
      writer.put_again();
    } else {
      writer.put(black && k % 2 ? nullptr : slice.data());
    }
  }
  return writer.finish();
}

/// Every `step`-th slice from the last on.
void expect_slices(const KeptTile& tile, const Slices& slices, int step) {
  TileReader reader(tile);
  Bytes bytes(kColumns, 0);
  for (int n = tile.slices - 1; n >= 0; n -= step) {
    const TileReader::Step how = reader.go_to(n);
    if (how == TileReader::Step::whole) std::copy_n(reader.whole(), kColumns, bytes.begin());
    if (how == TileReader::Step::changes) {
      for (const auto& change : reader.changes()) bytes[change.at] ^= change.value;
    }
    ASSERT_EQ(bytes, slices[static_cast<std::size_t>(n)]) << n << " " << step;
  }
}

TEST(KeptTile, ReadsWhatWasPutFromEitherEnd) {
  const TemporaryFolder folder;
  for (const std::size_t budget : {std::size_t{0}, std::size_t{1} << 20}) {
    BlobStore store(folder.path(), budget, {});
    for (const int count : {1, kPieceSlices - 1, kPieceSlices, 5 * kPieceSlices + 17}) {
      const Slices slices = some_slices(count, static_cast<unsigned>(count));
      const KeptTile up = kept(store, slices, TileWriter::From::first);
      const KeptTile down = kept(store, slices, TileWriter::From::last);
      for (const int step : {1, 3, kPieceSlices + 1}) {
        expect_slices(up, slices, step);
        expect_slices(down, slices, step);
      }
    }
  }
}

TEST(KeptTile, BlackPiecesTakeNoRoom) {
  const TemporaryFolder folder;
  BlobStore store(folder.path(), 0, {});
  for (const auto from : {TileWriter::From::first, TileWriter::From::last}) {
    const KeptTile tile = kept(store, some_slices(5 * kPieceSlices, 3), from);
    EXPECT_EQ(tile.pieces[2], nullptr);
    EXPECT_NE(tile.pieces[0], nullptr);
  }
}

TEST(KeptTile, SharesPiecesThatAreAlike) {
  const TemporaryFolder folder;
  BlobStore store(folder.path(), 0, {});
  Slices slices = some_slices(6 * kPieceSlices, 5);
  const KeptTile first = kept(store, slices, TileWriter::From::last);
  const std::uint64_t bytes = store.scratch_bytes();
  EXPECT_EQ(kept(store, slices, TileWriter::From::last, &first), first);
  slices[kPieceSlices + 3][17] ^= 1;
  const KeptTile other = kept(store, slices, TileWriter::From::last, &first);
  for (std::size_t k = 0; k < first.pieces.size(); ++k) {
    EXPECT_EQ(other.pieces[k] == first.pieces[k], k != 1) << k;
  }
  expect_slices(other, slices, 1);
  // Room of what nobody holds is taken again.
  for (int k = 0; k < 50; ++k) {
    slices[kPieceSlices + 3][17] ^= 1;
    kept(store, slices, TileWriter::From::last, &first);
  }
  EXPECT_LE(store.scratch_bytes(), 2 * bytes);
}

TEST(KeptTile, WhatDoesNotComeStays) {
  const TemporaryFolder folder;
  BlobStore store(folder.path(), 0, {});
  const int count = 4 * kPieceSlices;
  Slices slices = some_slices(count, 9);
  const KeptTile before = kept(store, slices, TileWriter::From::last);
  TileWriter writer(store, kColumns, count, TileWriter::From::last, &before);
  for (int n = count; n-- > kPieceSlices;) {
    slices[static_cast<std::size_t>(n)].assign(kColumns, 7);
    writer.put(slices[static_cast<std::size_t>(n)].data());
  }
  const KeptTile after = writer.finish();
  EXPECT_EQ(after.pieces[0], before.pieces[0]);
  expect_slices(after, slices, 1);
  // Without a tile before, the rest is black.
  TileWriter few(store, kColumns, count, TileWriter::From::first);
  few.put(slices[0].data());
  Slices one(static_cast<std::size_t>(count), Bytes(kColumns, 0));
  one[0] = slices[0];
  expect_slices(few.finish(), one, 1);
}

}  // namespace
}  // namespace slicecorr
