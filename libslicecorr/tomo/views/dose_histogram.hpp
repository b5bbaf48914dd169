// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How much light or dose the part has, and what is beside it: the same picture for vials and still beams.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace slicecorr::tomo::detail {

/// Places of part and outside by what they have, in bins of the same width from 0 to `most`.
class DoseHistogram {
 public:
  /// `greatest`: of all values and of `gels`, above which resin gels.
  DoseHistogram(double greatest, double gels);
  void add(double value, bool part);
  struct Words {
    std::string title, text, axis, counted, outside, note;
  };
  std::string svg(const Words& words) const;

 private:
  static constexpr std::size_t kBins = 80;
  double most_, gels_;
  std::array<std::vector<double>, 2> bins_;  ///< outside, part
};

}  // namespace slicecorr::tomo::detail
