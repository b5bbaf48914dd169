// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a lab does from a browser beside jobs: studies, resins, printers, machines; and leave to
// follow links.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>

#include "serve/api.hpp"
#include "serve/plate.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/token.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

constexpr auto kMoment = std::chrono::seconds(30);

const char* type_of(const std::string& name) {
  if (name.ends_with(".json")) return kJsonType;
  if (name.ends_with(".html")) return kHtmlType;
  if (name.ends_with(".svg")) return "image/svg+xml";
  if (name.ends_with(".png")) return "image/png";
  if (name.ends_with(".toml")) return kTextType;
  return "application/octet-stream";
}

/// A folder that goes with the request.
struct Scratch {
  explicit Scratch(const FarmFolder& folder) : path(folder.root + "/studies/" + random_token()) {
    std::error_code error;
    fs::create_directories(path, error);
    if (error) throw DeviceError(path + ": can't be made: " + error.message());
  }
  ~Scratch() {
    std::error_code error;
    fs::remove_all(path, error);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  std::string path;
};

bool flag_of(const Json& json, const char* key) {
  const auto value = json.find(key);
  if (value == json.end()) return false;
  if (!value->is_boolean()) {
    throw ApiError(400, "json", std::string(key) + ": expected true or false");
  }
  return value->get<bool>();
}

/// An answer to a question of `resinctl new-printer`, on one line.
std::string answer_of(const Json& json, const char* key, bool required) {
  const auto value = json.find(key);
  if (value == json.end() || value->is_null()) {
    if (required) throw ApiError(400, "json", std::string(key) + ": expected a number");
    return "\n";
  }
  if (!value->is_number() || !std::isfinite(value->get<double>())) {
    throw ApiError(400, "json", std::string(key) + ": expected a number");
  }
  return fmt::format("{}\n", value->get<double>());
}

}  // namespace

void check_keys(const Json& json, std::initializer_list<std::string_view> known) {
  for (const auto& item : json.items()) {
    if (std::find(known.begin(), known.end(), item.key()) == known.end()) {
      throw ApiError(400, "json", "has a key that this request does not take");
    }
  }
}

std::string Api::ask_program(std::vector<std::string> arguments, const std::string& input,
                             const std::string& folder) {
  if (!programs_.try_acquire_for(std::chrono::seconds(10))) {
    throw ApiError(503, "busy", "too many requests wait for programs; try again soon");
  }
  struct Release {
    std::counting_semaphore<>& of;
    ~Release() { of.release(); }
  } const release{programs_};
  arguments[0] = program_path(options_.children, arguments[0]);
  const CommandResult result =
      run_command(arguments, kMoment, input, {}, child_limits(options_.children, folder));
  if (!result.ok()) {
    const bool ours = result.exit_code == 2 || result.exit_code == 3;
    throw ApiError(ours ? 400 : 503, ours ? "input" : "program", told_by(result, folder_));
  }
  return result.out;
}

// --- studies ------------------------------------------------------------------------------------

void Api::start_study(const std::string& text, const Asker& asker, httplib::Response& response) {
  const std::string token = studies_.start(plan_study(folder_, parsed(text)), asker.name);
  send_json(response, 202, studies_.state(token));
}

void Api::read_study(const std::vector<std::string>& rest, httplib::Response& response) {
  const std::string& token = rest[0];
  if (rest.size() == 1) return send_json(response, 200, studies_.state(token));
  if (rest[1] == "layers") {
    std::string number = rest[2];
    if (number.ends_with(".png")) number.resize(number.size() - 4);
    // Layers count from 0, as slices do.
    const std::int64_t layer = number == "0" ? 0 : id_of(number);
    std::string png;
    if (layer > 0 || number == "0") png = layer_png(studies_.layers(token), layer);
    if (png.empty()) throw ApiError(404, "not_found", "the study has no such layer");
    return send(response, 200, std::move(png), "image/png");
  }
  const std::string path = studies_.file(token, rest[2]);
  const bool page = rest[2].ends_with(".html");
  response.set_header("Content-Security-Policy", page ? kPartPolicy : kBarePolicy);
  send_file(path, -1, type_of(rest[2]), rest[2].ends_with(".toml") ? rest[2] : "", response);
}

// --- resins and printers ------------------------------------------------------------------------

void Api::resin_curve(const std::string& name, httplib::Response& response) {
  const std::string resin = checked_name(Json(name), "name");
  const Scratch scratch(folder_);
  ask_program({"resinctl", "plot", resin, "-o", "curve.svg"}, {}, scratch.path);
  send_file(scratch.path + "/curve.svg", -1, "image/svg+xml", "", response);
}

void Api::add_resin(const std::string& text, const std::string& by, httplib::Response& response) {
  const Json json = parsed(text);
  check_keys(json, {"study", "replace"});
  const auto study = json.find("study");
  if (study == json.end() || !study->is_string()) {
    throw ApiError(400, "json", "expected {\"study\": \"...\"}, a fit that is done");
  }
  const auto [path, name] = studies_.fitted(study->get<std::string>());
  std::vector<std::string> arguments{"resinctl", "add", path, "-m",
                                     "fitted in a browser, by " + by};
  if (flag_of(json, "replace")) arguments.emplace_back("--replace");
  ask_program(std::move(arguments));
  send_json(response, 201, {{"resin", name}});
}

void Api::add_printer(const std::string& text, httplib::Response& response) {
  const Json json = parsed(text);
  check_keys(json, {"name", "width_px", "height_px", "pixel_um", "bit_depth", "wavelength_nm",
                    "readings", "max_speed_mm_h", "travel_mm", "f_picture", "replace"});
  const auto name = json.find("name");
  if (name == json.end()) throw ApiError(400, "json", "name: expected the printer's name");
  const std::string printer = checked_name(*name, "name");
  // The answers to the questions of `resinctl new-printer`, in their order.
  std::string answers = printer + "\n";
  answers += answer_of(json, "width_px", true) + answer_of(json, "height_px", true) +
             answer_of(json, "pixel_um", true) + answer_of(json, "bit_depth", false) +
             answer_of(json, "wavelength_nm", false);
  const auto readings = json.find("readings");
  if (readings == json.end() || !readings->is_array() || readings->size() > 1000) {
    throw ApiError(400, "json", "readings: expected a list of [grey level, mW/cm2]");
  }
  for (const Json& r : *readings) {
    if (!r.is_array() || r.size() != 2 || !r[0].is_number() || !r[1].is_number()) {
      throw ApiError(400, "json", "readings: expected a list of [grey level, mW/cm2]");
    }
    answers += fmt::format("{} {}\n", r[0].get<double>(), r[1].get<double>());
  }
  answers += "\n" + answer_of(json, "max_speed_mm_h", false) + answer_of(json, "travel_mm", false) +
             answer_of(json, "f_picture", false);
  std::vector<std::string> arguments{"resinctl", "new-printer"};
  if (flag_of(json, "replace")) arguments.emplace_back("--replace");
  ask_program(std::move(arguments), answers);
  send_json(response, 201, {{"printer", printer}});
}

// --- machines -----------------------------------------------------------------------------------

void Api::print(JobId id, const std::string& text, const std::string& by,
                httplib::Response& response) {
  const Json json = parsed(text);
  check_keys(json, {"bridge", "dry_run", "machine_is_clear"});
  const auto bridge = json.find("bridge");
  if (bridge == json.end() || !bridge->is_string()) {
    throw ApiError(400, "json", "bridge: expected the name of a bridge");
  }
  Reader reader(*this);
  const auto job = reader->job(id);
  if (!job || job->state != JobState::done) {
    throw ApiError(409, "state", "the job is not done");
  }
  const auto stack = std::find_if(job->files.begin(), job->files.end(), [](const ResultFile& f) {
    return f.ending != "html" && f.ending != "json";
  });
  std::error_code error;
  if (stack == job->files.end() ||
      static_cast<std::int64_t>(fs::file_size(job->output(stack->ending), error)) != stack->bytes ||
      error) {
    throw ApiError(410, "gone", "the output was moved or changed since the job was done");
  }
  send_json(response, 202,
            bridges_.print(bridge->get<std::string>(), job->output(stack->ending), *job,
                           flag_of(json, "dry_run"), flag_of(json, "machine_is_clear"), by));
}

void Api::act_on_machine(const std::string& name, const std::string& what, const std::string& text,
                         httplib::Response& response) {
  const Json json = text.empty() ? Json::object() : parsed(text);
  check_keys(json, what == "send" ? std::initializer_list<std::string_view>{"job"}
                   : what == "start"
                       ? std::initializer_list<std::string_view>{"plate_is_empty", "vat_is_filled"}
                       : std::initializer_list<std::string_view>{});
  if (what != "send") {
    static_cast<void>(flag_of(json, "plate_is_empty") || flag_of(json, "vat_is_filled"));
    return send_json(response, 200, machines_.act(name, what, json));
  }
  const auto id = json.find("job");
  if (id == json.end() || !id->is_number_integer()) {
    throw ApiError(400, "json", "job: expected the number of a job");
  }
  Reader reader(*this);
  const auto job = reader->job(id->get<std::int64_t>());
  if (!job) throw ApiError(404, "not_found", "there is no such job");
  machines_.send(name, *job);
  send_json(response, 202, {{"machine", name}, {"job", job->id}, {"running", true}});
}

void Api::give_ticket(const std::string& text, httplib::Response& response) {
  const Json json = parsed(text);
  const auto path = json.find("path");
  if (json.size() != 1 || path == json.end() || !path->is_string()) {
    throw ApiError(400, "json", "expected {\"path\": \"/report\"}");
  }
  send_json(response, 201, {{"path", tickets_.give(path->get<std::string>())}});
}

}  // namespace slicecorr::farm::detail
