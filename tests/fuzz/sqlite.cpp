// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A farm's record in which bytes were changed on the disk, for clang's fuzzer. The input is a list of changes: four bytes of
// place, one of value. The record is read and written to, or refused with an error that names its file.
#include <fmt/format.h>

#include "farm_jobs.hpp"
#include "fuzz.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/status.hpp"

using namespace slicecorr;

namespace {

std::string record_of(const farm::FarmFolder& folder) {
  {
    farm::Queue queue(folder.database());
    std::vector<farm::NewJob> jobs;
    for (int i = 0; i < 20; ++i) {
      jobs.push_back(
          test::job_with_key(fmt::format("{:064x}", i), fmt::format("part-{}", i), "user"));
    }
    queue.submit(jobs, "user", "fuzz");
  }
  return fuzz::bytes_of(folder.database());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder memory;
  static const farm::FarmFolder folder = farm::open_folder(memory / "farm", "");
  static const std::string whole = record_of(folder);
  std::string record = whole;
  for (std::size_t at = 0; at + 5 <= size; at += 5) {
    std::uint32_t place = 0;
    for (std::size_t k = 0; k < 4; ++k) place |= std::uint32_t{data[at + k]} << (8 * k);
    record[place % record.size()] = static_cast<char>(data[at + 4]);
  }
  const std::string path = folder.database();
  for (const char* ending : {"-wal", "-shm"}) std::filesystem::remove(path + ending);
  fuzz::write(path, record);
  const auto refused = [&](const auto& use) {
    try {
      use();
    } catch (const Error& e) {
      if (std::string(e.what()).find(path) == std::string::npos) {
        fuzz::fail(std::string("a refusal names no file: ") + e.what());
      }
    }
  };
  refused([&] {
    farm::ReadModel model(path);
    farm::status_text(farm::read_status(model, folder, {}), folder, 100);
    model.last_events(20);
  });
  refused([&] {
    farm::Queue queue(path);
    farm::ClaimRequest request;
    request.service = queue.start_service("local", 2, 100'000);
    request.engine = "local";
    request.free_memory_mb = 100'000;
    if (const auto claim = queue.claim(request)) queue.give_up(claim->token, {});
  });
  return 0;
}
