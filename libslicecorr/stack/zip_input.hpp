/// @file zip_input.hpp
/// A zip archive opened for reading, distrusted.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

struct zip;

namespace slicecorr::detail {

/// Refuses what is no zip, is damaged, or holds doubled, encrypted, overlapping or strangely named
/// entries. Entries are inflated by ISA-L outside the lock of the zip handle.
class ZipInput {
 public:
  struct Entry {
    std::string name;
    std::uint64_t index = 0;
    std::uint64_t bytes = 0;         ///< inflated, as declared
    std::uint64_t packed_bytes = 0;  ///< in the archive
    std::uint32_t crc = 0;
    std::uint16_t method = 0;
  };

  explicit ZipInput(const std::string& path);
  ~ZipInput();
  ZipInput(const ZipInput&) = delete;
  ZipInput& operator=(const ZipInput&) = delete;

  /// Sorted by name.
  const std::vector<Entry>& entries() const { return entries_; }
  const Entry* find(const std::string& name) const;

  /// The entry's contents, checked against its declared size and checksum. Refuses more than
  /// `limit` bytes before reading. Thread-safe.
  void read(const Entry& entry, std::uint64_t limit, std::vector<std::uint8_t>& out);

 private:
  void list_entries(std::uint64_t archive_bytes);
  void read_packed(const Entry& entry, std::vector<std::uint8_t>& out);

  std::string path_;
  zip* zip_ = nullptr;
  std::mutex mutex_;
  std::vector<Entry> entries_;
};

}  // namespace slicecorr::detail
