// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// UVJ: the open zip of UVtools and uv3dp, and our own stack.

#include <cstdio>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/png/preview.hpp"

namespace slicecorr::detail {
namespace {

std::string slice_name(int slice) {
  char text[40];
  std::snprintf(text, sizeof text, "slice/%08d.png", slice);
  return text;
}

/// The names of a folder's images in order; checks that there are exactly `count`: as many as
/// layers, or as nodes.
std::vector<std::string> list_images(const Container& archive, const std::string& folder,
                                     std::string (*name_of)(int), int count, int layers) {
  std::vector<std::string> names;
  for (const Container::Entry& entry : archive.entries()) {
    if (!entry.name.starts_with(folder)) continue;
    // Entries are sorted by name, which for names of equal length is the order of slices.
    const std::string expected = name_of(static_cast<int>(names.size()));
    if (entry.name != expected) {
      const bool gap = entry.name.size() == expected.size() && entry.name > expected;
      throw InputError(archive.path(), gap ? expected : shown_name(entry.name),
                       gap ? std::string("is missing")
                           : "is no name of a slice, expected " + name_of(0) + " on");
    }
    if (static_cast<int>(names.size()) == count) {
      throw InputError(archive.path(), entry.name,
                       (count > layers ? "is one node too many: config.json has "
                                       : "is one slice too many: config.json has ") +
                           std::to_string(layers) + " layers");
    }
    names.push_back(entry.name);
  }
  if (static_cast<int>(names.size()) != count) {
    throw InputError(archive.path(), name_of(static_cast<int>(names.size())),
                     "is missing: config.json has " + std::to_string(layers) + " layers");
  }
  return names;
}

class Uvj final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "uvj"; }
  std::string_view what() const override { return "UVJ, the vendor-neutral zip; our own stacks"; }
  std::vector<std::string_view> endings() const override { return {".uvj"}; }

  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }
  bool says_lifts() const override { return true; }

  bool recognises(const Container& archive) const override {
    // Others have a config.json, too; where half of it is missing the ending tells.
    const bool named = archive.path().ends_with(".uvj");
    const bool config = archive.has("config.json");
    const bool slices = !numbered_entries(archive, "slice/", ".png").empty();
    return (config && slices) || (named && (config || slices));
  }

  ArchiveContents read(const Container& archive) const override {
    // Grows with the layers, which it lists one by one.
    const std::uint64_t limit = (std::uint64_t{64} << 20) + 256 * archive.entries().size();
    ArchiveContents contents = parse_uvj_config(archive.text("config.json", limit), archive.path());
    const StackInfo& info = contents.info;
    const int layers = info.grid.layers;
    contents.images = list_images(archive, "slice/", slice_name, layers, layers);
    if (info.process && info.process->uv.kind == UvKind::patterned) {
      contents.uv_images = list_images(archive, "uv/", uv_image_name, layers, layers);
    }
    if (info.has_edge_heights) {
      contents.edge_images =
          list_images(archive, "slicecorr/surface/", edge_image_name, layers + 1, layers);
    }
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.kept != nullptr) {
      const std::uint64_t limit = (std::uint64_t{64} << 20) + 256 * r.kept->entries().size();
      output.add_text("config.json",
                      change_uvj_config(r.kept->text("config.json", limit), r.info, r.checksums,
                                        r.exposure_changes, r.light_changes));
    } else {
      output.add_text("config.json", write_uvj_config(r.info, r.checksums));
      if (!r.preview.pixels.empty()) {
        constexpr int tiny_preview_px = 128;
        output.add("preview/huge.png", encode_png(r.preview));
        output.add("preview/tiny.png", encode_png(shrink(r.preview, tiny_preview_px)));
      }
    }
    std::vector<std::string> names;
    names.reserve(static_cast<std::size_t>(r.info.grid.layers));
    for (int n = 0; n < r.info.grid.layers; ++n) names.push_back(slice_name(n));
    return names;
  }
};

}  // namespace

const ArchiveFormat& uvj_format() {
  static const Uvj format;
  return format;
}

}  // namespace slicecorr::detail
