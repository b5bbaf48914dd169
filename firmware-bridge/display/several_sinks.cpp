// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "display/several_sinks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "frames/wire.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

Shown SeveralSinks::show(const std::shared_ptr<const Frame>& frame, double at_s) {
  const Shown first = sinks_.front()->show(frame, at_s);
  for (std::size_t i = 1; i < sinks_.size(); ++i) {
    const Shown other = sinks_[i]->show(frame, at_s);
    if (other.number != first.number) {
      throw DeviceError(fmt::format("{} shows image {}, {} image {}", sinks_.front()->describe(),
                                    first.number, sinks_[i]->describe(), other.number));
    }
  }
  return first;
}

void SeveralSinks::black() noexcept {
  for (const auto& sink : sinks_) sink->black();
}

void SeveralSinks::tick(double at_s) {
  for (const auto& sink : sinks_) sink->tick(at_s);
}

void SeveralSinks::check() {
  for (const auto& sink : sinks_) sink->check();
}

std::string SeveralSinks::describe() const {
  std::string all;
  for (const auto& sink : sinks_) all += (all.empty() ? "" : ", ") + sink->describe();
  return all;
}

namespace {

/// "drm:A:B" -> "drm", "A", "B".
std::vector<std::string> parts_of(const std::string& name) {
  std::vector<std::string> parts{""};
  for (const char c : name) {
    if (c == ':') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace

std::unique_ptr<FrameSink> make_several_sinks(std::vector<std::unique_ptr<FrameSink>> sinks) {
  return std::make_unique<SeveralSinks>(std::move(sinks));
}

void check_sinks(const std::vector<std::string>& names, bool lockstep) {
  int windows = 0;
  std::vector<std::string> seen;
  for (const std::string& name : names) {
    const auto parts = parts_of(name);
    const bool wire = name.starts_with("unix:") || name.starts_with("tcp:");
    const bool window = parts[0] == "window" && parts.size() <= 2;
    const bool drm = parts[0] == "drm" && parts.size() <= 3;
    if (!wire && !window && !drm && name != "null") {
      throw InputError(
          fmt::format("--sink is '{}', expected window[:DISPLAY], drm[:CARD[:CONNECTOR]], "
                      "unix:PATH, tcp:HOST:PORT or null",
                      name));
    }
    if (window && ++windows > 1) {
      throw InputError("two windows; expected one of --sink and --uv-sink to be a window");
    }
    if (drm && lockstep) {
      throw InputError(name + " has a time of its own; expected no --lockstep with it");
    }
    if (name != "null" && std::find(seen.begin(), seen.end(), name) != seen.end()) {
      throw InputError(name + " is given twice; expected a display of its own for each sink");
    }
    seen.push_back(name);
  }
}

std::unique_ptr<FrameSink> open_sinks(const std::vector<std::string>& names, const Machine& machine,
                                      const WireHello& hello, BridgeClock& clock) {
  check_sinks(names, hello.lockstep);
  std::vector<std::unique_ptr<FrameSink>> sinks;
  for (const std::string& name : names) {
    auto parts = parts_of(name);
    parts.resize(3);
    if (parts[0] == "window") {
      sinks.push_back(make_window_sink(parts[1], machine, clock));
    } else if (parts[0] == "drm") {
      sinks.push_back(make_drm_sink(parts[1], parts[2], machine, clock));
    } else if (name == "null") {
      sinks.push_back(make_null_sink(clock));
    } else {
      sinks.push_back(make_wire_sink(name, hello, clock));
    }
  }
  if (sinks.empty()) return make_null_sink(clock);
  return sinks.size() == 1 ? std::move(sinks.front()) : make_several_sinks(std::move(sinks));
}

}  // namespace slicecorr::bridge
