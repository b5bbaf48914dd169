// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machine_watch.hpp
/// The machines of DIR/machines.toml as the server's pages see them: asked again and again from a
/// thread of its own, with what changed written into the record; and what is done to them for
/// requests. Those that printbridge drives have their own place (bridges.hpp).
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/job.hpp"
#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

/// All functions are thread-safe and throw `ApiError`.
class MachineWatch {
 public:
  explicit MachineWatch(FarmFolder folder);
  /// Ends uploads that are under way.
  ~MachineWatch();
  MachineWatch(const MachineWatch&) = delete;
  MachineWatch& operator=(const MachineWatch&) = delete;

  /// All of them, as they were seen last, with what is being sent.
  nlohmann::ordered_json list();
  /// pause, resume, stop, cleared, and start with both words in `body`; gives the machine as it is then.
  nlohmann::ordered_json act(const std::string& name, const std::string& what,
                             const nlohmann::ordered_json& body);
  /// Begins to send a job's stack.
  void send(const std::string& name, const Job& job);
  /// A small picture, as PNG, of what is on the machine; empty without one.
  std::string picture(const std::string& name);
  /// Metrics in Prometheus' text format; empty without machines.
  std::string metrics();

 private:
  struct Watched {
    std::unique_ptr<MachineRoom> room;  ///< of the watching thread alone
    std::string spec;                   ///< as it was read, to see changes
    MachineView view;
    bool looked = false, troubled = false;
    int silent = 0;  ///< looks without an answer, in a row
    /// Of what is on it, and of which file; the number says to pages when it is another one.
    std::string picture, picture_of;
    int picture_number = 0;
  };
  struct Sending {
    JobId job = 0;
    std::string name, message;
    std::int64_t done = 0, all = 0;
    bool running = false;
    std::chrono::steady_clock::time_point not_before{};  ///< of another try by itself
    std::thread thread;
  };

  void watch();
  void read_file();
  void look_at_all();
  void send_next();
  void tell(const Watched& before, const MachineView& now, bool troubled);
  MachineSpec spec_of(const std::string& name) const;
  nlohmann::ordered_json json_of(const std::string& name);

  FarmFolder folder_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Watched> machines_;
  std::map<std::string, Sending> sending_;
  std::string trouble_;  ///< of the file
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace slicecorr::farm::detail
