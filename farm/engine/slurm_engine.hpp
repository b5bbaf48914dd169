// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The engine that gives tasks to a Slurm cluster, through its commands. Nothing blocks for longer
/// than a moment: commands run beside, and their answers are taken when they are there.
#pragma once

#include <chrono>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/slurm_tasks.hpp"
#include "engine/slurm_text.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/work.hpp"
#include "support/process/command.hpp"

namespace slicecorr::farm::detail {

/// Slurm's commands give up by themselves, by default after MessageTimeout (10 s) and some tries.
inline constexpr std::chrono::milliseconds kCommandLimit{60'000};
/// Time between listings while something is being cancelled, since a user waits for it.
inline constexpr std::int64_t kHastyMs = 250;

class SlurmEngine final : public Engine {
 public:
  explicit SlurmEngine(const SlurmEngineOptions& options);

  std::string name() const override { return "slurm"; }
  bool outlives_service() const override { return true; }

  EngineCapacity capacity() override;
  TaskSize share(const EngineCapacity& capacity, std::int64_t waiting, std::int64_t base_memory_mb,
                 std::int64_t thread_memory_mb) const override;
  std::vector<std::string> submit(const std::vector<Task>& tasks) override;
  std::vector<TaskReport> poll() override;
  void wait(std::chrono::milliseconds most, int wake_fd) override;
  void cancel(const std::vector<std::string>& tokens) override;
  void withdraw() override;
  void tidy(bool last) override;
  void forget(const std::vector<std::string>& tokens) override;
  std::vector<std::string> adopt(const std::vector<Attempt>& attempts) override;
  std::string trouble() const override;
  std::vector<FarmNode> nodes() override;

 private:
  struct Submission {
    Submission(std::string batch_token, const std::vector<std::string>& arguments,
               const std::string& script)
        : batch(std::move(batch_token)), command(arguments, kCommandLimit, script) {}
    std::string batch;
    Command command;
  };

  static std::int64_t now() { return system_clock().steady_ms(); }

  static TaskReport failure(const std::string& token, Reason reason, const std::string& message);

  // --- the cluster ------------------------------------------------------------------------------

  static std::vector<std::string> nodes_command() { return {"scontrol", "-o", "show", "node"}; }

  /// Asks for the cluster at the start; throws when it does not answer, as nothing can run then.
  void ask_cluster();
  void take_nodes();

  // --- submitting -------------------------------------------------------------------------------

  void submit_batch(const Needs& needs, const std::vector<Task>& tasks,
                    const std::vector<std::size_t>& members);
  void take_submissions();
  void judge_submission(const Submission& s);

  // --- listings, and cancelling (slurm_listings.cpp) ---------------------------------------------

  void start_listing();
  void take_listing(std::vector<TaskReport>& reports);
  bool any_cancelled() const;
  WorkerTrace left_by(const HeldTask& h) const;
  void judge_all(const Sightings* seen, std::vector<TaskReport>& reports);
  bool out_of_patience(const HeldTask& h) const;
  /// Jobs of this farm in Slurm that nobody waits for: cancelled ones that a controller forgot to
  /// have cancelled, attempts that were given up while Slurm did not answer, and doubles.
  void end_strays(const Sightings& seen);
  bool is_submitting(const std::string& batch) const;
  bool is_held(const std::string& batch) const;
  /// Folders of batches whose attempts have all ended, those of services that are gone included.
  void remove_ended_batches();
  /// Done once in a while: removes batches that were not seen to end, and forgets what is
  /// remembered of batches that Slurm has forgotten.
  void sweep();
  void force_cancelled();
  /// Without filters like --name and --state: with them, Slurm 22.05 cancels all waiting tasks of
  /// an array when one of them is named.
  void scancel(const std::vector<std::string>& ids, const std::string& signal = {});

  SlurmEngineOptions options_;
  BatchFolder batches_;
  Patience patience_;
  std::map<std::string, HeldTask> held_;
  std::map<std::string, int> sizes_;  ///< number of tasks by batch
  std::set<TaskPlace> ended_;         ///< what we have reported as ended
  std::set<std::string> live_batches_;
  std::set<std::string> ending_batches_;      ///< tasks of them have ended, their folders are there
  std::map<TaskPlace, std::int64_t> strays_;  ///< since when, or when last cancelled
  std::vector<TaskReport> failed_;

  std::list<std::unique_ptr<Submission>> submissions_;
  std::list<std::unique_ptr<Command>> orders_;
  std::unique_ptr<Command> listing_, node_listing_;
  std::int64_t listing_begun_ = 0, listing_due_ = 0, idle_listing_due_ = 0, nodes_due_ = 0,
               sweep_due_ = 0, refused_until_ = 0;
  bool answers_ = true, listed_ = false;
  std::string complaint_;  ///< why it does not answer

  Cluster cluster_;
  int array_limit_ = 1;
};

}  // namespace slicecorr::farm::detail
