// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <zip.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <memory>
#include <unordered_map>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "stack/container/zip_output.hpp"
#include "stack/container/zip_pack.hpp"
#include "support/files/errno_message.hpp"
#include "support/text/utf8.hpp"

namespace slicecorr::detail {

/// The entry that is being written. Only one is open at a time, so all share one buffer.
struct ZipWriting {
  const ExecutionContext& context;
  const std::vector<ZipOutput::Source>& sources;
  int level = 0;  ///< of images
  std::vector<std::uint8_t> data;
  std::size_t at = 0;
  /// Thrown by `fill` or by the user's callback: it must not pass through the C library.
  std::exception_ptr error;
  std::unordered_map<std::size_t, PackedEntry> packed;  ///< by place in `sources`

  struct Entry {
    ZipWriting* writing;
    std::size_t place;  ///< in `sources`
    bool deflate_here;  ///< else it is left to the zip library, where it is deflated at all
    bool done = false;
    std::uint64_t packed_bytes = 0;  ///< once it was deflated here
    std::uint32_t crc32 = 0;
  };
  std::vector<Entry> entries;

  /// Deflates the entry and some that follow, on all threads.
  const PackedEntry& packed_entry(std::size_t place) {
    const auto found = packed.find(place);
    if (found != packed.end()) return found->second;
    std::vector<std::size_t> batch;
    std::uint64_t bytes = 0;
    for (std::size_t i = place; i < entries.size() && bytes < kZipBatchBytes; ++i) {
      const Entry& entry = entries[i];
      if (i != place && (!entry.deflate_here || entry.done || packed.contains(i))) continue;
      batch.push_back(i);
      bytes += sources[i].size;
    }
    std::vector<PackedEntry> made(batch.size());
    parallel_for(silent(context), "", batch.size(), [&](std::size_t i) {
      std::vector<std::uint8_t> contents;
      sources[batch[i]].make(contents);
      made[i] = deflate_entry(contents, level);
    });
    for (std::size_t i = 0; i < batch.size(); ++i) packed[batch[i]] = std::move(made[i]);
    return packed[place];
  }

  void report(double fraction) {
    try {
      context.report("write", std::clamp(fraction, 0.0, 1.0));
    } catch (...) {
      error = std::current_exception();
    }
  }

  bool stopped() const { return error || (context.cancel != nullptr && context.cancel->load()); }

  static zip_int64_t call(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
    Entry& entry = *static_cast<Entry*>(state);
    ZipWriting& writing = *entry.writing;
    try {
      return writing.answer(entry, data, length, command);
    } catch (...) {
      writing.error = std::current_exception();
      return -1;
    }
  }

  zip_int64_t answer(Entry& entry, void* out, zip_uint64_t length, zip_source_cmd_t command) {
    const ZipOutput::Source& source = sources[entry.place];
    switch (command) {
      case ZIP_SOURCE_OPEN:
        at = 0;
        if (entry.deflate_here) {
          data = packed_entry(entry.place).data;
        } else {
          source.make(data);
        }
        return 0;
      case ZIP_SOURCE_READ: {
        const std::size_t n = std::min<std::size_t>(length, data.size() - at);
        std::memcpy(out, data.data() + at, n);
        at += n;
        return static_cast<zip_int64_t>(n);
      }
      case ZIP_SOURCE_STAT: {
        auto* const status = static_cast<zip_stat_t*>(out);
        zip_stat_init(status);
        status->size = source.size;
        status->valid = ZIP_STAT_SIZE;
        if (entry.deflate_here) {
          if (!entry.done) {
            const PackedEntry& its = packed_entry(entry.place);
            entry.packed_bytes = its.data.size();
            entry.crc32 = its.crc32;
          }
          status->comp_method = ZIP_CM_DEFLATE;
          status->comp_size = entry.packed_bytes;
          status->crc = entry.crc32;
          status->valid |= ZIP_STAT_COMP_METHOD | ZIP_STAT_COMP_SIZE | ZIP_STAT_CRC;
        }
        return sizeof *status;
      }
      case ZIP_SOURCE_ERROR: {
        const int codes[2] = {ZIP_ER_INTERNAL, 0};
        std::memcpy(out, codes, sizeof codes);
        return sizeof codes;
      }
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE,
                                              ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE,
                                              -1);
      case ZIP_SOURCE_CLOSE:
        entry.done = true;
        packed.erase(entry.place);
        return 0;
      case ZIP_SOURCE_FREE:
        return 0;
      default:
        return -1;
    }
  }
};

namespace {

constexpr zip_uint32_t kTextLevel = 9;

std::string zip_text(zip_error_t* error) {
  // The text of the system alone says more to the user than with the library's in front.
  if (zip_error_system_type(error) == ZIP_ET_SYS && zip_error_code_system(error) != 0) {
    return std::generic_category().message(zip_error_code_system(error));
  }
  return zip_error_strerror(error);
}

/// Whether what failed is reading: of the archive that is changed, not of what is written.
/// `system`: the error of the system that the library had, which tells a disk without room.
bool is_of_reading(int code, int system) {
  if (system == ENOSPC || system == EDQUOT || system == EFBIG) return false;
  switch (code) {
    case ZIP_ER_NOZIP:
    case ZIP_ER_INCONS:
    case ZIP_ER_READ:
    case ZIP_ER_SEEK:
    case ZIP_ER_EOF:
    case ZIP_ER_CRC:
    case ZIP_ER_ZLIB:
    case ZIP_ER_COMPRESSED_DATA:
      return true;
    default:
      return false;
  }
}

/// Names that continue those of the archive are in its encoding, which need not be UTF-8 and may be
/// unknown: then their bytes are taken as they are.
zip_flags_t encoding_of(std::string_view name) {
  const bool as_said = is_utf8(name) && std::none_of(name.begin(), name.end(), [](char c) {
                         return static_cast<unsigned char>(c) < 32;
                       });
  return as_said ? ZIP_FL_ENC_UTF_8 : ZIP_FL_ENC_GUESS;
}

/// Where the entries are, by the bytes of their names: the library looks for what it takes to be
/// meant by them.
std::unordered_map<std::string, zip_uint64_t> indices_of(zip_t* zip) {
  std::unordered_map<std::string, zip_uint64_t> index_of;
  for (zip_int64_t i = 0; i < zip_get_num_entries(zip, 0); ++i) {
    const auto index = static_cast<zip_uint64_t>(i);
    if (const char* const name = zip_get_name(zip, index, ZIP_FL_ENC_RAW)) {
      index_of.emplace(name, index);
    }
  }
  return index_of;
}

/// Has the library report to `writing` and ask it whether to stop.
void listen(zip_t* zip, const ExecutionContext& context, ZipWriting& writing) {
  const auto on_progress = [](zip_t*, double fraction, void* state) {
    static_cast<ZipWriting*>(state)->report(fraction);
  };
  const auto on_cancel = [](zip_t*, void* state) -> int {
    return static_cast<ZipWriting*>(state)->stopped() ? 1 : 0;
  };
  if (context.progress) {
    zip_register_progress_callback_with_state(zip, 0.01, on_progress, nullptr, &writing);
  }
  zip_register_cancel_callback_with_state(zip, on_cancel, nullptr, &writing);
}

}  // namespace

void ZipOutput::change(const std::string& temporary, const ExecutionContext& context) {
  ZipWriting writing{context, sources_, zip_image_level(images_), {}, 0, nullptr, {}, {}};
  std::vector<ZipWriting::Entry>& entries = writing.entries;
  entries.reserve(sources_.size());  // the library keeps pointers

  zip_error_t error;
  int code = 0;
  zip_t* const zip = zip_open(temporary.c_str(), 0, &code);
  // The archive was read before: if it can't be read now, it became another file since.
  const auto changed = [&] { return InputError(keep_from_, "", "was changed while it was read"); };
  if (zip == nullptr && is_of_reading(code, errno)) throw changed();
  if (zip == nullptr) throw DeviceError(errno_message(path_, "can't be written"));
  // After the entries: discarding the archive still calls them.
  std::unique_ptr<zip_t, decltype(&zip_discard)> guard(zip, &zip_discard);
  const auto fail = [&](zip_error_t* e) {
    if (is_of_reading(zip_error_code_zip(e), zip_error_code_system(e))) throw changed();
    throw DeviceError(path_ + ": can't be written: " + zip_text(e));
  };

  const auto set_packed = [&](const std::string& name, zip_uint64_t index, bool packed) {
    entries.back().deflate_here = packed && is_zipped_image(name);
    return zip_set_file_compression(zip, index, packed ? ZIP_CM_DEFLATE : ZIP_CM_STORE,
                                    kTextLevel) == 0;
  };
  const auto index_of = indices_of(zip);
  for (const std::string& name : left_out_) {
    const auto kept = index_of.find(name);
    if (kept != index_of.end() && zip_delete(zip, kept->second) != 0) fail(zip_get_error(zip));
  }
  ImagePacking images = images_;
  for (const Source& source : sources_) {
    entries.push_back({&writing, entries.size(), false});
    zip_error_init(&error);
    zip_source_t* const made =
        zip_source_function_create(&ZipWriting::call, &entries.back(), &error);
    if (made == nullptr) fail(&error);
    if (const auto kept = index_of.find(source.name); kept != index_of.end()) {
      const zip_uint64_t index = kept->second;
      zip_stat_t was;
      if (zip_stat_index(zip, index, 0, &was) != 0) fail(zip_get_error(zip));
      if (zip_file_replace(zip, index, made, 0) != 0) {
        zip_source_free(made);
        fail(zip_get_error(zip));
      }
      const bool packed = was.comp_method != ZIP_CM_STORE ||
                          (images_ == ImagePacking::smallest && is_zipped_image(source.name));
      if (is_zipped_image(source.name)) {
        images = !packed                             ? ImagePacking::stored
                 : images_ == ImagePacking::smallest ? images_
                                                     : ImagePacking::deflated;
      }
      if (!set_packed(source.name, index, packed) ||
          zip_file_set_mtime(zip, index, was.mtime, 0) != 0) {
        fail(zip_get_error(zip));
      }
      continue;
    }
    const zip_int64_t added =
        zip_file_add(zip, source.name.c_str(), made, encoding_of(source.name));
    if (added < 0) {
      zip_source_free(made);
      fail(zip_get_error(zip));
    }
    const auto index = static_cast<zip_uint64_t>(added);
    constexpr zip_uint16_t first_of_1980 = 1 << 5 | 1;
    const bool packed = is_zipped_image(source.name) && images != ImagePacking::stored;
    if (!set_packed(source.name, index, packed) ||
        zip_file_set_dostime(zip, index, 0, first_of_1980, 0) != 0) {
      fail(zip_get_error(zip));
    }
  }
  listen(zip, context, writing);
  if (zip_close(zip) != 0) {
    if (writing.error) std::rethrow_exception(writing.error);
    if (zip_error_code_zip(zip_get_error(zip)) == ZIP_ER_CANCELLED) throw Cancelled();
    fail(zip_get_error(zip));
  }
  (void)guard.release();
}

}  // namespace slicecorr::detail
