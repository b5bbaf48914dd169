// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where a part lies on the display, and how many slices it needs.
#pragma once

#include <algorithm>
#include <cstddef>

#include "parallel/silent.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::detail {

inline constexpr std::size_t kChunk = 1 << 15;
inline std::size_t chunks_of(std::size_t count) { return (count + kChunk - 1) / kChunk; }
/// Calls `each(chunk, begin, end)` for parts of [0, count), on all threads.
template <class Each>
void in_chunks(std::size_t count, const ExecutionContext& context, const Each& each) {
  parallel_for(silent(context), "", chunks_of(count), [&](std::size_t chunk) {
    each(chunk, chunk * kChunk, std::min(count, (chunk + 1) * kChunk));
  });
}

/// The box around the corners of the part's triangles, mm.
struct PartBox {
  Point3 low, high;
  double size(std::size_t k) const { return high[k] - low[k]; }
  double middle(std::size_t k) const { return 0.5 * (low[k] + high[k]); }
};
/// Throws where a corner is not at a finite place.
PartBox box_of(const TriangleMesh& mesh, const ExecutionContext& context);

/// Where the middle of the part lies on the display, whose size is also given, mm.
struct Placing {
  double display_x, display_y, cx, cy;
};
Placing placing_of(const Grid& plate, const SliceOptions& options);

/// Throws where the part reaches over the display.
void check_fits(const PartBox& box, const Placing& at, const Grid& plate, const Printer& printer);

/// The height of the part that lies on the platform.
double platform_z_mm(const PartBox& box, const SliceOptions& options);

/// Slices of the part. Throws where they are none or too many, or beyond the stage's travel, and for
/// a platform inside the part.
int layers_of(const PartBox& box, const Printer& printer, const SliceOptions& options);

}  // namespace slicecorr::detail
