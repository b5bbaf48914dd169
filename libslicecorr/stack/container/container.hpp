// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file container.hpp
/// The files in an archive, whatever holds them: a zip, a tar.gz, a folder or what lies beside a
/// binary file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

enum class ContainerKind { zip, tar_gz, folder, binary };

/// Large files and entries are read by so much at a time.
inline constexpr std::size_t kPieceBytes = std::size_t{1} << 20;

/// An archive opened for reading. Doubled, encrypted, overlapping or strangely named entries are
/// refused with `InputError`. Folders are not listed as entries.
class Container {
 public:
  struct Entry {
    std::string name;
    std::uint64_t index = 0;  ///< place in the archive; of a folder, place by name
    std::uint64_t bytes = 0;  ///< unpacked, as declared
  };

  virtual ~Container() = default;
  Container(const Container&) = delete;
  Container& operator=(const Container&) = delete;

  virtual ContainerKind kind() const { return ContainerKind::zip; }
  const std::string& path() const { return path_; }
  /// All entries, sorted by name.
  const std::vector<Entry>& entries() const { return entries_; }
  const Entry* find(std::string_view name) const;
  bool has(std::string_view name) const { return find(name) != nullptr; }

  /// The entry's contents, checked against its declared size and checksum. Refuses more than
  /// `limit` bytes before reading. Thread-safe.
  virtual void read(const Entry& entry, std::uint64_t limit,
                    std::vector<std::uint8_t>& out) const = 0;
  /// The same as text. Throws `InputError` when there is no such entry.
  std::string text(std::string_view name, std::uint64_t limit = std::uint64_t{16} << 20) const;

 protected:
  explicit Container(std::string path) : path_(std::move(path)) {}
  /// Sorts and refuses doubled names; `entries_` is filled before.
  void finish_list();

  std::string path_;
  std::vector<Entry> entries_;
};

/// What a path holds, by its first bytes. Throws `InputError` when it is none of these.
ContainerKind container_kind(const std::string& path);

/// Opens what is there. Scratch, which a large tar.gz needs, goes to `scratch_folder`, as `context`
/// is told.
std::unique_ptr<Container> open_container(const std::string& path,
                                          const std::string& scratch_folder,
                                          const ExecutionContext& context = {});

/// Whether an entry's name stays inside the archive: not absolute, no "..", no backslash.
bool is_safe_name(std::string_view name);

/// Entry names come from outside: control characters must not reach a terminal.
std::string shown_name(std::string_view name);

}  // namespace slicecorr::detail
