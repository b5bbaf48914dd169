// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any text as the file of a printer or of a resin, for clang's fuzzer: read or refused with an `InputError`
// that names the file. What `resinctl validate` finds nothing wrong with is read, a printer whose light is to be
// measured as a display.
#include <algorithm>

#include "database/schema.hpp"
#include "fuzz.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/resins/record.hpp"
#include "slicecorr/unmeasured_light.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  const std::string path = folder / "some.toml", text = fuzz::text_of(data, size);
  const auto is_right = [&](const char* kind) {
    bool right = false;
    fuzz::read_or_refuse(
        [&] {
          const auto findings = resins::validate_text(text, path, kind);
          right = std::all_of(findings.begin(), findings.end(),
                              [](const resins::Finding& f) { return f.warning; });
        },
        path);
    return right;
  };
  const bool printer = fuzz::read_or_refuse([&] { parse_printer(text, path); }, path);
  bool measured = true;
  const bool display =
      fuzz::read_or_refuse([&] { measured = light_is_measured(parse_display(text, path)); }, path);
  if (printer != (display && measured)) fuzz::fail("a display is read otherwise than its printer");
  if (!display && is_right("printer")) fuzz::fail("a printer that is valid is refused");
  const bool resin = fuzz::read_or_refuse([&] { parse_resin(text, path); }, path);
  const bool record = fuzz::read_or_refuse([&] { resins::parse_record(text, path); }, path);
  if (!(resin && record) && is_right("resin")) fuzz::fail("a resin that is valid is refused");
  return 0;
}
