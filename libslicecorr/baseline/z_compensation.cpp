// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "baseline/z_compensation.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace slicecorr::detail {

CodedBand compensated_by_one(const CodedBand& slices) {
  CodedBand made(slices.columns());
  std::vector<std::uint8_t> before(slices.columns()), here(slices.columns());
  for (int n = 0; n < slices.slices(); ++n) {
    if (n > 1 && slices.same(n, n - 1) && slices.same(n - 1, n - 2)) {
      made.append_again();
      continue;
    }
    if (slices.black(n) || (n > 0 && slices.black(n - 1))) {
      made.append(nullptr);
      continue;
    }
    slices.read(n, here.data());
    if (n > 0) {
      slices.read(n - 1, before.data());
      std::transform(here.begin(), here.end(), before.begin(), here.begin(),
                     [](std::uint8_t a, std::uint8_t b) { return std::min(a, b); });
    }
    made.append(here.data());
  }
  return made;
}

CodedBand compensated(CodedBand slices, int layers) {
  // Beyond the first slice there is nothing more to lose.
  for (int k = 0; k < std::min(layers, slices.slices()); ++k) slices = compensated_by_one(slices);
  return slices;
}

}  // namespace slicecorr::detail
