// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/tar_functions.hpp"

#include "support/files/shared_object.hpp"

namespace slicecorr::detail {

const TarFunctions& libarchive() {
  static const TarFunctions* const functions = reinterpret_cast<const TarFunctions* (*)()>(
      module_entry("slicecorr-tar.so", kTarModuleEntry, "reads and writes tar.gz archives"))();
  return *functions;
}

}  // namespace slicecorr::detail
