// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any text as a table of measurements, for clang's fuzzer: read or refused with an `InputError` that names
// the file. What is read is finite and above 0 where it has to be.
#include "slicecorr/resins/measurements.hpp"

#include <cmath>

#include "fuzz.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  resins::Measurements read;
  const std::string source = "some.csv";
  if (!fuzz::read_or_refuse(
          [&] { read = resins::parse_measurements(fuzz::text_of(data, size), source); }, source)) {
    return 0;
  }
  const auto above = [](double x) {
    if (!(std::isfinite(x) && x > 0)) fuzz::fail("a number is not above 0");
  };
  const auto from = [](double x) {
    if (!(std::isfinite(x) && x >= 0)) fuzz::fail("a number is not 0 or more");
  };
  for (const resins::CuredHeight& c : read.cured) {
    above(c.dose_mj_cm2);
    above(c.height_um);
    for (const double x : {c.blue_mw_cm2, c.exposure_s, c.sigma_um}) from(x);
  }
  for (const resins::DeadZone& z : read.dead_zones) {
    for (const double x : {z.blue_mw_cm2, z.uv_mw_cm2, z.exposure_s}) above(x);
    for (const double x : {z.dead_zone_um, z.sigma_um}) from(x);
  }
  if (read.cured.empty() && read.dead_zones.empty()) fuzz::fail("a table without rows is read");
  return 0;
}
