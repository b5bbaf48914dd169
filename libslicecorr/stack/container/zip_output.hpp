// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file zip_output.hpp
/// A zip archive that appears under its name only when it is complete.
#pragma once

#include <string>

#include "stack/container/container_output.hpp"

namespace slicecorr::detail {

/// New entries have a fixed time, in the order they were added; they are stored uncompressed,
/// images as `ImagePacking` says. Kept ones are copied as they are packed; a changed one keeps its
/// place, time, comment and compression, and new images are packed like those before them.
class ZipOutput final : public ContainerOutput {
 public:
  explicit ZipOutput(const std::string& path, std::string keep_from = "",
                     ImagePacking images = ImagePacking::stored);
  void finish(const ExecutionContext& context, const Check& check) override;

 private:
  friend struct ZipWriting;
  void write(const std::string& temporary, const ExecutionContext& context);
  /// What the zip library is for: everything not touched stays as it is.
  void change(const std::string& temporary, const ExecutionContext& context);

  std::string keep_from_;
  ImagePacking images_;
};

}  // namespace slicecorr::detail
