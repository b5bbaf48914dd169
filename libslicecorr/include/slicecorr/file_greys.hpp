// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file file_greys.hpp
/// Which grey values archives hold. Thread-safe.
#pragma once

#include <array>
#include <cstdint>

#include "slicecorr/grid.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {

/// What becomes of a grey value 0..255 in an archive: a pixel v comes back as `FileGreys[v]`, which
/// comes back as itself.
using FileGreys = std::array<std::uint8_t, 256>;

/// That of the archive that would be written for images of such a grid: of `file.keep_from` where one
/// is changed, else of a new one. Archives of images hold all values; print files may hold fewer
/// (docs/print-files.md); all are given where a new one would be refused. Throws `InputError` where
/// the archive that is changed can't be read.
FileGreys greys_of_file(const StackFile& file, const Grid& grid);

}  // namespace slicecorr
