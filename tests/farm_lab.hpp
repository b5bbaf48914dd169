// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_lab.hpp
/// A server with accounts, and what a lab asks of it.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "farm_served.hpp"
#include "ladder.hpp"

namespace slicecorr::farm::test {

namespace fs = std::filesystem;
using nlohmann::json;

inline const std::string kLook(40, 'l'), kSubmit(40, 's'), kOther(40, 'o'), kOperate(40, 'p');

inline ServeOptions with_accounts() {
  ServeOptions options;
  options.accounts = {{"lena", Role::look, kLook},
                      {"sam", Role::submit, kSubmit},
                      {"olga", Role::submit, kOther},
                      {"pia", Role::operate, kOperate}};
  options.children.programs = SLICECORR_BIN_DIR;
  return options;
}

inline httplib::Client client_of(const Served& served, const std::string& token) {
  httplib::Client c = served.client();
  if (!token.empty()) c.set_default_headers({{"Authorization", "Bearer " + token}});
  return c;
}

inline httplib::Result post(httplib::Client& client, const std::string& path, const json& body) {
  return client.Post(path.c_str(), body.dump(), "application/json");
}

inline std::string message_of(const httplib::Result& result) {
  const json body = body_of(result);
  return body.contains("error") ? body["error"]["message"].get<std::string>() : "";
}

inline std::string upload(httplib::Client& client, const std::string& name,
                          const std::string& bytes) {
  const auto answer = client.Put(("/api/v1/parts/" + name).c_str(), bytes, "model/stl");
  return body_of(answer)["part"];
}

inline std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The ladder of figure 2.2, uploaded.
inline std::string ladder_of(Farm& farm, httplib::Client& client) {
  const std::string path = farm.root + "/ladder.stl";
  slicecorr::test::write_stl(path, slicecorr::test::ladder());
  return upload(client, "ladder.stl", bytes_of(path));
}

inline json ended_study(httplib::Client& client, const std::string& token) {
  json state;
  for (int i = 0; i < 1200; ++i) {
    state = body_of(client.Get(("/api/v1/studies/" + token).c_str()));
    if (state["state"] != "waiting" && state["state"] != "running") return state;
    ::usleep(50'000);
  }
  return state;
}

/// Starts a study and waits for its end.
inline json study(httplib::Client& client, const json& request) {
  const auto answer = post(client, "/api/v1/studies", request);
  EXPECT_EQ(status_of(answer), 202) << answer->body;
  return ended_study(client, body_of(answer).value("study", ""));
}

inline std::string file_of(httplib::Client& client, const json& study, const std::string& name) {
  const auto answer = client.Get(
      ("/api/v1/studies/" + study["study"].get<std::string>() + "/files/" + name).c_str());
  EXPECT_EQ(status_of(answer), 200) << name;
  return answer ? answer->body : "";
}

inline json of_ladder(const char* kind, const std::string& part) {
  return {{"kind", kind},
          {"parts", {part}},
          {"printer", "dual-wavelength-dlp"},
          {"resin", "benchy-resin"},
          {"layer_um", 50}};
}

/// A folder of programs, each a script.
inline std::string scripts(Farm& farm, const std::map<std::string, std::string>& texts) {
  const std::string folder = farm.root + "/programs";
  for (const auto& [name, text] : texts) {
    write_file(folder + "/" + name, "#!/bin/sh\n" + text);
    fs::permissions(folder + "/" + name, fs::perms::owner_all);
  }
  return folder;
}

}  // namespace slicecorr::farm::test
