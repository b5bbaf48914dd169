// Any bytes as a binary print file of one format, for clang's fuzzer: they are read or refused with an
// `InputError` that names the file. What is read is written back to the same bytes, or refused as well.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"

namespace {

using namespace slicecorr;

/// In memory where that is possible.
std::string make_folder() {
  std::string name = ::access("/dev/shm", W_OK) == 0 ? "/dev/shm/slicecorr-fuzz-XXXXXX"
                                                     : "/tmp/slicecorr-fuzz-XXXXXX";
  if (!::mkdtemp(name.data())) std::abort();
  return name;
}

[[noreturn]] void fail(const std::string& what) {
  fmt::print(stderr, "{}\n", what);
  std::abort();
}

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string folder = make_folder();
  const std::string path = folder + "/part.bin", out = folder + "/out.bin";
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  std::ofstream(path, std::ios::binary) << bytes;
  try {
    const StackInfo info = StackReader::read_info(path);
    if (info.format != SLICECORR_FUZZ_FORMAT) return -1;
    // A few bytes may stand for large images, which are allowed and take their time.
    const Grid& g = info.grid;
    if (1.0 * g.width_px * g.height_px * g.layers > 4e6) return -1;
    MissingFacts facts;
    facts.pixel_x_um = facts.pixel_y_um = facts.layer_um = 50;
    const StackReader stack(path, folder, {}, facts);
    StackFile file(out);
    file.format = info.format;
    file.keep_from = path;
    convert_stack(stack, file);
    if (bytes_of(out) != bytes) fail("written back, the file has other bytes");
  } catch (const InputError& e) {
    const std::string what = e.what();
    if (what.find(path) == std::string::npos && what.find(out) == std::string::npos) {
      fail("a refusal names no file: " + what);
    }
  }
  return 0;
}
