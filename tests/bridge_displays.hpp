// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A machine with a small display, frames for it, and what a call throws.
#pragma once

#include <exception>
#include <memory>
#include <random>
#include <string>

#include "models.hpp"
#include "slicecorr/bridge/display.hpp"

namespace slicecorr::bridge {

inline constexpr int kWidthPx = 40, kHeightPx = 30;
inline constexpr double kHz = 60, kPeriodS = 1 / kHz;

inline Machine machine_of(int width = kWidthPx, int height = kHeightPx) {
  Machine m;
  m.printer = slicecorr::test::linear_printer(1, 100);
  m.printer.width_px = width;
  m.printer.height_px = height;
  return m;
}

inline std::shared_ptr<const Frame> noise(int number, bool uv = false, int width = kWidthPx,
                                          int height = kHeightPx) {
  std::mt19937 random(static_cast<unsigned>(number) + 1);
  auto frame = std::make_shared<Frame>();
  frame->number = number;
  frame->width_px = width;
  frame->height_px = height;
  for (int i = 0; i < width * height; ++i) {
    frame->blue.push_back(static_cast<std::uint8_t>(random()));
  }
  for (int i = 0; uv && i < width * height; ++i) {
    frame->uv.push_back(static_cast<std::uint8_t>(random()));
  }
  return frame;
}

template <class Call>
std::string thrown_by(const Call& call) {
  try {
    call();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

}  // namespace slicecorr::bridge
