// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file sdcp.hpp
/// What SDCP 3 and SDCP 1 say: their messages, read so that what is missing, unknown or of another
/// type than expected spoils nothing else.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

using SdcpJson = nlohmann::ordered_json;

/// A text of a machine; discarded where it is none of JSON, or beyond the bounds.
SdcpJson sdcp_json(const std::string& text);

/// A status: the whole message, or its member `Status` at either place. `first`: of SDCP 1, whose
/// numbers differ.
MachineStatus sdcp_status(const SdcpJson& message, bool first = false);
/// The member `Status` of a message; null where there is none.
const SdcpJson& sdcp_status_of(const SdcpJson& message);

/// How a print ended, by its entry in the machine's history; nothing where that says none of it.
std::optional<PrintEnd> sdcp_end(const SdcpJson& task);

/// What a message of the topic of errors says; empty: it is none.
std::string sdcp_error(const SdcpJson& message);

/// Attributes: the whole message.
MachineFacts sdcp_facts(const SdcpJson& message);

/// An answer to an upload of a part.
struct SdcpPart {
  bool taken = false;
  bool other_offset = false;  ///< the machine holds other bytes: the upload begins anew
  std::string trouble;        ///< in words, where it was not taken
};
SdcpPart sdcp_part(int http_status, const std::string& body);

/// What an Ack of Cmd 128 says; empty: it begins.
std::string start_trouble(int ack);

/// An answer to the datagram M99999; nothing where it is none.
std::optional<FoundMachine> sdcp_found(const std::string& datagram, const std::string& from);

/// A request; `first` writes it as SDCP 1 has it, with ms and without a topic.
struct SdcpRequest {
  int cmd = 0;
  SdcpJson data = SdcpJson::object();
  std::string id;       ///< of this request: hex digits
  std::string machine;  ///< MainboardID
  std::int64_t wall_ms = 0;
};
std::string sdcp_text(const SdcpRequest& request, bool first = false);
/// The answer to a request: `Data.Data` of a message with this command and id; null: it is another.
const SdcpJson* sdcp_answer(const SdcpJson& message, const SdcpRequest& request);

}  // namespace slicecorr::farm::detail
