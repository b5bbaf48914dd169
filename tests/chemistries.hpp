// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Chemistries of the database that several tests share.
#pragma once

#include <string>

#include "slicecorr/chemistry.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::test {

inline Chemistry chemistry_of(const char* name) {
  return *load_resin(std::string(SLICECORR_DB_DIR "/") + name + ".toml").chemistry;
}
inline const Chemistry& hydrogel() {
  static const Chemistry c = chemistry_of("model-hydrogel");
  return c;
}
inline const Chemistry& diacrylate() {
  static const Chemistry c = chemistry_of("model-diacrylate");
  return c;
}

}  // namespace slicecorr::test
