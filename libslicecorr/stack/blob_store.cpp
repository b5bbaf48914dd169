// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/blob_store.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr {
namespace {

/// Marks offsets that count from the start of the scratch file.
constexpr std::uint64_t kInFile = std::uint64_t{1} << 63;

constexpr std::size_t kLargestChunk = std::size_t{1} << 20;

/// Which parts of a row of bytes are taken. What is given back is joined with free neighbours and
/// taken again where it fits best.
class Space {
 public:
  /// Takes `size` bytes below `limit`; none where there is no room.
  std::optional<std::uint64_t> take(std::uint64_t size, std::uint64_t limit) {
    const auto fits = by_size_.lower_bound({size, 0});
    if (fits != by_size_.end()) {
      const auto [found, offset] = *fits;
      remove(offset, found);
      if (found > size) add(offset + size, found - size);
      return offset;
    }
    if (size > limit - end_) return std::nullopt;
    return std::exchange(end_, end_ + size);
  }
  void give(std::uint64_t offset, std::uint64_t size) {
    const auto after = by_offset_.lower_bound(offset);
    if (after != by_offset_.end() && after->first == offset + size) {
      size += after->second;
      remove(after->first, after->second);
    }
    const auto next = by_offset_.lower_bound(offset);
    if (next != by_offset_.begin()) {
      const auto [first, bytes] = *std::prev(next);
      if (first + bytes == offset) {
        remove(first, bytes);
        offset = first;
        size += bytes;
      }
    }
    add(offset, size);
  }
  /// All that was ever taken lies below.
  std::uint64_t end() const { return end_; }

 private:
  void add(std::uint64_t offset, std::uint64_t size) {
    by_offset_.emplace(offset, size);
    by_size_.emplace(size, offset);
  }
  void remove(std::uint64_t offset, std::uint64_t size) {
    by_offset_.erase(offset);
    by_size_.erase({size, offset});
  }
  std::uint64_t end_ = 0;
  std::map<std::uint64_t, std::uint64_t> by_offset_;           ///< sizes of free parts
  std::set<std::pair<std::uint64_t, std::uint64_t>> by_size_;  ///< size, offset
};

}  // namespace

struct BlobStore::Impl {
  std::string folder;
  ExecutionContext context;
  std::size_t budget = 0;
  std::size_t chunk_size = 0;
  /// Memory for blobs. The table never grows and its chunks never move, so that bytes are copied
  /// outside the lock.
  std::vector<std::unique_ptr<std::uint8_t[]>> chunks;
  Space memory, in_file;
  int file = -1;
  mutable std::mutex mutex;

  ~Impl() {
    if (file >= 0) ::close(file);
  }

  [[noreturn]] void fail(const char* what) const {
    throw DeviceError(
        detail::errno_message(folder, std::string("can't ") + what + " a scratch file"));
  }

  void open_file() {
#ifdef O_TMPFILE
    file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
#endif
    if (file >= 0) return;
    // Some file systems (NFS, FAT, overlays) know no unnamed files.
    std::string name = folder + "/.slicecorr.XXXXXX";
    file = ::mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) fail("make");
    ::unlink(name.c_str());
  }

  /// Calls `copy(memory, done, length)` for every chunk that [offset, offset + size) touches.
  template <class Copy>
  void for_chunks(std::uint64_t offset, std::size_t size, const Copy& copy) const {
    for (std::size_t done = 0; done < size;) {
      const std::size_t at = (offset + done) % chunk_size;
      const std::size_t length = std::min(size - done, chunk_size - at);
      copy(chunks[(offset + done) / chunk_size].get() + at, done, length);
      done += length;
    }
  }
};

BlobStore::BlobStore(std::string folder, std::size_t memory_budget_bytes,
                     const ExecutionContext& context)
    : impl_(std::make_unique<Impl>()) {
  impl_->folder = folder.empty() ? "." : std::move(folder);
  impl_->context = context;
  impl_->budget = memory_budget_bytes;
  impl_->chunk_size = std::clamp<std::size_t>(memory_budget_bytes, 1, kLargestChunk);
  impl_->chunks.resize((memory_budget_bytes + impl_->chunk_size - 1) / impl_->chunk_size);
}

BlobStore::~BlobStore() = default;

BlobStore::Blob BlobStore::put(const std::uint8_t* data, std::size_t size) {
  Impl& s = *impl_;
  if (size > 0xffffffffu) throw DeviceError("a blob of an image is larger than 4 GiB");
  Blob blob;
  blob.size = static_cast<std::uint32_t>(size);
  bool first_in_file = false;
  {
    const std::scoped_lock lock(s.mutex);
    if (const auto offset = s.memory.take(size, s.budget)) {
      blob.offset = *offset;
      for (std::size_t i = blob.offset / s.chunk_size; i * s.chunk_size < blob.offset + size; ++i) {
        if (!s.chunks[i])
          s.chunks[i] = std::make_unique_for_overwrite<std::uint8_t[]>(s.chunk_size);
      }
    } else {
      if (s.file < 0) {
        s.open_file();
        first_in_file = true;
      }
      blob.offset = *s.in_file.take(size, kInFile) | kInFile;
    }
  }
  if (first_in_file) {
    s.context.tell("images need more than " + std::to_string(s.budget >> 20) +
                   " MiB: keeping the rest in a scratch file in " + s.folder);
  }
  if ((blob.offset & kInFile) == 0) {
    s.for_chunks(blob.offset, size, [&](std::uint8_t* memory, std::size_t done, std::size_t n) {
      std::memcpy(memory, data + done, n);
    });
    return blob;
  }
  for (std::size_t done = 0; done < size;) {
    const auto at = static_cast<off_t>((blob.offset & ~kInFile) + done);
    const ssize_t n = ::pwrite(s.file, data + done, size - done, at);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
    } else if (n == 0 || errno != EINTR) {
      if (n == 0) errno = ENOSPC;
      s.fail("write");
    }
  }
  return blob;
}

void BlobStore::drop(const Blob& blob) {
  if (blob.size == 0) return;
  const std::scoped_lock lock(impl_->mutex);
  if ((blob.offset & kInFile) != 0) {
    impl_->in_file.give(blob.offset & ~kInFile, blob.size);
  } else {
    impl_->memory.give(blob.offset, blob.size);
  }
}

void BlobStore::get(const Blob& blob, std::vector<std::uint8_t>& out) const {
  const Impl& s = *impl_;
  const std::size_t start = out.size();
  out.resize(start + blob.size);
  std::uint8_t* const data = out.data() + start;
  if ((blob.offset & kInFile) == 0) {
    s.for_chunks(blob.offset, blob.size,
                 [&](const std::uint8_t* memory, std::size_t done, std::size_t n) {
                   std::memcpy(data + done, memory, n);
                 });
    return;
  }
  for (std::size_t done = 0; done < blob.size;) {
    const auto at = static_cast<off_t>((blob.offset & ~kInFile) + done);
    const ssize_t n = ::pread(s.file, data + done, blob.size - done, at);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
    } else if (n == 0 || errno != EINTR) {
      if (n == 0) errno = EIO;
      s.fail("read");
    }
  }
}

std::uint64_t BlobStore::scratch_bytes() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->in_file.end();
}

}  // namespace slicecorr
