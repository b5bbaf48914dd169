/// @file zip_output.hpp
/// A zip archive that appears under its name only when it is complete.
#pragma once

#include <string>

#include "stack/container_output.hpp"

namespace slicecorr::detail {

/// New entries are stored uncompressed, with a fixed time, in the order they were added. Kept ones
/// are copied as they are packed; a changed one keeps its place, time and comment, and, unless it
/// is an image, its compression.
class ZipOutput final : public ContainerOutput {
 public:
  explicit ZipOutput(const std::string& path, std::string keep_from = "");
  void finish(const Job& job) override;

 private:
  friend struct ZipWriting;
  void write(const std::string& temporary, const Job& job);

  std::string keep_from_;
};

}  // namespace slicecorr::detail
