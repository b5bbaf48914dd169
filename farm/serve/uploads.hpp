// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uploads.hpp
/// Parts that came over HTTP and wait for a submission: DIR/uploads/TOKEN/NAME.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "slicecorr/farm/folder.hpp"

namespace slicecorr::farm::detail {

/// "upload:TOKEN/NAME" to the path of a part that was uploaded; empty where it is no such text.
std::string upload_path(const FarmFolder& folder, const std::string& part);

/// Whether a name is one file's name and nothing else: no folders, no control characters.
bool is_file_name(const std::string& name);

/// A part while it comes; goes again unless it is kept.
class Upload {
 public:
  /// Throws `ApiError` for other names, and `DeviceError`.
  Upload(const FarmFolder& folder, const std::string& name);
  ~Upload();
  Upload(const Upload&) = delete;
  Upload& operator=(const Upload&) = delete;
  void write(const char* data, std::size_t size);
  /// Gives "upload:TOKEN/NAME".
  std::string keep();
  std::int64_t bytes() const { return bytes_; }

 private:
  std::string folder_, part_, path_, text_;
  int file_ = -1;
  std::int64_t bytes_ = 0;
};

/// Removes parts that were uploaded before a time, and what a server that is no more had begun; gives the size of the
/// others.
std::int64_t clean_uploads(const FarmFolder& folder, double kept_s);

}  // namespace slicecorr::farm::detail
