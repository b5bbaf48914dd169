// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/kept_tile.hpp"

#include <algorithm>
#include <utility>

#include "base/coded_band.hpp"

namespace slicecorr::detail {

namespace {

void put_size(std::size_t size, std::vector<std::uint8_t>& out) {
  for (; size >= 128; size >>= 7) out.push_back(static_cast<std::uint8_t>(size | 128));
  out.push_back(static_cast<std::uint8_t>(size));
}

}  // namespace

TileWriter::TileWriter(BlobStore& store, std::size_t columns, int slices, From from,
                       const KeptTile* before)
    : store_(store), from_(from), before_(before), last_(columns, 0), change_(columns) {
  tile_.columns = columns;
  tile_.slices = slices;
  tile_.pieces.resize(static_cast<std::size_t>((slices + kPieceSlices - 1) / kPieceSlices));
}

void TileWriter::put(const std::uint8_t* rows) {
  const std::size_t columns = tile_.columns;
  const bool lit = rows != nullptr && !all_zero(rows, columns);
  const bool first_of_piece = ends_.empty();
  if (!first_of_piece || from_ == From::first) {
    // From the last slice on, the first of a piece stands for itself.
    if (!first_of_piece && (lit || lit_)) {
      std::uint8_t any = 0;
      for (std::size_t k = 0; k < columns; ++k) {
        change_[k] = static_cast<std::uint8_t>(last_[k] ^ (lit ? rows[k] : 0));
        any |= change_[k];
      }
      if (any) run_length_encode(change_.data(), columns, code_);
    }
  } else if (lit) {
    run_length_encode(rows, columns, code_);
  }
  if (lit) {
    std::copy_n(rows, columns, last_.begin());
  } else if (lit_) {
    std::fill(last_.begin(), last_.end(), std::uint8_t{0});
  }
  lit_ = lit;
  end_entry();
}

void TileWriter::put_again() {
  if (ends_.empty() && from_ == From::last && lit_) {
    run_length_encode(last_.data(), tile_.columns, code_);
  }
  end_entry();
}

void TileWriter::end_entry() {
  ends_.push_back(code_.size());
  const int slice = next_slice();
  ++put_;
  const bool last_of_piece =
      from_ == From::first ? slice % kPieceSlices == kPieceSlices - 1 || slice == tile_.slices - 1
                           : slice % kPieceSlices == 0;
  if (!last_of_piece) return;
  end_piece();
  const auto k = static_cast<std::size_t>(slice / kPieceSlices);
  if (!piece_.empty()) {
    const Kept* const before = before_ ? &before_->pieces[k] : nullptr;
    bool alike = before && *before && (*before)->size() == piece_.size();
    if (alike) {
      (*before)->get(kept_);
      alike = kept_ == piece_;
    }
    tile_.pieces[k] = alike ? *before : std::make_shared<const KeptBytes>(store_, piece_);
  }
  code_.clear();
  ends_.clear();
}

void TileWriter::end_piece() {
  piece_.clear();
  if (from_ == From::last) {
    if (code_.empty()) return;
    std::size_t first = 0;
    for (const std::size_t past : ends_) {
      put_size(past - first, piece_);
      piece_.insert(piece_.end(), code_.begin() + static_cast<std::ptrdiff_t>(first),
                    code_.begin() + static_cast<std::ptrdiff_t>(past));
      first = past;
    }
    return;
  }
  // The last slice, then the changes backwards; before the first one there is none.
  if (!lit_ && code_.empty()) return;
  const std::size_t changes = code_.size();
  if (lit_) run_length_encode(last_.data(), tile_.columns, code_);
  const auto append = [&](std::size_t first, std::size_t past) {
    put_size(past - first, piece_);
    piece_.insert(piece_.end(), code_.begin() + static_cast<std::ptrdiff_t>(first),
                  code_.begin() + static_cast<std::ptrdiff_t>(past));
  };
  append(changes, code_.size());
  for (std::size_t k = ends_.size(); k-- > 1;) append(ends_[k - 1], ends_[k]);
}

KeptTile TileWriter::finish() {
  if (before_ && from_ == From::last && ends_.empty()) {
    for (int slice = next_slice(); slice >= 0; slice -= kPieceSlices) {
      const auto k = static_cast<std::size_t>(slice / kPieceSlices);
      tile_.pieces[k] = before_->pieces[k];
    }
    put_ = tile_.slices;
  }
  while (put_ < tile_.slices) put(nullptr);
  return std::move(tile_);
}

void TileReader::read_code(std::size_t& first, std::size_t& past) {
  std::size_t size = 0;
  for (int shift = 0;; shift += 7) {
    const std::uint8_t byte = code_[at_++];
    size |= static_cast<std::size_t>(byte & 127U) << shift;
    if (byte < 128) break;
  }
  first = at_;
  past = at_ += size;
}

TileReader::Step TileReader::go_to(int slice) {
  if (slice < 0 || slice >= tile_->slices) return Step::same;
  const int piece = slice / kPieceSlices;
  std::size_t first = 0, past = 0;
  if (piece == piece_) {
    if (black_ || slice == slice_) return Step::same;
    if (slice == slice_ - 1) {
      slice_ = slice;
      read_code(first, past);
      if (first == past) return Step::same;
      changes_.clear();
      run_length_nonzero(code_.data() + first, code_.data() + past, tile_->columns, range_,
                         changes_);
      return Step::changes;
    }
  }
  const bool was_black = black_;
  if (piece != piece_) whole_.clear();
  piece_ = piece;
  const Kept& kept = tile_->pieces[static_cast<std::size_t>(piece)];
  black_ = kept == nullptr;
  slice_ = slice;
  if (black_ && was_black) return Step::same;
  whole_.assign(tile_->columns, 0);
  if (black_) return Step::whole;
  kept->get(code_);
  at_ = 0;
  read_code(first, past);
  if (first < past) {
    run_length_decode(code_.data() + first, code_.data() + past, whole_.data(), tile_->columns);
  }
  const int top = std::min(tile_->slices, (piece + 1) * kPieceSlices) - 1;
  for (int n = top; n-- > slice;) {
    read_code(first, past);
    if (first == past) continue;
    changes_.clear();
    run_length_nonzero(code_.data() + first, code_.data() + past, tile_->columns, changes_);
    for (const NonZero& change : changes_) whole_[change.at] ^= change.value;
  }
  return Step::whole;
}

}  // namespace slicecorr::detail
