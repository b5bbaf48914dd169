// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file binary_file.hpp
/// Print files of one binary block: layers of coded pixels between tables of offsets. What such a file
/// has no place for, our record above all, lies in a small zip beside it, `record_beside`.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"

namespace slicecorr::detail {

/// Whether a file that starts with these bytes is binary and of a kind that is read.
bool is_binary_print_file(std::string_view first_bytes);

/// A binary file opened for reading. Its entries are those of the record beside it, as long as that
/// is of the same bytes: a file that was exported anew has none. Thread-safe.
class BinaryFile final : public Container {
 public:
  explicit BinaryFile(const std::string& path);
  ~BinaryFile() override;
  ContainerKind kind() const override { return ContainerKind::binary; }
  std::uint64_t size() const { return size_; }
  /// Bytes [offset, offset + count); throws `InputError` naming `what` where the file has not as many.
  void read_at(std::uint64_t offset, std::uint64_t count, std::vector<std::uint8_t>& out,
               std::string_view what) const;
  /// There is a record beside, of another file.
  bool record_is_of_another() const { return record_is_of_another_; }
  void read(const Entry& entry, std::uint64_t limit, std::vector<std::uint8_t>& out) const override;

 private:
  std::uint32_t crc32() const;
  int fd_ = -1;
  std::uint64_t size_ = 0;
  bool record_is_of_another_ = false;
  std::unique_ptr<Container> record_;
};

/// The container of a format of kind `ContainerKind::binary`.
inline const BinaryFile& binary_file(const Container& archive) {
  return static_cast<const BinaryFile&>(archive);
}

/// Writes a binary file: the pieces that were added without a name, in their order. Entries with names
/// go to the record beside it, which is made only if there are some.
class BinaryOutput final : public ContainerOutput {
 public:
  BinaryOutput(const std::string& path, std::string keep_from);
  void add_piece(std::vector<std::uint8_t> bytes) { add("", std::move(bytes)); }
  void add_piece(std::uint64_t size, Fill fill, std::size_t number = 0) {
    sources_.push_back({"", size, std::move(fill), number});
  }
  /// While pieces are written: CRC-32 (polynomial EDB88320, reflected) of those before, from 0 and
  /// without an inversion at its end; and the exclusive or of their bytes.
  std::uint32_t plain_crc32() const { return ~crc_; }
  std::uint8_t xor_of_bytes() const { return xor_; }
  void finish(const ExecutionContext& context, const Check& check) override;

 private:
  std::string keep_from_;
  std::uint32_t crc_ =
      0xffffffff;  ///< of zlib's kind, whose start 0xffffffff is a plain start of 0
  std::uint8_t xor_ = 0;
};

inline BinaryOutput& binary_output(ContainerOutput& output) {
  return static_cast<BinaryOutput&>(output);
}

}  // namespace slicecorr::detail
