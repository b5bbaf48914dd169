// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Small files of a printer and of a resin, and ways to spoil them.
#pragma once

#include <gtest/gtest.h>

#include <ostream>
#include <string>

namespace slicecorr::test {

inline const std::string kPrinter = R"(# a printer
name = "dlp-1"
[display]
width_px = 1280
height_px = 800
pixel_um = 50.0
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 100
)";

inline const std::string kResin = R"(# a resin
name = "r-1"
[cure]
model = "jacobs"
m = 1.0
absorbance_height_um = 2000.0
absorbance_base = 10
critical_dose_mj_cm3 = 576.0
[provenance]
source = "somewhere"
)";

/// A text in which one line is replaced; nothing when it is not there.
inline std::string with(std::string text, const std::string& line, const std::string& replacement) {
  const std::size_t at = text.find("\n" + line + "\n");
  EXPECT_NE(at, std::string::npos) << line;
  if (at != std::string::npos) text.replace(at + 1, line.size(), replacement);
  return text;
}

struct Wrong {
  const char* name;
  const char* line;         ///< that is replaced
  const char* replacement;  ///< by this
  const char* place;        ///< what the message must say: line and key
  const char* reason;       ///< and this
};

inline void PrintTo(const Wrong& w, std::ostream* out) { *out << w.name; }
inline std::string wrong_name(const testing::TestParamInfo<Wrong>& info) { return info.param.name; }

inline constexpr char kCalibrationLine[] = "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]";

}  // namespace slicecorr::test
