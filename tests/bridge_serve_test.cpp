// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The bridge's server against clients that send what they like.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <thread>
#include <vector>

#include "raw_client.hpp"
#include "slicecorr/bridge/serve.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::bridge {
namespace {

const std::string kToken(64, 'k');

TEST(BridgeServe, EveryHeaderToEveryRoute) {
  const slicecorr::test::TemporaryFolder folder;
  ServeOptions options;
  options.token = kToken;
  options.status = [] { return std::string("{\"printer\":\"a\",\"running\":false}"); };
  PrintServer server({folder.path()}, options);
  std::thread serving([&] { server.run(); });
  std::map<std::string, int> answers;
  int n = 0;
  for (const char* asked :
       {"GET /", "GET /live.js", "GET /live.css", "GET /healthz", "GET /status.json",
        "GET /metrics", "GET /record", "GET /report", "GET /nothing", "HEAD /report", "POST /",
        "PUT /status.json", "DELETE /report", "OPTIONS *", "get /", "GET /../journal.jsonl"}) {
    for (const std::string& header : slicecorr::test::asked_headers()) {
      slicecorr::test::Raw raw(server.port());
      const std::string token =
          ++n % 2 == 0 ? "Authorization: Bearer " + kToken + "\r\n" : std::string();
      raw.send(std::string(asked) + " HTTP/1.1\r\n" +
               fmt::format("Host: 127.0.0.1:{}\r\n", server.port()) + token + header + "\r\n\r\n");
      raw.end_sending();
      const std::string answer = raw.rest();
      EXPECT_EQ(
          slicecorr::test::fault_of_answer(answer, std::string(asked).starts_with("HEAD"), kToken),
          "")
          << asked << " " << header.substr(0, 100) << "\n"
          << answer.substr(0, 400);
      ++answers[answer.substr(0, 12)];
    }
  }
  EXPECT_EQ(answers["HTTP/1.1 500"], 0);
  EXPECT_GT(answers["HTTP/1.1 200"], 300);
  server.stop();
  serving.join();
}

}  // namespace
}  // namespace slicecorr::bridge
