// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Images in a folder or a zip, one for each angle.
#pragma once

#include <vector>

#include "stack/container/container.hpp"

namespace slicecorr::tomo::detail {

/// The PNG images in the natural order of their names. Throws `InputError` for two with the same number.
std::vector<const slicecorr::detail::Container::Entry*> images_in(
    const slicecorr::detail::Container& archive);

}  // namespace slicecorr::tomo::detail
