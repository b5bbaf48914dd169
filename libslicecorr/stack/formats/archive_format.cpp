// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/archive_format.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/units.hpp"
#include "stack/formats/known_foreign.hpp"
#include "stack/png/png.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

std::string list_of_formats() {
  std::string list;
  for (const ArchiveFormat* f : all_archive_formats()) {
    list += (list.empty() ? "" : ", ") + std::string(f->name());
  }
  return list;
}

}  // namespace

const std::vector<const ArchiveFormat*>& all_archive_formats() {
  static const std::vector<const ArchiveFormat*> formats{
      &uvj_format(),          &sl1_format(),         &anycubic_zip_format(),
      &chitubox_zip_format(), &generic_zip_format(), &vdt_format(),
      &rgb_nanodlp_format(),  &nanodlp_format(),     &rgb_cws_format(),
      &cws_format(),          &ember_zip_format(),   &ember_tar_format(),
      &vda_format(),          &folder_format(),      &ctb_format(),
      &photon_format(),       &goo_format(),         &photon_workshop_format(),
      &phz_format(),          &fdg_format(),         &cxdlp_format(),
      &lgs_format()};
  return formats;
}

const ArchiveFormat& recognise_format(const Container& archive) {
  // Whatever it is called: its config.json would pass for another's.
  if (archive.has("frame/00000000.png")) {
    throw InputError(
        archive.path(), "",
        "is a job of frames for a vial that turns; expected a slice archive. `slicecorr tomo "
        "verify` and `printbridge print` take jobs");
  }
  for (const ArchiveFormat* f : all_archive_formats()) {
    if (f->container() == archive.kind() && f->recognises(archive)) return *f;
  }
  refuse_known_foreign(archive);
  throw InputError(archive.path(), "",
                   "is no slice archive of a known format; expected one of " + list_of_formats());
}

const ArchiveFormat& format_named(const std::string& name, const std::string& path,
                                  const std::string& like) {
  const auto& formats = all_archive_formats();
  if (!name.empty()) {
    for (const ArchiveFormat* f : formats) {
      if (f->name() == name) return *f;
    }
    throw InputError("format " + name + " is not known; expected one of " + list_of_formats());
  }
  // The longest ending counts: .rgb.cws is also .cws.
  const std::string file = lower_case(path_parts(path).file);
  std::size_t longest = 0;
  std::vector<const ArchiveFormat*> fitting;
  for (const ArchiveFormat* f : formats) {
    for (const std::string_view ending : f->endings()) {
      if (ending.size() < longest || file.size() <= ending.size() || !file.ends_with(ending)) {
        continue;
      }
      if (ending.size() > longest) fitting.clear();
      longest = ending.size();
      fitting.push_back(f);
    }
  }
  if (fitting.size() == 1) return *fitting.front();
  // Not for every name without an ending: the ending may have been forgotten.
  std::error_code error;
  if (fitting.empty() && (path.ends_with('/') || std::filesystem::is_directory(path, error))) {
    return folder_format();
  }
  for (const ArchiveFormat* f : fitting) {
    if (f->name() == like) return *f;
  }
  if (!fitting.empty()) {
    std::string names;
    for (const ArchiveFormat* f : fitting) {
      names += (names.empty() ? "" : ", ") + std::string(f->name());
    }
    throw InputError(path, "",
                     "several formats end like this; expected one of them named: " + names);
  }
  std::vector<std::string_view> endings;
  for (const ArchiveFormat* f : formats) {
    for (const std::string_view e : f->endings()) {
      if (e != "/" && std::find(endings.begin(), endings.end(), e) == endings.end()) {
        endings.push_back(e);
      }
    }
  }
  std::string list;
  for (const std::string_view e : endings) list += std::string(e) + ", ";
  throw InputError(path, "",
                   "expected a name that ends in " + list + "or a folder, which ends in /");
}

std::vector<NumberedEntry> numbered_entries(const Container& archive, std::string_view prefix,
                                            std::string_view suffix) {
  std::vector<NumberedEntry> found;
  for (const Container::Entry& entry : archive.entries()) {
    std::string_view name = entry.name;
    if (!name.starts_with(prefix) || !name.ends_with(suffix) ||
        name.size() <= prefix.size() + suffix.size()) {
      continue;
    }
    name = name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
    // Names with more digits than any number of layers has are not numbered images.
    if (name.size() > 9 || !std::all_of(name.begin(), name.end(), is_digit)) continue;
    long number = 0;
    std::from_chars(name.data(), name.data() + name.size(), number);
    found.push_back({number, &entry});
  }
  std::stable_sort(found.begin(), found.end(), [](const NumberedEntry& a, const NumberedEntry& b) {
    return a.number < b.number;
  });
  return found;
}

std::vector<std::string> complete_names(const Container& archive,
                                        const std::vector<NumberedEntry>& entries, long first,
                                        std::string_view what) {
  if (entries.empty()) {
    throw InputError(archive.path(), "", "has no layer images, expected " + std::string(what));
  }
  std::vector<std::string> names;
  names.reserve(entries.size());
  for (const NumberedEntry& e : entries) {
    const long expected = first + static_cast<long>(names.size());
    if (e.number != expected) {
      throw InputError(archive.path(), shown_name(e.entry->name),
                       e.number < expected
                           ? "has the number of another image"
                           : "follows a gap: image " + std::to_string(expected) + " is missing");
    }
    names.push_back(e.entry->name);
  }
  return names;
}

ImageSize image_size(const Container& archive, const std::string& name) {
  const Container::Entry* const entry = archive.find(name);
  if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
  std::vector<std::uint8_t> png;
  archive.read(*entry, std::uint64_t{1} << 32, png);
  const PngHeader header = read_png_header(png, {archive.path(), name});
  if (!is_image_size(header.width, header.height)) {
    throw InputError(archive.path(), shown_name(name),
                     "is " + std::to_string(header.width) + " x " + std::to_string(header.height) +
                         " pixels, expected at most " + std::to_string(kMostPixelsAcross) + " x " +
                         std::to_string(kMostPixelsAcross) + " and " + std::to_string(kMostPixels) +
                         " in all");
  }
  return {static_cast<int>(header.width), static_cast<int>(header.height), header.channels()};
}

}  // namespace slicecorr::detail

namespace slicecorr {

std::vector<FormatInfo> archive_formats() {
  std::vector<FormatInfo> list;
  for (const detail::ArchiveFormat* f : detail::all_archive_formats()) {
    const auto endings = f->endings();
    list.push_back({std::string(f->name()),
                    std::string(f->what()),
                    {endings.begin(), endings.end()},
                    f->codes_layers()});
  }
  return list;
}

FormatLimits limits_of_format(const std::string& name) {
  const detail::ArchiveFormat& format = detail::format_named(name, "");
  const detail::LayerCodecPtr codec = format.new_codec({.width_px = 1, .height_px = 1});
  return {format.made_new(), codec ? detail::levels_of(codec->shown()) : 256};
}

std::string format_of(const StackFile& file, const std::string& like) {
  return std::string(detail::format_named(file.format, file.path, like).name());
}

}  // namespace slicecorr
