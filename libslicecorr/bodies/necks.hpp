// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// By how much of its area a body hangs on what printed before it, slice by slice.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

/// Of patches, voxels of a slice that hang together in it. A patch hangs by what it shares with patches
/// of the slice before, of which each bears no more than it hangs by itself; on the platform by its own
/// area. Where that is less than asked for it is a *neck*, until a patch hangs by less. A neck by which no
/// patch of the slice at hand hangs any more is told and forgotten, so memory is that of a slice.
class NeckFinder {
 public:
  using Run = BodyTracker::Run;
  using Sink = std::function<void(const Neck&)>;
  /// `least`: voxels of a slice by which a body must hang, > 0. `found` is told, in the order in which they
  /// end, necks by which something hangs, and by no neck after it, that has as many voxels in a slice as a
  /// body must hang by: the tip of a cone is no body that hangs.
  NeckFinder(int rows, std::uint64_t least, Sink found);
  /// As `BodyTracker::set_row`, delays aside.
  void set_row(int y, std::span<const Run> runs);
  void end_slice(int more);
  /// Tells those by which the last slice hangs.
  void finish();
  /// Voxels of the widest patch of all slices.
  std::uint64_t widest() const { return widest_; }
  /// Necks that are kept.
  std::size_t kept() const { return necks_.size() - free_.size() - 1; }

 private:
  static constexpr std::uint32_t kEnough = 0, kNothing = 0xFFFFFFFF;
  struct Labelled {
    std::int32_t begin = 0, end = 0;
    std::uint32_t patch = 0;
  };
  using Row = std::vector<Labelled>;
  struct Patch {
    std::uint32_t neck = kNothing;  ///< the one that it hangs by
    std::uint64_t voxels = 0;
  };
  struct Found {
    Neck neck;
    std::uint64_t widest = 0;  ///< most voxels of a patch that hangs by it, by no neck after it
    std::uint32_t below = kEnough;  ///< the neck that this one hangs by
    std::uint32_t hanging = 0;      ///< patches of the slice at hand, and necks that hang by it
  };
  /// What a patch shares with those of the slice before that hang by one neck.
  struct Contact {
    std::uint32_t patch, neck;
    std::uint64_t voxels;
    std::int64_t column2, row2;  ///< sums of twice the middles
  };
  void label();
  void hang();
  std::uint32_t hang(std::span<const Contact> contacts);
  std::uint32_t add(std::uint64_t voxels, std::int64_t column2, std::int64_t row2,
                    std::uint32_t below);
  void hold(std::uint32_t neck);
  /// One less hangs by it; tells and forgets it where that was the last, and so on below.
  void let_go(std::uint32_t neck);

  const std::uint64_t least_;
  const Sink found_;
  int slice_ = 0;
  std::uint64_t widest_ = 0;
  bool changed_ = true;
  std::vector<Row> rows_, before_;  ///< of the slice at hand, and of the one before
  std::vector<std::uint32_t> parent_;
  std::vector<Patch> patches_, patches_before_;
  std::vector<Contact> contacts_;
  std::vector<Found> necks_;         ///< the first stands for enough
  std::vector<std::uint32_t> free_;  ///< places among them
};

}  // namespace slicecorr::detail
