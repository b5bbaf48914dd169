// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What libarchive does for us, behind a module that is loaded when the first tar is met: with it
/// come eight more libraries, an eighth of the time in which programs start.
#pragma once

#include <archive.h>
#include <archive_entry.h>

namespace slicecorr::detail {

/// libarchive's functions, which have these names after `archive_`.
struct TarFunctions {
  decltype(&archive_errno) error_number;
  decltype(&archive_error_string) error_string;
  decltype(&archive_set_error) set_error;

  decltype(&archive_read_new) read_new;
  decltype(&archive_read_free) read_free;
  decltype(&archive_read_support_format_tar) read_support_format_tar;
  decltype(&archive_read_open) read_open;
  decltype(&archive_read_next_header) read_next_header;
  decltype(&archive_read_header_position) read_header_position;
  decltype(&archive_read_data) read_data;

  decltype(&archive_write_new) write_new;
  decltype(&archive_write_free) write_free;
  decltype(&archive_write_set_format_pax_restricted) write_set_format_pax_restricted;
  decltype(&archive_write_add_filter_gzip) write_add_filter_gzip;
  decltype(&archive_write_set_filter_option) write_set_filter_option;
  decltype(&archive_write_set_bytes_in_last_block) write_set_bytes_in_last_block;
  decltype(&archive_write_open_filename) write_open_filename;
  decltype(&archive_write_header) write_header;
  decltype(&archive_write_data) write_data;
  decltype(&archive_write_close) write_close;

  decltype(&archive_entry_new) entry_new;
  decltype(&archive_entry_free) entry_free;
  decltype(&archive_entry_clear) entry_clear;
  decltype(&archive_entry_filetype) entry_filetype;
  decltype(&archive_entry_hardlink) entry_hardlink;
  decltype(&archive_entry_pathname) entry_pathname;
  decltype(&archive_entry_pathname_utf8) entry_pathname_utf8;
  decltype(&archive_entry_size) entry_size;
  decltype(&archive_entry_set_filetype) entry_set_filetype;
  decltype(&archive_entry_set_mtime) entry_set_mtime;
  decltype(&archive_entry_set_pathname) entry_set_pathname;
  decltype(&archive_entry_set_perm) entry_set_perm;
  decltype(&archive_entry_set_size) entry_set_size;
  decltype(&archive_entry_sparse_clear) entry_sparse_clear;
};

/// Loads the module at the first call. Thread-safe. Throws `DeviceError` when it is not there.
const TarFunctions& libarchive();

/// Name of the function by which the module gives its functions.
inline constexpr const char* kTarModuleEntry = "slicecorr_tar_functions";

}  // namespace slicecorr::detail
