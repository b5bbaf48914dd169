// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file studies.hpp
/// What somebody wants to know before a print: how parts lie on the plate, how fast they can print,
/// what they print before and after correction, what a fit of measurements says. A study runs
/// programs of the project one after the other, in a folder of its own and within bounds, while the
/// server goes on answering.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "serve/accounts.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/serve.hpp"
#include "support/process/command.hpp"

namespace slicecorr::farm::detail {

/// One program of a study.
struct StudyStep {
  std::string what;  ///< in words, for who waits: "slicing"
  /// Its arguments, the program's name first, once the steps before are done; `folder`: of the study.
  std::function<std::vector<std::string>(const std::string& folder)> arguments;
};

struct StudyPlan {
  std::string kind;  ///< plate, plan, check or fit
  std::string name;  ///< of the resin that a fit makes
  /// Tables that the programs read, by name and text: written before the first step.
  std::vector<std::pair<std::string, std::string>> tables;
  std::vector<StudyStep> steps;
  std::vector<std::string> files;  ///< that may be asked for when it is done
};

/// Checks what POST /api/v1/studies was sent, and says which programs answer it. Throws `ApiError`.
StudyPlan plan_study(const FarmFolder& folder, const nlohmann::ordered_json& request);

/// Whether studies take this key of jobs for how parts are sized, turned and placed.
bool is_placing(std::string_view key);

/// A printer's or resin's name, as the database has them; no path. Throws `ApiError` naming `key`.
std::string checked_name(const nlohmann::ordered_json& value, const char* key);

/// A message with names in place of paths: who asks knows names, and need not know where files lie.
std::string without_folders(std::string text, const FarmFolder& folder);

/// The path of a program of the project.
std::string program_path(const ChildRules& rules, const std::string& name);
/// Bounds on a child that works in `folder`.
CommandLimits child_limits(const ChildRules& rules, const std::string& folder);
/// The last line that a program said, without folders of the farm.
std::string told_by(const CommandResult& result, const FarmFolder& folder);

/// All functions are thread-safe and throw `ApiError`.
class Studies {
 public:
  Studies(const FarmFolder& folder, const ChildRules& rules);
  /// Ends what runs, and removes all.
  ~Studies();
  Studies(const Studies&) = delete;
  Studies& operator=(const Studies&) = delete;

  /// Queues a study; gives its token.
  std::string start(StudyPlan plan, const std::string& by);
  /// What is known of it.
  nlohmann::ordered_json state(const std::string& token) const;
  void cancel(const std::string& token, const Asker& asker);
  /// The path of a file of a study that is done.
  std::string file(const std::string& token, const std::string& name) const;
  /// The path of layers.bin, and of the definition that a fit made with the resin's name.
  std::string layers(const std::string& token) const;
  std::pair<std::string, std::string> fitted(const std::string& token) const;

 private:
  enum class State { waiting, running, done, failed, cancelled };
  struct Study {
    StudyPlan plan;
    std::string token, folder, by, message, stage;
    State state = State::waiting;
    int exit_code = -1;
    std::chrono::steady_clock::time_point begin, end;
    std::atomic<bool> cancelled{false};
  };
  using Pointer = std::shared_ptr<Study>;

  void work();
  void run(Study& study);
  Pointer find(const std::string& token) const;
  std::string path_of(const std::string& token, const std::string& name) const;
  void forget_oldest();

  FarmFolder folder_;
  ChildRules rules_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Pointer> studies_;
  std::deque<Pointer> waiting_, ended_;
  std::atomic<bool> stopping_{false};
  std::vector<std::thread> threads_;
};

}  // namespace slicecorr::farm::detail
