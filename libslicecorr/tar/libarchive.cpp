// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The module slicecorr-tar: libarchive.
#include "stack/container/tar_functions.hpp"

namespace slicecorr::detail {
namespace {

constexpr TarFunctions kFunctions{
    .error_number = archive_errno,
    .error_string = archive_error_string,
    .set_error = archive_set_error,
    .read_new = archive_read_new,
    .read_free = archive_read_free,
    .read_support_format_tar = archive_read_support_format_tar,
    .read_open = archive_read_open,
    .read_next_header = archive_read_next_header,
    .read_header_position = archive_read_header_position,
    .read_data = archive_read_data,
    .write_new = archive_write_new,
    .write_free = archive_write_free,
    .write_set_format_pax_restricted = archive_write_set_format_pax_restricted,
    .write_add_filter_gzip = archive_write_add_filter_gzip,
    .write_set_filter_option = archive_write_set_filter_option,
    .write_set_bytes_in_last_block = archive_write_set_bytes_in_last_block,
    .write_open_filename = archive_write_open_filename,
    .write_header = archive_write_header,
    .write_data = archive_write_data,
    .write_close = archive_write_close,
    .entry_new = archive_entry_new,
    .entry_free = archive_entry_free,
    .entry_clear = archive_entry_clear,
    .entry_filetype = archive_entry_filetype,
    .entry_hardlink = archive_entry_hardlink,
    .entry_pathname = archive_entry_pathname,
    .entry_pathname_utf8 = archive_entry_pathname_utf8,
    .entry_size = archive_entry_size,
    .entry_set_filetype = archive_entry_set_filetype,
    .entry_set_mtime = archive_entry_set_mtime,
    .entry_set_pathname = archive_entry_set_pathname,
    .entry_set_perm = archive_entry_set_perm,
    .entry_set_size = archive_entry_set_size,
    .entry_sparse_clear = archive_entry_sparse_clear,
};

}  // namespace
}  // namespace slicecorr::detail

extern "C" __attribute__((visibility("default"))) const slicecorr::detail::TarFunctions*
slicecorr_tar_functions() {
  return &slicecorr::detail::kFunctions;
}
