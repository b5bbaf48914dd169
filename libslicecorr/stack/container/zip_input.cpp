// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/zip_input.hpp"

#include <sys/stat.h>
#include <zip.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <string_view>

#include "slicecorr/error.hpp"
#include "stack/isa_l.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {
namespace {

/// Deflate makes at most 1032 bytes of one.
constexpr std::uint64_t kLargestRatio = 1032;

void inflate_all(const std::vector<std::uint8_t>& packed, std::vector<std::uint8_t>& out,
                 const std::string& path, const std::string& name) {
  const auto state = std::make_unique_for_overwrite<inflate_state>();
  isal_inflate_init(state.get());
  state->next_in = const_cast<std::uint8_t*>(packed.data());
  state->avail_in = static_cast<std::uint32_t>(packed.size());
  state->next_out = out.data();
  state->avail_out = static_cast<std::uint32_t>(out.size());
  const int result = isal::inflate_stateless(state.get());
  if (result == ISAL_OUT_OVERFLOW) {
    throw InputError(path, name,
                     "entry holds more than the declared " + std::to_string(out.size()) + " bytes");
  }
  if (result != ISAL_DECOMP_OK) throw InputError(path, name, "compressed data are damaged");
  if (state->avail_out != 0 || state->avail_in != 0) {
    throw InputError(path, name,
                     "entry does not hold the declared " + std::to_string(out.size()) + " bytes");
  }
}

/// Whether the directory at the end of a zip has a name with a zero byte, of which the library
/// makes a blank: rewritten, the entry would have another name.
bool has_zero_in_name(const std::string& path, std::uint64_t bytes) {
  std::ifstream file(path, std::ios::binary);
  std::string text;
  const auto read = [&](std::uint64_t at, std::uint64_t size) {
    text.resize(size);
    file.seekg(static_cast<std::streamoff>(at));
    return static_cast<bool>(file.read(text.data(), static_cast<std::streamsize>(size)));
  };
  const auto number = [&](std::size_t at, int count) {
    std::uint64_t value = 0;
    for (int i = count; i-- > 0;) {
      value = value << 8 | static_cast<unsigned char>(text[at + static_cast<std::size_t>(i)]);
    }
    return value;
  };
  constexpr std::uint64_t longest_comment = 65535, end_record = 22, locator = 20, end64_record = 56;
  const std::uint64_t tail = std::min(bytes, longest_comment + end_record + locator);
  if (!read(bytes - tail, tail)) return false;
  const std::size_t end = text.rfind("PK\5\6");
  if (end == text.npos || end + end_record > text.size()) return false;
  std::uint64_t size = number(end + 12, 4), at = number(end + 16, 4);
  if ((size == 0xffffffff || at == 0xffffffff) && end >= locator &&
      text.compare(end - locator, 4, "PK\6\7") == 0) {
    const std::uint64_t end64 = number(end - locator + 8, 8);
    if (end64 > bytes || !read(end64, end64_record)) return false;
    size = number(40, 8);
    at = number(48, 8);
  }
  if (at > bytes || size > bytes - at || !read(at, size)) return false;
  for (std::size_t entry = 0; entry + 46 <= text.size() && text.compare(entry, 4, "PK\1\2") == 0;) {
    const std::uint64_t name = number(entry + 28, 2);
    if (std::string_view(text).substr(entry + 46, name).find('\0') != std::string_view::npos) {
      return true;
    }
    entry += 46 + name + number(entry + 30, 2) + number(entry + 32, 2);
  }
  return false;
}

}  // namespace

ZipInput::ZipInput(const std::string& path) : Container(path) {
  struct stat status;
  if (::stat(path.c_str(), &status) != 0) {
    throw InputError(errno_message(path, "can't be read"));
  }
  int error = 0;
  // Not ZIP_CHECKCONS: it refuses what common programs write. Contents are checked when they are
  // read.
  zip_ = zip_open(path.c_str(), ZIP_RDONLY, &error);
  if (zip_ == nullptr) {
    zip_error_t details;
    zip_error_init_with_code(&details, error);
    const std::string text = zip_error_strerror(&details);
    zip_error_fini(&details);
    throw InputError(path, "", "not a sound zip archive (" + text + "), expected a slice archive");
  }
  try {
    list_entries(static_cast<std::uint64_t>(status.st_size));
  } catch (...) {
    zip_discard(zip_);
    throw;
  }
}

ZipInput::~ZipInput() { zip_discard(zip_); }

void ZipInput::list_entries(std::uint64_t archive_bytes) {
  const zip_int64_t count = zip_get_num_entries(zip_, 0);
  std::uint64_t packed_sum = 0;
  bool blanks = false;
  for (zip_int64_t i = 0; i < count; ++i) {
    const auto index = static_cast<std::uint64_t>(i);
    zip_stat_t s;
    const char* const name = zip_get_name(zip_, index, ZIP_FL_ENC_RAW);
    constexpr auto needed = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_CRC |
                            ZIP_STAT_COMP_METHOD | ZIP_STAT_ENCRYPTION_METHOD;
    if (name == nullptr || zip_stat_index(zip_, index, 0, &s) != 0 ||
        (s.valid & needed) != needed) {
      throw InputError(path_, "entry " + std::to_string(i), "can't be read");
    }
    if (!is_safe_name(name)) {
      throw InputError(path_, shown_name(name), "entry name is absolute or leaves the archive");
    }
    blanks = blanks || std::string_view(name).find(' ') != std::string_view::npos;
    if (s.encryption_method != ZIP_EM_NONE)
      throw InputError(path_, shown_name(name), "is encrypted");
    packed_sum += s.comp_size;
    const bool fits = s.comp_size <= archive_bytes && packed_sum <= archive_bytes;
    if (!fits) throw InputError(path_, shown_name(name), "entries overlap in the archive");
    packed_.push_back({s.comp_size, s.crc, s.comp_method});
    // A name that ends in a slash is a folder's, and no entry.
    if (std::string_view(name).ends_with('/')) continue;
    entries_.push_back({name, index, s.size});
  }
  if (blanks && has_zero_in_name(path_, archive_bytes)) {
    throw InputError(path_, "",
                     "has an entry whose name holds a zero byte; expected names of text");
  }
  finish_list();
}

void ZipInput::read(const Entry& entry, std::uint64_t limit, std::vector<std::uint8_t>& out) const {
  const Packed& p = packed_[entry.index];
  const std::string name = shown_name(entry.name);
  // Offsets of 32 bits are enough for any image that is allowed.
  limit = std::min<std::uint64_t>(limit, 0xffffffff);
  if (entry.bytes > limit || p.bytes > limit + limit / 1024 + 4096) {
    throw InputError(path_, name,
                     "entry has " + std::to_string(std::max(entry.bytes, p.bytes)) +
                         " bytes, expected at most " + std::to_string(limit));
  }
  if (p.method == ZIP_CM_STORE) {
    if (entry.bytes != p.bytes) {
      throw InputError(path_, name, "stored entry has two different sizes");
    }
    read_packed(entry, out);
  } else if (p.method == ZIP_CM_DEFLATE) {
    if (entry.bytes > kLargestRatio * (p.bytes + 1)) {
      throw InputError(path_, name, "entry declares more than its compressed data can hold");
    }
    std::vector<std::uint8_t> packed;
    read_packed(entry, packed);
    out.resize(entry.bytes);
    inflate_all(packed, out, path_, name);
  } else {
    throw InputError(path_, name,
                     "entry is compressed by method " + std::to_string(p.method) +
                         ", expected stored or deflated");
  }
  if (isal::crc32(0, out.data(), out.size()) != p.crc) {
    throw InputError(path_, name, "entry has a wrong checksum");
  }
}

void ZipInput::read_packed(const Entry& entry, std::vector<std::uint8_t>& out) const {
  out.resize(packed_[entry.index].bytes);
  const std::scoped_lock lock(mutex_);
  // Raw bytes: the library would inflate while the lock is held.
  zip_file_t* const file = zip_fopen_index(zip_, entry.index, ZIP_FL_COMPRESSED);
  std::uint64_t done = 0;
  while (file != nullptr && done < out.size()) {
    const zip_int64_t n = zip_fread(file, out.data() + done, out.size() - done);
    if (n <= 0) break;
    done += static_cast<std::uint64_t>(n);
  }
  if (file != nullptr) zip_fclose(file);
  if (file == nullptr || done != out.size()) {
    throw InputError(path_, shown_name(entry.name), "entry can't be read: the archive is damaged");
  }
}

}  // namespace slicecorr::detail
