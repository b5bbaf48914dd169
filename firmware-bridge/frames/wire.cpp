// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "frames/wire.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>
#include <zlib.h>

#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/setup.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::bridge {
namespace {

using Time = std::chrono::steady_clock;
constexpr std::uint32_t kMostHelloBytes = 64u << 20;  // the picture of a flat-field is in it

template <class T>
void put(std::uint8_t* out, T value) {
  for (std::size_t i = 0; i < sizeof value; ++i) {
    out[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
}

template <class T>
T get(const std::uint8_t* in) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{in[i]} << (8 * i);
  return static_cast<T>(value);
}

std::uint32_t crc(const std::vector<std::uint8_t>& bytes, std::uint32_t start = 0) {
  // zlib takes a null pointer for a new beginning.
  if (bytes.empty()) return start;
  return static_cast<std::uint32_t>(::crc32_z(start, bytes.data(), bytes.size()));
}

std::uint32_t crc(const std::uint8_t (&header)[kWireHeaderBytes]) {
  return static_cast<std::uint32_t>(::crc32_z(0, header, sizeof header));
}

[[noreturn]] void wrong(const std::string& what) { throw DeviceError("frame wire: " + what); }

/// Waits until the socket can be read from or written to, or the time is over.
void wait_for(int descriptor, short what, const std::optional<Time::time_point>& until) {
  while (true) {
    int timeout_ms = -1;
    if (until) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(*until - Time::now());
      if (left.count() < 0) wrong("the other end does not answer");
      timeout_ms = static_cast<int>(left.count()) + 1;
    }
    pollfd p{descriptor, what, 0};
    const int ready = ::poll(&p, 1, timeout_ms);
    if (ready > 0) return;
    if (ready < 0 && errno != EINTR) wrong(std::strerror(errno));
  }
}

/// False when the stream ends before the first byte.
bool read_all(int descriptor, std::uint8_t* out, std::size_t size,
              std::optional<Time::time_point> until) {
  std::size_t have = 0;
  while (have < size) {
    const ssize_t n = ::recv(descriptor, out + have, size - have, MSG_DONTWAIT);
    if (n > 0) {
      have += static_cast<std::size_t>(n);
    } else if (n == 0) {
      if (have == 0) return false;
      wrong("the other end is gone");
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      wait_for(descriptor, POLLIN, until);
    } else if (errno != EINTR) {
      wrong(std::strerror(errno));
    }
  }
  return true;
}

void write_all(int descriptor, const std::uint8_t* data, std::size_t size, int flags,
               const Time::time_point& until) {
  while (size > 0) {
    const ssize_t n = ::send(descriptor, data, size, MSG_DONTWAIT | MSG_NOSIGNAL | flags);
    if (n > 0) {
      data += n;
      size -= static_cast<std::size_t>(n);
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      wait_for(descriptor, POLLOUT, until);
    } else if (n < 0 && errno != EINTR) {
      wrong(errno == EPIPE || errno == ECONNRESET ? "the other end is gone" : std::strerror(errno));
    }
  }
}

Time::time_point in(double seconds) {
  return Time::now() + std::chrono::duration_cast<Time::duration>(
                           std::chrono::duration<double>(std::min(seconds, 1e6)));
}

void check(const WireMessage& m, std::uint32_t payload_bytes) {
  if (!std::isfinite(m.at_s)) wrong("a time that is no number");
  switch (m.kind) {
    case WireKind::hello:
      if (payload_bytes == 0) wrong("a hello without facts");
      if (payload_bytes > kMostHelloBytes) {
        wrong(fmt::format("a hello of {} bytes", payload_bytes));
      }
      return;
    case WireKind::frame: {
      if (m.number < kBlackFrame) wrong(fmt::format("frame {}", m.number));
      if (m.width_px > std::uint32_t{kMostPixelsAcross} ||
          m.height_px > std::uint32_t{kMostPixelsAcross} ||
          (m.number == kBlackFrame) != (m.width_px == 0) ||
          (m.width_px == 0) != (m.height_px == 0) || (m.flags & ~kWireUv) != 0) {
        wrong(fmt::format("frame {} of {} x {} pixels, flags {}", m.number, m.width_px, m.height_px,
                          m.flags));
      }
      const std::uint64_t expected =
          std::uint64_t{m.width_px} * m.height_px * ((m.flags & kWireUv) != 0 ? 2 : 1);
      if (payload_bytes != expected) {
        wrong(fmt::format("frame {} has {} bytes, expected {}", m.number, payload_bytes, expected));
      }
      return;
    }
    case WireKind::tick:
    case WireKind::answer:
      if (payload_bytes != 0) wrong("a payload where none belongs");
      return;
  }
  wrong(fmt::format("a message of kind {}", static_cast<int>(m.kind)));
}

}  // namespace

WireSocket::~WireSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}
WireSocket::WireSocket(WireSocket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}
WireSocket& WireSocket::operator=(WireSocket&& other) noexcept {
  if (this != &other) {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = std::exchange(other.descriptor_, -1);
  }
  return *this;
}

void send_message(const WireSocket& socket, const WireMessage& m, double timeout_s) {
  if (m.payload.size() > kWireMaxPayload) wrong("an image too large for the wire");
  std::uint8_t header[kWireHeaderBytes];
  put(header, kWireMagic);
  put(header + 4, kWireVersion);
  put(header + 6, static_cast<std::uint16_t>(m.kind));
  put(header + 8, static_cast<std::uint32_t>(m.number));
  put(header + 12, m.width_px);
  put(header + 16, m.height_px);
  put(header + 20, m.flags);
  put(header + 24, std::bit_cast<std::uint64_t>(m.at_s));
  put(header + 32, static_cast<std::uint64_t>(m.count));
  put(header + 40, std::uint32_t{0});
  put(header + 44, static_cast<std::uint32_t>(m.payload.size()));
  put(header + 40, crc(m.payload, crc(header)));
  const Time::time_point until = in(timeout_s);
  write_all(socket.get(), header, sizeof header, m.payload.empty() ? 0 : MSG_MORE, until);
  write_all(socket.get(), m.payload.data(), m.payload.size(), 0, until);
}

bool receive_message(const WireSocket& socket, WireMessage& m, double timeout_s) {
  std::uint8_t header[kWireHeaderBytes];
  std::optional<Time::time_point> until;
  if (timeout_s >= 0) until = in(timeout_s);
  if (!read_all(socket.get(), header, 1, until)) return false;
  // Who has begun a message must end it.
  if (!until) until = in(10);
  if (!read_all(socket.get(), header + 1, sizeof header - 1, until)) wrong("half a message");
  if (get<std::uint32_t>(header) != kWireMagic) wrong("the other end speaks something else");
  const auto version = get<std::uint16_t>(header + 4);
  if (version != kWireVersion) {
    wrong(fmt::format("version {}, expected {}", version, kWireVersion));
  }
  m.kind = static_cast<WireKind>(get<std::uint16_t>(header + 6));
  m.number = static_cast<std::int32_t>(get<std::uint32_t>(header + 8));
  m.width_px = get<std::uint32_t>(header + 12);
  m.height_px = get<std::uint32_t>(header + 16);
  m.flags = get<std::uint32_t>(header + 20);
  m.at_s = std::bit_cast<double>(get<std::uint64_t>(header + 24));
  m.count = static_cast<std::int64_t>(get<std::uint64_t>(header + 32));
  const auto expected_crc = get<std::uint32_t>(header + 40);
  put(header + 40, std::uint32_t{0});
  const auto size = get<std::uint32_t>(header + 44);
  if (size > kWireMaxPayload) wrong(fmt::format("a message of {} bytes", size));
  check(m, size);
  m.payload.resize(size);
  if (size > 0 && !read_all(socket.get(), m.payload.data(), size, until)) wrong("half a message");
  if (crc(m.payload, crc(header)) != expected_crc)
    wrong("a message was changed on its way (checksum)");
  return true;
}

WireMessage message_of(const WireHello& hello) {
  nlohmann::ordered_json json;
  json["version"] = kWireVersion;
  json["setup"] = slicecorr::detail::own_json<nlohmann::ordered_json>(setup_json(hello.setup));
  json["layer_um"] = hello.layer_um;
  json["target_layers"] = hello.target_layers;
  json["slices"] = hello.slices;
  json["start_um"] = hello.start_um;
  json["m"] = hello.m;
  json["cycle_s"] = hello.cycle_s;
  json["lockstep"] = hello.lockstep;
  json["dry_run"] = hello.dry_run;
  if (hello.angles > 0) json["angles"] = hello.angles;
  if (hello.uv_display) json["uv_display"] = true;
  const std::string text = json.dump();
  WireMessage message;
  message.kind = WireKind::hello;
  message.payload.assign(text.begin(), text.end());
  return message;
}

WireHello hello_of(const WireMessage& message) {
  if (message.kind != WireKind::hello) wrong("expected a hello first");
  WireHello hello;
  try {
    const std::string_view text(reinterpret_cast<const char*>(message.payload.data()),
                                message.payload.size());
    const auto json =
        slicecorr::detail::read_json<nlohmann::ordered_json>(text, {"frame wire", ""});
    if (json.at("version") != kWireVersion) {
      wrong(
          fmt::format("hello of version {}, expected {}", json.at("version").dump(), kWireVersion));
    }
    hello.setup = parse_setup_json(json.at("setup").dump(), "frame wire");
    hello.layer_um = json.at("layer_um").get<double>();
    hello.target_layers = json.at("target_layers").get<int>();
    hello.slices = json.at("slices").get<int>();
    hello.start_um = json.at("start_um").get<double>();
    hello.m = json.at("m").get<double>();
    hello.cycle_s = json.at("cycle_s").get<double>();
    hello.lockstep = json.at("lockstep").get<bool>();
    hello.dry_run = json.at("dry_run").get<bool>();
    hello.angles = json.value("angles", 0);
    hello.uv_display = json.value("uv_display", false);
  } catch (const nlohmann::json::exception& e) {
    wrong("hello: " + slicecorr::detail::in_words(e));
  } catch (const InputError& e) {
    wrong(std::string("hello: ") + e.what());
  }
  if (!(hello.layer_um > 0) || hello.slices < 1 || hello.slices > 1'000'000'000 ||
      hello.angles < 0 || (hello.angles == 0 && hello.slices > 1'000'000) || !(hello.m > 0) ||
      !(hello.cycle_s > 0) || !std::isfinite(hello.start_um)) {
    wrong("hello: values out of range");
  }
  return hello;
}

WireMessage message_of(const Frame* frame, double at_s) {
  WireMessage m;
  m.kind = WireKind::frame;
  m.at_s = at_s;
  if (frame == nullptr || frame->number < 0) return m;
  m.number = frame->number;
  m.width_px = static_cast<std::uint32_t>(frame->width_px);
  m.height_px = static_cast<std::uint32_t>(frame->height_px);
  m.payload = frame->blue;
  if (!frame->uv.empty()) {
    m.flags |= kWireUv;
    m.payload.insert(m.payload.end(), frame->uv.begin(), frame->uv.end());
  }
  return m;
}

std::shared_ptr<const Frame> frame_of(WireMessage&& m) {
  if (m.kind != WireKind::frame) wrong("expected a frame");
  if (m.number < 0) return nullptr;
  auto frame = std::make_shared<Frame>();
  frame->number = m.number;
  frame->width_px = static_cast<int>(m.width_px);
  frame->height_px = static_cast<int>(m.height_px);
  const std::size_t pixels = std::size_t{m.width_px} * m.height_px;
  if ((m.flags & kWireUv) != 0) {
    frame->uv.assign(m.payload.begin() + static_cast<std::ptrdiff_t>(pixels), m.payload.end());
    m.payload.resize(pixels);
  }
  frame->blue = std::move(m.payload);
  frame->crc32 = crc32_of(*frame);
  return frame;
}

std::uint32_t crc32_of(const Frame& frame) { return crc(frame.uv, crc(frame.blue)); }

}  // namespace slicecorr::bridge
