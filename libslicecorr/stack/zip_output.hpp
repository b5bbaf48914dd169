/// @file zip_output.hpp
/// A zip archive that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// Entries are stored uncompressed, with a fixed time, in the order they were added. All is written
/// by `finish`, to a temporary file in the same folder. Throws `DeviceError`.
class ZipOutput {
 public:
  using Fill = std::function<void(std::size_t i, std::vector<std::uint8_t>& data)>;

  /// Checks already now that a file can be made here.
  explicit ZipOutput(const std::string& path);
  const std::string& folder() const { return folder_; }

  void add(std::string name, std::vector<std::uint8_t> data);
  /// Entries named by printf format `names` with 0, 1, ...; `fill` makes the contents, of the
  /// promised size, one entry at a time while the archive is written.
  void add_lazily(const char* names, const std::vector<std::uint64_t>& sizes, Fill fill);

  void finish(const Job& job);

 private:
  struct Source {
    std::string name;
    std::uint64_t size = 0;
    Fill fill;
    std::size_t number = 0;
  };
  friend struct ZipWriting;

  std::string make_temporary() const;
  void write(const std::string& temporary, const Job& job);

  std::string path_, folder_, file_;
  std::vector<Source> sources_;
};

}  // namespace slicecorr::detail
