// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_section.hpp
/// Resin in the thin gap under one slice of any shape (dissertation chapter IV in the limit of a thin
/// gap): the suction under the part, the dose that resin brings along to the front where it gels, and
/// the light that makes this dose even.
///
/// The part rises with the speed S and resin gels at its bottom, so the flow Q per width obeys
///
///     div(h³/(12 mu) grad p) = S on the section,  p = 0 on its outline.
///
/// With h even p = -(mu S/h³) Phi, lap Phi = -12, so that one solve of `solve_pressure` serves every
/// speed, viscosity and gap. Resin goes along the lines of Q, whatever its level q = z/h; with
/// tau counted along them, dx/dtau = Q/S, dose obeys
///
///     F'(q) dY/dtau + F dY/dq - (c/(S h)) d²Y/dq² = (h/S) a(x, h q),  a = Ib e^(-z/hb) - beta Iuv e^(-z/huv),
///
/// with Y = 0 where it enters and no flux of Y through window and front. Omega_f = Y(q = 1)/D'c is the
/// front's dose, Omega_w = Y(q = 0)/D'c the window's. Y < 0 is inhibitor in store: it lasts for the life
/// tau_z of `FlowResin::inhibitor_life_s` (dY/dt = a - Y/tau_z while Y < 0). Infinite is the law of
/// chapter IV, and linear in both lights; 0 is the clamp Y >= 0, which goes with c = 0.
///
/// Arrays of cells are row by row, row 0 the image's top, x to the right; what is said of "cells" has
/// width * height numbers, and numbers outside the section are neither read nor, in answers, other
/// than 0. Lights are at the window, mW/cm²; heights are base e.
///
/// Functions are pure, classes immutable once made, all thread-safe. Results are the same bits for
/// any number of threads. `InputError` for what does not fit, naming it; `InfeasibleError` where no
/// dead zone can last; `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/flow.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr {

// ---------------------------------------------------------------------------------- the section

enum class FlowCell : std::uint8_t {
  bath,   ///< open: p = 0
  part,   ///< gels: resin is drawn in at S
  blind,  ///< under an enclosed void that fills through the gap: drawn in at S, p even in it
};

/// One slice's mask on square or oblong cells. Cells beyond the border are bath.
struct FlowSection {
  int width = 0, height = 0;  ///< cells
  double pitch_x_um = 0, pitch_y_um = 0;
  std::vector<FlowCell> cells;
  /// Share of each cell that lies within the outline towards the bath, 0..1; cells of part have half
  /// and more, bath less. Empty: 1 in part and blind, 0 in bath, the outline runs along cells.
  /// With it round outlines are met to the second order.
  std::vector<float> coverage;
  /// Of blind cells, the void that they belong to, >= 0: cells of one void share p even where they do
  /// not touch. Empty: those that touch by edges.
  std::vector<std::int32_t> voids;

  std::size_t size() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
  double cell_um2() const { return pitch_x_um * pitch_y_um; }
};

/// A section without blind voids: part where half a cell and more is covered.
FlowSection section_of_coverage(int width, int height, double pitch_x_um, double pitch_y_um,
                                std::vector<float> coverage);
/// Throws `InputError`, `name` in front, unless sizes fit, pitches are finite and > 0, a cell is part
/// and no pitch is more than a third of the section.
void check_section(const FlowSection& section, const std::string& name = "section");
/// Distance of the middles of part and blind cells from the nearest outline towards the bath, um; 0 in
/// bath. The model does not hold nearer than about h.
std::vector<double> outline_distance_um(const FlowSection& section);
/// Gap that the flow feels where the dead zone is rough, um: the least over all cells of
/// gap + slope * distance. `gap_um`: cells.
std::vector<double> felt_gap_um(const FlowSection& section, std::span<const double> gap_um,
                                double slope = 0.7);

// ----------------------------------------------------------------------------------- pressure

struct GapPressure {
  std::vector<double> phi_um2;  ///< Phi, cells, >= 0
  double max_phi_um2 = 0;
  int max_x = 0, max_y = 0;  ///< the cell of it; of equal ones the first
  double integral_um4 = 0;   ///< of Phi over the section, voids among it
  double gap_um = 0;         ///< that Phi is relative to; 0: any, the gap is even
  int iterations = 0;        ///< of conjugate gradients
};

/// Phi of an even gap.
GapPressure solve_pressure(const FlowSection& section, const ExecutionContext& context = {});
/// Phi of a gap that varies: div((h/reference)³ grad Phi) = -12, p = -(mu S/reference³) Phi.
/// `gap_um`: cells, > 0 in part cells. Early slices under the platform are its footprint with
/// n hs + h where the part is not.
GapPressure solve_pressure(const FlowSection& section, std::span<const double> gap_um,
                           double reference_gap_um, const ExecutionContext& context = {});

/// Suction (mu S/h³) Phi, Pa, >= 0; `gap_um` that of the pressure where it varies.
double suction_pa(double phi_um2, double viscosity_pa_s, double speed_mm_h, double gap_um);
/// Force (mu S/h³) times the integral of Phi that holds the part down, N.
double suction_force_n(double integral_um4, double viscosity_pa_s, double speed_mm_h,
                       double gap_um);
/// Speed at which the greatest suction is `limit_pa`, mm/h: S_max = p_lim h³/(mu max Phi).
double suction_speed_limit_mm_h(double max_phi_um2, double viscosity_pa_s, double gap_um,
                                double limit_pa);

/// F of the level at which the resin came in that gels at a cell: F_in = e^-tau, cells; 1 in resin
/// that just came. With even light and gap the front's dose is one function of it. `gap_um`: cells, where
/// the pressure's gap varies.
std::vector<double> share_in(const FlowSection& section, const GapPressure& pressure,
                             std::span<const double> gap_um = {});

// --------------------------------------------------------------------------------- closed forms

/// Phi of shapes with an even gap, um²; places from the middle. Integrals in um⁴, of the strip in um³.
namespace flow_shapes {
double disc_phi_um2(double radius_um, double r_um);
double disc_integral_um4(double radius_um);
double strip_phi_um2(double half_width_um, double x_um);
double strip_integral_um3(double half_width_um);
double ellipse_phi_um2(double a_um, double b_um, double x_um, double y_um);
double ellipse_integral_um4(double a_um, double b_um);
double rectangle_max_phi_um2(double width_um, double length_um);
double rectangle_mean_phi_um2(double width_um, double length_um);
/// A ring whose hole is open to the bath, between `inner_um` and `outer_um`.
double ring_phi_um2(double inner_um, double outer_um, double r_um);
/// Where that is greatest.
double ring_peak_um(double inner_um, double outer_um);
/// Gap under the whole platform at which the part's own gap takes over: (R⁴ h³/Rp⁴)^(1/3).
double platform_changeover_um(double platform_radius_um, double part_radius_um, double gap_um);
}  // namespace flow_shapes

// ---------------------------------------------------------------------------------------- dose

struct SectionDose {
  std::vector<double> front;   ///< Omega_f, cells of part
  std::vector<double> window;  ///< Omega_w, cells of part; resin sticks to the window at 1
  /// Cells in which dose was undone: a < 0 where Y > 0, which the law takes for less dose.
  std::size_t undone_cells = 0;
};

/// Derivatives of a sum of doses by the light of cells.
struct SectionGradient {
  std::vector<double> blue, uv;
};

struct SweepOptions {
  int levels = 48;  ///< of q, 8..1000
};

/// Carries dose through the gap of a section: one pass over cells from the outline inwards.
/// Memory: about 30 numbers per cell and, where it is linear, 3 per cell and level.
class SectionSweep {
 public:
  /// `gap_um`: one number for an even gap, or cells; those which `pressure` was solved with, where it
  /// varies. Copies what it needs.
  SectionSweep(const FlowSection& section, const GapPressure& pressure, const FlowResin& resin,
               double speed_mm_h, std::span<const double> gap_um, const SweepOptions& options = {});
  ~SectionSweep();
  SectionSweep(SectionSweep&&) noexcept;

  /// Y signed without an end to its store, and m = 1: doses are linear in both lights.
  bool linear() const;
  /// `blue` and `uv`: one number for even light, or cells; >= 0.
  SectionDose dose(std::span<const double> blue_mw_cm2, std::span<const double> uv_mw_cm2) const;
  /// The transpose of `dose` where it is linear, `InputError` elsewhere: derivatives of
  /// sum(front_weight Omega_f) + sum(window_weight Omega_w). Weights: cells.
  SectionGradient adjoint(std::span<const double> front_weight,
                          std::span<const double> window_weight) const;
  /// The same at a light, for every law: of the pieces of the law that hold there.
  SectionGradient gradient(std::span<const double> blue_mw_cm2, std::span<const double> uv_mw_cm2,
                           std::span<const double> front_weight,
                           std::span<const double> window_weight) const;

  /// Y/D'c at every level of a cell, the window's first.
  std::vector<double> profile(std::span<const double> blue_mw_cm2,
                              std::span<const double> uv_mw_cm2, int x, int y) const;
  /// q of the levels' middles; they are finer towards the window.
  std::vector<double> level_q() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Doses of the part's cells weighed by their area.
struct DoseSummary {
  double min = 0, mean = 0, max = 0;
  double mean_square = 0;  ///< of Omega_f - 1
  double within_10 = 0;    ///< share within 0.9..1.1
  double max_window = 0;
};
/// `weight`: cells, >= 0, in place of their area; empty: area.
DoseSummary summarise(const FlowSection& section, const SectionDose& dose,
                      std::span<const double> weight = {});

// -------------------------------------------------------------------------------- optimisation

/// Which light may change from cell to cell.
enum class FlowPattern { constant, blue, uv, both };

/// What images show of the light that cells are asked for. Light is bilinear between the middles of
/// cells, so that a cell shows shares of its own light and of its eight neighbours'; pixels that go by
/// something else, grey ones of outlines and before edges, show light of their own.
struct ImageLight {
  /// Cells: the shares of what itself and its neighbours are asked for, row by row, the cell's own the
  /// fifth; 0..1, together at most 1.
  std::vector<std::array<float, 9>> shares;
  /// Cells: what is shown besides, whatever is asked for, in the mean over the cell; >= 0.
  std::vector<double> blue_mw_cm2, uv_mw_cm2;
  bool uv = false;  ///< UV light comes in images, too; else cells get what they are asked for
  /// What the cells of part show of this; 0 elsewhere.
  std::vector<double> of_blue(const FlowSection& section, const std::vector<double>& asked) const;
  std::vector<double> of_uv(const FlowSection& section, const std::vector<double>& asked) const;
};

struct SectionGoal {
  FlowPattern pattern = FlowPattern::both;
  /// Gaps that are tried, um; equal: that one.
  double min_gap_um = 10, max_gap_um = 300;
  double max_blue_mw_cm2 = 0, max_uv_mw_cm2 = 0;  ///< caps of the lamps, > 0
  double max_window = 0.98;                       ///< most of Omega_w, > 0
  /// Cells nearer than this many gaps to an outline do not count: 0, or 1 where 1 can't be had there.
  double leave_out_gaps = 0;
  /// What counts how much, cells, >= 0; empty: area. Weights 1/r are the dr of chapter IV.
  std::vector<double> weight = {};
  /// What images show of the light; null: cells show what they are asked for.
  std::shared_ptr<const ImageLight> image = nullptr;
  /// Roughness costs the mean of (smooth_um |grad I| / cap)² of each patterned light.
  double smooth_um = 40;
  /// Costs times ((Iuv - its mean)/cap)²: where both lights are free the middle's is undetermined.
  double uv_pull = 1e-4;
  int iterations = 150;  ///< of the last search, >= 1
  SweepOptions sweep = {};
};

struct SectionOptimum {
  double gap_um = 0;
  /// Cells, as they are asked for; outside the section as the nearest part.
  std::vector<double> blue_mw_cm2, uv_mw_cm2;
  SectionDose dose;     ///< of what is shown
  DoseSummary summary;  ///< over all that counts
  bool blue_at_cap = false, uv_at_cap = false;
  bool gap_at_limit = false;  ///< the best gap is an end of the range
  int iterations = 0;
};

/// The light of least mean (Omega_f - 1)² with Omega_w <= max_window: for each gap a convex problem,
/// where the sweep is linear; the gap itself is scanned, then refined. Sets out from the best constant
/// light. Gaps run on the context's threads.
SectionOptimum optimise_section(const FlowSection& section, const GapPressure& pressure,
                                const FlowResin& resin, double speed_mm_h, const SectionGoal& goal,
                                const ExecutionContext& context = {});

}  // namespace slicecorr
