// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What an archive says, checked, without its images.
#include <algorithm>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/stack.hpp"
#include "stack/block_check.hpp"
#include "stack/coded_images.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/layer_places.hpp"
#include "stack/recording_entry.hpp"
#include "stack/stack_reader_parts.hpp"

namespace slicecorr {

namespace detail {

ArchiveContents read_contents(const Container& archive) {
  const ArchiveFormat& format = recognise_format(archive);
  ArchiveContents contents = read_with_places(format, archive);
  contents.info.format = format.name();
  if (archive.has(kProvenanceEntry)) {
    if (contents.info.kind != StackKind::foreign) {
      throw InputError(archive.path(), kProvenanceEntry,
                       "is a second record beside that of the archive; expected one of them");
    }
    const std::uint64_t limit = (std::uint64_t{64} << 20) + 256 * archive.entries().size();
    read_provenance(archive.text(kProvenanceEntry, limit), archive.path(), contents);
  }
  read_flat_field(archive, contents);
  read_recording(archive, contents);
  StackInfo& info = contents.info;
  if (contents.codec) {
    contents.facts.emplace_back("grey levels", std::to_string(levels_of(contents.codec->shown())));
    if (archive.kind() == ContainerKind::binary && binary_file(archive).record_is_of_another()) {
      contents.warnings.push_back("the record beside it, " + record_beside(archive.path()) +
                                  ", is of another file: it does not count");
    }
  }
  // Some formats can say mirroring only: the orientation is known where they say that.
  if (info.orientation != Orientation{}) info.orientation_known = true;
  // Archives of other programs are made for a display.
  if (info.kind == StackKind::foreign) {
    info.for_display = true;
  } else if (!info.for_display) {
    info.orientation_known = true;
  }
  check_block(contents, archive.path());
  if (info.process && info.kind != StackKind::target) {
    // The process says them, exactly.
    info.light_share.clear();
    info.layer_heights_um.clear();
  } else {
    check_lit(info, archive.path());
  }
  const Grid& grid = info.grid;
  const std::size_t images = contents.codec ? coded_image_count(contents) : contents.images.size();
  if (grid.layers < 1 || grid.width_px < 1 || grid.height_px < 1 ||
      images != (info.exposures.empty() ? static_cast<std::size_t>(grid.layers)
                                        : info.exposures.size())) {
    throw Error("a format's reader gave no whole stack");
  }
  return contents;
}

std::vector<const Container::Entry*> entries_of(const Container& archive,
                                                const std::vector<std::string>& names,
                                                const Grid& grid) {
  // Twice the largest PNG pixel, 4 channels of 16 bits, and some for chunks that don't matter.
  const std::uint64_t limit = std::uint64_t{8} * static_cast<unsigned>(grid.width_px) *
                                  static_cast<unsigned>(grid.height_px) +
                              (1 << 20);
  std::vector<const Container::Entry*> entries;
  entries.reserve(names.size());
  for (const std::string& name : names) {
    const Container::Entry* const entry = archive.find(name);
    if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
    if (entry->bytes > limit) {
      throw InputError(archive.path(), name,
                       "declares " + std::to_string(entry->bytes) + " bytes, expected at most " +
                           std::to_string(limit));
    }
    entries.push_back(entry);
  }
  return entries;
}

}  // namespace detail

std::vector<std::pair<std::string, std::string>> print_file_facts(const std::string& path) {
  const detail::ContainerKind kind = detail::container_kind(path);
  if (kind != detail::ContainerKind::binary && kind != detail::ContainerKind::zip) return {};
  const auto file = detail::open_container(path, std::filesystem::temp_directory_path().string());
  if (!detail::recognise_format(*file).codes_layers()) return {};
  return detail::read_contents(*file).facts;
}

StackInfo StackReader::read_info(const std::string& path) {
  const std::string scratch = std::filesystem::temp_directory_path().string();
  const std::unique_ptr<detail::Container> archive = detail::open_container(path, scratch);
  detail::ArchiveContents contents = detail::read_contents(*archive);
  detail::entries_of(*archive, contents.images, contents.info.grid);
  detail::entries_of(*archive, contents.uv_images, contents.info.grid);
  detail::entries_of(*archive, contents.edge_images, contents.info.grid);
  return std::move(contents.info);
}

}  // namespace slicecorr
