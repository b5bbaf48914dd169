// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/bridges.hpp"

#include <fmt/format.h>
#include <sys/wait.h>

#include <algorithm>
#include <filesystem>
#include <thread>

#include "machines/detached.hpp"
#include "serve/studies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/machines.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;
using http::ApiError;
using Json = nlohmann::ordered_json;

namespace {

/// What a bridge refuses it mostly says by then: stacks are read first.
constexpr auto kFirstWords = std::chrono::seconds(3);
constexpr auto kStatusTime = std::chrono::seconds(5);

std::string log_of(const FarmFolder& folder, const std::string& bridge) {
  return folder.root + "/bridges/" + bridge + ".log";
}

}  // namespace

std::vector<Bridge> read_bridges(const FarmFolder& folder) {
  std::vector<Bridge> bridges;
  for (const MachineSpec& m : read_machines(folder)) {
    if (m.kind != MachineKind::bridge) continue;
    bridges.push_back({m.name, m.printer, m.options, m.status_options, m.page});
  }
  return bridges;
}

Json Bridges::list() {
  Json json = Json::array();
  for (const Bridge& b : read_bridges(folder_)) {
    Json one = {{"name", b.name}, {"printer", b.printer}, {"page", b.page}};
    std::vector<std::string> ask{
        program_path(rules_, "printbridge"), "status", "--printer", b.printer, "--json", "-"};
    ask.insert(ask.end(), b.status_options.begin(), b.status_options.end());
    const CommandResult result = run_command(ask, kStatusTime, {}, {}, child_limits(rules_, ""));
    Json state = slicecorr::detail::try_json<Json>(result.out);
    one["state"] = state.is_discarded() ? Json(nullptr) : state;
    if (!result.ok()) one["trouble"] = told_by(result, folder_);
    {
      const std::scoped_lock lock(shared_->mutex);
      const auto sent = shared_->sent.find(b.name);
      if (sent != shared_->sent.end()) {
        const Sent& s = sent->second;
        one["sent"] = {{"job", s.job},
                       {"name", s.name},
                       {"by", s.by},
                       {"dry_run", s.dry_run},
                       {"running", s.running}};
        if (!s.running) {
          one["sent"]["exit_code"] = s.exit_code;
          CommandResult said;
          said.exit_code = s.exit_code;
          said.err = text_of_file(log_of(folder_, b.name)).value_or("");
          one["sent"]["message"] = told_by(said, folder_);
        }
      }
    }
    json.push_back(one);
  }
  return json;
}

Json Bridges::print(const std::string& bridge, const std::string& stack, const Job& job,
                    bool dry_run, bool machine_is_clear, const std::string& by) {
  const std::vector<Bridge> all = read_bridges(folder_);
  const auto b =
      std::find_if(all.begin(), all.end(), [&](const Bridge& x) { return x.name == bridge; });
  if (b == all.end()) throw ApiError(404, "bridge", "there is no bridge of this name");
  if (b->printer != job.printer) {
    throw ApiError(
        409, "bridge",
        "the job is for the printer " + job.printer + ", the bridge drives " + b->printer);
  }
  {
    const std::scoped_lock lock(shared_->mutex);
    Sent& s = shared_->sent[bridge];
    if (s.running) throw ApiError(409, "bridge", "the bridge prints");
    s = {job.id, job.name, by, true, dry_run, -1};
  }
  const auto not_started = [&](int code) {
    const std::scoped_lock lock(shared_->mutex);
    shared_->sent[bridge].running = false;
    shared_->sent[bridge].exit_code = code;
  };
  std::vector<std::string> command{program_path(rules_, "printbridge"), "print", stack, "--printer",
                                   b->printer};
  command.insert(command.end(), b->options.begin(), b->options.end());
  if (dry_run) command.emplace_back("--dry-run");
  if (machine_is_clear) command.emplace_back("--machine-is-clear");
  std::error_code error;
  const std::string log = log_of(folder_, bridge);
  fs::create_directories(fs::path(log).parent_path(), error);
  const pid_t pid = start_detached(command, log);
  if (pid < 0) {
    not_started(4);
    throw ApiError(503, "device", "printbridge can't be started");
  }
  // Whoever waits for it may go before it: what they share lives as long as either.
  std::thread([shared = shared_, bridge, pid] {
    int status = 0;
    while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    const std::scoped_lock lock(shared->mutex);
    Sent& s = shared->sent[bridge];
    s.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 1;
    s.running = false;
  }).detach();
  const auto until = std::chrono::steady_clock::now() + kFirstWords;
  for (;;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    const std::scoped_lock lock(shared_->mutex);
    const Sent& s = shared_->sent[bridge];
    if (!s.running) {
      CommandResult said;
      said.exit_code = s.exit_code;
      said.err = text_of_file(log).value_or("");
      if (s.exit_code != 0) throw ApiError(409, "bridge", told_by(said, folder_));
      return {{"bridge", bridge}, {"job", job.id}, {"dry_run", dry_run}, {"running", false}};
    }
    if (std::chrono::steady_clock::now() > until) break;
  }
  return {{"bridge", bridge}, {"job", job.id}, {"dry_run", dry_run}, {"running", true}};
}

}  // namespace slicecorr::farm::detail
