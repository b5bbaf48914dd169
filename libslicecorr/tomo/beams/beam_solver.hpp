// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Grey images of beams, by the ladder of tomographic printing.
#pragma once

#include <array>
#include <limits>
#include <vector>

#include "slicecorr/tomo/beams.hpp"

namespace slicecorr::tomo::detail {

struct GreyImages {
  std::vector<BeamImage> images;
  double contrast_bound = std::numeric_limits<double>::infinity();
  /// As `BeamPrint` says; where hardly any contrast was found.
  std::vector<std::array<int, 3>> in_the_way;
};

/// `start`: silhouettes.
GreyImages grey_images(const Box<std::uint8_t>& part, const BeamSetup& setup,
                       std::vector<BeamImage> start, const ExecutionContext& context);

double bytes_of_grey(const Box<std::uint8_t>& part, const BeamSetup& setup);

}  // namespace slicecorr::tomo::detail
