// Writes a lattice as binary STL: make_lattice OUT.stl CELLS_X CELLS_Y CELLS_Z CELL_MM RADIUS_MM
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "lattice.hpp"

int main(int argc, char** argv) {
  if (argc != 7) {
    std::fprintf(stderr, "usage: make_lattice OUT.stl CELLS_X CELLS_Y CELLS_Z CELL_MM RADIUS_MM\n");
    return 2;
  }
  const auto mesh =
      slicecorr::test::lattice(std::atoi(argv[2]), std::atoi(argv[3]), std::atoi(argv[4]),
                               std::atof(argv[5]), std::atof(argv[6]));
  std::vector<char> bytes(84 + 50 * mesh.triangles.size());
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  std::memcpy(bytes.data() + 80, &count, 4);
  char* at = bytes.data() + 84;
  for (const auto& t : mesh.triangles) {
    float f[12] = {};
    for (std::size_t k = 0; k < 9; ++k)
      f[3 + k] = static_cast<float>(mesh.vertices[t[k / 3]][k % 3]);
    std::memcpy(at, f, sizeof f);
    at += 50;
  }
  std::FILE* file = std::fopen(argv[1], "wb");
  const bool written = file && std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  if (!written || std::fclose(file) != 0) {
    std::perror(argv[1]);
    return 4;
  }
  std::fprintf(stderr, "%s: %u triangles\n", argv[1], count);
  return 0;
}
