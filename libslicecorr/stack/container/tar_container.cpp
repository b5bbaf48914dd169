// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/tar_container.hpp"

#include <stdio.h>

#include <algorithm>
#include <cerrno>
#include <unordered_map>

#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "stack/blob_store.hpp"
#include "stack/container/tar_functions.hpp"
#include "stack/container/tar_reader.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kMemoryBudget = std::size_t{64} << 20;

class TarContainer final : public Container {
 public:
  TarContainer(const std::string& path, const std::string& scratch_folder,
               const ExecutionContext& context)
      : Container(path), store_(scratch_folder, kMemoryBudget, context) {
    TarReader tar(path);
    std::vector<std::uint8_t> data(kPieceBytes);
    while (tar.next()) {
      if (tar.is_folder()) continue;
      context.check_cancelled();
      entries_.push_back({tar.name(), first_piece_.size(), tar.bytes()});
      first_piece_.push_back(blobs_.size());
      while (const std::size_t n = tar.read(data)) blobs_.push_back(store_.put(data.data(), n));
    }
    first_piece_.push_back(blobs_.size());
    finish_list();
  }

  ContainerKind kind() const override { return ContainerKind::tar_gz; }

  void read(const Entry& entry, std::uint64_t limit,
            std::vector<std::uint8_t>& out) const override {
    if (entry.bytes > limit) {
      throw InputError(path_, shown_name(entry.name),
                       "entry has " + std::to_string(entry.bytes) + " bytes, expected at most " +
                           std::to_string(limit));
    }
    out.clear();
    out.reserve(entry.bytes);
    for (std::size_t i = first_piece_[entry.index]; i < first_piece_[entry.index + 1]; ++i) {
      store_.get(blobs_[i], out);
    }
  }

 private:
  BlobStore store_;
  std::vector<BlobStore::Blob> blobs_;
  std::vector<std::size_t> first_piece_;  ///< of each entry, and the end
};

/// A tar.gz that is being written.
class TarWriter {
 public:
  TarWriter(const std::string& file, const std::string& shown_path)
      : path_(shown_path), tar_(libarchive().write_new(), libarchive().write_free) {
    if (!tar_) throw std::bad_alloc();
    // Plain ustar headers wherever they can say it all: printers read little else.
    check(libarchive().write_set_format_pax_restricted(tar_.get()));
    check(libarchive().write_add_filter_gzip(tar_.get()));
    check(libarchive().write_set_filter_option(tar_.get(), "gzip", "timestamp", nullptr));
    check(libarchive().write_set_bytes_in_last_block(tar_.get(), 1));
    check(libarchive().write_open_filename(tar_.get(), file.c_str()));
  }

  void begin(archive_entry* header) {
    const int result = libarchive().write_header(tar_.get(), header);
    // A warning: the name is in no encoding that the locale has, and is written as it is.
    if (result != ARCHIVE_WARN) check(result);
  }
  void write(std::span<const std::uint8_t> data) {
    while (!data.empty()) {
      const la_ssize_t n = libarchive().write_data(tar_.get(), data.data(), data.size());
      if (n <= 0) fail();
      data = data.subspan(static_cast<std::size_t>(n));
    }
  }
  void close() { check(libarchive().write_close(tar_.get())); }

 private:
  void check(int result) {
    if (result != ARCHIVE_OK) fail();
  }
  [[noreturn]] void fail() {
    // The text of the system alone says more than the library's, which names the temporary file.
    const int error = libarchive().error_number(tar_.get());
    if (error > 0) throw DeviceError(errno_message(path_, "can't be written", error));
    const char* const text = libarchive().error_string(tar_.get());
    throw DeviceError(path_ + ": can't be written: " + (text != nullptr ? text : "unknown error"));
  }

  std::string path_;
  std::unique_ptr<archive, decltype(TarFunctions::write_free)> tar_;
};

class TarGzOutput final : public ContainerOutput {
 public:
  TarGzOutput(const std::string& path, std::string keep_from)
      : ContainerOutput(path), keep_from_(std::move(keep_from)) {
    check_new_file(path);
  }

  void finish(const ExecutionContext& context, const Check& check) override {
    context.check_cancelled();
    Temporary temporary{make_temporary(path_)};
    write(temporary.path, context);
    if (!keep_from_.empty()) copy_mode(keep_from_, temporary.path);
    sync_file(temporary.path);
    context.check_cancelled();
    if (check) check(temporary.path);
    put_in_place(temporary, path_);
  }

 private:
  void write(const std::string& file, const ExecutionContext& context);
  void write_source(const Source& source, archive_entry* header, TarWriter& tar,
                    const ExecutionContext& context);

  std::string keep_from_;
  std::vector<std::uint8_t> data_;
  double done_ = 0, total_ = 0;  ///< bytes, of which kept ones count as packed
};

void TarGzOutput::write_source(const Source& source, archive_entry* header, TarWriter& tar,
                               const ExecutionContext& context) {
  context.check_cancelled();
  source.make(data_);
  libarchive().entry_set_size(header, static_cast<la_int64_t>(source.size));
  tar.begin(header);
  tar.write(data_);
  done_ += static_cast<double>(source.size);
  context.report("write", std::min(1.0, done_ / total_));
}

void TarGzOutput::write(const std::string& file, const ExecutionContext& context) {
  total_ = 1;
  for (const Source& source : sources_) total_ += static_cast<double>(source.size);
  std::unordered_map<std::string, std::size_t> by_name;
  std::vector<bool> written(sources_.size());
  TarWriter tar(file, path_);
  if (!keep_from_.empty()) {
    for (std::size_t i = 0; i < sources_.size(); ++i) by_name.emplace(sources_[i].name, i);
    TarReader kept(keep_from_);
    std::vector<std::uint8_t> block(kPieceBytes);
    while (kept.next()) {
      context.check_cancelled();
      archive_entry* const header = kept.header();
      libarchive().entry_sparse_clear(header);
      const auto found = kept.is_folder() ? by_name.end() : by_name.find(kept.name());
      if (found != by_name.end()) {
        write_source(sources_[found->second], header, tar, context);
        written[found->second] = true;
        continue;
      }
      tar.begin(header);
      while (const std::size_t n = kept.read(block)) tar.write(std::span(block).first(n));
    }
  }
  const std::unique_ptr<archive_entry, decltype(TarFunctions::entry_free)> header(
      libarchive().entry_new(), libarchive().entry_free);
  if (!header) throw std::bad_alloc();
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (written[i]) continue;
    libarchive().entry_clear(header.get());
    libarchive().entry_set_pathname(header.get(), sources_[i].name.c_str());
    libarchive().entry_set_filetype(header.get(), AE_IFREG);
    libarchive().entry_set_perm(header.get(), 0644);
    constexpr time_t first_of_1980 = 315532800;  // as in our zips, which know no earlier one
    libarchive().entry_set_mtime(header.get(), first_of_1980, 0);
    write_source(sources_[i], header.get(), tar, context);
  }
  tar.close();
  context.report("write", 1);
}

}  // namespace

std::unique_ptr<Container> open_tar_gz(const std::string& path, const std::string& scratch_folder,
                                       const ExecutionContext& context) {
  return std::make_unique<TarContainer>(path, scratch_folder, context);
}

std::unique_ptr<ContainerOutput> make_tar_gz_output(const std::string& path,
                                                    const std::string& keep_from) {
  return std::make_unique<TarGzOutput>(path, keep_from);
}

}  // namespace slicecorr::detail
