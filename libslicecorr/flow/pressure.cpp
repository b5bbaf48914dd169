// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Suction in the gap: one linear solve per section.
#include <fmt/format.h>

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <cmath>

#include "net.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_section.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using Matrix = Eigen::SparseMatrix<double>;

/// Phi is met to this share of the right-hand side's norm; dose follows its slopes.
constexpr double kResidual = 1e-12;

Matrix matrix_of(const detail::FlowNet& net) {
  std::vector<Eigen::Triplet<double>> parts;
  parts.reserve(net.nodes() * 3);
  std::vector<double> diagonal(net.nodes(), 0.0);
  for (std::size_t n = 0; n < net.parts(); ++n) {
    for (const detail::FlowFace& face : net.faces[n]) {
      diagonal[n] += face.conductance;
      const auto to = static_cast<std::size_t>(face.node);
      if (face.node < 0) continue;
      if (to >= net.parts()) {
        // A void has no faces of its own: its side is added from here.
        diagonal[to] += face.conductance;
        parts.emplace_back(face.node, static_cast<int>(n), -face.conductance);
      } else if (to < n) {
        parts.emplace_back(static_cast<int>(n), face.node, -face.conductance);
      }
    }
  }
  for (std::size_t v = 0; v < net.leak.size(); ++v) diagonal[net.parts() + v] += net.leak[v];
  for (std::size_t n = 0; n < net.nodes(); ++n) {
    parts.emplace_back(static_cast<int>(n), static_cast<int>(n), diagonal[n]);
  }
  const auto size = static_cast<Eigen::Index>(net.nodes());
  Matrix matrix(size, size);
  matrix.setFromTriplets(parts.begin(), parts.end());
  return matrix;
}

GapPressure solve(const FlowSection& section, std::span<const double> mobility,
                  const ExecutionContext& context) {
  context.check_cancelled();
  const detail::FlowNet net = detail::make_net(section, mobility);
  const Matrix matrix = matrix_of(net);
  Eigen::VectorXd source(static_cast<Eigen::Index>(net.nodes()));
  for (std::size_t n = 0; n < net.nodes(); ++n) {
    source[static_cast<Eigen::Index>(n)] = 12 * section.cell_um2() * net.area[n];
  }
  Eigen::ConjugateGradient<Matrix, Eigen::Lower, Eigen::IncompleteCholesky<double>> solver;
  solver.setTolerance(kResidual);
  solver.setMaxIterations(static_cast<Eigen::Index>(20 * std::sqrt(net.nodes()) + 2000));
  solver.compute(matrix);
  const Eigen::VectorXd phi = solver.solve(source);
  if (solver.info() != Eigen::Success || !phi.allFinite()) {
    throw InputError("section", "gap_um",
                     fmt::format("the suction is not found to {} in {} iterations; expected gaps "
                                 "that differ less",
                                 kResidual, solver.iterations()));
  }
  GapPressure answer;
  answer.phi_um2.assign(section.size(), 0.0);
  answer.iterations = static_cast<int>(solver.iterations());
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (net.node_of[i] < 0) continue;
    const double here = phi[net.node_of[i]];
    answer.phi_um2[i] = here;
    answer.integral_um4 += here * section.cell_um2();
    if (here > answer.max_phi_um2) {
      answer.max_phi_um2 = here;
      answer.max_x = static_cast<int>(i % static_cast<std::size_t>(section.width));
      answer.max_y = static_cast<int>(i / static_cast<std::size_t>(section.width));
    }
  }
  return answer;
}

double positive(double value, const char* what) {
  if (std::isfinite(value) && value > 0) return value;
  throw InputError("flow", what, fmt::format("{}; expected more than 0", value));
}

/// mu S / h³, Pa/um²; with Phi in um² and h in um that is mu S (1e-6 m)² / (1e-6 m)³.
double pa_per_um2(double viscosity_pa_s, double speed_mm_h, double gap_um) {
  const double um_s = 1e4 * units::cm_s_from_mm_h(positive(speed_mm_h, "speed_mm_h"));
  const double h = positive(gap_um, "gap_um");
  return positive(viscosity_pa_s, "viscosity_pa_s") * um_s / (h * h * h);
}

}  // namespace

GapPressure solve_pressure(const FlowSection& section, const ExecutionContext& context) {
  check_section(section);
  return solve(section, {}, context);
}

GapPressure solve_pressure(const FlowSection& section, std::span<const double> gap_um,
                           double reference_gap_um, const ExecutionContext& context) {
  check_section(section);
  positive(reference_gap_um, "reference_gap_um");
  if (gap_um.size() != section.size()) {
    throw InputError(
        "section", "gap_um",
        fmt::format("{} numbers for {} x {} cells", gap_um.size(), section.width, section.height));
  }
  std::vector<double> mobility(section.size(), 0.0);
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    const double share = positive(gap_um[i], "gap_um") / reference_gap_um;
    mobility[i] = share * share * share;
  }
  GapPressure answer = solve(section, mobility, context);
  answer.gap_um = reference_gap_um;
  return answer;
}

double suction_pa(double phi_um2, double viscosity_pa_s, double speed_mm_h, double gap_um) {
  return phi_um2 * pa_per_um2(viscosity_pa_s, speed_mm_h, gap_um);
}

double suction_force_n(double integral_um4, double viscosity_pa_s, double speed_mm_h,
                       double gap_um) {
  return integral_um4 * 1e-12 * pa_per_um2(viscosity_pa_s, speed_mm_h, gap_um);
}

double suction_speed_limit_mm_h(double max_phi_um2, double viscosity_pa_s, double gap_um,
                                double limit_pa) {
  return positive(limit_pa, "suction_limit_pa") /
         (positive(max_phi_um2, "max_phi_um2") * pa_per_um2(viscosity_pa_s, 1, gap_um));
}

std::vector<double> share_in(const FlowSection& section, const GapPressure& pressure,
                             std::span<const double> gap_um) {
  check_section(section);
  const detail::FlowPath path(section, pressure, gap_um);
  // With dG/dtau = -G, G = 1 where resin enters, and div Q = -S: div(Q G) = -2 S G.
  std::vector<double> share(path.net.nodes(), 0.0), answer(section.size(), 0.0);
  for (const int node : path.rows.order) {
    const auto n = static_cast<std::size_t>(node);
    double sum = path.rows.outline[n];
    for (std::size_t k = path.rows.begin[n]; k < path.rows.begin[n + 1]; ++k) {
      sum += path.rows.weight[k] * share[static_cast<std::size_t>(path.rows.from[k])];
    }
    share[n] = sum / (path.rows.diagonal[n] + 2 * path.net.area[n]);
  }
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (path.net.node_of[i] >= 0) answer[i] = share[static_cast<std::size_t>(path.net.node_of[i])];
  }
  return answer;
}

}  // namespace slicecorr
