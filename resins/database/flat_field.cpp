#include "database/flat_field.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

/// Width or height in the header of a PNG.
std::uint32_t big_endian(const std::vector<std::uint8_t>& bytes, std::size_t at) {
  return (std::uint32_t{bytes[at]} << 24) | (std::uint32_t{bytes[at + 1]} << 16) |
         (std::uint32_t{bytes[at + 2]} << 8) | bytes[at + 3];
}

}  // namespace

FlatField flat_field_of(GreyImage image, const std::string& source) {
  FlatField field;
  if (image.pixels.empty()) throw InputError(source, "", "has no pixel");
  const auto [least, greatest] = std::minmax_element(image.pixels.begin(), image.pixels.end());
  if (*greatest == 0) {
    throw InputError(source, "", "is black; expected relative intensity, white the brightest");
  }
  double sum = 0;
  for (const std::uint8_t v : image.pixels) sum += v;
  field.least = static_cast<double>(*least) / *greatest;
  field.mean = sum / static_cast<double>(image.pixels.size()) / *greatest;
  field.image = std::move(image);
  return field;
}

FlatField flat_field_of_png(const std::string& path) {
  const std::string text = read_text_file(path);
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  constexpr std::uint8_t signature[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  if (bytes.size() < 24 || std::memcmp(bytes.data(), signature, sizeof signature) != 0) {
    throw InputError(path, "", "is no PNG image");
  }
  const std::uint32_t width = big_endian(bytes, 16), height = big_endian(bytes, 20);
  if (width < 1 || height < 1 || width > 65536 || height > 65536) {
    throw InputError(path, "", "has a side that is not from 1 to 65536 pixels");
  }
  return flat_field_of(
      decode_png(bytes, static_cast<int>(width), static_cast<int>(height), path, "flat-field"),
      path);
}

}  // namespace slicecorr::resins
