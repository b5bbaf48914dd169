// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which slicefarm a test runs.
#pragma once

#include <map>
#include <string>

namespace slicecorr::test {

inline const std::string kSlicefarm = SLICECORR_BIN_DIR "/slicefarm";

/// The one that is shipped; where the environment asks for a fault, the one that has faults
/// (farm_faults.cpp).
inline std::string slicefarm_for(const std::map<std::string, std::string>& environment) {
  const bool faulty = environment.contains("SLICEFARM_TEST_FAULT") ||
                      environment.contains("SLICEFARM_TEST_SERVICE_FAULT");
  return faulty ? SLICECORR_FAULTY_SLICEFARM : kSlicefarm;
}

}  // namespace slicecorr::test
