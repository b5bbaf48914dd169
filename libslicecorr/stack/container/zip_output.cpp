// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/zip_output.hpp"

#include <libdeflate.h>
#include <unistd.h>

#include <algorithm>
#include <memory>
#include <new>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "stack/container/output_file.hpp"
#include "stack/container/zip_layout.hpp"
#include "stack/container/zip_pack.hpp"
#include "stack/isa_l.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::detail {

namespace {

std::uint32_t crc32_of(const std::vector<std::uint8_t>& data) {
  return isal::crc32(0, data.data(), data.size());
}

}  // namespace

PackedEntry deflate_entry(const std::vector<std::uint8_t>& data, int level) {
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(level), &libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  PackedEntry packed;
  packed.data.resize(libdeflate_deflate_compress_bound(compressor.get(), data.size()));
  packed.data.resize(libdeflate_deflate_compress(compressor.get(), data.data(), data.size(),
                                                 packed.data.data(), packed.data.size()));
  packed.crc32 = crc32_of(data);
  return packed;
}

ZipOutput::ZipOutput(const std::string& path, std::string keep_from, ImagePacking images)
    : ContainerOutput(path), keep_from_(std::move(keep_from)), images_(images) {
  check_new_file(path);
}

void ZipOutput::finish(const ExecutionContext& context, const Check& check) {
  context.check_cancelled();
  Temporary temporary{make_temporary(path_)};
  if (keep_from_.empty()) {
    write(temporary.path, context);
  } else {
    // The library replaces the file under the temporary name; the original's stays as it is.
    ::unlink(temporary.path.c_str());
    link_or_copy(keep_from_, temporary.path);
    change(temporary.path, context);
    // The library leaves out the last step when it is a small one.
    context.report("write", 1);
    copy_mode(keep_from_, temporary.path);
  }
  sync_file(temporary.path);
  context.check_cancelled();
  if (check) check(temporary.path);
  put_in_place(temporary, path_);
}

void ZipOutput::write(const std::string& temporary, const ExecutionContext& context) {
  OutputFile file(temporary, path_);
  std::vector<ZipEntry> entries(sources_.size());
  std::uint64_t offset = 0, written = 0, synced = 0;
  const ExecutionContext quiet = silent(context);
  context.report("write", 0);
  for (std::size_t first = 0, last = 0; first < sources_.size(); first = last) {
    std::uint64_t bytes = 0;
    bool deflates = false;
    for (; last < sources_.size() && bytes < kZipBatchBytes; ++last) {
      const Source& source = sources_[last];
      ZipEntry& entry = entries[last];
      entry.name = source.name;
      entry.bytes = entry.packed_bytes = source.size;
      entry.deflated = images_ != ImagePacking::stored && is_zipped_image(source.name);
      deflates = deflates || entry.deflated;
      bytes += source.size;
    }
    // Where an entry lies is known once those before it are deflated.
    std::vector<PackedEntry> packed(deflates ? last - first : 0);
    parallel_for(quiet, "", packed.size(), [&](std::size_t i) {
      ZipEntry& entry = entries[first + i];
      if (!entry.deflated) return;
      std::vector<std::uint8_t> data;
      sources_[first + i].make(data);
      packed[i] = deflate_entry(data, zip_image_level(images_));
      entry.packed_bytes = packed[i].data.size();
      entry.crc32 = packed[i].crc32;
    });
    for (std::size_t i = first; i < last; ++i) {
      entries[i].offset = offset;
      offset += local_record_bytes(entries[i]) + entries[i].packed_bytes;
    }
    parallel_for(quiet, "", last - first + 1, [&](std::size_t i) {
      if (i == last - first) return file.begin_sync(synced, written);
      ZipEntry& entry = entries[first + i];
      std::vector<std::uint8_t> data, record;
      if (entry.deflated) {
        data = std::move(packed[i].data);
      } else {
        sources_[first + i].make(data);
        entry.crc32 = crc32_of(data);
      }
      append_local_record(entry, record);
      file.write(record, entry.offset);
      file.write(data, entry.offset + record.size());
    });
    synced = std::exchange(written, offset);
    context.report("write", static_cast<double>(last) / static_cast<double>(sources_.size()));
  }
  file.write(zip_directory(entries, offset), offset);
  file.close();
}

}  // namespace slicecorr::detail
