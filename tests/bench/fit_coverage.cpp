// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints the coverage table of docs/fits.md: how often intervals of fits hold the true parameter,
// over 500 seeded runs of each experiment of the dissertation.
#include <fmt/format.h>

#include "fit_designs.hpp"

int main() {
  using namespace slicecorr;
  constexpr int runs = 500;
  fmt::print(
      "| model | resin | R² | parameter | true | mean of fits | mean standard error | in its "
      "interval |\n|---|---|---|---|---|---|---|---|\n");
  for (const test::Design& design : test::published_designs()) {
    const test::CoverageOf c = test::measure_coverage(design, runs);
    for (const auto& [name, value] : design.truth) {
      const test::Seen& seen = c.parameters.at(name);
      fmt::print("| {} | {} | {:.3f} | {} | {:.4g} | {:.4g} | {:.2g} | {:.1f} % |\n",
                 resins::name_of(design.model), design.name, c.mean_r2, name, value,
                 seen.mean_value, seen.mean_stderr, 100 * seen.share);
    }
  }
}
