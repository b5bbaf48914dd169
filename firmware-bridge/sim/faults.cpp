// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Faults on demand, by name.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/bridge/model.hpp"
#include "slicecorr/error.hpp"
#include "support/text/nearest.hpp"

namespace slicecorr::bridge {

namespace {

double number_of(const std::string& text, const std::string& whole, const char* what) {
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
    used = std::string::npos;
  }
  if (text.empty() || used != text.size() || !std::isfinite(value) || std::abs(value) > 1e9) {
    throw InputError(fmt::format("fault '{}': '{}' is no {}", whole, text, what));
  }
  return value;
}

}  // namespace

const std::vector<SimFaultKind>& sim_fault_kinds() {
  static const std::vector<SimFaultKind> kinds{
      {"late-reply", "wire", "seconds", 0.2,
       "an exchange is carried out, its answer comes so late"},
      {"wrong-reply", "wire", "exchanges", 1, "so many answers belong to no request"},
      {"drop", "wire", "exchanges", 1, "so many exchanges are carried out, but not answered"},
      {"disconnect", "wire", "seconds", 0,
       "connections are closed, and new ones for so long refused"},
      {"stuck-stage", "machine", "seconds", 0,
       "the stage does not follow its drive, for so long or for good (0)"},
      {"stage-slips", "machine", "um", 50, "the stage jumps by so much; one that turns by degrees"},
      {"stage-wobbles", "machine", "share", 0.02,
       "the stage's speed rises and falls by this share, once a millimetre or turn"},
      {"stage-fails", "machine", "", 0, "the drive stops and says so"},
      {"lamp-fails", "machine", "", 0, "blue goes dark, and the machine says so"},
      {"lamp-drifts", "machine", "share", 0.2,
       "within a second blue becomes brighter by this share than asked, or darker (negative)"},
      {"lamp-sticks", "machine", "", 0,
       "blue no longer follows what is asked; only the safety relay puts it off"},
      {"uv-fails", "machine", "", 0, "UV goes dark, and nothing says so"},
      {"door", "machine", "seconds", 0, "the door opens, for so long or for good (0)"},
      {"stop-button", "machine", "seconds", 0,
       "the stop button is pressed, for so long or for good (0)"},
      {"hot", "machine", "degrees", 90, "it gets so hot"},
      {"restart", "machine", "", 0, "the machine's controller starts anew"},
      {"freeze-display", "display", "", 0, "the display keeps its image"},
      {"late-frame", "display", "seconds", 0.1, "an image appears so late"},
      {"display-gone", "display", "", 0, "the display does not answer any more"},
      {"freeze-uv-display", "uv display", "", 0, "the UV display keeps its image"},
      {"late-uv-frame", "uv display", "seconds", 0.1, "an image of the UV display appears so late"},
      {"uv-display-gone", "uv display", "", 0, "the UV display does not answer any more"},
  };
  return kinds;
}

SimFault parse_sim_fault(const std::string& text) {
  SimFault fault;
  std::string rest = text;
  std::string moment;
  if (const auto at = rest.find('@'); at != std::string::npos) {
    moment = rest.substr(at + 1);
    rest.resize(at);
    if (moment.empty())
      throw InputError(fmt::format("fault '{}': expected a moment after @", text));
  }
  std::optional<std::string> value;
  if (const auto is = rest.find('='); is != std::string::npos) {
    value = rest.substr(is + 1);
    rest.resize(is);
  }
  fault.what = rest;
  const auto& kinds = sim_fault_kinds();
  const auto kind =
      std::find_if(kinds.begin(), kinds.end(), [&](const auto& k) { return k.name == rest; });
  if (kind == kinds.end()) {
    std::vector<std::string_view> names;
    std::string list;
    for (const auto& k : kinds) {
      names.push_back(k.name);
      list += (list.empty() ? "" : ", ") + std::string(k.name);
    }
    const std::string near = nearest(rest, names);
    throw InputError(fmt::format(
        "fault '{}': '{}' is not known; {}", text, rest,
        near.empty() ? "expected one of " + list : fmt::format("did you mean '{}'?", near)));
  }
  fault.value = kind->standard;
  if (value) {
    if (kind->value.empty()) {
      throw InputError(fmt::format("fault '{}': {} takes no value", text, rest));
    }
    fault.value = number_of(*value, text, "number");
    const bool any_sign = rest == "stage-slips" || rest == "lamp-drifts" || rest == "hot";
    const bool counts = rest == "drop" || rest == "wrong-reply";
    if (counts && (fault.value < 1 || fault.value != std::floor(fault.value))) {
      throw InputError(fmt::format("fault '{}': {} is no number of exchanges", text, *value));
    }
    if (rest == "stage-wobbles" && fault.value >= 1) {
      throw InputError(fmt::format("fault '{}': {} would turn the stage round", text, *value));
    }
    if (fault.value < 0 && !any_sign) {
      throw InputError(fmt::format("fault '{}': {} is below 0", text, *value));
    }
  }
  if (moment.starts_with("frame:")) {
    const double frame = number_of(moment.substr(6), text, "frame");
    if (frame < 0 || frame != std::floor(frame)) {
      throw InputError(fmt::format("fault '{}': '{}' is no frame", text, moment.substr(6)));
    }
    fault.at_frame = static_cast<int>(frame);
  } else if (!moment.empty()) {
    if (moment.back() != 's') {
      throw InputError(
          fmt::format("fault '{}': '{}' is no moment; expected TIMEs or frame:N", text, moment));
    }
    moment.pop_back();
    const double time = number_of(moment, text, "time");
    if (time < 0)
      throw InputError(fmt::format("fault '{}': {} s is before the beginning", text, time));
    fault.at_s = time;
  }
  return fault;
}

}  // namespace slicecorr::bridge
