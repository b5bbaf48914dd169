// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Writes a lattice as binary STL: make_lattice OUT.stl CELLS_X CELLS_Y CELLS_Z CELL_MM RADIUS_MM
#include <cstdio>
#include <cstdlib>

#include "ladder.hpp"
#include "lattice.hpp"

int main(int argc, char** argv) {
  if (argc != 7) {
    std::fprintf(stderr, "usage: make_lattice OUT.stl CELLS_X CELLS_Y CELLS_Z CELL_MM RADIUS_MM\n");
    return 2;
  }
  const auto mesh =
      slicecorr::test::lattice(std::atoi(argv[2]), std::atoi(argv[3]), std::atoi(argv[4]),
                               std::atof(argv[5]), std::atof(argv[6]));
  slicecorr::test::write_stl(argv[1], mesh);
  std::fprintf(stderr, "%s: %zu triangles\n", argv[1], mesh.triangles.size());
  return 0;
}
