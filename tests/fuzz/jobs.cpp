// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any text as a jobs file (TOML, CSV) or as the body of a submission over HTTP (JSON), for clang's fuzzer; the first byte
// says as which. Jobs are read, or refused with all that is wrong, each with its place in the file.
#include "fuzz.hpp"
#include "slicecorr/farm/submit.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return -1;
  const std::string text = fuzz::text_of(data + 1, size - 1), source = "some.jobs";
  fuzz::read_or_refuse(
      [&] {
        const auto jobs = data[0] % 3 == 0   ? farm::parse_jobs_toml(text, source)
                          : data[0] % 3 == 1 ? farm::parse_jobs_csv(text, source)
                                             : farm::parse_jobs_json(text, source);
        for (const farm::JobRequest& job : jobs) {
          if (job.copies < 1) fuzz::fail("a job has no copies");
          if (job.where.find(source) == std::string::npos) fuzz::fail("a job has no place");
        }
      },
      source);
  return 0;
}
