// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/binary_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <numeric>

#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/container/output_file.hpp"
#include "stack/container/zip_input.hpp"
#include "stack/container/zip_output.hpp"
#include "stack/isa_l.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using namespace std::string_view_literals;

/// Of what file a record is.
constexpr const char* kOfEntry = "of.json";

constexpr std::string_view kMagics[] = {
    "\x19\x00\xfd\x12"sv,
    "\x86\x00\xfd\x12"sv,
    "\x06\x01\xfd\x12"sv,
    "\x10\x08\x22\xff"sv,
    "\xae\x83\xda\x9f"sv,
    "\xc8\x7a\x3c\xbd"sv,
    "ANYCUBIC\0\0\0\0"sv,
    "V3.0\x07\0\0\0DLP\0"sv,
    "\0\0\0\x09"
    "CXSW3D"sv,
    "\0\0\0\x07"
    "CXSW3D"sv,
    "Longer3D"sv,
};

}  // namespace

bool is_binary_print_file(std::string_view first_bytes) {
  return std::any_of(std::begin(kMagics), std::end(kMagics),
                     [&](std::string_view magic) { return first_bytes.starts_with(magic); });
}

BinaryFile::BinaryFile(const std::string& path)
    : Container(path), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  struct stat status;
  if (fd_ < 0 || ::fstat(fd_, &status) != 0) {
    const std::string message = errno_message(path, "can't be read");
    if (fd_ >= 0) ::close(fd_);
    throw InputError(message);
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
  const std::string beside = record_beside(path);
  if (::access(beside.c_str(), F_OK) != 0) return;
  try {
    auto record = std::make_unique<ZipInput>(beside);
    const auto of = try_json(record->text(kOfEntry));
    if (!of.is_object() || !of["bytes"].is_number_unsigned() || !of["crc32"].is_number_unsigned()) {
      throw InputError(beside, kOfEntry, "does not say of which file the record is");
    }
    if (of["bytes"] != size_ || of["crc32"] != crc32()) {
      record_is_of_another_ = true;
      return;
    }
    for (const Entry& entry : record->entries()) {
      if (entry.name != kOfEntry) entries_.push_back(entry);
    }
    record_ = std::move(record);
  } catch (...) {
    ::close(fd_);
    throw;
  }
}

BinaryFile::~BinaryFile() { ::close(fd_); }

void BinaryFile::read_at(std::uint64_t offset, std::uint64_t count, std::vector<std::uint8_t>& out,
                         std::string_view what) const {
  if (offset > size_ || count > size_ - offset) {
    throw InputError(path_, std::string(what),
                     "has " + std::to_string(count) + " bytes from byte " + std::to_string(offset) +
                         " on, but the file ends at " + std::to_string(size_));
  }
  out.resize(count);
  for (std::uint64_t done = 0; done < count;) {
    const ssize_t n =
        ::pread(fd_, out.data() + done, count - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw InputError(errno_message(path_, "can't be read"));
    if (n == 0) throw InputError(path_, "", "was shortened while it was read");
    done += static_cast<std::uint64_t>(n);
  }
}

std::uint32_t BinaryFile::crc32() const {
  std::uint32_t crc = 0;
  std::vector<std::uint8_t> piece;
  for (std::uint64_t at = 0; at < size_; at += piece.size()) {
    read_at(at, std::min<std::uint64_t>(kPieceBytes, size_ - at), piece, "");
    crc = isal::crc32(crc, piece.data(), piece.size());
  }
  return crc;
}

void BinaryFile::read(const Entry& entry, std::uint64_t limit,
                      std::vector<std::uint8_t>& out) const {
  record_->read(entry, limit, out);
}

BinaryOutput::BinaryOutput(const std::string& path, std::string keep_from)
    : ContainerOutput(path), keep_from_(std::move(keep_from)) {
  check_new_file(path);
}

void BinaryOutput::finish(const ExecutionContext& context, const Check& check) {
  context.check_cancelled();
  Temporary temporary{make_temporary(path_)};
  OutputFile file(temporary.path, path_);
  std::vector<std::uint8_t> piece;
  std::uint32_t crc = 0;
  std::uint64_t bytes = 0, total = 1;
  for (const Source& source : sources_) total += source.name.empty() ? source.size : 0;
  for (const Source& source : sources_) {
    if (!source.name.empty()) continue;
    context.check_cancelled();
    source.make(piece);
    file.write(piece, bytes);
    crc = isal::crc32(crc, piece.data(), piece.size());
    crc_ = isal::crc32(crc_, piece.data(), piece.size());
    xor_ = std::accumulate(piece.begin(), piece.end(), xor_, std::bit_xor<std::uint8_t>());
    bytes += piece.size();
    context.report("write", static_cast<double>(bytes) / static_cast<double>(total));
  }
  file.close();
  context.report("write", 1);
  if (!keep_from_.empty()) copy_mode(keep_from_, temporary.path);
  sync_file(temporary.path);

  // The record is there before the file that it is of: whatever happens between, a file is never
  // taken for another than it is.
  const Temporary record{record_beside(temporary.path)};
  bool has_record = false;
  ZipOutput zip(record.path);
  zip.add_text(kOfEntry, nlohmann::json{{"bytes", bytes}, {"crc32", crc}}.dump() + "\n");
  for (const Source& source : sources_) {
    if (source.name.empty()) continue;
    source.make(piece);
    zip.add(source.name, piece);
    has_record = true;
  }
  if (has_record) zip.finish({}, {});
  context.check_cancelled();
  if (check) check(temporary.path);
  rename_with_record(temporary.path, path_);
  temporary.keep = true;
  sync_folder(folder_);
}

}  // namespace slicecorr::detail

namespace slicecorr {

std::string record_beside(const std::string& path) { return path + ".slicecorr"; }

void rename_with_record(const std::string& from, const std::string& to) {
  const auto rename = [&](const std::string& a, const std::string& b) {
    if (::rename(a.c_str(), b.c_str()) != 0) {
      throw DeviceError(detail::errno_message(b, "can't be written"));
    }
  };
  const std::string record = record_beside(from), old = record_beside(to);
  const bool has_record = ::access(record.c_str(), F_OK) == 0;
  if (has_record) rename(record, old);
  rename(from, to);
  // What is there without one is of another file now.
  if (!has_record) ::unlink(old.c_str());
}

}  // namespace slicecorr
