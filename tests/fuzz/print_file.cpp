// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a binary print file of one format, for clang's fuzzer: they are read or refused with an
// `InputError` that names the file. What is read is written back to the same bytes, or refused as well.
#include <algorithm>

#include "cxdlp_sum.hpp"
#include "fuzz.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/stack_preview.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  const std::string path = folder / "part.bin", out = folder / "out.bin";
  std::string bytes = fuzz::text_of(data, size);
  // A checksum hides all else from who changes bytes.
  test::set_cxdlp_sum(reinterpret_cast<std::uint8_t*>(bytes.data()), bytes.size());
  fuzz::write(path, bytes);
  bool other = false;
  fuzz::read_or_refuse(
      [&] {
        const StackInfo info = StackReader::read_info(path);
        // A few bytes may stand for large images, which are allowed and take their time.
        const Grid& g = info.grid;
        other =
            info.format != SLICECORR_FUZZ_FORMAT || 1.0 * g.width_px * g.height_px * g.layers > 4e6;
        if (other) return;
        // Its picture is one, or there is none.
        if (const auto png = preview_png(path); !png.empty() && !is_preview_png(png)) {
          fuzz::fail("the picture is none");
        }
        const StackReader stack(path, folder.path(), fuzz::one_thread(), {50, 50, 50});
        StackFile file(out);
        file.format = info.format;
        file.keep_from = path;
        convert_stack(stack, file, fuzz::one_thread());
        const std::string written = fuzz::bytes_of(out);
        if (written == bytes) return;
        const auto places =
            std::mismatch(written.begin(), written.end(), bytes.begin(), bytes.end());
        fuzz::fail(
            fmt::format("written back, the file has other bytes: {} instead of {}, from byte {} on",
                        written.size(), size, places.first - written.begin()));
      },
      path, out);
  return other ? -1 : 0;
}
