// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The distinct columns of a design: what happens in a column depends on nothing else, so each is
/// corrected once, however many pixels have it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "bands/design_band.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// A change of a column on its way from the platform: from this layer on that coverage; or the edge
/// height of the layer's upper node, alone.
struct ColumnEvent {
  std::int32_t layer;
  std::uint8_t coverage;  ///< from here on
  std::uint8_t height;    ///< of this node; 0: none
};

class DesignColumns {
 public:
  /// Only columns with a full voxel. Gentle slopes of targets with edge heights are made sharp, as
  /// corrections see them. Throws `InputError` where there is none.
  DesignColumns(const SliceSource& target, const ExecutionContext& context);

  struct Column {
    int x = 0, y = 0;          ///< of the first pixel that has it, in reading order
    std::uint64_t pixels = 0;  ///< that have it
    std::size_t first_event = 0, events = 0;
  };
  std::span<const Column> columns() const { return columns_; }
  std::span<const ColumnEvent> events(std::size_t column) const {
    return {events_.data() + columns_[column].first_event, columns_[column].events};
  }
  std::uint64_t pixels() const { return pixels_; }
  int layers() const { return layers_; }
  bool has_heights() const { return has_heights_; }
  /// The design of some columns, slice by slice. `which` must outlive what comes back.
  DesignReader reader(std::span<const std::uint32_t> which) const;

 private:
  int layers_;
  bool has_heights_;
  std::uint64_t pixels_ = 0;
  std::vector<Column> columns_;
  std::vector<ColumnEvent> events_;
};

}  // namespace slicecorr::detail
