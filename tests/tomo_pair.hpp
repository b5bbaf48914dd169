// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo_pair.hpp
/// Light to dose and back: that the two are transposes of each other, to the last digits of floats.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <random>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo {

/// Random numbers in all voxels and pixels.
struct RandomPair {
  Field field;
  Light light;
  explicit RandomPair(const TomoGrid& g) : field(g), light(g) {
    std::mt19937 random(3);
    const auto any = [&] { return static_cast<float>(random() % 1000) * 1e-3F; };
    for (int z = 0; z < g.slices; ++z) {
      for (int y = 0; y < g.voxels; ++y) {
        for (int x = g.inside(y).first; x < g.inside(y).end; ++x) {
          field.values[g.voxel(x, y, z)] = any();
        }
      }
    }
    for (int m = 0; m < g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int r = 0; r < g.light_rows(); ++r) light.values[g.pixel(m, i, r)] = any();
      }
    }
  }
};

inline void expect_transposes(const Projector& projector, const RandomPair& random) {
  const Light ax = forward(projector, {}, random.field);
  const Field atb = adjoint(projector, {}, random.light);
  double left = 0, right = 0;
  for (std::size_t i = 0; i < ax.values.size(); ++i) {
    left += double{ax.values[i]} * random.light.values[i];
  }
  for (std::size_t i = 0; i < atb.values.size(); ++i) {
    right += double{atb.values[i]} * random.field.values[i];
  }
  ASSERT_GT(left, 0);
  EXPECT_NEAR(right / left, 1, 1e-5);
}

/// The same bits by one thread as by all, from a pair that is made anew.
inline void expect_same_for_any_threads(const Projector& projector, const Projector& anew,
                                        const RandomPair& random) {
  ExecutionContext alone;
  alone.threads = 1;
  EXPECT_EQ(forward(projector, {}, random.field).values, forward(anew, alone, random.field).values);
  EXPECT_EQ(adjoint(projector, {}, random.light).values, adjoint(anew, alone, random.light).values);
}

}  // namespace slicecorr::tomo
