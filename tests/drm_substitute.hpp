// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A card with displays in place of the kernel's DRM: modes, a clock of vertical blanks, page flips
/// that take time or go wrong. What is asked of it is written down in order.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "display/drm_calls.hpp"
#include "slicecorr/bridge/link.hpp"

namespace slicecorr::test {

using bridge::detail::DrmBuffer;
using bridge::detail::DrmCalls;
using bridge::detail::DrmConnector;
using bridge::detail::DrmCrtcState;
using bridge::detail::DrmFlip;
using bridge::detail::DrmGamma;
using bridge::detail::DrmMode;
using bridge::detail::DrmProperty;

/// What is left of the card when its calls are gone, as the kernel is when a file is closed.
struct DrmCard {
  double now_s = 1000;       ///< CLOCK_MONOTONIC
  double vblank0_s = 999.9;  ///< of vertical blank number `sequence0`
  std::uint32_t sequence0 = 5000;
  double period_s = 1.0 / 60;  ///< of the mode that is set
  std::vector<DrmConnector> connectors;
  std::map<std::uint32_t, DrmCrtcState> crtcs;
  DrmGamma gamma;
  std::vector<DrmProperty> properties;
  std::map<std::uint32_t, std::vector<std::uint32_t>> buffers;
  std::vector<std::string> calls;

  // What goes wrong.
  int master_error = 0, crtc_error = 0, buffer_error = 0, gamma_error = 0;
  std::deque<int> flip_errors;  ///< of the next flips; 0: well
  std::deque<int> skipped;      ///< blanks that the next flips miss; -1: never carried out
  bool dumb_buffers = true, monotonic_times = true, timed = true;
  double pack_s = 0;  ///< that passes while nobody is asked

  std::uint32_t shown = 0;  ///< buffer that is scanned out
  std::uint32_t next_id = 1;
  std::deque<std::pair<std::uint32_t, DrmFlip>> pending;

  void say(const std::string& what) { calls.push_back(what); }
  double blank_after(double time_s) const {
    return vblank0_s + (std::floor((time_s - vblank0_s) / period_s) + 1) * period_s;
  }
  std::uint32_t sequence_at(double blank_s) const {
    return sequence0 + static_cast<std::uint32_t>(std::llround((blank_s - vblank0_s) / period_s));
  }
  /// Time passes; flips are carried out.
  void pass_to(double time_s) {
    now_s = std::max(now_s, time_s);
    for (const auto& [buffer, flip] : pending) {
      if (flip.at_s <= now_s) shown = buffer;
    }
  }
  const std::vector<std::uint32_t>& seen() const { return buffers.at(shown); }
};

inline DrmMode drm_mode(int width, int height, double hz, bool interlaced = false) {
  DrmMode m;
  m.width_px = width;
  m.height_px = height;
  m.period_s = 1 / hz;
  m.interlaced = interlaced;
  return m;
}

class SubstituteDrm final : public DrmCalls {
 public:
  explicit SubstituteDrm(DrmCard& card) : card_(card) {}
  ~SubstituteDrm() override { card_.say("close"); }
  std::string card() const override { return "/dev/dri/card7"; }
  int become_master() override {
    card_.say("master");
    return card_.master_error;
  }
  void drop_master() override { card_.say("drop master"); }
  bool has_dumb_buffers() override { return card_.dumb_buffers; }
  bool has_monotonic_times() override { return card_.monotonic_times; }
  std::vector<DrmConnector> connectors() override { return card_.connectors; }
  bool is_connected(std::uint32_t id) override {
    return std::any_of(card_.connectors.begin(), card_.connectors.end(),
                       [&](const DrmConnector& c) { return c.id == id && c.connected; });
  }
  int read_crtc(std::uint32_t crtc, DrmCrtcState& state) override {
    state = card_.crtcs[crtc];
    return 0;
  }
  int set_crtc(std::uint32_t crtc, const DrmCrtcState& state) override {
    card_.say(!state.on ? fmt::format("crtc {} off", crtc)
                        : fmt::format("crtc {} buffer {} {}x{} {:.0f} Hz", crtc, name(state.buffer),
                                      state.mode.width_px, state.mode.height_px,
                                      1 / state.mode.period_s));
    if (card_.crtc_error != 0) return card_.crtc_error;
    card_.crtcs[crtc] = state;
    card_.pending.clear();
    card_.shown = state.buffer;
    if (state.on) card_.period_s = state.mode.period_s;
    return 0;
  }
  int read_gamma(std::uint32_t, DrmGamma& gamma) override {
    gamma = card_.gamma;
    return 0;
  }
  int set_gamma(std::uint32_t, const DrmGamma& gamma) override {
    card_.say("gamma");
    if (card_.gamma_error == 0) card_.gamma = gamma;
    return card_.gamma_error;
  }
  std::vector<DrmProperty> properties(std::uint32_t) override { return card_.properties; }
  int set_property(std::uint32_t, const DrmProperty& property) override {
    card_.say(fmt::format("{} = {}", property.name, property.value));
    for (DrmProperty& p : card_.properties) {
      if (p.id == property.id) p.value = property.value;
    }
    return 0;
  }
  int make_buffer(int width, int height, DrmBuffer& buffer) override {
    if (card_.buffer_error != 0) return card_.buffer_error;
    buffer.id = card_.next_id++;
    card_.say("make " + name(buffer.id));
    buffer.handle = buffer.id;
    // Rows are longer than the picture, as hardware likes them.
    buffer.pitch_px = static_cast<std::size_t>(width) + 16;
    auto& pixels = card_.buffers[buffer.id];
    pixels.assign(buffer.pitch_px * static_cast<std::size_t>(height), 0xDEADBEEF);
    buffer.pixels = pixels.data();
    buffer.bytes = pixels.size() * 4;
    return 0;
  }
  void free_buffer(const DrmBuffer& buffer) override {
    card_.say("free " + name(buffer.id));
    card_.buffers.erase(buffer.id);
    if (card_.buffers.empty()) card_.next_id = 1;
  }
  int flip(std::uint32_t crtc, std::uint32_t buffer) override {
    card_.say(fmt::format("flip {} {}", crtc, name(buffer)));
    if (!card_.flip_errors.empty()) {
      const int code = card_.flip_errors.front();
      card_.flip_errors.pop_front();
      if (code != 0) return code;
    }
    if (!card_.pending.empty()) return EBUSY;
    int skipped = 0;
    if (!card_.skipped.empty()) {
      skipped = card_.skipped.front();
      card_.skipped.pop_front();
    }
    const double blank_s =
        skipped < 0 ? 1e300 : card_.blank_after(card_.now_s) + skipped * card_.period_s;
    card_.pending.push_back({buffer, {skipped < 0 ? 0 : card_.sequence_at(blank_s), blank_s}});
    return 0;
  }
  int wait_flip(double timeout_s, DrmFlip& flip) override {
    const double until_s = card_.now_s + timeout_s;
    if (card_.pending.empty() || card_.pending.front().second.at_s > until_s) {
      card_.pass_to(until_s);
      return ETIMEDOUT;
    }
    flip = card_.pending.front().second;
    card_.pass_to(flip.at_s);
    card_.pending.pop_front();
    // Whoever waits is told somewhat later.
    card_.now_s += 0.0001;
    if (!card_.timed) flip = {};
    return 0;
  }
  double monotonic_s() const override {
    card_.now_s += card_.pack_s;
    return card_.now_s;
  }

 private:
  /// A, B, C in the order in which they were made.
  static std::string name(std::uint32_t id) {
    return id >= 1 && id <= 26 ? std::string(1, static_cast<char>('A' + id - 1))
                               : std::to_string(id);
  }
  DrmCard& card_;
};

/// The print's clock beside the card's, of another beginning.
class CardClock final : public bridge::BridgeClock {
 public:
  explicit CardClock(DrmCard& card) : card_(card), start_s_(card.now_s) {}
  double now_s() const override { return card_.now_s - start_s_; }
  void sleep_until(double time_s) override { card_.pass_to(start_s_ + time_s); }

 private:
  DrmCard& card_;
  const double start_s_;
};

}  // namespace slicecorr::test
