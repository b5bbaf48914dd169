// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as what comes over the wire of images, for clang's fuzzer: whole messages, or a `DeviceError`. A message that
// is taken is sent as the same bytes.
#include "frames/wire.hpp"

#include <sys/socket.h>

#include <thread>

#include "fuzz.hpp"

using namespace slicecorr;
using namespace slicecorr::bridge;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size > 65536) return -1;
  int ends[2], back[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0 ||
      ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, back) != 0) {
    std::abort();
  }
  const WireSocket from(ends[1]), to(back[0]), again(back[1]);
  {
    const WireSocket sender(ends[0]);
    if (::send(ends[0], data, size, MSG_NOSIGNAL | MSG_DONTWAIT) != static_cast<ssize_t>(size)) {
      return -1;
    }
  }
  try {
    WireMessage message;
    std::size_t at = 0;
    while (receive_message(from, message, 0.05)) {
      const std::size_t bytes = kWireHeaderBytes + message.payload.size();
      if (bytes <= 65536) {
        send_message(to, message, 0.05);
        std::string sent(bytes, '\0');
        if (::recv(back[1], sent.data(), bytes, MSG_WAITALL) != static_cast<ssize_t>(bytes) ||
            sent != fuzz::text_of(data + at, bytes)) {
          fuzz::fail("sent again, the message is another");
        }
      }
      at += bytes;
      try {
        hello_of(message);
      } catch (const DeviceError&) {
        // no greeting
      }
      try {
        frame_of(std::move(message));
      } catch (const DeviceError&) {
        // no image
      }
    }
  } catch (const DeviceError& e) {
    if (std::string(e.what()).empty()) fuzz::fail("nothing is said");
  }
  return 0;
}
