// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any text as the table of what a print showed, for clang's fuzzer: read or refused with an `InputError` that names the
// file. What is read is written as a table that reads as the same.
#include "fuzz.hpp"
#include "stack/recording_entry.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return -1;
  const int slices = 1 + data[0] % 8;
  const std::string text = fuzz::text_of(data + 1, size - 1), source = "some.uvj";
  fuzz::read_or_refuse(
      [&] {
        const Recording read = detail::parse_recording(text, slices, source);
        const std::string written = detail::recording_csv(read);
        if (detail::recording_csv(detail::parse_recording(written, slices, source)) != written)
          fuzz::fail("written back, the recording says other things");
      },
      source);
  return 0;
}
