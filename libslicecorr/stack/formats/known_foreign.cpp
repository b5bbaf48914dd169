#include "stack/formats/known_foreign.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::json;

/// First bytes of binary print files: magic numbers as UVtools reads and writes them.
struct Magic {
  std::string_view bytes, what;
};
using namespace std::string_view_literals;
constexpr Magic kMagics[] = {
    {"\x19\x00\xfd\x12"sv, "a .cbddlp or .photon file (Chitubox)"},
    {"\x86\x00\xfd\x12"sv, "a .ctb file (Chitubox)"},
    {"\x06\x01\xfd\x12"sv, "a .ctb file (Chitubox, version 4)"},
    {"\x07\x01\xfd\x12"sv, "an encrypted .ctb file (Chitubox)"},
    {"\x10\x08\x22\xff"sv, "a .ctb file (UniFormation)"},
    {"\xae\x83\xda\x9f"sv, "a .phz file (Chitubox)"},
    {"ANYCUBIC\0"sv, "a Photon Workshop file (.pws, .pwmx and the like)"},
    {"V3.0\x07\x00\x00\x00"
     "DLP\0"sv,
     "a .goo file (Elegoo)"},
};

/// Binary print files by their endings, for versions whose first bytes are not known.
struct Ending {
  std::string_view ending, what;
};
constexpr Ending kEndings[] = {
    {".cbddlp", "a .cbddlp file (Chitubox)"},
    {".photon", "a .photon file (Anycubic)"},
    {".ctb", "a .ctb file (Chitubox)"},
    {".phz", "a .phz file (Chitubox)"},
    {".fdg", "a .fdg file (Voxelab)"},
    {".goo", "a .goo file (Elegoo)"},
    {".lys", "a .lys scene of Lychee Slicer"},
    {".lyt", "a .lyt file of Lychee Slicer"},
    {".cxdlp", "a .cxdlp file (Creality)"},
    {".mdlp", "a .mdlp file (Makerbase)"},
    {".gr1", "a .gr1 file (Workshop)"},
    {".lgs", "a .lgs file (Longer)"},
    {".osla", "a .osla file"},
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
          ", whose binary layers can't be read; expected an archive of images: export it from the "
          "slicer as .sl1, .cws, .nanodlp, .vdt or a zip of PNG images, or convert it with UVtools "
          "to .uvj");
}

/// Most images that one layer of a Nordin print file shows.
std::size_t most_images(const Json& print) {
  std::size_t most = 0;
  const auto layers = print.find("Layers");
  if (layers == print.end() || !layers->is_array()) return most;
  for (const Json& layer : *layers) {
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
    const Json print = Json::parse(archive.text(entry.name, limit), nullptr, false);
    if (!print.is_object() || !print.contains("Header") ||
        !print.contains("Default layer settings")) {
      continue;
    }
    const Json& header = print["Header"];
    if (!header.is_object() || !header.contains("Schema version")) continue;
    const Json& version = header["Schema version"];
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
  for (const Magic& magic : kMagics) {
    if (bytes.starts_with(magic.bytes)) refuse(path, magic.what);
  }
  // Zip and gzip archives are recognised by their contents, whatever their names end in.
  if (bytes.starts_with("PK") || bytes.starts_with("\x1f\x8b")) return;
  const std::string name = lower_case(path.substr(path.rfind('/') + 1));
  const std::size_t point = name.rfind('.');
  if (point == std::string::npos) return;
  const std::string_view ending = std::string_view(name).substr(point);
  if (is_photon_workshop(ending))
    refuse(path, "a Photon Workshop file (" + std::string(ending) + ")");
  for (const Ending& known : kEndings) {
    if (ending == known.ending) refuse(path, known.what);
  }
}

}  // namespace slicecorr::detail
