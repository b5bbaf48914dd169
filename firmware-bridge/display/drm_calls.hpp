// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the DRM sink asks of the kernel: few calls, so that a test can stand in for it. The real
/// ones are in drm_calls.cpp. Where a call gives an int, that is an errno, 0: done. One thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace slicecorr::bridge::detail {

struct DrmMode {
  int width_px = 0, height_px = 0;
  double period_s = 0;  ///< from vertical blank to vertical blank
  bool interlaced = false, doubled = false;
  std::shared_ptr<const void> raw;  ///< the kernel's own words
};

struct DrmConnector {
  std::uint32_t id = 0;
  std::string name;  ///< "HDMI-A-1"
  bool connected = false;
  std::vector<DrmMode> modes;
  std::vector<std::uint32_t> crtcs;  ///< that can drive it, the one that does so now first
};

/// What a CRTC does.
struct DrmCrtcState {
  bool on = false;
  std::uint32_t buffer = 0, x = 0, y = 0;
  DrmMode mode;
  std::vector<std::uint32_t> connectors;
};

/// Red, green, blue; empty: there is no table.
struct DrmGamma {
  std::vector<std::uint16_t> red, green, blue;
};

/// A property of a kernel object: the words that it may take with their values, or a number.
struct DrmProperty {
  std::uint32_t id = 0;
  std::string name;
  std::uint64_t value = 0;
  struct Word {
    std::string name;
    std::uint64_t value = 0;
  };
  std::vector<Word> words;  ///< of an enumeration
};

struct DrmBuffer {
  std::uint32_t id = 0, handle = 0;
  std::uint32_t* pixels = nullptr;  ///< XRGB8888
  std::size_t pitch_px = 0, bytes = 0;
};

/// A page flip that was carried out.
struct DrmFlip {
  std::uint32_t sequence = 0;  ///< of the vertical blank, wraps; 0 and
  double at_s = 0;             ///< 0 where the driver has none; CLOCK_MONOTONIC
};

class DrmCalls {
 public:
  virtual ~DrmCalls() = default;
  virtual std::string card() const = 0;
  virtual int become_master() = 0;
  virtual void drop_master() = 0;
  virtual bool has_dumb_buffers() = 0;
  virtual bool has_monotonic_times() = 0;
  /// Asks displays for their modes anew.
  virtual std::vector<DrmConnector> connectors() = 0;
  /// As the kernel last knew it, quickly.
  virtual bool is_connected(std::uint32_t connector) = 0;
  virtual int read_crtc(std::uint32_t crtc, DrmCrtcState& state) = 0;
  /// Sets mode and image of a CRTC; switches it off where `state.on` is false.
  virtual int set_crtc(std::uint32_t crtc, const DrmCrtcState& state) = 0;
  virtual int read_gamma(std::uint32_t crtc, DrmGamma& gamma) = 0;
  virtual int set_gamma(std::uint32_t crtc, const DrmGamma& gamma) = 0;
  virtual std::vector<DrmProperty> properties(std::uint32_t connector) = 0;
  virtual int set_property(std::uint32_t connector, const DrmProperty& property) = 0;
  virtual int make_buffer(int width_px, int height_px, DrmBuffer& buffer) = 0;
  virtual void free_buffer(const DrmBuffer& buffer) = 0;
  /// At the next vertical blank; `wait_flip` tells when it was.
  virtual int flip(std::uint32_t crtc, std::uint32_t buffer) = 0;
  /// Waits for a flip at most so long; ETIMEDOUT.
  virtual int wait_flip(double timeout_s, DrmFlip& flip) = 0;
  virtual double monotonic_s() const = 0;
};

/// "/dev/dri/card0", "card0", "0" or empty: the first with a connected display. Throws `InputError`
/// and `DeviceError`.
std::unique_ptr<DrmCalls> open_drm(const std::string& card);

}  // namespace slicecorr::bridge::detail
