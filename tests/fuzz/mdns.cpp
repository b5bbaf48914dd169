// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a datagram that answers the question for printers, for clang's fuzzer. What is found came
// from the host that sent it, and can be shown on a terminal.
#include "machines/mdns.hpp"

#include "fuzz.hpp"

using namespace slicecorr;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const farm::detail::MdnsAnswer answer =
      farm::detail::mdns_answer(fuzz::text_of(data, size), "192.0.2.7");
  for (const farm::FoundMachine& found : answer.found) {
    if (!found.host.starts_with("192.0.2.7")) std::abort();
    for (const std::string* text : {&found.name, &found.model, &found.id, &found.firmware}) {
      for (const char c : *text) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) std::abort();
      }
    }
  }
  // What is asked for again is a question that can be sent.
  const std::string question = farm::detail::mdns_question(answer.unfinished);
  if (question.size() < 12 || question.size() > 512) std::abort();
  return 0;
}
