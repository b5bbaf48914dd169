// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/text_beside.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "post/beside.hpp"
#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kMostBytes = std::size_t{1} << 20;

}  // namespace

std::string write_text_beside(const std::string& path, const std::string& title,
                              const std::string& message) {
  const std::string to = path + ".txt";
  std::error_code ec;
  if (fs::symlink_status(to, ec).type() != fs::file_type::not_found) {
    const auto old = fs::is_regular_file(fs::symlink_status(to, ec)) ? text_of_file(to, kMostBytes)
                                                                     : std::nullopt;
    if (!old || !old->starts_with(kTextFirstWords)) return to + " is a file of somebody else";
  }
  std::string text = kTextFirstWords + title + "\n" + fs::path(path).filename().string() + "\n\n";
  std::size_t at = 0;
  while (at < message.size()) {
    const std::size_t end = std::min(message.find('\n', at), message.size());
    text += text::printable(message.substr(at, end - at)) + "\n";
    at = end + 1;
  }
  try {
    detail::check_new_file(to);
    detail::Temporary temporary{detail::make_temporary(to)};
    std::ofstream out(temporary.path, std::ios::binary);
    out << text;
    out.close();
    if (!out) return to + ": can't be written";
    fs::permissions(temporary.path, fs::status(path, ec).permissions() & ~fs::perms::owner_exec,
                    ec);
    detail::put_in_place(temporary, to);
  } catch (const Error& e) {
    return e.what();
  }
  return {};
}

}  // namespace slicecorr::post
