// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Memory that a solve takes, by counting what it allocates: so that large parts fit a desk computer.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <new>
#include <string>
#include <vector>

#include "slicecorr/tomo/print.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo::memory_test {

std::atomic<std::size_t> live{0}, most{0};

void* counted(std::size_t size, std::size_t alignment) {
  void* const p =
      alignment > alignof(std::max_align_t)
          ? std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment)
          : std::malloc(std::max<std::size_t>(size, 1));
  if (p == nullptr) throw std::bad_alloc();
  const std::size_t now = live += malloc_usable_size(p);
  std::size_t before = most;
  while (before < now && !most.compare_exchange_weak(before, now)) {
  }
  return p;
}
void give_back(void* p) {
  if (p == nullptr) return;
  live -= malloc_usable_size(p);
  std::free(p);
}

}  // namespace slicecorr::tomo::memory_test

void* operator new(std::size_t size) { return slicecorr::tomo::memory_test::counted(size, 1); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return slicecorr::tomo::memory_test::counted(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* p) noexcept { slicecorr::tomo::memory_test::give_back(p); }
void operator delete(void* p, std::size_t) noexcept { slicecorr::tomo::memory_test::give_back(p); }
void operator delete(void* p, std::align_val_t) noexcept {
  slicecorr::tomo::memory_test::give_back(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  slicecorr::tomo::memory_test::give_back(p);
}

namespace slicecorr::tomo::memory_test {
namespace {

struct Taken {
  double voxels = 0, bytes = 0;
};
/// OSMO on a part of n² x slices voxels before a pinhole in a bath, pixels as large, 3/2 n angles.
Taken taken(int half, int slices) {
  constexpr double voxel_mm = 0.25;
  Printer p = bench_printer();
  p.vial = Vial{voxel_mm * half + 0.5, voxel_mm * half, 1.5, 1.5};
  p.width_px = 2 * half + 8;
  p.height_px = slices + 16;
  p.optics->kind = OpticsKind::pinhole;
  p.optics->distance_mm = 400;
  p.rotation->max_fps = 0;
  const int n = voxels_across(p, voxel_mm);
  Box<std::uint8_t> part{slices, n, n,
                         std::vector<std::uint8_t>(static_cast<std::size_t>(slices * n * n))};
  for (int z = 0; z < slices; ++z) {
    for (int y = n / 4; y < n - n / 4; ++y) {
      for (int x = n / 4; x < n - n / 4; ++x) {
        part.values[part.at(z, y, x)] = (x / 4 + y / 4 + z / 4) % 2 ? 255 : 0;
      }
    }
  }
  PrintOptions options;
  options.angles = 3 * n / 2;
  options.hold = 1;
  options.solve.method = Method::osmo;
  options.solve.steps = 1;
  ExecutionContext alone;
  alone.threads = 1;
  const std::size_t before = live;
  most = before;
  solve_print(part, voxel_mm, p, bench_resin(0.3), options, alone);
  return {static_cast<double>(part.values.size()), static_cast<double>(most - before)};
}

/// What grows with the voxels: 37 bytes each were seen. 512^3 of them in 4 GB would be 29.8, which is not reached. Light
/// counts with 1.5 angles a voxel; the rows of these images are nearly whole lanes of 16, as those of large parts are,
/// and both vials are as high as they are wide, so that tables of rays are as large in both.
TEST(TomoMemory, BytesOfAVoxel) {
  const Taken few = taken(7, 14), many = taken(15, 30);
  const double of_voxel = (many.bytes - few.bytes) / (many.voxels - few.voxels);
  RecordProperty("bytes_of_a_voxel", std::to_string(of_voxel));
  EXPECT_LT(of_voxel, 40);
  EXPECT_GT(of_voxel, 8);  // dose and model alone
}

}  // namespace
}  // namespace slicecorr::tomo::memory_test
