// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Modules: code with large dependencies, loaded when it is first needed.
#pragma once

#include <filesystem>

namespace slicecorr::detail {

/// Loads the module for good and gives its function of this name. `what_it_does` goes into the
/// message when it is not there: "reads and makes images of this kind". Thread-safe. Throws
/// `DeviceError`.
void* module_entry(const char* file_name, const char* entry_name, const char* what_it_does);

/// The folder of the file that this code is part of, a program or a shared library; empty where
/// nobody knows.
std::filesystem::path own_folder();

}  // namespace slicecorr::detail
