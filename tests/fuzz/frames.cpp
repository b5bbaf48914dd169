// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as an entry of a job of a tomographic printer (.frames), or of a job of beams, for clang's fuzzer; the first
// byte says of which entry. The job is read or refused with an `InputError` that names the file. What is read is written
// as a job that reads as the same.
#include <string_view>

#include "fuzz.hpp"
#include "job_entries.hpp"

using namespace slicecorr;

namespace {

constexpr bool kBeams = std::string_view(SLICECORR_FUZZ_FORMAT) == "beams";

void there_and_back(const std::string& path, const std::string& out) {
  if constexpr (kBeams) {
    if (!tomo::is_beam_job(path)) return;
    const tomo::BeamJob job = tomo::read_beam_job(path, fuzz::one_thread());
    if (job.cells[0] < 1 || job.cells[1] < 1 || job.cells[2] < 1) fuzz::fail("a vat has no cells");
  } else {
    const tomo::TomoJob job = tomo::read_job(path, fuzz::one_thread());
    tomo::write_job(out, job, fuzz::one_thread());
    const tomo::TomoJob back = tomo::read_job(out, fuzz::one_thread());
    if (back.levels != job.levels || back.part.values != job.part.values ||
        back.turns != job.turns) {
      fuzz::fail("written back, the job is another");
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  static const test::Entries entries = kBeams ? fuzz::beams_entries() : fuzz::frames_entries();
  if (size == 0 || data[0] >= entries.size()) return -1;
  test::Entries changed = entries;
  changed[data[0]].second.assign(data + 1, data + size);
  const std::string path = folder / "job.frames", out = folder / "out.frames";
  test::make_zip(path, changed);
  fuzz::read_or_refuse([&] { there_and_back(path, out); }, path, out);
  return 0;
}
