// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bytes of a tile of pixels through all slices, coded, in a `BlobStore`: on a disk where tiles are
/// too many for the memory.
///
/// A tile is kept in pieces of `kPieceSlices` slices, each with its last slice and then, slice by
/// slice towards the first, the bytes that change (exclusive or), all run-length coded. It is read
/// from the last slice to the first. Pieces that are black take no room, and tiles share those that
/// are the same.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/run_length.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr::detail {

inline constexpr int kPieceSlices = 64;

/// Bytes in a store, which must outlive them; their room is free when nobody holds them any more.
class KeptBytes {
 public:
  KeptBytes(BlobStore& store, const std::vector<std::uint8_t>& bytes)
      : store_(store), blob_(store.put(bytes.data(), bytes.size())) {}
  ~KeptBytes() { store_.drop(blob_); }
  KeptBytes(const KeptBytes&) = delete;
  KeptBytes& operator=(const KeptBytes&) = delete;
  /// In place of what `out` held.
  void get(std::vector<std::uint8_t>& out) const {
    out.clear();
    store_.get(blob_, out);
  }
  std::size_t size() const { return blob_.size; }

 private:
  BlobStore& store_;
  BlobStore::Blob blob_;
};
using Kept = std::shared_ptr<const KeptBytes>;

struct KeptTile {
  std::size_t columns = 0;
  int slices = 0;
  std::vector<Kept> pieces;  ///< the first slices first; null: black
  /// Whether all pieces are shared.
  bool operator==(const KeptTile&) const = default;
};

/// Takes the slices of a tile, all from the first or all from the last one on.
class TileWriter {
 public:
  enum class From { first, last };
  /// Pieces like those of `before`, if there is one, are shared with it.
  TileWriter(BlobStore& store, std::size_t columns, int slices, From from,
             const KeptTile* before = nullptr);
  /// The next slice; null is black.
  void put(const std::uint8_t* rows);
  /// A slice like the one before it.
  void put_again();
  /// The slices that have not come are black, or, from the last piece that is complete on, those of
  /// `before` where there is one.
  KeptTile finish();

 private:
  void end_entry();
  void end_piece();
  int next_slice() const { return from_ == From::first ? put_ : tile_.slices - 1 - put_; }

  BlobStore& store_;
  KeptTile tile_;
  From from_;
  const KeptTile* before_;
  int put_ = 0;
  bool lit_ = false;  ///< the slice before has a byte that is not 0
  std::vector<std::uint8_t> last_, change_;
  /// What there is of a piece: codes, one after the other, and where each ends.
  std::vector<std::uint8_t> code_, piece_, kept_;
  std::vector<std::size_t> ends_;
};

/// Goes through a tile from the last slice to the first. The tile must outlive it.
class TileReader {
 public:
  explicit TileReader(const KeptTile& tile) : TileReader(tile, {0, tile.columns}) {}
  /// `changes` tells of these bytes only.
  TileReader(const KeptTile& tile, const ByteRange& range) : tile_(&tile), range_(range) {}
  enum class Step {
    same,     ///< the slice is like the one before
    changes,  ///< `changes` are the exclusive ors
    whole     ///< `whole` is the slice
  };
  /// Goes to a slice, not above the one before it; those there are not are black.
  Step go_to(int slice);
  const std::vector<NonZero>& changes() const { return changes_; }
  const std::uint8_t* whole() const { return whole_.data(); }

 private:
  /// The code of the next slice of the piece, in `code_`.
  void read_code(std::size_t& first, std::size_t& past);
  const KeptTile* tile_;
  ByteRange range_;
  int slice_ = -1, piece_ = -1;
  bool black_ = true;  ///< the piece is
  std::size_t at_ = 0;
  std::vector<std::uint8_t> code_, whole_;
  std::vector<NonZero> changes_;
};

}  // namespace slicecorr::detail
