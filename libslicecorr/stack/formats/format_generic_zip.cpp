// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The plainest zip: 1.png, 2.png, ... and, from UVtools, manifest.uvtools with the sizes. Phrozen's
// printers take the images alone.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <pugixml.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/version.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/read_xml.hpp"
#include "stack/png/preview.hpp"

namespace slicecorr::detail {
namespace {

constexpr const char* kUvtoolsManifest = "manifest.uvtools";

/// Number of an element that may be missing or empty.
std::optional<double> number_of(const pugi::xml_node& root, const char* key, double most,
                                const std::string& file) {
  const pugi::xml_node node = root.child(key);
  if (!node) return std::nullopt;
  KeyValueText value(fmt::format("{}={}", key, node.text().get()), '=', file, kUvtoolsManifest);
  return value.number(key, 0, most);
}

void read_manifest(const Container& archive, ArchiveContents& contents) {
  const std::string& path = archive.path();
  const std::string text = archive.text(kUvtoolsManifest);
  pugi::xml_document document;
  read_xml(document, text, path, kUvtoolsManifest);
  const pugi::xml_node root = document.child("Manifest");
  if (!root) throw InputError(path, kUvtoolsManifest, "has no element Manifest");
  const auto number = [&](const char* key, double most) {
    return number_of(root, key, most, path);
  };
  take_image_size(
      archive,
      whole(number("ResolutionX", kMostPixelsAcross), path, kUvtoolsManifest, "ResolutionX"),
      whole(number("ResolutionY", kMostPixelsAcross), path, kUvtoolsManifest, "ResolutionY"),
      kUvtoolsManifest, false, contents);
  Grid& grid = contents.info.grid;
  grid.layer_um = layer_um(number("LayerHeight", 1e5).value_or(0), archive, kUvtoolsManifest);
  grid.pixel_x_um =
      pixel_um(number("DisplayWidth", 1e5).value_or(0) / grid.width_px, archive, kUvtoolsManifest);
  grid.pixel_y_um = pixel_um(number("DisplayHeight", 1e5).value_or(0) / grid.height_px, archive,
                             kUvtoolsManifest);
  contents.info.machine_height_mm = machine_height_of(root.child("MachineZ").text().as_double());
}

/// The manifest as UVtools writes it, without dates.
std::string new_manifest(const ArchiveRequest& r) {
  const Grid& g = r.info.grid;
  const auto mm = [](double value) { return number_text(std::round(value * 1e6) / 1e6); };
  const double build_mm = new_machine_height_mm(r.info, g.layers * g.layer_um * 1e-3);
  pugi::xml_document document;
  pugi::xml_node declaration = document.append_child(pugi::node_declaration);
  declaration.append_attribute("version") = "1.0";
  declaration.append_attribute("encoding") = "utf-8";
  pugi::xml_node root = document.append_child("Manifest");
  const auto add = [&](const char* key, const std::string& value) {
    root.append_child(key).text().set(value.c_str());
  };
  const std::string program = std::string("slicecorr ") + version;
  add("CreatedBy", program);
  add("UpdatedBy", program);
  add("LayerHeight", mm(g.layer_um * 1e-3));
  add("ResolutionX", std::to_string(g.width_px));
  add("ResolutionY", std::to_string(g.height_px));
  add("DisplayWidth", mm(g.width_px * g.pixel_x_um * 1e-3));
  add("DisplayHeight", mm(g.height_px * g.pixel_y_um * 1e-3));
  add("MachineZ", mm(build_mm));
  struct Text final : pugi::xml_writer {
    std::string text;
    void write(const void* data, std::size_t size) override {
      text.append(static_cast<const char*>(data), size);
    }
  } out;
  document.save(out, "  ");
  return out.text;
}

class GenericZip final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "generic"; }
  std::string_view what() const override { return "zip of numbered images, Phrozen's and others'"; }
  std::vector<std::string_view> endings() const override { return {".zip"}; }
  /// Either there is the manifest, or nothing in the archive that belongs to another format.
  bool recognises(const Container& archive) const override {
    if (archive.has(kUvtoolsManifest)) return true;
    const auto foreign = [](const Container::Entry& e) {
      const std::string_view name = e.name;
      return name != kProvenanceEntry &&
             (name.ends_with(".gcode") || name.ends_with(".json") || name.ends_with(".xml") ||
              name.ends_with(".ini") || name.ends_with(".conf"));
    };
    return archive.has("1.png") &&
           std::none_of(archive.entries().begin(), archive.entries().end(), foreign);
  }

  ArchiveContents read(const Container& archive) const override {
    ArchiveContents contents;
    contents.images =
        complete_names(archive, numbered_entries(archive, "", ".png"), 1, "1.png, 2.png, ...");
    contents.info.grid.layers = contents.info.target_layers =
        static_cast<int>(contents.images.size());
    if (archive.has(kUvtoolsManifest)) {
      read_manifest(archive, contents);
    } else {
      take_image_size(archive, {}, {}, "", false, contents);
    }
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    const ExposureSummary s = exposure_summary(r.info);
    if (!lifts(r.info)) {
      warn_of_mode(r, "generic zip");
    } else if (s.normal_s > 0 && (r.kept == nullptr || r.exposure_changes)) {
      warn(r, fmt::format(
                  "a generic zip holds no exposure times: set {:g} s at the printer{}", s.normal_s,
                  s.uneven              ? ", which can't show layers for different times"
                  : s.bottom_layers > 0 ? fmt::format(", and {:g} s for the first {} layers",
                                                      s.bottom_s, s.bottom_layers)
                                        : ""));
    }
    // The manifest says nothing that a changed stack could change.
    if (r.kept != nullptr) return continued_names(r, ".png");
    if (!r.preview.pixels.empty()) {
      output.add("preview.png", encode_png(framed(r.preview, 854, 480)));
      output.add("preview_cropping.png", encode_png(framed(r.preview, 472, 240)));
    }
    output.add_text(kUvtoolsManifest, new_manifest(r));
    std::vector<std::string> names;
    for (int n = 1; n <= r.info.grid.layers; ++n) names.push_back(std::to_string(n) + ".png");
    return names;
  }
};

}  // namespace

const ArchiveFormat& generic_zip_format() {
  static const GenericZip format;
  return format;
}

}  // namespace slicecorr::detail
