// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/uploads.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <map>
#include <mutex>
#include <set>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/http/guard.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;
using http::ApiError;
using slicecorr::detail::errno_message;

namespace {

bool is_token(const std::string& text) {
  return text.size() == 32 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

/// Whether an upload lies there that a server had begun which is no more.
bool was_cut_short(const fs::path& upload) {
  std::error_code error;
  for (const auto& file : fs::directory_iterator(upload, error)) {
    const auto name = slicecorr::detail::temporary_name(file.path().filename().string());
    if (name && slicecorr::detail::is_gone(name->maker, upload.string())) return true;
  }
  return false;
}

/// How old uploads are. Since this process first saw one, its age goes by the clock that does not jump: where somebody
/// sets the computer's clock, no upload becomes old before its time.
class Ages {
 public:
  double age_s(const std::string& upload, double at_first_s) {
    const std::scoped_lock lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    const Seen& seen = seen_.try_emplace(upload, Seen{now, at_first_s}).first->second;
    return seen.age_s + std::chrono::duration<double>(now - seen.at).count();
  }
  void forget_others(const std::string& folder, const std::set<std::string>& uploads) {
    const std::scoped_lock lock(mutex_);
    std::erase_if(seen_, [&](const auto& one) {
      return one.first.starts_with(folder) && !uploads.contains(one.first);
    });
  }

 private:
  struct Seen {
    std::chrono::steady_clock::time_point at;
    double age_s;
  };
  std::mutex mutex_;
  std::map<std::string, Seen> seen_;
};
Ages& ages() {
  static Ages all;
  return all;
}

}  // namespace

bool is_file_name(const std::string& name) {
  return !name.empty() && name.size() <= 200 && name[0] != '.' && name[0] != '-' &&
         name.find_first_of("/\\") == std::string::npos && text::printable(name) == name;
}

std::string upload_path(const FarmFolder& folder, const std::string& part) {
  constexpr std::string_view scheme = "upload:";
  if (!part.starts_with(scheme)) return {};
  const std::string rest = part.substr(scheme.size());
  const std::size_t slash = rest.find('/');
  if (slash == std::string::npos || !is_token(rest.substr(0, slash)) ||
      !is_file_name(rest.substr(slash + 1))) {
    return {};
  }
  return folder.root + "/uploads/" + rest;
}

Upload::Upload(const FarmFolder& folder, const std::string& name) {
  if (!is_file_name(name)) {
    throw ApiError(400, "name", "expected the name of a file: no folders, no leading dot");
  }
  const std::string token = random_token();
  folder_ = folder.root + "/uploads/" + token;
  text_ = "upload:" + token + "/" + name;
  path_ = folder_ + "/" + name;
  std::error_code error;
  slicecorr::detail::make_lasting_folder(folder_);
  ages().age_s(folder_, 0);
  try {
    part_ = slicecorr::detail::make_temporary(path_);
    file_ = ::open(part_.c_str(), O_WRONLY | O_CLOEXEC);
    if (file_ < 0 || ::fchmod(file_, 0600) != 0) {
      throw DeviceError(errno_message(path_, "can't be made"));
    }
  } catch (...) {
    if (file_ >= 0) ::close(file_);
    fs::remove_all(folder_, error);
    throw;
  }
}

Upload::~Upload() {
  if (file_ < 0) return;
  ::close(file_);
  std::error_code error;
  fs::remove_all(folder_, error);
}

void Upload::write(const char* data, std::size_t size) {
  while (size > 0) {
    const ssize_t n = ::write(file_, data, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) throw DeviceError(errno_message(part_, "can't be written"));
    data += n;
    size -= static_cast<std::size_t>(n);
    bytes_ += n;
  }
}

std::string Upload::keep() {
  if (::fsync(file_) != 0 || ::rename(part_.c_str(), path_.c_str()) != 0) {
    throw DeviceError(errno_message(path_, "can't be written"));
  }
  ::close(file_);
  file_ = -1;
  slicecorr::detail::sync_folder(slicecorr::detail::path_parts(path_).folder);
  return text_;
}

std::int64_t clean_uploads(const FarmFolder& folder, double kept_s) {
  std::int64_t bytes = 0;
  std::error_code error;
  const auto now = fs::file_time_type::clock::now();
  std::set<std::string> there;
  for (const auto& entry : fs::directory_iterator(folder.root + "/uploads", error)) {
    if (!is_token(entry.path().filename().string())) continue;
    const auto changed = fs::last_write_time(entry.path(), error);
    if (error) continue;
    there.insert(entry.path().string());
    const double age_s = std::chrono::duration<double>(now - changed).count();
    if (ages().age_s(entry.path().string(), age_s) > kept_s || was_cut_short(entry.path())) {
      fs::remove_all(entry.path(), error);
      continue;
    }
    for (const auto& file : fs::directory_iterator(entry.path(), error)) {
      const auto size = file.file_size(error);
      if (!error) bytes += static_cast<std::int64_t>(size);
    }
  }
  ages().forget_others(folder.root + "/", there);
  return bytes;
}

}  // namespace slicecorr::farm::detail
