// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any folder of numbered images.

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/exposure_pattern.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::string_view kSuffix = ".png";

/// What an image's name is before its digits; nothing when it is no name of an image.
std::optional<std::string> prefix_of(std::string_view name) {
  if (!name.ends_with(kSuffix) || name.find('/') != name.npos) return std::nullopt;
  name.remove_suffix(kSuffix.size());
  const std::size_t digits = name.find_last_not_of("0123456789") + 1;  // npos + 1 is 0
  if (digits == name.size()) return std::nullopt;
  return std::string(name.substr(0, digits));
}

std::map<std::string, int> count_prefixes(const Container& archive) {
  std::map<std::string, int> count;
  for (const Container::Entry& entry : archive.entries()) {
    if (const auto prefix = prefix_of(entry.name)) ++count[*prefix];
  }
  return count;
}

/// The prefix that most images have.
std::string image_prefix(const Container& archive, std::vector<std::string>& warnings) {
  const std::map<std::string, int> count = count_prefixes(archive);
  if (count.empty()) {
    throw InputError(archive.path(), "",
                     "has no layer images, expected PNGs whose names end in a number, like "
                     "00000000.png, on");
  }
  const auto most = std::max_element(
      count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  for (const auto& [prefix, images] : count) {
    if (prefix == most->first) continue;
    if (images == most->second) {
      throw InputError(archive.path(), "",
                       fmt::format("holds as many images named {}NUMBER.png as {}NUMBER.png, "
                                   "expected one stack",
                                   shown_name(most->first), shown_name(prefix)));
    }
    warnings.push_back(fmt::format("{} named {}NUMBER.png left out: most are named {}NUMBER.png",
                                   images == 1 ? "an image" : fmt::format("{} images", images),
                                   shown_name(prefix), shown_name(most->first)));
  }
  return most->first;
}

class Folder final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "folder"; }
  std::string_view what() const override { return "a folder of numbered PNG images"; }
  std::vector<std::string_view> endings() const override { return {"/"}; }
  ContainerKind container() const override { return ContainerKind::folder; }

  bool recognises(const Container& archive) const override {
    return archive.kind() == ContainerKind::folder;
  }

  ArchiveContents read(const Container& archive) const override {
    ArchiveContents contents;
    const std::string prefix = image_prefix(archive, contents.warnings);
    const auto entries = numbered_entries(archive, prefix, kSuffix);
    if (entries.size() > static_cast<std::size_t>(kMaxLayers)) {
      throw InputError(
          archive.path(), "",
          fmt::format("has {} images, expected at most {}", entries.size(), kMaxLayers));
    }
    const long first = entries.empty() ? 0 : entries.front().number;
    if (first > 1) {
      throw InputError(archive.path(), shown_name(entries.front().entry->name),
                       "is the first image, expected number 0 or 1");
    }
    contents.images =
        complete_names(archive, entries, first, "PNGs numbered from 0 or 1 with at most 9 digits");
    take_image_size(archive, {}, {}, "", false, contents);
    contents.info.grid.layers = contents.info.target_layers =
        static_cast<int>(contents.images.size());
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput&) const override {
    if (r.kept != nullptr) return continued_names(r, kSuffix);
    if (r.info.kind == StackKind::foreign) {
      warn(r, "a folder of images has no exposure times: these are lost");
    } else if (const double s = exposure_summary(r.info).normal_s;
               s > 0 && r.info.kind == StackKind::target) {
      warn(r,
           fmt::format("a folder of images holds no exposure times: set {:g} s at the printer", s));
    }
    std::vector<std::string> names;
    names.reserve(static_cast<std::size_t>(r.info.grid.layers));
    for (int n = 0; n < r.info.grid.layers; ++n) names.push_back(fmt::format("{:08}.png", n));
    return names;
  }
};

}  // namespace

const ArchiveFormat& folder_format() {
  static const Folder format;
  return format;
}

}  // namespace slicecorr::detail
