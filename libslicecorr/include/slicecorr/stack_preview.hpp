// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file stack_preview.hpp
/// The small picture of the part that most archives have for people to choose by.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace slicecorr {

/// Largest picture that is given, bytes and px of a side.
inline constexpr std::size_t kMostPreviewBytes = std::size_t{4} << 20;
inline constexpr std::uint32_t kMostPreviewPx = 4096;

/// The picture in an archive, ours or of other programs, as PNG: of zips their own entry as it is, of
/// CTB's kind and GOO in grey. Empty where there is none, or none within the bounds. Only its head is
/// checked: who decodes it treats it as foreign. Thread-safe. Throws `InputError` for what is no archive.
std::vector<std::uint8_t> preview_png(const std::string& path);

/// Whether these are the bytes of a PNG within the bounds, by its head.
bool is_preview_png(const std::vector<std::uint8_t>& bytes);

}  // namespace slicecorr
