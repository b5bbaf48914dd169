// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/part_form.hpp"

#include <algorithm>
#include <string_view>

namespace slicecorr::farm::detail {

namespace {

/// The text in quotes behind `key="`; empty: it is not there.
std::string quoted_after(std::string_view head, const std::string& key) {
  const std::size_t at = head.find(key + "=\"");
  if (at == head.npos) return {};
  const std::size_t begin = at + key.size() + 2, end = head.find('"', begin);
  return end == head.npos ? std::string() : std::string(head.substr(begin, end - begin));
}

}  // namespace

std::optional<PartForm> read_part_form(const std::string& content_type, const std::string& body) {
  const std::size_t at = content_type.find("boundary=");
  if (!content_type.starts_with("multipart/form-data") || at == content_type.npos)
    return std::nullopt;
  std::string boundary = content_type.substr(at + 9);
  boundary.resize(std::min(boundary.find(';'), boundary.size()));
  std::erase(boundary, '"');
  if (boundary.empty() || boundary.size() > 70) return std::nullopt;
  const std::string mark = "--" + boundary;
  PartForm form;
  std::size_t place = body.find(mark);
  for (int fields = 0; place != body.npos && fields < 16; ++fields) {
    place += mark.size();
    if (body.compare(place, 2, "--") == 0) return form;
    const std::size_t head_end = body.find("\r\n\r\n", place);
    const std::size_t next = body.find("\r\n" + mark, head_end);
    if (head_end == body.npos || next == body.npos) return std::nullopt;
    const std::string_view head(body.data() + place, head_end - place);
    std::string value = body.substr(head_end + 4, next - head_end - 4);
    // " name=", as in "; name=", is no end of "filename=".
    const std::string name = quoted_after(head, " name");
    if (name == "File") {
      form.file_name = quoted_after(head, "filename");
      form.bytes = std::move(value);
    } else if (value.size() <= 200) {
      form.fields[name] = std::move(value);
    }
    place = next + 2;
  }
  return std::nullopt;
}

std::string PartForm::text(const char* key) const {
  const auto found = fields.find(key);
  return found == fields.end() ? std::string() : found->second;
}

std::int64_t PartForm::number(const char* key) const {
  const std::string digits = text(key);
  if (digits.empty() || digits.size() > 15) return -1;
  return digits.find_first_not_of("0123456789") == digits.npos ? std::stoll(digits) : -1;
}

}  // namespace slicecorr::farm::detail
