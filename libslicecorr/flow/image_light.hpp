// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What images show of the light that cells are asked for, and back.
#pragma once

#include <vector>

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// Cells whose light some cell of part shows, rising: those of part where `image` is null.
std::vector<std::size_t> asked_cells(const FlowSection& section, const ImageLight* image);
/// The light of cells without what they show by themselves. `image` null: what is asked for.
std::vector<double> followed(const FlowSection& section, const ImageLight* image,
                             std::vector<double> asked);
/// The transpose: derivatives by the light that is asked for, from those by light that is shown.
std::vector<double> by_asked(const FlowSection& section, const ImageLight* image,
                             std::vector<double> by_shown);
/// On cells coarser by `factor`, which show a share of their own light alone.
ImageLight coarser_image(const FlowSection& fine, const FlowSection& coarse, int factor,
                         const ImageLight& image);
/// Throws `InputError` unless an image has numbers for each cell of a section, within their ranges.
void check_image(const FlowSection& section, const ImageLight& image);

}  // namespace slicecorr::detail
