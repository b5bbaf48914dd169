// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_necks.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>

#include "correct/coverage.hpp"

namespace slicecorr::detail {

namespace {

constexpr int kMiddle = 13, kAround = 27;
constexpr std::array<int, 6> kFaces = {4, 10, 12, 14, 16, 22};

/// Whether two of the 27 voxels share a face.
bool share_face(int a, int b) {
  return std::abs(a % 3 - b % 3) + std::abs(a / 3 % 3 - b / 3 % 3) + std::abs(a / 9 - b / 9) == 1;
}

/// All that hangs together with one of them, the middle aside.
VoxelsAround body_of(int first, const VoxelsAround& solid) {
  VoxelsAround body;
  std::array<int, kAround> found{first};
  body.set(static_cast<std::size_t>(first));
  for (std::size_t i = 0, size = 1; i < size; ++i) {
    for (int k = 0; k < kAround; ++k) {
      const auto at = static_cast<std::size_t>(k);
      if (k == kMiddle || !solid[at] || body[at] || !share_face(found[i], k)) continue;
      body.set(at);
      found[size++] = k;
    }
  }
  return body;
}

/// What is solid in a slice of a box, and a pixel around it.
class SolidSlice {
 public:
  explicit SolidSlice(const PixelBox& box)
      : box_(PatchPlace::grown(box, 1, 1)), designed_(pixels_of(box_)), prints_(designed_) {}
  void fill(bool solid) {
    std::fill(designed_.begin(), designed_.end(), solid);
    prints_ = designed_;
  }
  template <class Cover>
  void set(const Cover& cover) {
    std::size_t i = 0;
    for (int y = box_.y0; y < box_.y1; ++y) {
      for (int x = box_.x0; x < box_.x1; ++x) designed_[i++] = cover(x, y) >= kLeftAlone;
    }
    prints_ = designed_;
  }
  void lose(const Miss& miss) { prints_[index_in(box_, miss.x, miss.y)] = false; }
  bool designed(int x, int y) const { return designed_[index_in(box_, x, y)]; }
  bool prints(int x, int y) const { return prints_[index_in(box_, x, y)]; }

 private:
  PixelBox box_;
  std::vector<bool> designed_, prints_;
};

}  // namespace

bool joins_alone(const VoxelsAround& solid) {
  VoxelsAround body;
  for (const int face : kFaces) {
    const auto at = static_cast<std::size_t>(face);
    if (!solid[at] || body[at]) continue;
    if (body.any()) return true;
    body = body_of(face, solid);
  }
  return false;
}

std::vector<Miss> lost_necks(const CoupledPlan& plan, const PixelBox& box,
                             const std::vector<Miss>& misses,
                             const std::vector<PatchBytes::Source>& coverage) {
  std::vector<Miss> lost, necks;
  for (const Miss& miss : misses) {
    if (miss.wrong && miss.excess < 0) lost.push_back(miss);
  }
  if (lost.empty()) return necks;
  const PixelBox watched = PatchPlace::grown(box, 1, 1);
  const PatchPlace place(plan, watched);
  PatchBytes cover(place, watched, coverage);
  // Slices n + 1, n and n - 1 are at n + 1, n and n - 1 modulo 3.
  std::array<SolidSlice, 3> slices{SolidSlice(box), SolidSlice(box), SolidSlice(box)};
  const auto slice = [&](int n) -> SolidSlice& {
    return slices[static_cast<std::size_t>(n + 3) % 3];
  };
  auto next = lost.begin();
  int read = lost.front().slice + 2;  // the lowest slice that is known
  const auto read_down_to = [&](int n) {
    read = std::min(read, n + 3);
    while (read > n) {
      SolidSlice& its = slice(--read);
      if (read < 0) {
        its.fill(true);
        continue;
      }
      cover.go_to(read, [](std::size_t, std::uint8_t, std::uint8_t) {});
      its.set([&](int x, int y) { return cover[place.at(x, y)]; });
      while (next != lost.end() && next->slice > read) ++next;
      for (; next != lost.end() && next->slice == read; ++next) its.lose(*next);
    }
  };
  for (const Miss& miss : lost) {
    read_down_to(miss.slice - 1);
    VoxelsAround designed, prints;
    for (int k = 0; k < kAround; ++k) {
      const SolidSlice& its = slice(miss.slice + k / 9 - 1);
      const int x = miss.x + k % 3 - 1, y = miss.y + k / 3 % 3 - 1;
      designed.set(static_cast<std::size_t>(k), its.designed(x, y));
      prints.set(static_cast<std::size_t>(k), its.prints(x, y));
    }
    if (joins_alone(designed) || joins_alone(prints)) necks.push_back(miss);
  }
  return necks;
}

}  // namespace slicecorr::detail
