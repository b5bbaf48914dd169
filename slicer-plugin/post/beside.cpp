// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/beside.hpp"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/text_file.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

/// Figures and texts are of some kilobytes.
constexpr std::size_t kMostBytes = std::size_t{1} << 20;
/// A page says who made it in its first line.
constexpr std::size_t kPageHead = 512;

std::string beginning_of(const std::string& path) {
  std::string head(kPageHead, '\0');
  std::ifstream in(path, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(std::max<std::streamsize>(0, in.gcount())));
  return head;
}

bool is_our_page(const std::string& path) {
  return beginning_of(path).find(page::kGenerator) != std::string::npos;
}

bool are_our_figures(const std::string& path) {
  const auto text = text_of_file(path, kMostBytes);
  if (!text) return false;
  const auto json = slicecorr::detail::try_json<nlohmann::json>(*text);
  return json.is_object() && json.contains("target_voxels") && json.contains("height_error_um");
}

bool is_our_text(const std::string& path) {
  return beginning_of(path).starts_with(kTextFirstWords);
}

}  // namespace

std::vector<std::string> remove_beside(const std::string& name,
                                       const std::vector<std::string>& written) {
  struct Kind {
    const char* ending;
    bool (*ours)(const std::string& path);
  };
  std::vector<std::string> gone;
  for (const Kind& kind :
       {Kind{".html", is_our_page}, Kind{".json", are_our_figures}, Kind{".txt", is_our_text}}) {
    std::string path = name + kind.ending;
    std::error_code ec;
    if (!fs::is_regular_file(fs::symlink_status(path, ec)) || !kind.ours(path) ||
        std::find(written.begin(), written.end(), path) != written.end()) {
      continue;
    }
    if (!fs::remove(path, ec) && ec) {
      errno = ec.value();
      throw DeviceError(detail::errno_message(path, "can't be taken away"));
    }
    gone.push_back(std::move(path));
  }
  return gone;
}

}  // namespace slicecorr::post
