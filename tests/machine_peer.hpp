// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machine_peer.hpp
/// A printer on the network for tests: machine_peer.py, a process that is told what goes wrong.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "run_program.hpp"

namespace slicecorr::test {

inline const std::string kPeerPython = "/usr/bin/python3";

class MachinePeer {
 public:
  explicit MachinePeer(const std::string& kind, const std::vector<std::string>& traps = {}) {
    std::vector<std::string> command{kPeerPython, "-B",
                                     SLICECORR_SOURCE_DIR "/tests/machine_peer.py", kind};
    for (const std::string& trap : traps) {
      command.emplace_back("--trap");
      command.push_back(trap);
    }
    int in[2], out[2];
    if (::pipe2(in, O_CLOEXEC) != 0 || ::pipe2(out, O_CLOEXEC) != 0) {
      throw std::runtime_error("no pipes");
    }
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, in[0], STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&files, out[1], STDOUT_FILENO);
    const TextList argv(command);
    const int error =
        ::posix_spawn(&pid_, kPeerPython.c_str(), &files, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    ::close(in[0]);
    ::close(out[1]);
    to_ = in[1];
    from_ = ::fdopen(out[0], "r");
    if (error != 0) throw std::runtime_error("no peer");
    const nlohmann::json ports = answer();
    port = ports.value("port", 0);
    udp = ports.value("udp", 0);
    mdns = ports.value("mdns", 0);
  }
  ~MachinePeer() {
    ::close(to_);
    ::fclose(from_);
    ::waitpid(pid_, nullptr, 0);
  }
  MachinePeer(const MachinePeer&) = delete;
  MachinePeer& operator=(const MachinePeer&) = delete;

  nlohmann::json tell(const std::string& command) {
    const std::string line = command + "\n";
    if (::write(to_, line.data(), line.size()) != static_cast<ssize_t>(line.size())) return {};
    return answer();
  }
  nlohmann::json log() { return tell("log"); }
  /// What happened of one kind.
  std::vector<nlohmann::json> happened(const std::string& what) {
    std::vector<nlohmann::json> list;
    const nlohmann::json all = log();
    for (const nlohmann::json& each : all["log"]) {
      if (each["what"] == what) list.push_back(each);
    }
    return list;
  }
  int begun() { return log().value("begun", -1); }

  int port = 0, udp = 0, mdns = 0;

 private:
  nlohmann::json answer() {
    std::string line;
    for (int c = std::fgetc(from_); c != EOF && c != '\n'; c = std::fgetc(from_)) {
      line += static_cast<char>(c);
    }
    return nlohmann::json::parse(line, nullptr, false);
  }
  pid_t pid_ = 0;
  int to_ = -1;
  std::FILE* from_ = nullptr;
};

inline bool has_peer_python() { return std::filesystem::exists(kPeerPython); }

}  // namespace slicecorr::test
