// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints how long fits take beside scipy's curve_fit on the same measurements, in one run: the
// table of docs/fits.md. Without scipy, our times alone.
#include <fmt/format.h>
#include <stdlib.h>

#include <chrono>
#include <filesystem>
#include <limits>

#include "scipy_peer.hpp"

namespace {

using namespace slicecorr;

/// Fastest of several runs, s.
template <typename Body>
double fastest(int repeats, Body&& body) {
  double seconds = std::numeric_limits<double>::infinity();
  for (int i = 0; i < repeats; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    body();
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    seconds = std::min(seconds, taken.count());
  }
  return seconds;
}

}  // namespace

int main() {
  constexpr int repeats = 300;
  const bool scipy = test::have_scipy();
  nlohmann::json tasks = nlohmann::json::array();
  std::vector<test::Design> designs;
  std::vector<double> ours;
  for (const test::Design& d : test::published_designs()) {
    if (!designs.empty() && d.model == designs.back().model) continue;
    const resins::Measurements data = test::with_scatter(d, 1);
    resins::FitResult result;
    ours.push_back(fastest(repeats, [&] { result = resins::fit(data, d.model, d.options); }));
    designs.push_back(d);
    if (d.model == resins::FitModel::joint) continue;
    std::vector<double> near;
    for (const auto& p : result.parameters) near.push_back(p.value);
    tasks.push_back(test::scipy_task(d.model, data, d.options, near, repeats));
  }
  nlohmann::json theirs;
  if (scipy) {
    std::string scratch =
        (std::filesystem::temp_directory_path() / "slicecorr-fit-speed.XXXXXX").string();
    if (!::mkdtemp(scratch.data())) return 1;
    theirs = test::run_scipy(tasks, SLICECORR_SOURCE_DIR, scratch);
    std::filesystem::remove_all(scratch);
  }
  fmt::print("| model | measurements | ours | curve_fit | ratio |\n|---|---|---|---|---|\n");
  for (std::size_t i = 0; i < designs.size(); ++i) {
    const auto& d = designs[i];
    std::string peer = "not done | ";
    if (i < theirs.size()) {
      const double seconds = theirs[i]["seconds"].get<double>();
      peer = fmt::format("{:.2f} ms | {:.1f}", 1e3 * seconds, seconds / ours[i]);
    }
    fmt::print("| {} | {} | {:.3f} ms | {} |\n", resins::name_of(d.model),
               d.exact.cured.size() + d.exact.dead_zones.size(), 1e3 * ours[i], peer);
  }
  test::Design d = test::kinetic_design("", 67, 168, 0.99, 0.983);
  std::erase_if(d.exact.cured, [](const auto& c) { return c.exposure_s * c.blue_mw_cm2 < 150; });
  const resins::Measurements some = test::with_scatter(d, 1);
  d.options.bootstrap = 1000;
  const double resampled = fastest(5, [&] { resins::fit(some, d.model, d.options); });
  fmt::print("\nKinetic fit of {} measurements with 1000 resamplings: {:.0f} ms.\n",
             some.cured.size(), 1e3 * resampled);
}
