// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <numbers>
#include <numeric>

#include "flow/solvable.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/flow_part.hpp"

namespace slicecorr {

namespace {

/// Greatest extent of something in cells.
struct PieceExtent {
  std::size_t cells = 0;
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< both ends belong to it
  void add(int x, int y) {
    x0 = cells == 0 ? x : std::min(x0, x);
    x1 = cells == 0 ? x : std::max(x1, x);
    y0 = cells == 0 ? y : std::min(y0, y);
    y1 = cells == 0 ? y : std::max(y1, y);
    ++cells;
  }
};

/// The pieces of part and blind cells, connected by edges of cells.
std::vector<PieceExtent> pieces_of(const FlowSection& s) {
  std::vector<PieceExtent> pieces;
  std::vector<bool> seen(s.size(), false);
  std::vector<std::size_t> stack;
  const auto reach = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= s.width || y >= s.height) return;
    const std::size_t k = s.index(x, y);
    if (seen[k] || s.cells[k] == FlowCell::bath) return;
    seen[k] = true;
    stack.push_back(k);
  };
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      reach(x, y);
      if (stack.empty()) continue;
      PieceExtent piece;
      while (!stack.empty()) {
        const auto k = static_cast<int>(stack.back());
        stack.pop_back();
        const int cx = k % s.width, cy = k / s.width;
        piece.add(cx, cy);
        reach(cx - 1, cy);
        reach(cx + 1, cy);
        reach(cx, cy - 1);
        reach(cx, cy + 1);
      }
      pieces.push_back(piece);
    }
  }
  return pieces;
}

double bound_of(const PieceExtent& e, const FlowSection& s) {
  const double disc_um2 = 3 * static_cast<double>(e.cells) * s.cell_um2() / std::numbers::pi;
  const double side_um =
      std::min((e.x1 - e.x0 + 1) * s.pitch_x_um, (e.y1 - e.y0 + 1) * s.pitch_y_um);
  return std::min(disc_um2, 1.5 * side_um * side_um);
}

}  // namespace

bool detail::solvable(const FlowSection& s) {
  PieceExtent all;
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      if (s.cells[s.index(x, y)] == FlowCell::part) all.add(x, y);
    }
  }
  return all.x1 - all.x0 >= 2 && all.y1 - all.y0 >= 2;
}

double phi_bound_um2(const FlowSection& section) {
  double most = 0;
  for (const PieceExtent& piece : pieces_of(section))
    most = std::max(most, bound_of(piece, section));
  return most;
}

MaskPhi mask_phi(const FlowPart& part, std::size_t mask, const ExecutionContext& context) {
  const FlowSection section = part.section(mask);
  MaskPhi phi;
  if (!detail::solvable(section)) {
    phi.bound = true;
    for (const PieceExtent& piece : pieces_of(section)) {
      const double bound_um2 = bound_of(piece, section);
      phi.integral_um4 += bound_um2 * static_cast<double>(piece.cells) * section.cell_um2();
      if (!(bound_um2 > phi.max_phi_um2)) continue;
      phi.max_phi_um2 = bound_um2;
      phi.cell = section.index((piece.x0 + piece.x1) / 2, (piece.y0 + piece.y1) / 2);
    }
    return phi;
  }
  const GapPressure pressure = solve_pressure(section, context);
  phi.max_phi_um2 = pressure.max_phi_um2;
  phi.integral_um4 = pressure.integral_um4;
  phi.cell = section.index(pressure.max_x, pressure.max_y);
  return phi;
}

SlowestSlice slowest_slice(const FlowPart& part, const ExecutionContext& context) {
  const std::size_t count = part.masks();
  std::vector<double> bounds(count);
  parallel_for(context, "bound suction", count,
               [&](std::size_t i) { bounds[i] = phi_bound_um2(part.section(i)); });
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return bounds[a] > bounds[b]; });
  // The bound is that of the exact solution; cells miss it by less than this.
  constexpr double kMargin = 1.05;
  // As many at once whatever the number of threads, so that always the same masks are solved.
  constexpr std::size_t kAtOnce = 8;
  const ExecutionContext inner = detail::silent(context);
  ExecutionContext one_thread = inner;
  one_thread.threads = 1;
  SlowestSlice slowest;
  for (std::size_t first = 0; first < count; first += kAtOnce) {
    if (slowest.solved > 0 && bounds[order[first]] * kMargin < slowest.phi.max_phi_um2) break;
    const std::size_t some = std::min(kAtOnce, count - first);
    std::vector<MaskPhi> solved(some);
    parallel_for(context, "solve suction", some,
                 [&](std::size_t i) { solved[i] = mask_phi(part, order[first + i], context); });
    for (std::size_t i = 0; i < some; ++i) {
      const int slice = part.first_slice_of(order[first + i]);
      const double one = solved[i].max_phi_um2, best = slowest.phi.max_phi_um2;
      if (one < best || (one == best && best > 0 && slice > slowest.slice)) continue;
      slowest.slice = slice;
      slowest.phi = solved[i];
    }
    slowest.solved = first + some;
  }
  return slowest;
}

}  // namespace slicecorr
