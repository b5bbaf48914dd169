// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The wire between the bridge and printer-sim's display: how images travel, for both ends.
///
/// A stream socket. Each message is a header of 48 bytes, little endian, then its payload; each
/// message of the bridge is answered by one message without payload before the next is sent:
///
///     0  u32 magic 'SCFW'      16 u32 height_px        40 u32 crc32 of header and payload
///     4  u16 version, 1        20 u32 flags            44 u32 payload_bytes
///     6  u16 kind              24 f64 at_s
///     8  i32 number            32 i64 count
///    12  u32 width_px
///
/// The checksum is taken with 0 in its own place.
///
/// - *hello* comes first, once. Payload: JSON, see `WireHello`. Answer: `at_s` is the machine's
///   clock.
/// - *frame*: image `number` of the stack as the display shows it: payload is width * height bytes
///   of blue, then as many of UV where `kWireUv` is among the flags. `number` -1 is black: no
///   payload, width and height 0. It is to appear at `at_s` of the machine's clock: the bridge has
///   waited for that time in real time, so it appears on arrival; in lockstep time first passes up
///   to `at_s`. Answer: `number` of the image that is on the display now, `at_s` when it appeared
///   on the machine's clock, `count` of images shown so far (black ones too, hello none).
/// - *tick*, in lockstep only: time passes up to `at_s`, nothing else. The bridge sends one before
///   each exchange of its cycle, and the n-th exchange happens n * cycle_s after the hello: so time
///   on both ends is the same also when exchanges are lost. Where a bridge has sent ticks,
///   exchanges let no time pass themselves.
///
/// Layer by layer slice n is exposed while the stage stands at start_um + (n + 1) * layer_um.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr::bridge {

inline constexpr std::uint32_t kWireMagic = 0x57464353;  // "SCFW"
inline constexpr std::uint16_t kWireVersion = 1;
inline constexpr std::size_t kWireHeaderBytes = 48;
inline constexpr std::uint32_t kWireUv = 1;  ///< flag: the image has UV pixels
inline constexpr std::uint32_t kWireMaxPayload = 1u << 30;

enum class WireKind : std::uint16_t { hello = 1, frame = 2, tick = 3, answer = 128 };

struct WireMessage {
  WireKind kind = WireKind::tick;
  std::int32_t number = kBlackFrame;
  std::uint32_t width_px = 0, height_px = 0, flags = 0;
  double at_s = 0;
  std::int64_t count = 0;
  std::vector<std::uint8_t> payload;
};

/// A socket that is closed with its owner.
class WireSocket {
 public:
  WireSocket() = default;
  explicit WireSocket(int descriptor) : descriptor_(descriptor) {}
  ~WireSocket();
  WireSocket(WireSocket&& other) noexcept;
  WireSocket& operator=(WireSocket&& other) noexcept;
  int get() const { return descriptor_; }
  explicit operator bool() const { return descriptor_ >= 0; }

 private:
  int descriptor_ = -1;
};

/// "unix:PATH" or "tcp:HOST:PORT". Throws `InputError` for what is neither, `DeviceError` when
/// nobody listens.
WireSocket connect_wire(const std::string& address);
/// Listens; PORT 0 is a free one. An old socket at PATH, where nobody listens, is replaced.
struct WireListener {
  WireSocket socket;
  std::string address;  ///< with the port that it became
};
WireListener listen_wire(const std::string& address);

/// Whole messages, within `timeout_s`. Throw `DeviceError` when the other end is gone, too slow, or
/// does not speak like this: wrong magic, version, kind, sizes or checksum.
void send_message(const WireSocket& socket, const WireMessage& message, double timeout_s);
/// False when the other end has closed between messages. `timeout_s` < 0: waits for the first byte
/// as long as it takes.
bool receive_message(const WireSocket& socket, WireMessage& message, double timeout_s);

/// What a recorder needs to know of a print.
struct WireHello {
  Setup setup;  ///< of the stack: printer, resin, process
  double layer_um = 0;
  int target_layers = 0, slices = 0;
  double start_um = 0;  ///< stage position of the first slice's begin
  double m = 1;         ///< exponent of intensity
  double cycle_s = 0.01;
  bool lockstep = false, dry_run = false;
  /// Of a tomographic job: frames of a turn; `slices` and `layer_um` are as in `PrintPlan`, images
  /// are counted on over all turns. 0: a stack.
  int angles = 0;
  /// This connection is that of the UV display: images are of UV light alone. The other one, of blue
  /// images, lets time pass in lockstep.
  bool uv_display = false;
};
WireMessage message_of(const WireHello& hello);
/// Throw `DeviceError` when the message is not right.
WireHello hello_of(const WireMessage& message);

WireMessage message_of(const Frame* frame, double at_s);  ///< null: black
/// The image that a message carries; null where it says black.
std::shared_ptr<const Frame> frame_of(WireMessage&& message);

/// CRC-32 of blue, then UV.
std::uint32_t crc32_of(const Frame& frame);

}  // namespace slicecorr::bridge
