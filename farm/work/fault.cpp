// Faults on demand: what tests ask of a worker through SLICEFARM_TEST_FAULT.

#include "work/fault.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdlib>
#include <vector>

#include "slicecorr/error.hpp"

namespace slicecorr::farm {

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

void detail::commit_fault(const std::optional<TestFault>& fault, const std::string& stage,
                          const Order& order) {
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

}  // namespace slicecorr::farm
