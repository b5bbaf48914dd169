// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Faults on demand for the farm's tests. Linked into `slicefarm-with-faults` alone, which is never
// installed: the slicefarm that is shipped reads neither variable.
//
// SLICEFARM_TEST_FAULT=STAGE:WHAT[:N][@TEXT] breaks workers when they come to a stage
// (work/stages.hpp): `crash`, `segv`, `kill`, `hang` (deaf to polite requests), `memory`, `full`
// (no file may grow beyond 4 kB) or `exit=CODE`; with N only in the first N attempts of a job, with
// TEXT only in jobs whose name has it.
//
// SLICEFARM_TEST_SERVICE_FAULT=STAGE[:N] kills the service with SIGKILL when it comes to a stage
// the Nth time.

#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm {
namespace {

struct TestFault {
  std::string stage, what, only;
  int attempts = 0;
};

std::optional<TestFault> test_fault_from_environment() {
  const char* text = std::getenv("SLICEFARM_TEST_FAULT");
  if (!text || !*text) return std::nullopt;
  std::string rest = text;
  TestFault fault;
  if (const std::size_t at = rest.find('@'); at != rest.npos) {
    fault.only = rest.substr(at + 1);
    rest.resize(at);
  }
  std::vector<std::string> words;
  for (std::size_t at = 0;;) {
    const std::size_t colon = rest.find(':', at);
    words.push_back(rest.substr(at, colon - at));
    if (colon == rest.npos) break;
    at = colon + 1;
  }
  if (words.size() < 2 || words.size() > 3) {
    throw InputError("SLICEFARM_TEST_FAULT is '" + std::string(text) +
                     "', expected STAGE:WHAT[:ATTEMPTS][@NAME]");
  }
  fault.stage = words[0];
  fault.what = words[1];
  fault.attempts = words.size() == 3 ? std::atoi(words[2].c_str()) : 0;
  return fault;
}

void break_worker(const std::string& stage, const WorkOrder& order) {
  static const std::optional<TestFault> fault = test_fault_from_environment();
  if (!fault || fault->stage != stage) return;
  if (fault->attempts > 0 && order.number > fault->attempts) return;
  if (!fault->only.empty() && order.name.find(fault->only) == std::string::npos) return;
  const std::string& what = fault->what;
  if (what == "crash") {
    std::abort();
  } else if (what == "segv") {
    ::raise(SIGSEGV);
  } else if (what == "kill") {
    ::raise(SIGKILL);
  } else if (what == "hang") {
    // Deaf to polite requests, as a worker is that hangs in a system call.
    sigset_t all;
    sigfillset(&all);
    sigprocmask(SIG_SETMASK, &all, nullptr);
    for (;;) ::pause();
  } else if (what == "memory") {
    std::vector<std::vector<char>> blocks;
    for (;;) blocks.emplace_back(std::size_t{16} << 20, 'x');
  } else if (what == "full") {
    const rlimit limit{4096, RLIM_INFINITY};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  } else if (what.starts_with("exit=")) {
    ::_exit(std::atoi(what.c_str() + 5));
  } else {
    throw InputError("SLICEFARM_TEST_FAULT: '" + what +
                     "' is no fault; expected crash, segv, kill, hang, memory, full or exit=N");
  }
}

void kill_service(const char* stage) {
  static const std::string wanted = [] {
    const char* text = std::getenv("SLICEFARM_TEST_SERVICE_FAULT");
    return std::string(text ? text : "");
  }();
  if (wanted.empty()) return;
  static int left = [] {
    const std::size_t colon = wanted.find(':');
    return colon == wanted.npos ? 1 : std::atoi(wanted.c_str() + colon + 1);
  }();
  if (wanted.substr(0, wanted.find(':')) == stage && --left == 0) ::raise(SIGKILL);
}

/// Before `main`.
const bool kListening = [] {
  detail::work_stage_listener = break_worker;
  detail::service_stage_listener = kill_service;
  return true;
}();

}  // namespace
}  // namespace slicecorr::farm
