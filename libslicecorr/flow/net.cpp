// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "net.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::array<int, 4> kStepX{1, -1, 0, 0};
constexpr std::array<int, 4> kStepY{0, 0, 1, -1};
/// Outlines nearer to a cell's middle are moved away: they would only spoil the matrix.
constexpr double kLeastTheta = 0.02;

/// The outline within a cell as a straight line: inside where n·x < s, x from the middle in pitches,
/// |nx| + |ny| = 1.
struct CellLine {
  double nx = 0, ny = 0, s = 0;
  bool cuts = false;
};

class Coverage {
 public:
  explicit Coverage(const FlowSection& section) : s_(section) {}

  double at(int x, int y) const {
    if (x < 0 || y < 0 || x >= s_.width || y >= s_.height) return 0;
    const std::size_t i = s_.index(x, y);
    if (s_.cells[i] == FlowCell::blind) return 1;
    return s_.coverage[i];
  }

  /// Youngs' line: its normal from the nine cells around, its place from the share.
  CellLine line(int x, int y) const {
    const double c = at(x, y);
    CellLine line;
    if (c <= 0 || c >= 1) return line;
    for (int k = -1; k <= 1; ++k) {
      const double w = k == 0 ? 2 : 1;
      line.nx += w * (at(x - 1, y + k) - at(x + 1, y + k));
      line.ny += w * (at(x + k, y - 1) - at(x + k, y + 1));
    }
    const double sum = std::abs(line.nx) + std::abs(line.ny);
    if (!(sum > 0)) return line;
    line.nx /= sum;
    line.ny /= sum;
    line.cuts = true;
    line.s = place(c, std::min(std::abs(line.nx), std::abs(line.ny)));
    return line;
  }

 private:
  /// Of a line with the share `c` inside, smaller component of its normal `m`, the other 1 - m.
  static double place(double c, double m) {
    const double half = std::min(c, 1 - c), steep = 1 - m;
    const double corner = m / (2 * steep);
    const double alpha = half < corner ? std::sqrt(2 * m * steep * half) : steep * half + m / 2;
    return c < 0.5 ? alpha - 0.5 : 0.5 - alpha;
  }

  const FlowSection& s_;
};

/// Distance of the outline from the middle of a part cell towards its neighbour in bath, pitches.
double theta(const Coverage& coverage, int x, int y, int direction) {
  const auto along = [&](const CellLine& l) {
    return kStepX[direction] * l.nx + kStepY[direction] * l.ny;
  };
  const CellLine here = coverage.line(x, y);
  if (here.cuts && along(here) > 0 && here.s <= 0.5 * along(here)) {
    return std::clamp(here.s / along(here), kLeastTheta, 0.5);
  }
  const CellLine there = coverage.line(x + kStepX[direction], y + kStepY[direction]);
  if (there.cuts && along(there) > 0) return std::clamp(1 + there.s / along(there), 0.5, 1.0);
  return 0.5;
}

double cube(double v) { return v * v * v; }

double mean_mobility(double a, double b) { return 2 * a * b / (a + b); }

/// Numbers the blind cells that are one void; returns how many there are.
int number_voids(const FlowSection& s, std::vector<int>& node_of, int first) {
  int next = first;
  std::map<std::int32_t, int> named;
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.cells[i] != FlowCell::blind || node_of[i] >= 0) continue;
    if (!s.voids.empty()) {
      const auto [it, fresh] = named.try_emplace(s.voids[i], next);
      next += fresh ? 1 : 0;
      node_of[i] = it->second;
      continue;
    }
    node_of[i] = next;
    open.push_back(i);
    while (!open.empty()) {
      const std::size_t cell = open.back();
      open.pop_back();
      const int x = static_cast<int>(cell % static_cast<std::size_t>(s.width));
      const int y = static_cast<int>(cell / static_cast<std::size_t>(s.width));
      for (std::size_t d = 0; d < 4; ++d) {
        const int to_x = x + kStepX[d], to_y = y + kStepY[d];
        if (to_x < 0 || to_y < 0 || to_x >= s.width || to_y >= s.height) continue;
        const std::size_t to = s.index(to_x, to_y);
        if (s.cells[to] != FlowCell::blind || node_of[to] >= 0) continue;
        node_of[to] = next;
        open.push_back(to);
      }
    }
    ++next;
  }
  return next - first;
}

/// Width over distance of a face, for square cells 1.
double oblong(const FlowSection& s, std::size_t direction) {
  return direction < 2 ? s.pitch_y_um / s.pitch_x_um : s.pitch_x_um / s.pitch_y_um;
}

/// Says of each face what lies behind it, and how far away.
void find_neighbours(const FlowSection& s, FlowNet& net) {
  const Coverage coverage(s);
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (net.node_of[i] < 0) continue;
    const auto node = static_cast<std::size_t>(net.node_of[i]);
    const int x = static_cast<int>(i % static_cast<std::size_t>(s.width));
    const int y = static_cast<int>(i / static_cast<std::size_t>(s.width));
    if (node >= net.parts()) net.area[node] += 1;
    for (std::size_t d = 0; d < 4; ++d) {
      const int to_x = x + kStepX[d], to_y = y + kStepY[d];
      const bool beyond = to_x < 0 || to_y < 0 || to_x >= s.width || to_y >= s.height;
      const int to = beyond ? -1 : net.node_of[s.index(to_x, to_y)];
      if (node >= net.parts()) {
        // No part between a void and the bath: a wall of half a cell is taken for it.
        if (to < 0) net.leak[node - net.parts()] += 2 * oblong(s, d);
        continue;
      }
      FlowFace& face = net.faces[node][d];
      face.node = to;
      face.theta = to >= static_cast<int>(net.parts()) ? 0.5 : 1;
      if (to < 0)
        face.theta = s.coverage.empty() ? 0.5 : theta(coverage, x, y, static_cast<int>(d));
    }
  }
}

}  // namespace

FlowNet make_net(const FlowSection& s, std::span<const double> mobility) {
  FlowNet net;
  net.node_of.assign(s.size(), -1);
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.cells[i] != FlowCell::part) continue;
    net.node_of[i] = static_cast<int>(net.cell_of.size());
    net.cell_of.push_back(i);
  }
  const int parts = static_cast<int>(net.cell_of.size());
  const int voids = number_voids(s, net.node_of, parts);
  net.faces.resize(net.cell_of.size());
  net.area.assign(net.cell_of.size() + static_cast<std::size_t>(voids), 1);
  std::fill(net.area.begin() + parts, net.area.end(), 0);
  net.leak.assign(static_cast<std::size_t>(voids), 0);

  const auto mobility_of = [&](std::size_t i) { return mobility.empty() ? 1.0 : mobility[i]; };
  find_neighbours(s, net);
  for (std::size_t n = 0; n < net.parts(); ++n) {
    for (std::size_t d = 0; d < 4; ++d) {
      FlowFace& face = net.faces[n][d];
      const auto to = static_cast<std::size_t>(face.node);
      const double own = mobility_of(net.cell_of[n]);
      const bool inside = face.node >= 0 && to < net.parts();
      const double mobility = inside ? mean_mobility(own, mobility_of(net.cell_of[to])) : own;
      face.conductance = mobility * oblong(s, d) / face.theta;
    }
  }
  return net;
}

namespace {

/// Collects the rows of a net.
class RowMaker {
 public:
  RowMaker(const FlowNet& net, std::span<const double> phi, double cell_um2)
      : net_(net), phi_(phi), per_phi_(1 / (12 * cell_um2)) {}

  FlowRows make() {
    FlowRows rows;
    collect_voids();
    rows.begin.push_back(0);
    for (std::size_t n = 0; n < net_.nodes(); ++n) {
      parts_.clear();
      diagonal_ = outline_ = 0;
      n < net_.parts() ? add_part(n) : add_void(n);
      for (const auto& [node, weight] : parts_) {
        rows.from.push_back(node);
        rows.weight.push_back(weight);
      }
      rows.begin.push_back(rows.from.size());
      rows.diagonal.push_back(diagonal_);
      rows.outline.push_back(outline_);
    }
    put_in_order(rows);
    return rows;
  }

 private:
  void put_in_order(FlowRows& rows) const {
    rows.order.resize(net_.nodes());
    std::iota(rows.order.begin(), rows.order.end(), 0);
    const auto phi = [&](int n) { return phi_[static_cast<std::size_t>(n)]; };
    std::sort(rows.order.begin(), rows.order.end(),
              [&](int a, int b) { return phi(a) != phi(b) ? phi(a) < phi(b) : a < b; });
    std::vector<int> step(net_.nodes(), 0);
    for (const int node : rows.order) {
      const auto n = static_cast<std::size_t>(node);
      for (std::size_t k = rows.begin[n]; k < rows.begin[n + 1]; ++k) {
        step[n] = std::max(step[n], step[static_cast<std::size_t>(rows.from[k])] + 1);
      }
    }
    const auto step_of = [&](int n) { return step[static_cast<std::size_t>(n)]; };
    std::stable_sort(rows.order.begin(), rows.order.end(),
                     [&](int a, int b) { return step_of(a) < step_of(b); });
    for (std::size_t k = 0; k < rows.order.size(); ++k) {
      if (k == 0 || step_of(rows.order[k]) != step_of(rows.order[k - 1])) rows.step.push_back(k);
    }
    rows.step.push_back(rows.order.size());
  }

  /// Flow into part node `n` through its face `d`.
  double inflow(std::size_t n, std::size_t d) const {
    const FlowFace& face = net_.faces[n][d];
    const double beyond = face.node < 0 ? 0 : phi_[static_cast<std::size_t>(face.node)];
    return face.conductance * (phi_[n] - beyond) * per_phi_;
  }

  void take(int node, double weight) { parts_[node] += weight; }

  /// Adds `flow` times the dose at the face `d` through which part node `n` gives it away:
  /// Y + (Y - Y upstream)/2, upstream being what lies opposite where it flows in from there.
  /// The factor of Y itself is handed back; `sign`: 1 for what flows into the node in hand, -1 for
  /// what flows out of it.
  double give(std::size_t n, std::size_t d, double flow, double sign) {
    const std::size_t back = d ^ 1;
    const FlowFace& face = net_.faces[n][back];
    if (!(inflow(n, back) > 0)) return flow;
    const double slope = 0.5 / face.theta;
    if (face.node < 0) {
      outline_ -= sign * flow * slope;
    } else {
      take(face.node, -sign * flow * slope);
    }
    return flow * (1 + slope);
  }

  void add_part(std::size_t n) {
    for (std::size_t d = 0; d < 4; ++d) {
      const double in = inflow(n, d);
      const FlowFace& face = net_.faces[n][d];
      if (in < 0) {
        diagonal_ += give(n, d, -in, -1);
      } else if (face.node < 0) {
        // On the line through outline and middle, which may be continued beyond the outline: the
        // cell is taken for a whole one, whatever the outline cuts off.
        const double own = 1 - 0.5 / face.theta;
        diagonal_ -= in * own;
        outline_ += in * (1 - own);
      } else if (in > 0) {
        take_from(face.node, d, in);
      }
    }
  }

  /// Dose that flows from a neighbour in direction `d` into the node in hand.
  void take_from(int node, std::size_t d, double flow) {
    const bool part = node < static_cast<int>(net_.parts());
    take(node, part ? give(static_cast<std::size_t>(node), d ^ 1, flow, 1) : flow);
  }

  void collect_voids() {
    of_void_.resize(net_.nodes() - net_.parts());
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      for (std::size_t d = 0; d < 4; ++d) {
        const int to = net_.faces[n][d].node;
        if (to >= static_cast<int>(net_.parts())) {
          of_void_[static_cast<std::size_t>(to) - net_.parts()].emplace_back(n, d);
        }
      }
    }
  }

  void add_void(std::size_t v) {
    outline_ += net_.leak[v - net_.parts()] * phi_[v] * per_phi_;
    for (const auto& [n, d] : of_void_[v - net_.parts()]) {
      const double out = inflow(n, d);
      if (out > 0) {
        diagonal_ += out;
      } else if (out < 0) {
        take(static_cast<int>(n), give(n, d, -out, 1));
      }
    }
  }

  const FlowNet& net_;
  std::span<const double> phi_;
  double per_phi_;
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> of_void_;
  std::map<int, double> parts_;  ///< of the node in hand
  double diagonal_ = 0, outline_ = 0;
};

}  // namespace

FlowRows make_rows(const FlowNet& net, std::span<const double> phi, double cell_um2) {
  return RowMaker(net, phi, cell_um2).make();
}

FlowPath::FlowPath(const FlowSection& section, const GapPressure& pressure,
                   std::span<const double> gap_um) {
  if (pressure.phi_um2.size() != section.size()) {
    throw InputError("section", "pressure",
                     fmt::format("{} numbers for {} x {} cells", pressure.phi_um2.size(),
                                 section.width, section.height));
  }
  if ((pressure.gap_um > 0) == gap_um.empty()) {
    throw InputError("section", "gap_um", "is not that which the pressure was solved with");
  }
  std::vector<double> mobility;
  for (const double gap : gap_um) mobility.push_back(cube(gap / pressure.gap_um));
  net = make_net(section, mobility);
  std::vector<double> phi(net.nodes(), 0.0);
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (net.node_of[i] >= 0) phi[static_cast<std::size_t>(net.node_of[i])] = pressure.phi_um2[i];
  }
  rows = make_rows(net, phi, section.cell_um2());
}

}  // namespace slicecorr::detail
