// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Writes a part for benchmarks as binary STL; see the usage below.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "bench_parts.hpp"
#include "ladder.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr::test;
  const std::string kind = argc > 1 ? argv[1] : "";
  slicecorr::TriangleMesh mesh;
  if (kind == "gyroid" && argc == 8) {
    mesh = gyroid({std::atof(argv[3]), std::atof(argv[4]), std::atof(argv[5])}, std::atof(argv[6]),
                  std::atof(argv[7]));
  } else if (kind == "sphere" && argc == 5) {
    mesh = bumpy_sphere(std::atof(argv[3]), std::atoi(argv[4]));
  } else {
    std::fprintf(stderr,
                 "usage: make_part gyroid OUT.stl X_MM Y_MM Z_MM CELL_MM STEP_MM\n"
                 "       make_part sphere OUT.stl DIAMETER_MM FACES   (12 FACES^2 triangles)\n");
    return 2;
  }
  write_stl(argv[2], mesh);
  std::fprintf(stderr, "%s: %zu triangles\n", argv[2], mesh.triangles.size());
  return 0;
}
