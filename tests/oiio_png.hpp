// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file oiio_png.hpp
/// PNGs read by OpenImageIO, which shares no code with our decoder.
#pragma once

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include "stack_fixture.hpp"

namespace slicecorr::test {

/// All channels of all pixels, 8 bits each.
inline Bytes decode_by_oiio(const Bytes& png) {
  OIIO::Filesystem::IOMemReader reader(png.data(), png.size());
  OIIO::ImageSpec config, spec;
  OIIO::Filesystem::IOProxy* proxy = &reader;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  const auto input = OIIO::ImageInput::create("png");
  EXPECT_TRUE(input->open("a.png", spec, config)) << input->geterror();
  Bytes pixels(static_cast<std::size_t>(spec.image_pixels()) *
               static_cast<unsigned>(spec.nchannels));
  EXPECT_TRUE(input->read_image(0, 0, 0, -1, OIIO::TypeDesc::UINT8, pixels.data()))
      << input->geterror();
  return pixels;
}

}  // namespace slicecorr::test
