// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file lasting_folder.hpp
/// Folders for files that must outlive a power cut.
#pragma once

#include <string>
#include <system_error>

namespace slicecorr::detail {

/// Makes a folder, with those above it, where it is missing, and waits until the names of those that it made are on the
/// disk: else what lies in them, waited for or not, could be lost with them. Gives whether there was something to make.
/// Where one can't be made `error` is set; throws `DeviceError` where the disk fails.
bool make_lasting_folder(const std::string& path, std::error_code& error);
/// The same; throws `DeviceError`.
bool make_lasting_folder(const std::string& path);

}  // namespace slicecorr::detail
