// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "run/priority.hpp"

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace slicecorr::bridge {

std::string raise_priority(int level) {
  sched_param p{};
  p.sched_priority = level;
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &p) == 0) {
    return "real-time priority " + std::to_string(level);
  }
  return std::string("normal priority: ") + std::strerror(errno);
}

void lower_priority() {
  const sched_param p{};
  sched_setscheduler(0, SCHED_OTHER, &p);
}

std::string lock_memory() {
  // Under a limit, memory asked for later would be refused: worse than a page that is not there.
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  if (limit.rlim_cur != RLIM_INFINITY && geteuid() != 0) return "memory not locked: limited";
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return "memory locked";
  return std::string("memory not locked: ") + std::strerror(errno);
}

}  // namespace slicecorr::bridge
