// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as the body of a request that changes something, for clang's fuzzer; the first byte says of which. The token
// is right, the body as long as it says. Each answer is whole, no defect (500), and holds nothing that is secret.
#include <array>
#include <thread>

#include "fuzz.hpp"
#include "raw_client.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/serve.hpp"

using namespace slicecorr;

namespace {

const std::string kToken = "fuzz-" + std::string(59, 's');

struct Served {
  Served() : folder(farm::open_folder(memory / "farm", "")) {
    { farm::Queue queue(folder.database()); }
    ::setenv("SLICECORR_DB", (memory / "db").c_str(), 1);
    farm::ServeOptions options;
    options.token = kToken;
    options.submit = [](const std::string&, bool, const std::atomic<bool>&) {
      return farm::SubmitReply{201, "{}"};
    };
    server = std::make_unique<farm::FarmServer>(folder, options);
    std::thread([this] { server->run(); }).detach();
  }
  fuzz::Folder memory;
  farm::FarmFolder folder;
  std::unique_ptr<farm::FarmServer> server;
};

constexpr std::array kRoutes{
    "jobs",    "jobs/1/cancel",    "jobs/1/retry",    "jobs/1/priority", "jobs/1/print",
    "pause",   "resume",           "tickets",         "resins",          "printers",
    "studies", "studies/x/cancel", "machines/x/send", "machines/x/start"};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Served served;
  if (size == 0) return -1;
  const std::string body = fuzz::text_of(data + 1, size - 1);
  test::Raw raw(served.server->port());
  if (!raw.connected) fuzz::fail("the server is gone");
  raw.send(fmt::format(
      "POST /api/v1/{} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nAuthorization: Bearer {}\r\n"
      "Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{}",
      kRoutes[data[0] % kRoutes.size()], served.server->port(), kToken, body.size(), body));
  raw.end_sending();
  const std::string answer = raw.rest();
  const std::string fault = test::fault_of_answer(answer, false, kToken);
  if (!fault.empty()) fuzz::fail(fault + ": " + answer.substr(0, 300));
  if (answer.starts_with("HTTP/1.1 500")) fuzz::fail("a defect: " + answer.substr(0, 600));
  return 0;
}
