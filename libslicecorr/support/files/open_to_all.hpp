// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Files and folders that a program believes, and that everybody on the machine could change.
#pragma once

#include <string>

namespace slicecorr::detail {

/// Throws `InputError` where every user may write to the file or folder: what it says (which parts, which
/// programs, which machine) could then be anybody's word. Nothing where there is no such file.
void refuse_open_to_all(const std::string& path);

/// A folder that is believed, made with those above it where it is missing: others may not write to it, whatever the
/// umask. Throws `DeviceError` where it can't be made, `InputError` as `refuse_open_to_all`.
void make_own_folder(const std::string& path);

}  // namespace slicecorr::detail
