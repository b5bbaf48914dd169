// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a file of a print's state (journal, frames, status, latch) or of a machine's record in the farm, for clang's
// fuzzer; the first byte says as which. Readers of a print never throw, and a journal without an end or a latch that can't
// be read is a latch; the record of a machine is read, or a `DeviceError` names its file.
#include <array>

#include "fuzz.hpp"
#include "machines/record.hpp"
#include "slicecorr/bridge/record.hpp"
#include "slicecorr/bridge/view.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  constexpr std::array names{"journal.jsonl", "frames.csv", "status.json", "latch.json",
                             "machine.json"};
  if (size == 0) return -1;
  const std::string name = names[data[0] % names.size()];
  for (const char* other : names) std::filesystem::remove(folder / other);
  const std::string path = folder / name;
  fuzz::write(path, fuzz::text_of(data + 1, size - 1));
  if (name == "machine.json") {
    try {
      farm::detail::read_record(path);
    } catch (const DeviceError& e) {
      if (std::string(e.what()).find(path) == std::string::npos) fuzz::fail("no file is named");
    }
    return 0;
  }
  const bridge::StateFolder state{folder.path()};
  bridge::read_record(state, false);
  const auto latch = bridge::read_latch(state, true);
  if (name == "latch.json" && !latch) fuzz::fail("a latch is not seen");
  return 0;
}
