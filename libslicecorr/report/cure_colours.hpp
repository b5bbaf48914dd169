// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The colours of what prints, in pictures of sections.
#pragma once

#include "picture/canvas.hpp"

namespace slicecorr::detail {

inline constexpr Colour kEmpty{255, 255, 255}, kRight{128, 134, 140}, kCureThrough{214, 48, 49},
    kUndercure{38, 103, 214}, kGreyPrinted{176, 182, 188}, kGreyEmpty{228, 232, 236};

}  // namespace slicecorr::detail
