// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chemistry_pattern.hpp
/// The full equations of chemistry.hpp in the plane: what an image of light makes of a film of resin,
/// cell by cell, with everything that diffuses between cells.
///
/// Each step is one of reaction between two halves of diffusion (Strang). Diffusion is the exact
/// solution of its equation on the cells, with second differences of fourth order; reactions are
/// implicit to second order (chemistry/reaction_kernels.hpp). Plain values and functions,
/// thread-safe; results do not depend on the number of threads. Errors are `InputError` for what does
/// not fit, `InfeasibleError` for what never gels, `Cancelled`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/chemistry.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr {

/// An image of light: shares of the greatest intensity, 0..1, row by row.
struct LightPattern {
  int width = 0, height = 0;  ///< cells, >= 1
  std::vector<float> share;
  float at(int x, int y) const {
    return share[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)];
  }
};
/// Of 8-bit grey, row by row, each pixel as `refine` x `refine` cells.
LightPattern pattern_of_grey(int width_px, int height_px, const std::vector<std::uint8_t>& grey,
                             int refine = 1);

/// What is at the sides of the image: the image again, as in a mask, or walls.
enum class Sides { periodic, walls };

struct PatternSetup {
  double cell_um = 0;           ///< side of a cell, > 0
  double intensity_mw_cm2 = 0;  ///< of a share of 1, > 0
  double light_s = 0;           ///< how long it is on, > 0
  double dark_s = 0;            ///< how long resin is watched after that, >= 0
  Sides sides = Sides::periodic;
  double spread_um = 0;  ///< sigma of light that spreads like a Gaussian, >= 0
  /// Thickness of the film: it is cured by the mean of the light in it. 0: as thin as needs be.
  double film_um = 0;
  /// Initiator that has broken lets light pass, so that a film gets the more light the longer it is lit: the
  /// mean is that of the initiator that a cell has left. All that is broken in a film is then exact.
  bool bleaches = false;
  double supply_per_s = 0;  ///< ks: oxygen comes from outside at ks (O(0) - O), >= 0
  double step_s = 0;        ///< 0: as `step_of` says
};

/// Longest step that diffusion allows, dx² / 4D, and the one that is taken: this, or what resolves the
/// time to gel (150 steps) and the rise of chains (three), if that is less.
double longest_step_s(const Chemistry& c, const PatternSetup& setup);
double step_of(const Chemistry& c, const PatternSetup& setup);
/// What `run_pattern` needs, bytes.
std::size_t pattern_bytes(int width, int height, const Chemistry& c);
/// Cells across the thinnest lit part of the image, by rows and columns; 0 where nothing is lit.
int thinnest_cells(const LightPattern& pattern, Sides sides);

struct PatternRun {
  int width = 0, height = 0;
  /// When each cell had gelled, s from the start; infinite where it had not.
  std::vector<double> gel_time_s;
  /// At the end: oxygen over that at the start, and end groups used up, both 0..1.
  std::vector<float> oxygen_left, used_up;
  double step_s = 0;
  std::size_t steps = 0;
  /// Light that counted in each cell, mW/cm²: spread, and the mean over the film.
  std::vector<float> intensity_mw_cm2;
  /// By how much P0 + P1 + P2 + P3 came to differ in a cell, over P0(0); and oxygen with what it killed
  /// in all cells, over all oxygen (0 where other things take it or it comes from outside).
  double balance_error = 0, oxygen_balance_error = 0;
  double gel_time_at(int x, int y) const {
    return gel_time_s[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                      static_cast<std::size_t>(x)];
  }
};
/// Progress is reported as "reacting".
PatternRun run_pattern(const Chemistry& c, const LightPattern& pattern, const PatternSetup& setup,
                       const ExecutionContext& context = {});

/// How a pattern gels against what it is meant to be.
struct Overlap {
  double time_s = 0;
  /// Cells that are both gelled and meant to be over those that are either.
  double jaccard = 0;
};
/// At each of `count` times, evenly from 0 to `end_s`; a cell is meant to gel where the target has at
/// least half of the light.
std::vector<Overlap> overlap_over_time(const PatternRun& run, const LightPattern& target,
                                       double end_s, int count = 200);
/// The best over all times.
Overlap best_overlap(const PatternRun& run, const LightPattern& target);

/// Figures of a run: what gelled, when, and what gelled in the dark.
struct PatternFigures {
  std::size_t lit = 0, gelled = 0, lit_gelled = 0;
  /// Cells with less than half of the light that had gelled together with what is lit: by the time at
  /// which the last lit one that gels had gelled, and at the end.
  std::size_t dark_gelled = 0, dark_gelled_at_end = 0;
  double first_s = 0, last_lit_s = 0;  ///< of lit cells that gelled; 0 where none did
};
PatternFigures figures_of(const PatternRun& run, const LightPattern& target);

/// How an image is made with which all that is meant to gel uses up its oxygen at the same time.
struct PatternCorrection {
  /// T, by when oxygen is used up in the whole target; 0: a quarter more than full light needs, but no
  /// longer than the light is on.
  double used_up_by_s = 0;
  /// Share of its oxygen that everything else keeps at least until T, 0..1.
  double margin = 0.15;
  int steps = 500;  ///< of the search, >= 1
};

struct CorrectedPattern {
  LightPattern light;  ///< in steps of 1/255
  double used_up_by_s = 0;
  /// Oxygen used up by T over that at the start, as long as nobody runs out: the least in the target and
  /// the most outside of it.
  double least_inside = 0, most_outside = 0;
};

/// Finds light i(x, y) in 0..1 of the intensity that uses up the oxygen of the target all at once and
/// nobody else's. Until then consumption is linear, O = O(0) - K_T * i, with the transform of K_T being
/// Ri(1) (1 - exp(-D k² T)) / (D k²): the light minimises the squares of u - 1 in the target and of
/// max(0, u - (1 - margin)) elsewhere, u = K_T * G * i / O(0) with G the spread of light. Cells of the
/// target are those with at least half of the light. Throws `InfeasibleError` with the least time or
/// intensity that would do where full light does not use up oxygen by T, or something else gels.
/// Progress is reported as "finding light".
CorrectedPattern correct_pattern(const Chemistry& c, const LightPattern& target,
                                 const PatternSetup& setup, const PatternCorrection& correction,
                                 const ExecutionContext& context = {});

}  // namespace slicecorr
