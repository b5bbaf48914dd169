// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/stack_preview.hpp"

#include <filesystem>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/png/png.hpp"

namespace slicecorr {

namespace {

/// As SL1, NanoDLP, UVJ, Chitubox' zip and others, VDT call it.
constexpr const char* kPreviewEntries[] = {"thumbnail/thumbnail400x400.png",
                                           "thumbnail/thumbnail800x480.png",
                                           "3d.png",
                                           "preview/huge.png",
                                           "preview.png",
                                           "Preview_FLT.png"};

}  // namespace

std::vector<std::uint8_t> detail::ArchiveFormat::preview(const Container& archive) const {
  for (const char* name : kPreviewEntries) {
    const Container::Entry* entry = archive.find(name);
    if (!entry || entry->bytes > kMostPreviewBytes) continue;
    std::vector<std::uint8_t> bytes;
    archive.read(*entry, kMostPreviewBytes, bytes);
    return bytes;
  }
  return {};
}

std::vector<std::uint8_t> preview_png(const std::string& path) {
  const std::string scratch = std::filesystem::temp_directory_path().string();
  const std::unique_ptr<detail::Container> archive = detail::open_container(path, scratch);
  std::vector<std::uint8_t> bytes = detail::recognise_format(*archive).preview(*archive);
  if (!is_preview_png(bytes)) bytes.clear();
  return bytes;
}

bool is_preview_png(const std::vector<std::uint8_t>& bytes) {
  if (bytes.empty() || bytes.size() > kMostPreviewBytes) return false;
  try {
    const detail::PngHeader head = detail::read_png_header(bytes, {"", "the picture"});
    return head.width <= kMostPreviewPx && head.height <= kMostPreviewPx;
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace slicecorr
