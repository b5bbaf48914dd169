// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/node_kernels.hpp"

#include <algorithm>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// A place between nodes; those beyond the outer ones are next to them.
struct Between {
  int node;
  float share;
  [[gnu::always_inline]] Between(float place, float first, float by, int nodes) {
    const float most = static_cast<float>(nodes - 2);
    const float at = std::min(std::max((place - first) * by, 0.0f), most);
    node = static_cast<int>(at);
    share = at - static_cast<float>(node);
  }
};

}  // namespace

SLICECORR_CLONES
void gather_nodes(const NodeColumn& at, const float* nodes, float* field) {
  const float *const column = at.column, *const row = at.row, *const light = at.light;
  const int rows = at.rows;
  for (int z = 0; z < at.slices; ++z) {
    const Between c(column[z], at.first_column, at.by_column, at.columns);
    const Between r(row[z], at.first_row, at.by_row, at.rows);
    const int i = c.node * rows + r.node;
    const float low = nodes[i] + r.share * (nodes[i + 1] - nodes[i]);
    const float high = nodes[i + rows] + r.share * (nodes[i + rows + 1] - nodes[i + rows]);
    field[z] += light[z] * (low + c.share * (high - low));
  }
}

void scatter_nodes(const NodeColumn& at, const float* field, float* nodes) {
  for (int z = 0; z < at.slices; ++z) {
    const float value = at.light[z] * field[z];
    if (value == 0) continue;
    const Between c(at.column[z], at.first_column, at.by_column, at.columns);
    const Between r(at.row[z], at.first_row, at.by_row, at.rows);
    float* const low = nodes + static_cast<std::ptrdiff_t>(c.node) * at.rows + r.node;
    float* const high = low + at.rows;
    const float of_high = c.share * value, of_low = value - of_high;
    low[0] += of_low - r.share * of_low;
    low[1] += r.share * of_low;
    high[0] += of_high - r.share * of_high;
    high[1] += r.share * of_high;
  }
}

}  // namespace slicecorr::tomo::detail
