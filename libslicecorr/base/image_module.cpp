// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "base/image_module.hpp"

#include "support/files/shared_object.hpp"

namespace slicecorr::detail {

const ImageFunctions& image_functions() {
  static const ImageFunctions* const functions =
      reinterpret_cast<const ImageFunctions* (*)()>(module_entry(
          "slicecorr-images.so", kImageModuleEntry, "reads and makes images of this kind"))();
  return *functions;
}

}  // namespace slicecorr::detail
