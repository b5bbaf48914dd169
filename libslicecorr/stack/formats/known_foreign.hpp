// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file known_foreign.hpp
/// Print files that are known and can't be read as a stack of slices: refused with their names and
/// with what can be read instead.
#pragma once

#include <string>

#include "stack/container/container.hpp"

namespace slicecorr::detail {

/// Throws `InputError` when the archive is one that is made of more than one image per layer.
void refuse_known_foreign(const Container& archive);

/// Throws `InputError` when the file is one of the binary print files of LCD printers, by its first
/// bytes, or by its name where these say nothing. Files that can't be read pass.
void refuse_known_file(const std::string& path);

}  // namespace slicecorr::detail
