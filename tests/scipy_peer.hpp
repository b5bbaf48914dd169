// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file scipy_peer.hpp
/// Runs tests/curve_fit.py: least squares by scipy, for tests and the benchmark.
#pragma once

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "fit_designs.hpp"
#include "run_program.hpp"

namespace slicecorr::test {

/// Debian's interpreter: the one that its package python3-scipy serves.
inline constexpr const char* kPython = "/usr/bin/python3";

inline bool have_scipy() {
  return run_program({"/bin/sh", "-c", std::string(kPython) + " -c 'import scipy.optimize' 2>&1"})
             .exit_code == 0;
}

/// A fit for scipy. It starts a few percent off the truth, or off `near`.
inline nlohmann::json scipy_task(resins::FitModel model, const resins::Measurements& data,
                                 const resins::FitOptions& options, const std::vector<double>& near,
                                 int repeat) {
  nlohmann::json task;
  task["model"] = std::string(resins::name_of(model));
  for (const char* column : {"dose", "blue", "uv", "time", "height_um"}) {
    task[column] = nlohmann::json::array();
  }
  const auto add = [&](double dose, double blue, double uv, double time, double height) {
    task["dose"].push_back(dose);
    task["blue"].push_back(blue);
    task["uv"].push_back(uv);
    task["time"].push_back(time);
    task["height_um"].push_back(height);
  };
  for (const auto& c : data.cured) {
    add(c.dose_mj_cm2, c.blue_mw_cm2, 0, c.exposure_s, c.height_um);
  }
  for (const auto& z : data.dead_zones) {
    add(0, z.blue_mw_cm2, z.uv_mw_cm2, z.exposure_s, z.dead_zone_um);
  }
  task["hb_um"] = options.hb_um;
  task["critical_dose_prime"] = options.critical_dose_prime;
  task["start"] = near;
  for (auto& value : task["start"]) value = 1.04 * value.get<double>();
  task["repeat"] = repeat;
  return task;
}

/// The results of tests/curve_fit.py; `source` is the project's folder, `scratch` one to write to.
inline nlohmann::json run_scipy(const nlohmann::json& tasks, const std::string& source,
                                const std::string& scratch) {
  const std::string input = scratch + "/tasks.json";
  std::ofstream(input) << tasks.dump();
  RunOptions options;
  // Numerical libraries must not use more threads than we do.
  options.environment = {{"OMP_NUM_THREADS", "1"}, {"OPENBLAS_NUM_THREADS", "1"}};
  const RunResult r =
      run_program({"/bin/sh", "-c",
                   std::string(kPython) + " '" + source + "/tests/curve_fit.py' < '" + input + "'"},
                  options);
  if (r.exit_code != 0) throw std::runtime_error("curve_fit.py failed: " + r.err);
  return nlohmann::json::parse(r.out);
}

}  // namespace slicecorr::test
