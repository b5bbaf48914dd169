// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file store.hpp
/// Files of the farm by content: inputs, results, and the way of a result to where the user wants
/// it. Everything appears by rename; nothing half-written has a final name. Throws `DeviceError`,
/// for a full disk `DiskFull`. Functions are thread-safe, and safe against other processes; an
/// `InputLock` belongs to one thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/job.hpp"

namespace slicecorr::farm {

/// No room on a disk, in a quota or under a limit of file sizes.
class DiskFull : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

/// 64 hex digits.
std::string sha256_of_text(const std::string& text);
/// Hash and size of a file. Throws `InputError` when it can't be read.
ResultFile sha256_of_file(const std::string& path);

/// A file as it was when it was put into the store.
struct StoredInput {
  std::string file;  ///< name in the store
  std::string sha256;
  std::int64_t bytes = 0;
};
/// The ending under which a file is stored, since readers go by it; of two parts where the name has
/// such a one (".stl.gz", ".rgb.cws").
std::string stored_ending(const std::string& path);
/// Says, across threads and processes, that inputs are being put into the store: they are there
/// before the record has the jobs that need them. Ends with the object, or with its process.
class InputLock {
 public:
  /// A submission's, from before its first input until its jobs are queued; several may have it.
  /// Waits while inputs are being collected. Throws `DeviceError`.
  static InputLock shared(const FarmFolder& folder);
  /// A collector's. None while any submission has its own.
  static std::optional<InputLock> alone(const FarmFolder& folder);
  void release();
  ~InputLock() { release(); }
  InputLock(InputLock&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  InputLock& operator=(InputLock&&) = delete;

 private:
  explicit InputLock(int fd) : fd_(fd) {}
  int fd_;
};

/// Copies a file into the store unless its content is there. The ending is kept: readers go by it.
/// The caller holds an `InputLock`.
StoredInput store_input(const FarmFolder& folder, const std::string& path);
/// Whether the store's copy has the right size (and content, when `thorough`).
bool check_input(const FarmFolder& folder, const std::string& file, const std::string& sha256,
                 bool thorough);

/// Moves the outputs of an attempt into the cache; what is there already stays when it is whole.
/// Throws `InputError` when the sizes are others than recorded.
void put_in_cache(const FarmFolder& folder, const std::string& key, const std::string& out_folder,
                  const std::string& name, const std::vector<ResultFile>& files);
/// Whether all files are in the cache as recorded, by size and hash.
bool check_cached(const FarmFolder& folder, const std::string& key,
                  const std::vector<ResultFile>& files);
/// Copies a result from the cache to `output_folder`/NAME.ENDING: beside their places first,
/// synced, then renamed. The report gets the job's name as its title. Gives the files as written.
std::vector<ResultFile> deliver(const FarmFolder& folder, const std::string& key,
                                const std::vector<ResultFile>& files,
                                const std::string& output_folder, const std::string& name,
                                const std::string& token);
/// Removes what a delivery by a service that was killed left beside the outputs.
void remove_delivery_parts(const std::string& output_folder, const std::string& name,
                           const std::string& format, const std::string& token);
void remove_from_cache(const FarmFolder& folder, const std::string& key);
void remove_attempt(const FarmFolder& folder, const std::string& token);

/// Free bytes where `path` is or will be.
std::int64_t free_bytes(const std::string& path);

}  // namespace slicecorr::farm
