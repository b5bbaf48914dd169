// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// VDA: zips of Voxeldance Additive.

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/read_xml.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

/// Parses so that all of the file is kept as it is written: blanks, comments and ends of lines,
/// too.
constexpr unsigned kParseOptions =
    (pugi::parse_full | pugi::parse_ws_pcdata | pugi::parse_fragment) &
    ~(pugi::parse_eol | pugi::parse_wconv_attribute);

/// Where a manifest stands, for messages.
struct XmlSource {
  const Container& archive;
  std::string entry;

  [[noreturn]] void refuse(const std::string& message) const {
    throw InputError(archive.path(), shown_name(entry), message);
  }
};

bool is_manifest_name(std::string_view name) {
  return name.ends_with(".xml") && name.find('/') == name.npos;
}

/// The first of the archive's XML files, as UVtools takes it.
const Container::Entry* manifest_of(const Container& archive) {
  for (const Container::Entry& entry : archive.entries()) {
    if (is_manifest_name(entry.name)) return &entry;
  }
  return nullptr;
}

pugi::xml_node parse(const XmlSource& place, const std::string& text, pugi::xml_document& xml) {
  read_xml(xml, text, place.archive.path(), shown_name(place.entry), kParseOptions);
  const pugi::xml_node root = xml.child("root");
  if (!root.child("Slices") || !root.child("Machines")) {
    place.refuse("is no manifest of slices, expected <root> with <Slices> and <Machines>");
  }
  return root;
}

std::string load(const Container& archive, const std::string& entry) {
  // Grows with the layers, which it lists.
  return archive.text(entry, (std::uint64_t{64} << 20) + 512 * archive.entries().size());
}

double number_of(std::string_view text, double least, double most, const std::string& what,
                 const XmlSource& place) {
  double number = NAN;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() ||
      !(number >= least && number <= most)) {
    place.refuse(fmt::format("{} is {}, expected a number from {} to {}", what,
                             text.empty() ? "empty" : shown_name(text), number_text(least),
                             number_text(most)));
  }
  return number;
}

std::optional<double> number_at(pugi::xml_node parent, const char* key, double least, double most,
                                const XmlSource& place) {
  const pugi::xml_node node = parent.child(key);
  if (!node) return std::nullopt;
  return number_of(trimmed(node.text().get()), least, most, std::string(parent.name()) + "." + key,
                   place);
}

int layer_count(pugi::xml_node slices, const XmlSource& place) {
  const auto count = number_at(slices, "layersCount", 1, kMaxLayers, place);
  if (!count) place.refuse("Slices.layersCount is missing");
  return *whole(count, place.archive.path(), place.entry, "Slices.layersCount");
}

/// "1920*1080P"
void read_resolution(pugi::xml_node machines, const XmlSource& place, ArchiveContents& contents) {
  std::optional<int> width, height;
  if (const pugi::xml_node node = machines.child("Resolution")) {
    std::string_view text = trimmed(node.text().get());
    if (text.ends_with('P') || text.ends_with('p')) text.remove_suffix(1);
    const std::size_t star = text.find('*');
    if (star == text.npos) {
      place.refuse("Machines.Resolution is " + shown_name(text) + ", expected WIDTH*HEIGHTP");
    }
    const auto pixels = [&](std::string_view number) {
      return whole(number_of(trimmed(number), 1, kMostPixelsAcross, "Machines.Resolution", place),
                   place.archive.path(), place.entry, "Machines.Resolution");
    };
    width = pixels(text.substr(0, star));
    height = pixels(text.substr(star + 1));
  }
  take_image_size(place.archive, width, height, place.entry, false, contents);
}

/// Pixel size from a text like "50um", and from the length of the display, which is rounded. Where
/// the two disagree the length counts, as for UVtools.
double read_pitch(pugi::xml_node machines, const char* pitch_key, const char* length_key,
                  int pixels, const XmlSource& place, std::vector<std::string>& warnings) {
  double pitch_um = 0;
  if (const pugi::xml_node node = machines.child(pitch_key)) {
    std::string_view text = trimmed(node.text().get());
    if (text.ends_with("um")) text = trimmed(text.substr(0, text.size() - 2));
    if (!text.empty()) {
      pitch_um = number_of(text, 0, 1000, std::string("Machines.") + pitch_key, place);
    }
  }
  const double length_mm = number_at(machines, length_key, 0, 1e5, place).value_or(0);
  const double said_um = pixel_um(pitch_um / 1000, place.archive, place.entry);
  const double from_length_um = pixel_um(length_mm / pixels, place.archive, place.entry);
  if (said_um == 0 || from_length_um == 0) return said_um + from_length_um;
  if (std::abs(said_um - from_length_um) <= 0.01 * from_length_um) return said_um;
  warnings.push_back(fmt::format("{} says {} {:g} um, but {} makes {:g} um: that is taken",
                                 shown_name(place.entry), pitch_key, said_um, length_key,
                                 from_length_um));
  return from_length_um;
}

/// Where the manifest lists layers, it must list these images in their order.
void check_list(pugi::xml_node root, const std::vector<std::string>& images,
                const XmlSource& place) {
  std::size_t n = 0;
  for (const pugi::xml_node layer : root.child("Layers").children()) {
    const pugi::xml_node name = layer.child("filename");
    if (!name) continue;
    const std::string_view file = trimmed(name.text().get());
    if (n == images.size() || file != images[n]) {
      place.refuse(fmt::format("layer {} is {}, expected {}", n, shown_name(file),
                               n == images.size() ? "no more layers" : images[n]));
    }
    ++n;
  }
  if (n != 0 && n != images.size()) {
    place.refuse(fmt::format("lists {} layers, but there are {} images", n, images.size()));
  }
}

ArchiveContents read_vda(const Container& archive) {
  const Container::Entry* const manifest = manifest_of(archive);
  if (manifest == nullptr)
    throw InputError(archive.path(), "", "has no manifest, expected an .xml");
  const XmlSource place{archive, manifest->name};
  const std::string text = load(archive, manifest->name);
  pugi::xml_document xml;
  const pugi::xml_node root = parse(place, text, xml);
  const pugi::xml_node slices = root.child("Slices"), machines = root.child("Machines");
  ArchiveContents contents;
  Grid& grid = contents.info.grid;
  contents.images =
      complete_names(archive, numbered_entries(archive, "", ".png"), 1, "0001.png on");
  grid.layers = contents.info.target_layers = layer_count(slices, place);
  if (contents.images.size() != static_cast<std::size_t>(grid.layers)) {
    place.refuse(fmt::format("says {} layers, but there are {} images", grid.layers,
                             contents.images.size()));
  }
  read_resolution(machines, place, contents);
  grid.pixel_x_um =
      read_pitch(machines, "PixelXSize", "XLength", grid.width_px, place, contents.warnings);
  grid.pixel_y_um =
      read_pitch(machines, "PixelYSize", "YWidth", grid.height_px, place, contents.warnings);
  grid.layer_um =
      layer_um(number_at(slices, "thickness", 0, 1e3, place).value_or(0), archive, place.entry);
  contents.info.machine_height_mm = machine_height_of(machines.child("ZHeight").text().as_double());
  check_list(root, contents.images, place);
  for (const pugi::xml_node layer : root.child("Layers").children()) {
    if (const auto z_mm = number_at(layer, "zvalue", 0, 1e5, place)) contents.z_mm.push_back(*z_mm);
  }
  const pugi::xml_node by = root.child("FileInfo").child("Written").child("By");
  contents.info.program = by.attribute("ApplicationName").value();
  if (const pugi::xml_attribute version = by.attribute("ApplicationVersion")) {
    contents.info.program +=
        std::string(contents.info.program.empty() ? "" : " ") + version.value();
  }
  return contents;
}

/// Rounded to 1e-9 mm: without the noise of the last digits.
double tidy(double mm) { return std::round(mm * 1e9) / 1e9; }

double height_mm(const StackInfo& info, int layers) {
  return tidy(stack_height_um(info, layers) / 1000);
}

std::string image_name(int layer) { return fmt::format("{:04}.png", layer + 1); }

std::string saved(const pugi::xml_document& xml, unsigned options) {
  struct Writer final : pugi::xml_writer {
    std::string text;
    void write(const void* data, std::size_t size) override {
      text.append(static_cast<const char*>(data), size);
    }
  } writer;
  xml.save(writer, "  ", options, pugi::encoding_utf8);
  return std::move(writer.text);
}

pugi::xml_node add(pugi::xml_node parent, const char* name, const std::string& text) {
  pugi::xml_node node = parent.append_child(name);
  node.text().set(text.c_str());
  return node;
}

std::string new_manifest(const StackInfo& info) {
  const Grid& grid = info.grid;
  pugi::xml_document xml;
  pugi::xml_node declaration = xml.append_child(pugi::node_declaration);
  declaration.append_attribute("version") = "1.0";
  declaration.append_attribute("encoding") = "utf-8";
  pugi::xml_node root = xml.append_child("root");
  pugi::xml_node file = root.append_child("FileInfo");
  pugi::xml_node version = file.append_child("Version");
  add(version, "Major", "1");
  add(version, "Minor", "2");
  pugi::xml_node written = file.append_child("Written");
  pugi::xml_node by = written.append_child("By");
  by.append_attribute("ApplicationName") = "slicecorr";
  by.append_attribute("ApplicationVersion") = info.program.c_str();
  add(written, "When", "1980-01-01 00:00:00Z");
  pugi::xml_node slices = root.append_child("Slices");
  add(slices, "Count", "1");
  add(slices, "thickness", number_text(tidy(grid.layer_um / 1000)));
  add(slices, "startHeight", number_text(height_mm(info, 1)));
  add(slices, "endHeight", number_text(height_mm(info, grid.layers)));
  add(slices, "layersCount", std::to_string(grid.layers));
  pugi::xml_node machines = root.append_child("Machines");
  add(machines, "FileType", "ZIP File");
  add(machines, "Resolution", fmt::format("{}*{}P", grid.width_px, grid.height_px));
  add(machines, "PixelXSize", number_text(grid.pixel_x_um) + "um");
  add(machines, "PixelYSize", number_text(grid.pixel_y_um) + "um");
  add(machines, "Anti-Aliasing", "1");
  add(machines, "XLength", number_text(tidy(grid.width_px * grid.pixel_x_um / 1000)));
  add(machines, "YWidth", number_text(tidy(grid.height_px * grid.pixel_y_um / 1000)));
  add(machines, "ZHeight", number_text(info.machine_height_mm));
  pugi::xml_node layers = root.append_child("Layers");
  for (int n = 0; n < grid.layers; ++n) {
    pugi::xml_node layer = layers.append_child("VDALayer");
    add(layer, "Index", std::to_string(n));
    add(layer, "zvalue", number_text(height_mm(info, n + 1)));
    add(layer, "filename", image_name(n));
  }
  return saved(xml, pugi::format_indent);
}

/// The layers that the kept list lacks, each like the last one, with the blanks before it.
void add_layers(pugi::xml_node root, const std::vector<std::string>& names,
                const ArchiveContents& kept, const StackInfo& info) {
  pugi::xml_node list = root.child("Layers"), last;
  for (const pugi::xml_node layer : list.children()) {
    if (layer.child("filename")) last = layer;
  }
  if (!last) return;
  const double layer_um = kept.info.grid.layer_um > 0
                              ? layer_height_um(kept.info, kept.info.grid.layers)
                              : info.grid.layer_um;
  for (std::size_t n = kept.images.size(); n < names.size(); ++n) {
    const pugi::xml_node blanks = last.previous_sibling();
    pugi::xml_node layer = list.insert_copy_after(last, last);
    if (blanks.type() == pugi::node_pcdata) list.insert_copy_before(blanks, layer);
    const auto step = [&](const char* key, double by) {
      const std::string_view text = trimmed(layer.child(key).text().get());
      double value = 0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
      if (error != std::errc() || end != text.data() + text.size()) return;
      layer.child(key).text().set(number_text(tidy(value + by)).c_str());
    };
    step("Index", 1);
    step("zvalue", layer_um / 1000);
    layer.child("filename").text().set(names[n].c_str());
    last = layer;
  }
}

void change_vda(const ArchiveRequest& r, const std::vector<std::string>& names,
                ContainerOutput& output) {
  const int before = r.kept_contents->info.grid.layers;
  if (r.info.grid.layers == before) return;
  const XmlSource place{*r.kept, manifest_of(*r.kept)->name};
  const std::string text = load(*r.kept, place.entry);
  pugi::xml_document xml;
  const pugi::xml_node root = parse(place, text, xml);
  pugi::xml_node slices = root.child("Slices");
  slices.child("layersCount").text().set(std::to_string(r.info.grid.layers).c_str());
  if (pugi::xml_node end = slices.child("endHeight")) {
    const double layer_mm = number_at(slices, "thickness", 0, 1e3, place).value_or(0);
    const double end_mm = number_at(slices, "endHeight", 0, 1e9, place).value_or(0);
    const double now_mm = end_mm + (r.info.grid.layers - before) * layer_mm;
    end.text().set(number_text(tidy(now_mm)).c_str());
  }
  add_layers(root, names, *r.kept_contents, r.info);
  const bool mark = text.starts_with("\xef\xbb\xbf");
  output.add_text(place.entry, saved(xml, pugi::format_raw | pugi::format_no_declaration |
                                              (mark ? pugi::format_write_bom : 0u)));
}

class Vda final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "vda"; }
  std::string_view what() const override { return "zip of Voxeldance Additive"; }
  bool says_heights() const override { return true; }
  std::vector<std::string_view> endings() const override { return {".zip"}; }

  bool recognises(const Container& archive) const override {
    return archive.kind() == ContainerKind::zip && manifest_of(archive) != nullptr &&
           !numbered_entries(archive, "", ".png").empty();
  }

  ArchiveContents read(const Container& archive) const override { return read_vda(archive); }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    const ExposureSummary exposure = exposure_summary(r.info);
    if (exposure.normal_s > 0 && (r.kept == nullptr || r.exposure_changes)) {
      const bool others = exposure.uneven || exposure.bottom_layers + exposure.fade_layers > 0;
      warn(r,
           fmt::format("VDA archives have no exposure times: the printer must be set to {:g} s{}",
                       exposure.normal_s, others ? ", and to other times for some layers" : ""));
    }
    if (r.kept != nullptr) {
      std::vector<std::string> names = continued_names(r, ".png");
      change_vda(r, names, output);
      return names;
    }
    if (r.info.orientation != Orientation{}) {
      warn(r, "VDA archives can't say that images are turned or mirrored");
    }
    output.add_text(r.stem + ".xml", new_manifest(r.info));
    std::vector<std::string> names;
    names.reserve(static_cast<std::size_t>(r.info.grid.layers));
    for (int n = 0; n < r.info.grid.layers; ++n) names.push_back(image_name(n));
    return names;
  }
};

}  // namespace

const ArchiveFormat& vda_format() {
  static const Vda format;
  return format;
}

}  // namespace slicecorr::detail
