// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whole texts of files.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace slicecorr {

/// No definition, table or list of jobs is larger; what is named as one may be.
inline constexpr std::size_t kMostTextBytes = std::size_t{256} << 20;

/// The whole text of an ordinary file. Throws `InputError` when there is none, it can't be read, or
/// has more than `most_bytes`.
std::string read_text_file(const std::string& path, std::size_t most_bytes = kMostTextBytes);
/// The same where a file that can't be read counts as none.
std::optional<std::string> text_of_file(const std::string& path,
                                        std::size_t most_bytes = kMostTextBytes);

}  // namespace slicecorr
