// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The module that does what we use OpenImageIO for; see base/image_module.hpp.

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>

#include "base/image_module.hpp"

namespace slicecorr::detail {
namespace {

std::string or_unknown(const std::string& text) {
  return text.empty() ? "OpenImageIO does not say why" : text;
}

std::string decode_png(std::span<const std::uint8_t> png, int width, int height, int rows,
                       const ImageFunctions::RowSink& sink) {
  OIIO::Filesystem::IOMemReader reader(png.data(), png.size());
  OIIO::ImageSpec config;
  OIIO::Filesystem::IOProxy* const proxy = &reader;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  config.attribute("oiio:UnassociatedAlpha", 1);
  const auto input = OIIO::ImageInput::create("png");
  if (!input) return or_unknown(OIIO::geterror());
  OIIO::ImageSpec spec;
  if (!input->open("slice.png", spec, config)) return or_unknown(input->geterror());
  const int channels = spec.nchannels;
  if (spec.width != width || spec.height != height || channels < 1 || channels > 4) {
    return "unexpected size or channels";
  }
  const std::size_t row_bytes = static_cast<std::size_t>(width) * static_cast<unsigned>(channels);
  std::vector<std::uint8_t> pixels(row_bytes * static_cast<std::size_t>(std::min(rows, height)));
  for (int y0 = 0; y0 < height; y0 += rows) {
    const int y1 = std::min(height, y0 + rows);
    if (!input->read_scanlines(0, 0, y0, y1, 0, 0, channels, OIIO::TypeDesc::UINT8,
                               pixels.data())) {
      return or_unknown(input->geterror());
    }
    sink(y0, y1, pixels.data(), channels);
  }
  input->close();
  return "";
}

std::string read_tiff(const std::string& path, int most_px, GreyImageValues& out) {
  const auto input = OIIO::ImageInput::create("tiff");
  if (!input) return or_unknown(OIIO::geterror());
  OIIO::ImageSpec spec;
  if (!input->open(path, spec)) return or_unknown(input->geterror());
  if (spec.width < 1 || spec.height < 1 || spec.width > most_px || spec.height > most_px ||
      spec.depth > 1) {
    return "is of " + std::to_string(spec.width) + " x " + std::to_string(spec.height) +
           " pixels; expected up to " + std::to_string(most_px) + " along a side";
  }
  out.width_px = spec.width;
  out.height_px = spec.height;
  out.values.resize(static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height));
  // OpenImageIO scales whole numbers to 0..1: these are its own again. Tiled files are read like others.
  const double scale = spec.format.is_floating_point() ? 1.0
                       : spec.format.basesize() == 1   ? 255.0
                       : spec.format.basesize() == 2   ? 65535.0
                                                       : 4294967295.0;
  if (!input->read_image(0, 0, 0, 1, OIIO::TypeDesc::FLOAT, out.values.data())) {
    return or_unknown(input->geterror());
  }
  for (float& v : out.values) v = static_cast<float>(static_cast<double>(v) * scale);
  return "";
}

constexpr ImageFunctions kFunctions{decode_png, read_tiff};

}  // namespace
}  // namespace slicecorr::detail

extern "C" __attribute__((visibility("default"))) const slicecorr::detail::ImageFunctions*
slicecorr_image_functions() {
  return &slicecorr::detail::kFunctions;
}
