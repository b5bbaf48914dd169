// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The sink that flips pages of a display's scan-out.

#include "display/drm_sink.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "display/pixels.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using namespace detail;

/// How long a flip may take: some vertical blanks, and no less than what a busy kernel does.
constexpr double kFlipPeriods = 10, kLeastFlipS = 0.25, kBlackS = 0.5;

/// Settings of a connector that change what a pixel's number becomes as light, and how they are
/// wanted. The first that there is of a line's words counts.
struct Setting {
  const char *property, *word, *other_word;
};
constexpr std::array<Setting, 6> kSettings{{
    {"DPMS", "On", nullptr},
    {"Broadcast RGB", "Full", nullptr},  // else 16 to 235
    {"scaling mode", "None", nullptr},
    {"underscan", "off", nullptr},
    {"dither", "off", nullptr},
    {"dithering mode", "off", nullptr},
}};

std::string text_of(int code) { return std::strerror(code); }

class DrmSink final : public FrameSink {
 public:
  DrmSink(std::unique_ptr<DrmCalls> calls, const std::string& connector, const Machine& machine,
          BridgeClock& clock)
      : calls_(std::move(calls)),
        clock_(clock),
        channels_(machine.projector),
        width_px_(machine.printer.width_px),
        height_px_(machine.printer.height_px) {
    try {
      begin(connector.empty() ? machine.projector.output : connector);
    } catch (...) {
      leave();
      throw;
    }
  }
  ~DrmSink() override { leave(); }

  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    check();
    DrmBuffer& buffer = buffers_[back_];
    const double start_s = calls_->monotonic_s();
    pack(frame.get(), channels_, width_px_, height_px_, buffer.pixels, buffer.pitch_px);
    Shown shown;
    shown.number = frame ? frame->number : kBlackFrame;
    shown.times.upload_s = calls_->monotonic_s() - start_s;
    // What is handed over half a period before appears at the vertical blank nearest to the time.
    clock_.sleep_until(at_s - period_s() / 2);
    const double handed_s = calls_->monotonic_s();
    const DrmFlip flip = flip_to(buffer, std::max(kFlipPeriods * period_s(), kLeastFlipS));
    back_ = 1 - back_;
    const double now_s = calls_->monotonic_s();
    const bool timed = flip.at_s > 0 && flip.at_s >= handed_s - period_s() && flip.at_s <= now_s;
    const double lit_s = timed ? flip.at_s : now_s;
    shown.at_s = clock_.now_s() - (now_s - lit_s);
    shown.times.present_s = lit_s - handed_s;
    if (timed) count_vblanks(flip, handed_s, shown.times);
    shown.count = ++count_;
    return shown;
  }

  void black() noexcept override {
    try {
      if (show_black()) ++count_;
    } catch (...) {
      // Lamps are off by now, and the display may be what failed.
    }
  }

  void check() override {
    if (!calls_->is_connected(connector_.id)) {
      throw DeviceError(place() + ": the display is disconnected");
    }
  }

  std::string describe() const override {
    return fmt::format("{}, {} x {} pixels, {:.2f} Hz", place(), width_px_, height_px_,
                       1 / period_s());
  }

 private:
  std::string place() const {
    return calls_->card() + (connector_.name.empty() ? "" : " " + connector_.name);
  }
  double period_s() const { return mode_.period_s; }

  [[noreturn]] void fail(const char* what, int code) const {
    if (code == EACCES || code == EPERM) {
      throw DeviceError(fmt::format("{}: {}: another program has taken the display ({})", place(),
                                    what, text_of(code)));
    }
    throw DeviceError(fmt::format("{}: {}: {}", place(), what, text_of(code)));
  }

  void begin(const std::string& name) {
    if (const int code = calls_->become_master(); code != 0) {
      throw DeviceError(
          fmt::format("{}: another program has the display, expected no X server, Wayland "
                      "compositor or other bridge on it ({})",
                      calls_->card(), text_of(code)));
    }
    master_ = true;
    if (!calls_->has_dumb_buffers() || !calls_->has_monotonic_times()) {
      throw DeviceError(calls_->card() +
                        ": this driver has no plain buffers, or no monotonic times of vertical "
                        "blanks; expected one that has both");
    }
    choose_connector(name);
    choose_mode();
    choose_crtc();
    if (const int code = calls_->read_crtc(crtc_, before_); code != 0) fail("reading it", code);
    for (DrmBuffer* buffer : {&buffers_[0], &buffers_[1], &black_}) {
      if (const int code = calls_->make_buffer(width_px_, height_px_, *buffer); code != 0) {
        fail("a buffer", code);
      }
      pack(nullptr, channels_, width_px_, height_px_, buffer->pixels, buffer->pitch_px);
    }
    changed_ = true;
    if (const int code = set_crtc_to(black_); code != 0) fail("setting its mode", code);
    make_linear();
  }

  void choose_connector(const std::string& name) {
    const auto all = calls_->connectors();
    std::string names;
    for (const DrmConnector& c : all) {
      names += fmt::format("{}{}{}", names.empty() ? "" : ", ", c.name,
                           c.connected ? "" : " (disconnected)");
    }
    if (names.empty()) names = "none";
    const auto found = std::find_if(all.begin(), all.end(), [&](const DrmConnector& c) {
      return name.empty() ? c.connected : c.name == name;
    });
    if (found == all.end() && !name.empty()) {
      throw InputError(calls_->card(), "",
                       fmt::format("has no connector '{}'; expected one of {}", name, names));
    }
    if (found == all.end() || !found->connected) {
      throw DeviceError(fmt::format("{}: no display is connected; connectors: {}",
                                    calls_->card() + (name.empty() ? "" : " " + name), names));
    }
    connector_ = *found;
  }

  void choose_mode() {
    std::string modes;
    const DrmMode* best = nullptr;
    for (const DrmMode& m : connector_.modes) {
      const std::string words =
          fmt::format("{} x {}{}{}", m.width_px, m.height_px, m.interlaced ? " interlaced" : "",
                      m.doubled ? " doubled" : "");
      if (modes.find(words) == std::string::npos) modes += (modes.empty() ? "" : ", ") + words;
      const bool fits = m.width_px == width_px_ && m.height_px == height_px_ && !m.interlaced &&
                        !m.doubled && m.period_s > 0;
      if (fits && (best == nullptr || m.period_s < best->period_s)) best = &m;
    }
    if (best == nullptr) {
      throw InputError(place(), "",
                       fmt::format("has no mode of exactly {} x {} pixels, those of the printer; "
                                   "its modes are {}",
                                   width_px_, height_px_, modes.empty() ? "none" : modes));
    }
    mode_ = *best;
  }

  void choose_crtc() {
    for (const std::uint32_t crtc : connector_.crtcs) {
      DrmCrtcState state;
      if (calls_->read_crtc(crtc, state) != 0) continue;
      // One that drives another display is not taken away from it.
      const bool of_another = state.on && !state.connectors.empty() &&
                              std::find(state.connectors.begin(), state.connectors.end(),
                                        connector_.id) == state.connectors.end();
      if (of_another) continue;
      crtc_ = crtc;
      return;
    }
    throw DeviceError(place() + ": all of the card's scan-outs drive other displays");
  }

  int set_crtc_to(const DrmBuffer& buffer) {
    DrmCrtcState state;
    state.on = true;
    state.buffer = buffer.id;
    state.mode = mode_;
    state.connectors = {connector_.id};
    return calls_->set_crtc(crtc_, state);
  }

  /// No table and no setting between a pixel's number and the display. What a driver refuses is as
  /// if it had none.
  void make_linear() {
    if (calls_->read_gamma(crtc_, gamma_before_) == 0 && !gamma_before_.red.empty()) {
      const std::size_t size = gamma_before_.red.size();
      DrmGamma linear;
      for (std::size_t i = 0; i < size; ++i) {
        linear.red.push_back(static_cast<std::uint16_t>(
            size > 1 ? (65535 * i + (size - 1) / 2) / (size - 1) : 65535));
      }
      linear.green = linear.blue = linear.red;
      if (const int code = calls_->set_gamma(crtc_, linear); code != 0) {
        fail("making its gamma table linear", code);
      }
      gamma_changed_ = true;
    }
    for (const DrmProperty& property : calls_->properties(connector_.id)) {
      for (const Setting& setting : kSettings) {
        if (property.name != setting.property) continue;
        const auto word =
            std::find_if(property.words.begin(), property.words.end(),
                         [&](const DrmProperty::Word& w) { return w.name == setting.word; });
        if (word == property.words.end()) continue;
        DrmProperty wanted = property;
        wanted.value = word->value;
        const bool is_dpms = property.name == "DPMS";
        if (!is_dpms && wanted.value == property.value) continue;
        if (calls_->set_property(connector_.id, wanted) == 0 && !is_dpms) {
          properties_before_.push_back(property);
        }
      }
    }
  }

  /// Flips and waits for it. Throws `DeviceError`.
  DrmFlip flip_to(const DrmBuffer& buffer, double limit_s) {
    const double until_s = calls_->monotonic_s() + limit_s;
    DrmFlip flip;
    if (pending_) {
      if (const int code = calls_->wait_flip(limit_s, flip); code != 0) {
        fail("waiting for an earlier page flip", code);
      }
      pending_ = false;
    }
    int code = calls_->flip(crtc_, buffer.id);
    while (code == EBUSY && calls_->monotonic_s() < until_s) {
      // The kernel is still at something of its own.
      calls_->wait_flip(std::min(period_s() / 4, 0.004), flip);
      code = calls_->flip(crtc_, buffer.id);
    }
    if (code != 0) fail("a page flip", code);
    pending_ = true;
    code = calls_->wait_flip(std::max(0.0, until_s - calls_->monotonic_s()), flip);
    if (code != 0) fail("a page flip was not carried out", code);
    pending_ = false;
    return flip;
  }

  /// Blanks that went by although the flip had been handed over before them.
  void count_vblanks(const DrmFlip& flip, double handed_s, DisplayTimes& times) {
    const auto step = [&](std::uint32_t from) {
      return static_cast<std::int64_t>(static_cast<std::int32_t>(flip.sequence - from));
    };
    if (!last_) {
      times.vblank = flip.sequence;
    } else {
      times.vblank = last_vblank_ + step(last_->sequence);
      const double next_s =
          last_->at_s + (std::floor((handed_s - last_->at_s) / period_s()) + 1) * period_s();
      const double missed = std::round((flip.at_s - next_s) / period_s());
      times.missed_vblanks = static_cast<int>(std::max(0.0, missed));
    }
    last_ = flip;
    last_vblank_ = times.vblank;
  }

  /// By a flip; where that fails, by setting the mode anew, which needs no flip to end.
  bool show_black() {
    if (!changed_) return false;
    try {
      if (!pending_) {
        flip_to(black_, kBlackS);
        return true;
      }
    } catch (const DeviceError&) {
      // The mode is set anew instead.
    }
    return set_crtc_to(black_) == 0;
  }

  void leave() noexcept {
    try {
      if (changed_) {
        show_black();
        DrmCrtcState before = before_;
        if (!before.on) before = {};
        if (before.on && before.connectors.empty()) before.connectors = {connector_.id};
        calls_->set_crtc(crtc_, before);
        if (gamma_changed_) calls_->set_gamma(crtc_, gamma_before_);
        for (const DrmProperty& p : properties_before_) calls_->set_property(connector_.id, p);
      }
      for (const DrmBuffer* buffer : {&buffers_[0], &buffers_[1], &black_}) {
        if (buffer->id != 0) calls_->free_buffer(*buffer);
      }
      if (master_) calls_->drop_master();
    } catch (...) {
      // The kernel takes back what is left with the file.
    }
    changed_ = master_ = false;
  }

  std::unique_ptr<DrmCalls> calls_;
  BridgeClock& clock_;
  const Projector channels_;
  const int width_px_, height_px_;
  bool master_ = false, changed_ = false, gamma_changed_ = false;
  bool pending_ = false;  ///< a flip was given up waiting for
  DrmConnector connector_;
  DrmMode mode_;
  std::uint32_t crtc_ = 0;
  DrmCrtcState before_;
  DrmGamma gamma_before_;
  std::vector<DrmProperty> properties_before_;
  std::array<DrmBuffer, 2> buffers_;
  DrmBuffer black_;
  std::size_t back_ = 0;
  std::optional<DrmFlip> last_;
  std::int64_t last_vblank_ = 0;
  std::int64_t count_ = 0;
};

}  // namespace

std::unique_ptr<FrameSink> detail::make_drm_sink(std::unique_ptr<DrmCalls> calls,
                                                 const std::string& connector,
                                                 const Machine& machine, BridgeClock& clock) {
  return std::make_unique<DrmSink>(std::move(calls), connector, machine, clock);
}

std::unique_ptr<FrameSink> make_drm_sink(const std::string& card, const std::string& connector,
                                         const Machine& machine, BridgeClock& clock) {
  return detail::make_drm_sink(open_drm(card), connector, machine, clock);
}

}  // namespace slicecorr::bridge
