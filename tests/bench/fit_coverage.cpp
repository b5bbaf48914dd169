// Prints the coverage table of docs/fits.md: how often intervals of fits hold the true parameter,
// over 500 seeded runs of each experiment of the dissertation.
#include <fmt/format.h>

#include <cstdlib>

#include "fit_designs.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr;
  const int runs = argc > 1 ? std::atoi(argv[1]) : 500;
  fmt::print(
      "| model | resin | R² | parameter | true | mean of fits | mean standard error | coverage "
      "|\n");
  fmt::print("|---|---|---|---|---|---|---|---|\n");
  for (const test::Design& design : test::published_designs()) {
    const test::Coverage c = test::measure_coverage(design, runs);
    for (const auto& [name, value] : design.truth) {
      fmt::print("| {} | {} | {:.3f} | {} | {:.4g} | {:.4g} | {:.2g} | {:.1f} % |\n",
                 resins::name_of(design.model), design.name, c.mean_r2, name, value,
                 c.mean_value.at(name), c.mean_stderr.at(name), 100 * c.share.at(name));
    }
  }
}
