// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a volume of NumPy, for clang's fuzzer: read or refused with an `InputError` that names the file. What is
// read is as large as it says, its doses are finite, and written back it reads as the same.
#include "slicecorr/tomo/npy.hpp"

#include <cmath>

#include "fuzz.hpp"

using namespace slicecorr;

namespace {

template <class T, class Read>
void there_and_back(const std::string& path, const std::string& out, const Read& read) {
  fuzz::read_or_refuse(
      [&] {
        const tomo::Box<T> box = read(path);
        if (box.nz < 1 || box.ny < 1 || box.nx < 1 ||
            box.values.size() != static_cast<std::size_t>(box.nz) *
                                     static_cast<std::size_t>(box.ny) *
                                     static_cast<std::size_t>(box.nx)) {
          fuzz::fail("a volume is not as large as it says");
        }
        for (const T value : box.values) {
          if (!std::isfinite(static_cast<double>(value))) fuzz::fail("a number is not finite");
        }
        tomo::write_npy(out, box);
        const tomo::Box<T> back = read(out);
        if (back.nz != box.nz || back.ny != box.ny || back.nx != box.nx ||
            back.values != box.values) {
          fuzz::fail("written back, the volume is another");
        }
      },
      path, out);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  const std::string path = folder / "some.npy", out = folder / "out.npy";
  fuzz::write(path, fuzz::text_of(data, size));
  there_and_back<std::uint8_t>(path, out, tomo::read_part_npy);
  there_and_back<float>(path, out, tomo::read_dose_npy);
  return 0;
}
