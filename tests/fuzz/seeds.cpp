// Writes a small file of each binary print format, for the fuzzer to begin with: fuzz-seeds FOLDER.
#include <filesystem>

#include "print_file_fixture.hpp"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  for (const slicecorr::test::SmallFile& file : slicecorr::test::small_print_files()) {
    const std::filesystem::path folder = std::filesystem::path(argv[1]) / file.format;
    std::filesystem::create_directories(folder);
    slicecorr::test::write_file((folder / file.name).string(), file.bytes);
  }
  return 0;
}
