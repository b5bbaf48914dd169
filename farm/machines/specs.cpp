// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// DIR/machines.toml and DIR/bridges.toml.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/machines.hpp"
#include "support/files/text_file.hpp"
#include "support/http/guard.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::farm {

namespace {

struct KindName {
  MachineKind kind;
  const char* name;
};
constexpr KindName kKinds[kMachineKinds] = {
    {MachineKind::sdcp3, "sdcp3"},         {MachineKind::sdcp1, "sdcp1"},
    {MachineKind::nanodlp, "nanodlp"},     {MachineKind::odyssey, "odyssey"},
    {MachineKind::prusalink, "prusalink"}, {MachineKind::octoprint, "octoprint"},
    {MachineKind::bridge, "bridge"}};

std::string kinds_in_words() {
  std::string list;
  for (const KindName& k : kKinds) list += (list.empty() ? "" : ", ") + std::string(k.name);
  return list;
}

std::vector<std::string> list_of_texts(const TomlTable& read, const char* key) {
  std::vector<std::string> list;
  const toml::node* node = read.node(key);
  if (!node) return list;
  const toml::array* array = node->as_array();
  for (std::size_t i = 0; array && i < array->size(); ++i) {
    const auto text = (*array)[i].value<std::string>();
    if (!text)
      array = nullptr;
    else
      list.push_back(*text);
  }
  if (!array) read.fail(key, "expected a list of texts");
  return list;
}

void read_address(const TomlTable& read, MachineSpec& machine) {
  try {
    set_address(machine, read.text("address", ""));
  } catch (const InputError& e) {
    read.fail("address", e.what());
  }
}

void refuse_other_keys(const TomlTable& read, std::span<const std::string_view> known,
                       const char* of) {
  for (const auto& [key, node] : read.raw()) {
    if (std::find(known.begin(), known.end(), key.str()) == known.end()) {
      read.fail(key.str(), std::string("is no key of a ") + of);
    }
  }
}

void read_name(const TomlTable& read, MachineSpec& machine) {
  machine.name = read.text("name", "");
  const auto plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  };
  if (machine.name.empty() || machine.name.size() > 60 ||
      !std::all_of(machine.name.begin(), machine.name.end(), plain)) {
    read.fail("name", "expected a name of at most 60 small letters, digits, - and _");
  }
  machine.printer = read.text("printer", "");
  machine.page = read.text("page", "");
  if (!machine.page.empty() && !machine.page.starts_with("http://") &&
      !machine.page.starts_with("https://")) {
    read.fail("page", "expected an address that begins with http:// or https://");
  }
  machine.options = list_of_texts(read, "options");
  machine.status_options = list_of_texts(read, "status_options");
}

MachineSpec read_bridge(const TomlTable& read) {
  constexpr std::string_view known[] = {"name", "printer", "options", "status_options", "page"};
  refuse_other_keys(read, known, "bridge");
  MachineSpec machine;
  machine.kind = MachineKind::bridge;
  read_name(read, machine);
  if (machine.printer.empty()) read.fail("printer", "expected the name of a printer");
  return machine;
}

void read_resolution(const TomlTable& read, MachineSpec& machine) {
  const toml::node* node = read.node("resolution_px");
  if (!node) return;
  const toml::array* array = node->as_array();
  const auto side = [&](std::size_t i) {
    const auto value = array ? (*array)[i].value<std::int64_t>() : std::nullopt;
    if (!value || *value < 1 || *value > 100'000) {
      read.fail("resolution_px", "expected [width, height], whole numbers from 1 to 100000");
    }
    return static_cast<int>(*value);
  };
  if (!array || array->size() != 2) array = nullptr;
  machine.width_px = side(0);
  machine.height_px = side(1);
}

void read_login(const TomlTable& read, MachineSpec& machine, const FarmFolder& folder) {
  machine.user = read.text("user", "");
  machine.login = read.text("login", "");
  if (!machine.login.empty() && machine.login != "digest" && machine.login != "key" &&
      machine.login != "none") {
    read.fail("login", "expected digest, key or none");
  }
  machine.key_file = read.text("key_file", "");
  if (!machine.key_file.empty() && !machine.key_file.starts_with('/')) {
    machine.key_file = folder.root + "/" + machine.key_file;
  }
  for (const char* key : {"key", "password", "token"}) {
    if (read.has(key)) {
      read.fail(key, "does not belong here; expected key_file, the name of a file with mode 0600");
    }
  }
}

/// A value of a job's key, as JSON.
nlohmann::ordered_json rule_value(const TomlTable& read, const toml::node& node) {
  nlohmann::ordered_json json;
  if (const auto text = node.value_exact<std::string>()) return *text;
  if (const auto flag = node.value_exact<bool>()) return *flag;
  if (const auto number = node.value<double>()) return *number;
  const toml::array* list = node.as_array();
  if (!list) read.fail("job", "expected keys of jobs with texts, numbers, true, false or lists");
  json = nlohmann::ordered_json::array();
  for (const toml::node& each : *list) json.push_back(rule_value(read, each));
  return json;
}

std::string read_rule(const TomlTable& read) {
  nlohmann::ordered_json rule = nlohmann::ordered_json::object();
  if (!read.has("job")) return rule.dump();
  const TomlTable table = read.required_table("job");
  for (const auto& [key, node] : table.raw()) {
    const std::string name(key.str());
    if (name == "part" || name == "parts" || name == "for" || name == "printer" ||
        name == "copies") {
      read.fail("job", name + " has no place in a rule: what comes says it, or the machine");
    }
    rule[name] = rule_value(read, node);
  }
  return rule.dump();
}

MachineSpec read_machine(const TomlTable& read, const FarmFolder& folder) {
  constexpr std::string_view known[] = {
      "name",    "kind", "address",       "printer",        "format",      "resolution_px",
      "id",      "user", "login",         "key_file",       "key",         "password",
      "token",   "page", "options",       "discovery_port", "own_address", "status_options",
      "profile", "job",  "send_when_done"};
  refuse_other_keys(read, known, "machine");
  MachineSpec machine;
  read_name(read, machine);
  const auto kind = machine_kind_named(read.text("kind", ""));
  if (!kind) read.fail("kind", "expected one of " + kinds_in_words());
  machine.kind = *kind;
  const bool bridge = machine.kind == MachineKind::bridge;
  if (bridge) {
    if (machine.printer.empty()) read.fail("printer", "expected the name of a printer");
    for (const char* key : {"address", "id", "login", "key_file", "user", "own_address"}) {
      if (read.has(key)) read.fail(key, "is no key of a bridge: its printer's file has it");
    }
  } else {
    read_address(read, machine);
    for (const char* key : {"options", "status_options"}) {
      if (read.has(key)) read.fail(key, "is a key of bridges only");
    }
  }
  machine.format = read.text("format", "");
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); };
  if (machine.format.size() > 12 ||
      !std::all_of(machine.format.begin(), machine.format.end(), letter)) {
    read.fail("format", "expected an ending without a point, in small letters: \"ctb\"");
  }
  read_resolution(read, machine);
  machine.id = read.text("id", "");
  if (machine.id.size() > 64 ||
      machine.id.find_first_not_of("0123456789abcdefABCDEF-_") != machine.id.npos) {
    read.fail("id", "expected at most 64 hex digits");
  }
  read_login(read, machine, folder);
  machine.discovery_port = read.integer("discovery_port", 1, 65535, machine.discovery_port);
  machine.own_address = read.text("own_address", "");
  machine.job_rule = read_rule(read);
  if (const toml::node* node = read.node("send_when_done")) {
    const auto flag = node->value_exact<bool>();
    if (!flag) read.fail("send_when_done", "expected true or false");
    machine.send_when_done = *flag;
  }
  machine.profile = read.text("profile", "");
  if (machine.profile.find_first_not_of("0123456789") != machine.profile.npos) {
    read.fail("profile", "expected the number of a resin profile, as a text");
  }
  return machine;
}

template <class Read>
void read_tables(const std::string& path, const std::string& text, const char* name, Read one) {
  const toml::table table = parse_toml(text, path);
  for (const auto& [key, node] : table) {
    const toml::array* list = node.as_array();
    const std::string expected = fmt::format("expected [[{}]] tables", name);
    if (key.str() != name || !list) throw InputError(path, "", expected);
    for (const toml::node& each : *list) {
      const toml::table* t = each.as_table();
      if (!t) throw InputError(path, "", expected);
      one(TomlTable(*t, path, std::string(name) + "."));
    }
  }
}

std::vector<MachineSpec> machines_of(const FarmFolder& folder, const std::string& path,
                                     const std::string& text) {
  std::vector<MachineSpec> machines;
  const auto add = [&](const TomlTable& read, MachineSpec machine) {
    machine.files_folder = folder.root + "/machines/" + machine.name + ".files";
    for (const MachineSpec& other : machines) {
      if (other.name == machine.name) read.fail("name", "another machine is called so, too");
    }
    machines.push_back(std::move(machine));
  };
  read_tables(path, text, "machine",
              [&](const TomlTable& read) { add(read, read_machine(read, folder)); });
  std::error_code error;
  if (const std::string bridges = folder.root + "/bridges.toml";
      std::filesystem::exists(bridges, error)) {
    read_tables(bridges, read_text_file(bridges), "bridge",
                [&](const TomlTable& read) { add(read, read_bridge(read)); });
  }
  return machines;
}

std::string machines_path(const FarmFolder& folder) { return folder.root + "/machines.toml"; }

std::string machines_text(const FarmFolder& folder) {
  std::error_code error;
  const std::string path = machines_path(folder);
  return std::filesystem::exists(path, error) ? read_text_file(path) : "";
}

/// A text in quotes, as TOML has it. What comes here is checked when the file is read again.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    const auto u = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      out += std::string("\\") + c;
    else if (u < 0x20 || u == 0x7F)
      out += fmt::format("\\u{:04X}", u);
    else
      out += c;
  }
  return out + '"';
}

}  // namespace

const char* name_of(MachineKind kind) { return kKinds[static_cast<int>(kind)].name; }

std::optional<MachineKind> machine_kind_named(const std::string& name) {
  for (const KindName& k : kKinds) {
    if (name == k.name) return k.kind;
  }
  return std::nullopt;
}

void set_address(MachineSpec& machine, const std::string& address) {
  std::string host = address;
  if (const std::size_t colon = address.rfind(':');
      colon != address.npos && colon > 0 &&
      (address.find(':') == colon || address[colon - 1] == ']')) {
    const std::string port = address.substr(colon + 1);
    if (port.empty() || port.size() > 5 || port.find_first_not_of("0123456789") != port.npos ||
        std::stoi(port) < 1 || std::stoi(port) > 65535) {
      throw InputError("expected HOST or HOST:PORT, with a port from 1 to 65535");
    }
    machine.port = std::stoi(port);
    host.resize(colon);
  }
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
    host = host.substr(1, host.size() - 2);
  }
  const auto plain = [](char c) {
    const char small = lower_case(c);
    return (small >= 'a' && small <= 'z') || is_digit(c) || c == '-' || c == '.' || c == ':' ||
           c == '_';
  };
  if (host.empty() || host.size() > 253 || !std::all_of(host.begin(), host.end(), plain)) {
    throw InputError("expected HOST or HOST:PORT, without http:// and without a path");
  }
  machine.host = host;
}

std::vector<MachineSpec> read_machines(const FarmFolder& folder) {
  return machines_of(folder, machines_path(folder), machines_text(folder));
}

std::vector<std::string> formats_read_by(const MachineSpec& machine) {
  if (!machine.format.empty()) return {machine.format};
  switch (machine.kind) {
    case MachineKind::sdcp1:
      return {"ctb", "goo"};
    case MachineKind::nanodlp:
      return {"nanodlp", "zip"};
    case MachineKind::odyssey:
      return {"sl1"};
    case MachineKind::prusalink:
      return {"sl1", "sl1s"};
    default:
      return {};
  }
}

MachineSpec machine_named(const FarmFolder& folder, const std::string& name) {
  const std::vector<MachineSpec> machines = read_machines(folder);
  for (const MachineSpec& machine : machines) {
    if (machine.name == name) return machine;
  }
  std::string list;
  for (const MachineSpec& machine : machines) list += (list.empty() ? "" : ", ") + machine.name;
  throw InputError("there is no machine '" + text::printable(name) + "'; expected " +
                   (list.empty() ? "one of machines.toml, which names none" : "one of " + list));
}

void add_machine(const FarmFolder& folder, const MachineSpec& m) {
  std::string text = machines_text(folder);
  if (!text.empty() && text.back() != '\n') text += '\n';
  if (!text.empty()) text += '\n';
  text += "[[machine]]\n";
  const auto say = [&](const char* key, const std::string& value) {
    if (!value.empty()) text += fmt::format("{} = {}\n", key, quoted(value));
  };
  say("name", m.name);
  say("kind", name_of(m.kind));
  const std::string host = m.host.find(':') != m.host.npos ? "[" + m.host + "]" : m.host;
  say("address", m.port > 0 ? fmt::format("{}:{}", host, m.port) : host);
  say("printer", m.printer);
  say("format", m.format);
  if (m.width_px > 0) text += fmt::format("resolution_px = [{}, {}]\n", m.width_px, m.height_px);
  say("id", m.id);
  say("user", m.user);
  say("login", m.login);
  say("key_file", m.key_file);
  say("page", m.page);
  say("own_address", m.own_address);
  say("profile", m.profile);
  if (m.send_when_done) text += "send_when_done = true\n";
  if (m.discovery_port != MachineSpec{}.discovery_port) {
    text += fmt::format("discovery_port = {}\n", m.discovery_port);
  }
  // Read as it will be, before anything is written.
  machines_of(folder, machines_path(folder), text);
  if (!m.key_file.empty()) static_cast<void>(http::read_token_file(m.key_file, 1));
  cli::write_text_file(machines_path(folder), text);
}

}  // namespace slicecorr::farm
