// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file archive_texts.hpp
/// Small archives of all formats that are zips, and the texts in them: settings, lists, G-code.
#pragma once

#include <vector>

#include "newer_print_file_fixture.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::fuzz {

struct ArchiveText {
  std::string file;  ///< name of the archive
  test::Entries entries;
  std::size_t entry = 0;  ///< which of them is the text
};

/// In a fixed order. Each archive once as ours, once as another program's: without our block.
inline std::vector<ArchiveText> archive_texts() {
  constexpr const char* ours = "slicecorr.json";
  const auto is_text = [](const std::string& name) {
    return !name.ends_with(".png") && name.find("slicecorr") == std::string::npos;
  };
  std::vector<ArchiveText> texts;
  for (const FormatInfo& format : archive_formats()) {
    const test::TemporaryFolder folder;
    StackFile file(folder / ("part" + (format.endings.empty() ? "" : format.endings[0])));
    file.format = format.name;
    test::Entries all;
    try {
      test::Images images = test::random_images(6, 5, 3, 21);
      StackInfo info = test::info_of(images.grid);
      info.exposure_s = 2.5;
      info.bottom_exposure_s = 30;
      info.bottom_layers = 1;
      test::write_stack(file, images, info);
      if (!std::filesystem::is_regular_file(file.path)) continue;
      if (test::read_file(file.path).at(0) != 'P') continue;
      all = test::unzip(file.path);
    } catch (const InputError&) {  // not made new
      continue;
    }
    const std::string name = std::filesystem::path(file.path).filename().string();
    test::Entries foreign = all;
    std::erase_if(foreign, [](const auto& e) { return e.first == ours; });
    for (std::size_t i = 0; i < foreign.size(); ++i) {
      if (is_text(foreign[i].first)) texts.push_back({name, foreign, i});
    }
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i].first == ours) texts.push_back({name, all, i});
    }
  }
  // Not made from nothing; its layers are in no PNG.
  const test::SmallFile anycubic = test::small_anycubic_zip();
  const test::Entries entries = test::anycubic_entries(anycubic.slices);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (is_text(entries[i].first)) texts.push_back({anycubic.name, entries, i});
  }
  return texts;
}

}  // namespace slicecorr::fuzz
