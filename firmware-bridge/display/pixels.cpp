// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "display/pixels.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

constexpr std::uint32_t kOpaque = 0xFF000000U;

template <Channel channel>
constexpr std::uint32_t in(std::uint8_t grey) {
  const std::uint32_t g = grey;
  if constexpr (channel == Channel::red) return g << 16;
  if constexpr (channel == Channel::green) return g << 8;
  if constexpr (channel == Channel::blue) return g;
  return g << 16 | g << 8 | g;
}

// The channel is known when these are compiled: loops of shifts, which the compiler vectorises.

template <Channel blue>
void pack_row(const std::uint8_t* b, std::size_t width, std::uint32_t* out) {
  for (std::size_t x = 0; x < width; ++x) out[x] = kOpaque | in<blue>(b[x]);
}

template <Channel blue, Channel uv>
void pack_row(const std::uint8_t* b, const std::uint8_t* u, std::size_t width, std::uint32_t* out) {
  for (std::size_t x = 0; x < width; ++x) out[x] = kOpaque | in<blue>(b[x]) | in<uv>(u[x]);
}

struct Picture {
  const std::uint8_t *blue, *uv;
  std::size_t width, height, pitch;
  std::uint32_t* out;
};

template <Channel blue>
void pack_blue(const Picture& p) {
  for (std::size_t y = 0; y < p.height; ++y) {
    pack_row<blue>(p.blue + y * p.width, p.width, p.out + y * p.pitch);
  }
}

template <Channel blue, Channel uv>
void pack_both(const Picture& p) {
  for (std::size_t y = 0; y < p.height; ++y) {
    pack_row<blue, uv>(p.blue + y * p.width, p.uv + y * p.width, p.width, p.out + y * p.pitch);
  }
}

template <Channel blue>
void pack_with(const Picture& p, Channel uv) {
  if (p.uv == nullptr) return pack_blue<blue>(p);
  switch (uv) {
    case Channel::red:
      return pack_both<blue, Channel::red>(p);
    case Channel::green:
      return pack_both<blue, Channel::green>(p);
    case Channel::blue:
      return pack_both<blue, Channel::blue>(p);
    case Channel::all:
      return pack_both<blue, Channel::all>(p);
  }
}

}  // namespace

void pack(const Frame* frame, const Projector& channels, int width_px, int height_px,
          std::uint32_t* out, std::size_t pitch_px) {
  const auto width = static_cast<std::size_t>(width_px),
             height = static_cast<std::size_t>(height_px);
  if (frame == nullptr || frame->number < 0) {
    for (std::size_t y = 0; y < height; ++y) std::fill_n(out + y * pitch_px, width, kOpaque);
    return;
  }
  if (frame->width_px != width_px || frame->height_px != height_px ||
      frame->blue.size() != width * height ||
      (!frame->uv.empty() && frame->uv.size() != width * height)) {
    throw Error(fmt::format("frame {} has {} x {} pixels; the display has {} x {}", frame->number,
                            frame->width_px, frame->height_px, width_px, height_px));
  }
  const Picture picture{frame->blue.data(),
                        frame->uv.empty() ? nullptr : frame->uv.data(),
                        width,
                        height,
                        pitch_px,
                        out};
  switch (channels.blue) {
    case Channel::red:
      return pack_with<Channel::red>(picture, channels.uv);
    case Channel::green:
      return pack_with<Channel::green>(picture, channels.uv);
    case Channel::blue:
      return pack_with<Channel::blue>(picture, channels.uv);
    case Channel::all:
      return pack_with<Channel::all>(picture, channels.uv);
  }
}

}  // namespace slicecorr::bridge
