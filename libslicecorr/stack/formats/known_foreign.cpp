// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/known_foreign.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/mesh.hpp"
#include "stack/container/binary_file.hpp"
#include "support/json/read_json.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

using SortedJson = nlohmann::json;

using namespace std::string_view_literals;

/// Print files that are encrypted: what their vendors do not want opened stays closed.
struct Closed {
  std::string_view bytes, ending, what, instead;
};
constexpr Closed kClosed[] = {
    {"\x07\x01\xfd\x12"sv, "", "an encrypted .ctb file (Chitubox)",
     "export it from the slicer as .goo where the printer reads that (Elegoo Mars 4, Mars 5, Saturn 3, "
     "Saturn 4), or as .ctb without encryption where it reads that (boards that read .ctb before there was "
     "encryption still do); for a printer that reads encrypted .ctb alone, slice with a program that "
     "writes plain files, correct a .ctb and have UVtools encrypt it, or correct this file with UVtools "
     "and slicecorr-uvtools"},
    {"", ".form", "a .form file of Formlabs' PreForm, which is encrypted",
     "slice the part with a program that exports images or .goo, .ctb and the like, for a printer that "
     "takes these"},
};

/// Other binary print files by their endings.
struct Ending {
  std::string_view ending, what;
};
constexpr Ending kEndings[] = {
    {".cbddlp", "no .cbddlp file of a known kind (Chitubox)"},
    {".photon", "no .photon file of a known kind (Anycubic)"},
    {".ctb", "no .ctb file of a known kind (Chitubox)"},
    {".phz", "no .phz file of a known kind (Chitubox)"},
    {".fdg", "no .fdg file of a known kind (Voxelab)"},
    {".goo", "no .goo file of a known kind (Elegoo)"},
    {".prz", "no .prz file of a known kind (Phrozen)"},
    {".cxdlp", "no .cxdlp file of a known kind (Creality)"},
    {".lgs", "no .lgs file of a known kind (Longer)"},
    {".cxdlpv4", "no .cxdlpv4 file of a known kind (Creality)"},
    {".lys", "a .lys scene of Lychee Slicer"},
    {".lyt", "a .lyt file of Lychee Slicer"},
    {".mdlp", "a .mdlp file (Makerbase)"},
    {".gr1", "a .gr1 file (Workshop)"},
    {".osla", "a .osla file"},
    {".osf", "a .osf file (Vlare)"},
    {".photons", "a .photons file (Anycubic)"},
    {".svgx", "a .svgx file (Flashforge)"},
};
/// Photon Workshop names its files for the printer: .pws, .pw0, .pwx, .pwmo, .pwma, .pm3 ...
bool is_photon_workshop(std::string_view ending) {
  return ending == ".pws" || ending == ".pw0" || ending == ".pwx" || ending == ".dlp" ||
         ending == ".dl2p" || ending.starts_with(".pwm") || ending.starts_with(".pm3") ||
         ending == ".pmsq" || ending == ".px6s" || ending == ".pwc";
}

[[noreturn]] void refuse(const std::string& path, std::string_view what) {
  throw InputError(
      path, "",
      "is " + std::string(what) +
          ", whose layers can't be read; expected an archive of images or a known binary file: export "
          "it from the slicer as .goo, .ctb without encryption, .sl1, .cws, .nanodlp, .vdt or a zip "
          "of PNG images, or convert it with UVtools to .uvj");
}

/// Most images that one layer of a Nordin print file shows.
std::size_t most_images(const SortedJson& print) {
  std::size_t most = 0;
  const auto layers = print.find("Layers");
  if (layers == print.end() || !layers->is_array()) return most;
  for (const SortedJson& layer : *layers) {
    if (!layer.is_object()) continue;
    const auto images = layer.find("Image settings list");
    if (images != layer.end() && images->is_array()) most = std::max(most, images->size());
  }
  return most;
}

}  // namespace

void refuse_known_foreign(const Container& archive) {
  constexpr std::uint64_t limit = std::uint64_t{16} << 20;
  for (const Container::Entry& entry : archive.entries()) {
    // At the top, or in printfile/.
    if (!lower_case(entry.name).ends_with(".json") || entry.bytes > limit ||
        std::count(entry.name.begin(), entry.name.end(), '/') > 1) {
      continue;
    }
    const SortedJson print = try_json<SortedJson>(archive.text(entry.name, limit));
    if (!print.is_object() || !print.contains("Header") ||
        !print.contains("Default layer settings")) {
      continue;
    }
    const SortedJson& header = print["Header"];
    if (!header.is_object() || !header.contains("Schema version")) continue;
    const SortedJson& version = header["Schema version"];
    const std::size_t most = most_images(print);
    throw InputError(
        archive.path(), shown_name(entry.name),
        "is a JSON print file of the Nordin group (schema version " +
            shown_name(version.is_string() ? version.get<std::string>() : version.dump()) +
            "): each of its layers is a list of images with exposures, focus and power of their "
            "own" +
            (most > 1 ? ", here up to " + std::to_string(most) : "") +
            ", so it is no plain stack of slices; expected one image for each layer");
  }
}

void refuse_known_file(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (file < 0) return;
  char start[16] = {};
  const ssize_t n = ::read(file, start, sizeof start);
  ::close(file);
  const std::string_view bytes(start, n > 0 ? static_cast<std::size_t>(n) : 0);
  const std::string name = lower_case(path.substr(path.rfind('/') + 1));
  const std::size_t point = name.rfind('.');
  const std::string_view ending =
      point == std::string::npos ? std::string_view() : std::string_view(name).substr(point);
  for (const Closed& closed : kClosed) {
    if (closed.bytes.empty() ? ending == closed.ending : bytes.starts_with(closed.bytes)) {
      throw InputError(path, "",
                       "is " + std::string(closed.what) +
                           ", and is not opened; expected another: " + std::string(closed.instead));
    }
  }
  // A .3mf is a zip archive itself.
  if (is_mesh_name(path) && (ending == ".3mf" || !bytes.starts_with("PK"))) {
    throw InputError(path, "", "is a mesh; expected a slice archive, which slicing a mesh makes");
  }
  // These are recognised by their contents, whatever their names end in.
  if (is_binary_print_file(bytes)) return;
  // Zip and gzip archives, too.
  if (bytes.starts_with("PK") || bytes.starts_with("\x1f\x8b")) return;
  if (ending.empty()) return;
  if (is_photon_workshop(ending))
    refuse(path, "no Photon Workshop file of a known kind (" + std::string(ending) + ")");
  for (const Ending& known : kEndings) {
    if (ending == known.ending) refuse(path, known.what);
  }
}

}  // namespace slicecorr::detail
