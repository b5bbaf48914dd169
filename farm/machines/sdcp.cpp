// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/sdcp.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <iterator>

#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

using slicecorr::detail::member_of, slicecorr::detail::number_in, slicecorr::detail::text_in,
    slicecorr::detail::whole_in;

namespace {

constexpr std::size_t kMostText = 200;

std::string shown(const SdcpJson& json, const char* key) {
  return text::printable(text_in(json, key).substr(0, kMostText));
}

/// A number that may be written as a text, or as true and false.
std::optional<int> loose_number(const SdcpJson& value) {
  if (value.is_boolean()) return value.get<bool>() ? 1 : 0;
  if (value.is_number()) return static_cast<int>(std::clamp(value.get<double>(), -2e9, 2e9));
  if (!value.is_string()) return std::nullopt;
  const auto& text = value.get_ref<const std::string&>();
  int number = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || rest != text.data() + text.size()) return std::nullopt;
  return number;
}

/// CurrentStatus: a list, or of SDCP 1 a number.
std::vector<int> current_status(const SdcpJson& status) {
  const SdcpJson& current = member_of(status, "CurrentStatus");
  std::vector<int> list;
  const auto add = [&](const SdcpJson& value) {
    if (const auto number = loose_number(value)) list.push_back(*number);
  };
  if (current.is_array()) {
    for (std::size_t i = 0; i < std::min<std::size_t>(current.size(), 32); ++i) add(current[i]);
  } else {
    add(current);
  }
  return list;
}

struct Phase {
  int number;
  MachineState state;
  const char* name;
};
constexpr Phase kPhases[] = {{0, MachineState::printing, ""},
                             {1, MachineState::printing, "homing"},
                             {2, MachineState::printing, "descending"},
                             {3, MachineState::printing, "exposing"},
                             {4, MachineState::printing, "lifting"},
                             {5, MachineState::pausing, ""},
                             {6, MachineState::paused, ""},
                             {7, MachineState::stopping, ""},
                             {8, MachineState::stopped, ""},
                             {9, MachineState::finished, ""},
                             {10, MachineState::starting, "checking the file"}};

void read_phase(int number, bool first, MachineStatus& s) {
  if (number == 16) {
    s.state = first ? MachineState::finished : MachineState::printing;
    s.phase = first ? "" : "preheating";
    return;
  }
  for (const Phase& p : kPhases) {
    if (p.number != number) continue;
    s.state = p.state;
    s.phase = p.name;
    return;
  }
  s.state = MachineState::printing;
  s.phase = fmt::format("other ({})", number);
}

const char* const kErrors[] = {"",
                               "the file's checksum is wrong",
                               "the file can't be read",
                               "the file has another resolution",
                               "the file has a format that it does not read",
                               "the file is for another machine"};

/// Why a print ended, by `ErrorStatusReason`. No source names 23.
const char* const kReasons[] = {"",
                                "it got too hot",
                                "its strain gauge was not calibrated",
                                "the resin is low",
                                "the print needs more resin than the vat holds",
                                "there is no resin",
                                "something foreign is in the vat",
                                "its platform was not levelled",
                                "the model came off",
                                "its strain gauge does not answer",
                                "its LCD has a fault",
                                "its release film is worn out",
                                "the USB disk was pulled out",
                                "its X axis did not find its home",
                                "its Z axis did not find its home",
                                "the resin stands too high",
                                "the resin stands too low",
                                "an axis did not find its home",
                                "a model is on the platform",
                                "the print had a fault",
                                "a motor has a fault",
                                "no model was seen",
                                "the model is warped",
                                "reason 23",
                                "the file is bad",
                                "its camera has a fault",
                                "the network has a fault",
                                "its server can't be reached",
                                "its app can't be reached",
                                "its resin feeder has a fault",
                                "its resin feeder has a fault",
                                "its resin feeder has a fault",
                                "its resin feeder has a fault",
                                "the vat's sensor has a fault",
                                "the vat's sensor has a fault"};

void read_print(const SdcpJson& info, MachineStatus& s) {
  const auto whole = [&](const char* key) -> std::optional<int> {
    const auto n = number_in(info, key);
    return n && *n >= 0 ? std::optional(static_cast<int>(std::min(*n, 2e9))) : std::nullopt;
  };
  s.layer = whole("CurrentLayer");
  s.layers = whole("TotalLayer");
  const auto run = number_in(info, "CurrentTicks"), all = number_in(info, "TotalTicks");
  if (run && *run >= 0) s.run_s = *run / 1000;
  if (run && all && *all >= *run) s.left_s = (*all - *run) / 1000;
  s.file = shown(info, "Filename");
  const std::string task = text_in(info, "TaskId");
  if (task.size() <= 64) s.task = text::printable(task);
}

}  // namespace

SdcpJson sdcp_json(const std::string& text) {
  return slicecorr::detail::try_json<SdcpJson>(text, {std::size_t{8} << 20, 16, 200'000});
}

const SdcpJson& sdcp_status_of(const SdcpJson& message) {
  const SdcpJson& top = member_of(message, "Status");
  return top.is_object() ? top : member_of(member_of(message, "Data"), "Status");
}

MachineStatus sdcp_status(const SdcpJson& message, bool first) {
  const SdcpJson& inner = sdcp_status_of(message);
  const SdcpJson& status = inner.is_object() ? inner : message;
  MachineStatus s;
  const std::vector<int> current = current_status(status);
  const auto has = [&](int number) {
    return std::find(current.begin(), current.end(), number) != current.end();
  };
  const SdcpJson& info = member_of(status, "PrintInfo");
  const int phase = loose_number(member_of(info, "Status")).value_or(0);
  if (has(1)) {
    read_phase(phase, first, s);
    read_print(info, s);
  } else if (has(8)) {
    s.state = MachineState::checking;
  } else if (has(2)) {
    s.state = MachineState::uploading;
  } else if (has(3)) {
    s.state = MachineState::busy;
    s.phase = "exposure test";
  } else if (has(4)) {
    s.state = MachineState::busy;
    s.phase = "self-check";
  } else if (current.empty() || has(0)) {
    s.state = current.empty() ? MachineState::unknown : MachineState::idle;
    // Right after a print the last phase stays; layers of an old print are none of a new one.
    const bool ended = phase == 8 || phase == 9 || (first && phase == 16);
    if (ended && !current.empty()) {
      read_phase(phase, first, s);
      read_print(info, s);
    }
  } else {
    s.state = MachineState::busy;
    s.phase = fmt::format("other ({})", current.front());
  }
  const int error = loose_number(member_of(info, "ErrorNumber")).value_or(0);
  if (error > 0) {
    s.trouble = error < static_cast<int>(std::size(kErrors)) ? kErrors[error]
                                                             : fmt::format("error {}", error);
  }
  return s;
}

std::optional<PrintEnd> sdcp_end(const SdcpJson& task) {
  PrintEnd end;
  switch (whole_in(task, "TaskStatus", 0)) {
    case 1:
      end.state = MachineState::finished;
      return end;
    case 2:
      end.state = MachineState::failed;
      break;
    case 3:
      end.state = MachineState::stopped;
      break;
    default:
      return std::nullopt;
  }
  const int reason = loose_number(member_of(task, "ErrorStatusReason")).value_or(0);
  if (reason > 0) {
    end.why = reason < static_cast<int>(std::size(kReasons)) ? kReasons[reason]
                                                             : fmt::format("reason {}", reason);
  }
  return end;
}

std::string sdcp_error(const SdcpJson& message) {
  const SdcpJson& data = member_of(member_of(message, "Data"), "Data");
  const auto code = loose_number(member_of(data, "ErrorCode"));
  if (text_in(message, "Topic").find("sdcp/error/") == std::string::npos || !code || *code == 0)
    return {};
  return *code == 1   ? "the checksum of the file that it got is wrong"
         : *code == 2 ? "the file that it got has a format that it does not read"
                      : fmt::format("error {}", *code);
}

MachineFacts sdcp_facts(const SdcpJson& message) {
  const SdcpJson& top = member_of(message, "Attributes");
  const SdcpJson& nested = member_of(member_of(message, "Data"), "Attributes");
  const SdcpJson& a = top.is_object() ? top : nested.is_object() ? nested : message;
  MachineFacts facts;
  facts.model = shown(a, "MachineName");
  facts.firmware = shown(a, "FirmwareVersion");
  facts.id = shown(a, "MainboardID");
  const std::string resolution = text_in(a, "Resolution");
  const auto number = [](std::string_view text) {
    int n = 0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), n);
    return error == std::errc{} && rest == text.data() + text.size() && n > 0 && n <= 100'000 ? n
                                                                                              : 0;
  };
  if (const std::size_t x = resolution.find_first_of("xX*"); x != resolution.npos) {
    facts.width_px = number(trimmed(std::string_view(resolution).substr(0, x)));
    facts.height_px = number(trimmed(std::string_view(resolution).substr(x + 1)));
    if (facts.width_px == 0 || facts.height_px == 0) facts.width_px = facts.height_px = 0;
  }
  const SdcpJson& types = member_of(a, "SupportFileType");
  for (std::size_t i = 0; types.is_array() && i < std::min<std::size_t>(types.size(), 32); ++i) {
    if (types[i].is_string()) {
      facts.formats.push_back(
          lower_case(types[i].get_ref<const std::string&>().substr(0, kMostText)));
    }
  }
  return facts;
}

SdcpPart sdcp_part(int http_status, const std::string& body) {
  SdcpPart part;
  const SdcpJson json = sdcp_json(body);
  const std::string code = text_in(json, "code");
  if (http_status == 200 && code == "000000") {
    part.taken = true;
    return part;
  }
  if (!json.is_object() || code.empty()) {
    part.trouble = fmt::format("answers {} with what is no answer to an upload", http_status);
    return part;
  }
  part.trouble =
      fmt::format("refuses a part of the file (code {})", text::printable(code.substr(0, 20)));
  const SdcpJson& messages = member_of(json, "messages");
  for (std::size_t i = 0; messages.is_array() && i < std::min<std::size_t>(messages.size(), 8);
       ++i) {
    const SdcpJson& message = member_of(messages[i], "message");
    const auto number = loose_number(message);
    if (text_in(messages[i], "field") == "common_field" && number) {
      part.other_offset = *number == -2;
      part.trouble += *number == -1   ? ": a place below 0"
                      : *number == -2 ? ": it holds other bytes than were sent"
                      : *number == -3 ? ": it can't open its file"
                                      : fmt::format(": error {}", *number);
    } else if (message.is_string()) {
      part.trouble += ": " + shown(messages[i], "message");
    }
  }
  return part;
}

std::string start_trouble(int ack) {
  constexpr const char* words[] = {"",
                                   "is busy",
                                   "does not find the file",
                                   "finds the file's checksum wrong",
                                   "can't read the file",
                                   "finds that the file has another resolution",
                                   "finds that the file has another format",
                                   "finds that the file is for another machine"};
  return ack >= 0 && ack < static_cast<int>(std::size(words)) ? words[ack]
                                                              : fmt::format("answers {}", ack);
}

std::optional<FoundMachine> sdcp_found(const std::string& datagram, const std::string& from) {
  const SdcpJson json = sdcp_json(datagram);
  const SdcpJson& data = member_of(json, "Data");
  if (!data.is_object()) return std::nullopt;
  const SdcpJson& nested = member_of(data, "Attributes");
  const SdcpJson& a = nested.is_object() ? nested : data;
  FoundMachine found;
  found.host = from;
  found.id = shown(a, "MainboardID");
  found.version = shown(a, "ProtocolVersion");
  found.name = shown(a, "Name");
  found.model = shown(a, "MachineName");
  found.firmware = shown(a, "FirmwareVersion");
  if (found.id.empty()) return std::nullopt;
  found.kind = found.version.starts_with("V1") ? MachineKind::sdcp1 : MachineKind::sdcp3;
  return found;
}

std::string sdcp_text(const SdcpRequest& r, bool first) {
  SdcpJson json = {{"Id", r.machine},
                   {"Data",
                    {{"Cmd", r.cmd},
                     {"Data", r.data},
                     {"RequestID", r.id},
                     {"MainboardID", r.machine},
                     {"TimeStamp", first ? r.wall_ms : r.wall_ms / 1000},
                     {"From", 0}}}};
  if (!first) json["Topic"] = "sdcp/request/" + r.machine;
  return json.dump(-1, ' ', false, SdcpJson::error_handler_t::replace);
}

const SdcpJson* sdcp_answer(const SdcpJson& message, const SdcpRequest& request) {
  const SdcpJson& data = member_of(message, "Data");
  if (text_in(data, "RequestID") != request.id || whole_in(data, "Cmd", -1) != request.cmd) {
    return nullptr;
  }
  return &member_of(data, "Data");
}

}  // namespace slicecorr::farm::detail
