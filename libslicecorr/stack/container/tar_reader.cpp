// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/tar_reader.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <string_view>
#include <vector>

#include "slicecorr/error.hpp"
#include "stack/container/container.hpp"
#include "stack/container/tar_functions.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/unpacked_limit.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kBlockBytes = std::size_t{256} << 10;

/// What a file may unpack to: slices that are mostly black pack very well.
constexpr std::uint64_t kLargestGzipRatio = 500;

/// Twice a million slices, in visible and in UV light, and some for what else there is.
constexpr std::uint64_t kMostEntries = 2'100'000;

/// The inflated bytes of a gzip file, which may have several parts. zlib checks length and checksum
/// of each; libarchive's own filter would look at neither, nor at what follows them.
class GzipStream {
 public:
  explicit GzipStream(const std::string& path) : path_(path), packed_(kBlockBytes) {
    file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    struct stat status;
    if (file_ < 0 || ::fstat(file_, &status) != 0) {
      const std::string message = errno_message(path, "can't be read");
      if (file_ >= 0) ::close(file_);
      throw InputError(message);
    }
    file_bytes_ = static_cast<std::uint64_t>(status.st_size);
    limit_ = most_unpacked_bytes(file_bytes_, kLargestGzipRatio);
    constexpr int gzip_only = 16;
    if (inflateInit2(&state_, MAX_WBITS + gzip_only) != Z_OK) {
      ::close(file_);
      throw std::bad_alloc();
    }
  }
  ~GzipStream() {
    inflateEnd(&state_);
    ::close(file_);
  }
  GzipStream(const GzipStream&) = delete;
  GzipStream& operator=(const GzipStream&) = delete;

  /// The next bytes, fewer than `out` has only at the end.
  std::size_t read(std::span<std::uint8_t> out) {
    state_.next_out = out.data();
    state_.avail_out = static_cast<uInt>(out.size());
    while (state_.avail_out > 0 && !done_) {
      if (state_.avail_in == 0) refill();
      if (ended_) {
        begin_next_part();
        continue;
      }
      // Also at the end of the file: zlib may still hold bytes back.
      const int result = inflate(&state_, Z_NO_FLUSH);
      if (result == Z_STREAM_END) {
        ended_ = true;
      } else if (result == Z_BUF_ERROR && state_.avail_in == 0 && file_ended_) {
        throw InputError(path_, "", "ends too early: the compressed data are damaged");
      } else if (result != Z_OK && result != Z_BUF_ERROR) {
        throw InputError(path_, "",
                         std::string("compressed data are damaged") +
                             (state_.msg != nullptr ? std::string(" (") + state_.msg + ")" : ""));
      }
    }
    const std::size_t n = out.size() - state_.avail_out;
    unpacked_ += n;
    if (unpacked_ > limit_) {
      throw InputError(path_, "",
                       "unpacks to more than " + std::to_string(limit_) + " bytes, " +
                           std::to_string(kLargestGzipRatio) + " times its size");
    }
    return n;
  }

  double fraction() const {
    return file_bytes_ == 0
               ? 1
               : static_cast<double>(taken_ - state_.avail_in) / static_cast<double>(file_bytes_);
  }

 private:
  /// Reads more of the file behind the bytes that are left, which move to the front.
  void refill() {
    if (state_.avail_in > 0) std::memmove(packed_.data(), state_.next_in, state_.avail_in);
    state_.next_in = packed_.data();
    while (!file_ended_ && state_.avail_in < packed_.size()) {
      const ssize_t n =
          ::read(file_, packed_.data() + state_.avail_in, packed_.size() - state_.avail_in);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw InputError(errno_message(path_, "can't be read"));
      file_ended_ = n == 0;
      state_.avail_in += static_cast<uInt>(n);
      taken_ += static_cast<std::uint64_t>(n);
    }
  }

  void begin_next_part() {
    if (state_.avail_in < 2) refill();
    if (state_.avail_in == 0) {
      done_ = true;
      return;
    }
    if (state_.avail_in < 2 || state_.next_in[0] != 0x1f || state_.next_in[1] != 0x8b) {
      throw InputError(path_, "", "has bytes behind the end of the compressed data");
    }
    inflateReset(&state_);
    ended_ = false;
  }

  std::string path_;
  int file_ = -1;
  std::uint64_t file_bytes_ = 0, taken_ = 0, unpacked_ = 0, limit_ = 0;
  std::vector<std::uint8_t> packed_;
  z_stream state_{};
  bool file_ended_ = false;  ///< nothing more to be read
  bool ended_ = false;       ///< a part of the gzip has ended
  bool done_ = false;        ///< all of them have
};

std::string clean_name(std::string_view name) {
  while (name.starts_with("./")) {
    name.remove_prefix(2);
    while (name.starts_with("/")) name.remove_prefix(1);
  }
  return std::string(name == "." ? std::string_view() : name);
}

}  // namespace

struct TarReader::Impl {
  std::string path;
  GzipStream gzip;
  std::vector<std::uint8_t> block;
  std::uint64_t tar_bytes = 0;    ///< given to libarchive
  std::uint64_t nonzero_end = 0;  ///< end of the last byte among these that is not 0
  std::exception_ptr error;       ///< must not pass through the C library
  std::unique_ptr<archive, decltype(TarFunctions::read_free)> tar{nullptr, libarchive().read_free};
  archive_entry* header = nullptr;
  std::string name;
  bool folder = false;
  std::uint64_t entries = 0, bytes = 0, bytes_read = 0;

  explicit Impl(const std::string& p) : path(p), gzip(p), block(kBlockBytes) {}

  /// Fills `block` and remembers where its zeros begin.
  std::size_t fill() {
    const std::size_t n = gzip.read(block);
    std::size_t last = n;
    while (last > 0 && block[last - 1] == 0) --last;
    if (last > 0) nonzero_end = tar_bytes + last;
    tar_bytes += n;
    return n;
  }

  static la_ssize_t give(archive* a, void* state, const void** data) {
    Impl& s = *static_cast<Impl*>(state);
    try {
      *data = s.block.data();
      return static_cast<la_ssize_t>(s.fill());
    } catch (...) {
      s.error = std::current_exception();
      libarchive().set_error(a, EIO, "see the exception");
      return -1;
    }
  }

  [[noreturn]] void fail(const std::string& entry) {
    if (error) std::rethrow_exception(error);
    const char* const text = libarchive().error_string(tar.get());
    throw InputError(path, entry,
                     std::string("not a sound tar archive") +
                         (text != nullptr ? std::string(" (") + text + ")" : "") +
                         ", expected a slice archive");
  }

  void check_end() {
    // The two blocks of zeros that end a tar have been read; all after them must be zeros too.
    const auto end = static_cast<std::uint64_t>(libarchive().read_header_position(tar.get()));
    while (fill() > 0) {
    }
    if (nonzero_end > end)
      throw InputError(path, "", "has bytes behind the end of the tar archive");
  }
};

TarReader::TarReader(const std::string& path) : impl_(std::make_unique<Impl>(path)) {
  Impl& s = *impl_;
  s.tar.reset(libarchive().read_new());
  if (!s.tar) throw std::bad_alloc();
  if (libarchive().read_support_format_tar(s.tar.get()) != ARCHIVE_OK ||
      libarchive().read_open(s.tar.get(), &s, nullptr, &Impl::give, nullptr) != ARCHIVE_OK) {
    s.fail("");
  }
}

TarReader::~TarReader() = default;

bool TarReader::next() {
  Impl& s = *impl_;
  if (s.header != nullptr && s.bytes_read != bytes() && !is_folder()) {
    // Contents that are passed over are read, too: they must be whole.
    std::vector<std::uint8_t> rest(kBlockBytes);
    while (read(rest) > 0) {
    }
  }
  s.bytes_read = 0;
  const int result = libarchive().read_next_header(s.tar.get(), &s.header);
  if (result == ARCHIVE_EOF) {
    s.header = nullptr;
    s.check_end();
    return false;
  }
  // A warning: the name is in an encoding that the locale has not. The bytes are what counts.
  if (result != ARCHIVE_OK && result != ARCHIVE_WARN) s.fail("");
  s.folder = libarchive().entry_filetype(s.header) == AE_IFDIR;
  s.bytes = static_cast<std::uint64_t>(std::max<la_int64_t>(0, libarchive().entry_size(s.header)));
  const char* name = libarchive().entry_pathname(s.header);
  if (name == nullptr) name = libarchive().entry_pathname_utf8(s.header);
  if (name == nullptr) {
    throw InputError(s.path, "entry " + std::to_string(s.entries), "has no readable name");
  }
  s.name = clean_name(name);
  const std::string shown = shown_name(name);
  if (++s.entries > kMostEntries) {
    throw InputError(
        s.path, shown,
        "is more than the " + std::to_string(kMostEntries) + " entries that an archive may have");
  }
  if (libarchive().entry_hardlink(s.header) != nullptr ||
      libarchive().entry_filetype(s.header) == AE_IFLNK) {
    throw InputError(s.path, shown, "is a link, expected files only");
  }
  if (!is_folder() && libarchive().entry_filetype(s.header) != AE_IFREG) {
    throw InputError(s.path, shown, "is a device, expected files only");
  }
  if (!(is_folder() && s.name.empty()) && !is_safe_name(s.name)) {
    throw InputError(s.path, shown, "entry name is absolute or leaves the archive");
  }
  return true;
}

archive_entry* TarReader::header() const { return impl_->header; }
bool TarReader::is_folder() const { return impl_->folder; }
const std::string& TarReader::name() const { return impl_->name; }
std::uint64_t TarReader::bytes() const { return impl_->bytes; }
double TarReader::fraction() const { return impl_->gzip.fraction(); }

std::size_t TarReader::read(std::span<std::uint8_t> out) {
  Impl& s = *impl_;
  std::size_t done = 0;
  while (done < out.size()) {
    const la_ssize_t n = libarchive().read_data(s.tar.get(), out.data() + done, out.size() - done);
    if (n < 0) s.fail(shown_name(s.name));
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  s.bytes_read += done;
  if (s.bytes_read > bytes() || (done < out.size() && s.bytes_read != bytes())) {
    throw InputError(s.path, shown_name(s.name),
                     "entry does not hold the declared " + std::to_string(bytes()) + " bytes");
  }
  return done;
}

}  // namespace slicecorr::detail
