// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file container_output.hpp
/// An archive that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "stack/container/container.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::detail {

/// Collects entries; all is written by `finish`, beside `path` under a temporary name that is
/// renamed at the end. With `keep_from`, every entry of that archive stays as it is, in its place,
/// with its time, comment and compression, unless one of the same name is added, which then takes
/// its place; new names come last. Throws `DeviceError`.
class ContainerOutput {
 public:
  using Fill = std::function<void(std::size_t i, std::vector<std::uint8_t>& data)>;

  virtual ~ContainerOutput() = default;
  ContainerOutput(const ContainerOutput&) = delete;
  ContainerOutput& operator=(const ContainerOutput&) = delete;

  /// Where the archive, and scratch, is made.
  const std::string& folder() const { return folder_; }

  void add(std::string name, std::vector<std::uint8_t> data);
  void add_text(std::string name, const std::string& text);
  /// `fill` makes the contents, of the promised sizes, while writing; of several images at once,
  /// from several threads.
  void add_lazily(const std::vector<std::string>& names, const std::vector<std::uint64_t>& sizes,
                  Fill fill);
  /// An entry of the archive `keep_from` that is not to stay. Only zips leave out some.
  void leave_out(std::string name) { left_out_.push_back(std::move(name)); }
  /// Looks at the archive under its temporary name, as the last step before it is renamed; what it
  /// throws leaves the old one in its place.
  using Check = std::function<void(const std::string& written)>;
  virtual void finish(const ExecutionContext& context, const Check& check = {}) = 0;

 protected:
  friend struct ZipWriting;
  struct Source {
    std::string name;
    std::uint64_t size = 0;
    Fill fill;
    std::size_t number = 0;
    /// Throws `Error` when the contents have not the promised size.
    void make(std::vector<std::uint8_t>& contents) const;
  };
  explicit ContainerOutput(const std::string& path);

  std::string path_, folder_, file_;
  std::vector<Source> sources_;
  std::vector<std::string> left_out_;
};

/// Whether images, which are deflated as they are, are deflated once more where the container can:
/// not at all, fast, or as small as it gets. Rows that repeat leave a pattern in a PNG's data: that
/// makes images of large displays several times smaller.
enum class ImagePacking { stored, deflated, smallest };

/// Checks already now that `path` can be written. `keep_from` is empty for a new archive, and may
/// be `path` itself.
std::unique_ptr<ContainerOutput> make_container_output(const std::string& path, ContainerKind kind,
                                                       const std::string& keep_from,
                                                       ImagePacking images);

}  // namespace slicecorr::detail
