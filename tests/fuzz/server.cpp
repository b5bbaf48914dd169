// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as what a client sends to the farm's server, for clang's fuzzer. Whole headers are put in
// as well as bytes. Each answer is whole, and holds nothing that is secret.
#include <random>
#include <thread>

#include "fuzz.hpp"
#include "raw_client.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/serve.hpp"

using namespace slicecorr;

extern "C" size_t LLVMFuzzerMutate(std::uint8_t* data, size_t size, size_t most);

namespace {

const std::string kToken = "fuzz-" + std::string(59, 's');

struct Served {
  Served() : folder(farm::open_folder(memory / "farm", "")) {
    { farm::Queue queue(folder.database()); }
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

}  // namespace

extern "C" size_t LLVMFuzzerCustomMutator(std::uint8_t* data, size_t size, size_t most,
                                          unsigned seed) {
  static const std::vector<std::string> headers = test::asked_headers();
  std::minstd_rand random(seed);
  if (random() % 2 == 0) return LLVMFuzzerMutate(data, size, most);
  std::string text = fuzz::text_of(data, size);
  std::vector<std::size_t> lines;
  for (std::size_t at = 0; (at = text.find('\n', at)) != text.npos;) lines.push_back(++at);
  const std::size_t at = lines.empty() ? 0 : lines[random() % lines.size()];
  text.insert(at, headers[random() % headers.size()] + "\r\n");
  size = std::min(most, text.size());
  std::copy_n(text.begin(), size, data);
  return size;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Served served;
  std::string text = fuzz::text_of(data, size);
  // The server's own name, which it asks for; and in every second a right token.
  const std::string host = fmt::format("Host: 127.0.0.1:{}\r\n", served.server->port());
  if (const auto line = text.find("\r\n"); line != text.npos) {
    const bool right = size % 2 == 0;
    text.insert(line + 2, right ? host + "Authorization: Bearer " + kToken + "\r\n" : host);
  }
  test::Raw raw(served.server->port());
  if (!raw.connected) fuzz::fail("the server is gone");
  raw.send(text);
  raw.end_sending();
  const std::string answer = raw.rest();
  const std::string fault = test::fault_of_answer(answer, text.starts_with("HEAD"), kToken);
  if (!fault.empty()) fuzz::fail(fault + ": " + answer.substr(0, 300));
  return 0;
}
