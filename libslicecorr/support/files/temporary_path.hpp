// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file temporary_path.hpp
/// Names of temporary files, for who makes the file itself.
#pragma once

#include <string>

namespace slicecorr::detail {

/// A name beside `path` that this process has not given before, as `make_temporary` gives them (temporary.hpp); nothing
/// is made there, and nothing removed. What has this name goes with the next run of any program in that folder when this
/// process is no more.
std::string temporary_path(const std::string& path);

}  // namespace slicecorr::detail
