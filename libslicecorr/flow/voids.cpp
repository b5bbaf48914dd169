// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/voids.hpp"

#include <algorithm>
#include <tuple>

#include "flow/coarse_slices.hpp"

namespace slicecorr::detail {

int Voids::root(int v) {
  while (voids_[static_cast<std::size_t>(v)].parent != v) {
    Void& one = voids_[static_cast<std::size_t>(v)];
    one.parent = voids_[static_cast<std::size_t>(one.parent)].parent;
    v = one.parent;
  }
  return v;
}

int Voids::add_void() {
  Void one;
  one.parent = static_cast<int>(voids_.size());
  one.first = slice_;
  voids_.push_back(one);
  return one.parent;
}

BlindVoid Voids::described(const Void& v, bool vented) const {
  const double cell_mm2 = grid_.pitch_um * grid_.pitch_um * 1e-6;
  return {.x_mm = v.x_mm,
          .y_mm = v.y_mm,
          .first = v.first,
          .last = v.last,
          .volume_mm3 = v.cells * cell_mm2 * layer_um_ * 1e-3,
          .area_mm2 = static_cast<double>(v.widest) * cell_mm2,
          .from_platform = v.first == 0,
          .vented = vented};
}

void Voids::join(int a, int b) {
  a = root(a);
  b = root(b);
  if (a == b) return;
  if (b < a) std::swap(a, b);
  Void &stays = voids_[static_cast<std::size_t>(a)], &goes = voids_[static_cast<std::size_t>(b)];
  goes.parent = a;
  if (a == kBath) {
    if (goes.cells > 0) done_.push_back(described(goes, true));
    return;
  }
  stays.cells += goes.cells;
  stays.first = std::min(stays.first, goes.first);
  stays.last = std::max(stays.last, goes.last);
  if (goes.widest > stays.widest) {
    stays.widest = goes.widest;
    stays.x_mm = goes.x_mm;
    stays.y_mm = goes.y_mm;
  }
}

void Voids::label(const std::vector<std::uint8_t>& coverage) {
  pieces_.clear();
  piece_.assign(coverage.size(), kLit);
  const auto columns = static_cast<std::size_t>(grid_.columns);
  for (std::size_t start = 0; start < coverage.size(); ++start) {
    if (coverage[start] >= kLitCell || piece_[start] != kLit) continue;
    const int name = static_cast<int>(pieces_.size());
    Piece piece;
    const auto reach = [&](std::size_t cell) {
      if (coverage[cell] >= kLitCell || piece_[cell] != kLit) return;
      piece_[cell] = name;
      stack_.push_back(cell);
    };
    reach(start);
    while (!stack_.empty()) {
      const std::size_t cell = stack_.back();
      stack_.pop_back();
      ++piece.cells;
      const auto [x_mm, y_mm] = grid_.place_mm(cell);
      piece.x_mm += x_mm;
      piece.y_mm += y_mm;
      const std::size_t x = cell % columns;
      if (x > 0) reach(cell - 1);
      if (x + 1 < columns) reach(cell + 1);
      if (cell >= columns) reach(cell - columns);
      if (cell + columns < coverage.size()) reach(cell + columns);
    }
    piece.x_mm /= static_cast<double>(piece.cells);
    piece.y_mm /= static_cast<double>(piece.cells);
    pieces_.push_back(piece);
  }
}

void Voids::connect() {
  // The first cell is of the ring, and so is the first piece.
  pieces_.front().void_of = kBath;
  for (std::size_t cell = 0; cell < piece_.size(); ++cell) {
    if (piece_[cell] == kLit || before_.empty() || before_[cell] == kLit) continue;
    int& of = pieces_[static_cast<std::size_t>(piece_[cell])].void_of;
    if (of == kLit) {
      of = root(before_[cell]);
    } else {
      join(of, before_[cell]);
    }
  }
  for (Piece& piece : pieces_) {
    if (piece.void_of == kLit) piece.void_of = add_void();
  }
}

void Voids::measure() {
  for (const Piece& piece : pieces_) {
    const int r = root(piece.void_of);
    if (r == kBath) continue;
    Void& v = voids_[static_cast<std::size_t>(r)];
    v.cells += static_cast<double>(piece.cells);
    v.last = slice_;
    if (piece.cells > v.widest) {
      v.widest = piece.cells;
      v.x_mm = piece.x_mm;
      v.y_mm = piece.y_mm;
    }
  }
}

void Voids::set(SliceCells& cells, std::size_t cell, int of) const {
  cells.kinds[cell] = of == kLit ? FlowCell::part : of == kBath ? FlowCell::bath : FlowCell::blind;
  cells.voids[cell] = of > kBath ? of : -1;
}

void Voids::add_slice(const std::vector<std::uint8_t>& coverage, SliceCells& cells) {
  ++slice_;
  if (voids_.empty()) add_void();  // the bath
  label(coverage);
  connect();
  measure();
  cells.kinds.resize(coverage.size());
  cells.voids.resize(coverage.size());
  now_.resize(coverage.size());
  for (std::size_t cell = 0; cell < coverage.size(); ++cell) {
    if (piece_[cell] == kLit) {
      now_[cell] = kLit;
      // Without gelled material above, what is lit is still a piece of the void above.
      const bool gelled_above = before_.empty() || before_[cell] == kLit;
      set(cells, cell, gelled_above ? kLit : root(before_[cell]));
    } else {
      now_[cell] = root(pieces_[static_cast<std::size_t>(piece_[cell])].void_of);
      set(cells, cell, now_[cell]);
    }
  }
  before_.swap(now_);
}

void Voids::add_again(SliceCells& cells) {
  ++slice_;
  measure();
  for (std::size_t cell = 0; cell < before_.size(); ++cell) {
    set(cells, cell, before_[cell] == kLit ? kLit : root(before_[cell]));
  }
}

std::vector<BlindVoid> Voids::blind() const {
  std::vector<BlindVoid> all = done_;
  for (std::size_t v = 1; v < voids_.size(); ++v) {
    if (voids_[v].parent == static_cast<int>(v)) all.push_back(described(voids_[v], false));
  }
  std::sort(all.begin(), all.end(), [](const BlindVoid& a, const BlindVoid& b) {
    return std::tuple(-a.volume_mm3, a.first, a.x_mm, a.y_mm) <
           std::tuple(-b.volume_mm3, b.first, b.x_mm, b.y_mm);
  });
  return all;
}

}  // namespace slicecorr::detail
