// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>

#include "slicecorr/farm/engine.hpp"

namespace slicecorr::farm {

Engine::TaskSize Engine::share(const EngineCapacity& capacity, std::int64_t waiting,
                               std::int64_t base_memory_mb, std::int64_t thread_memory_mb) const {
  // One thread each while there are enough jobs: nothing scales better. The last jobs of a night
  // share the cores that would be idle.
  const std::int64_t sharing =
      std::max<std::int64_t>(1, std::min<std::int64_t>(std::max(1, capacity.tasks), waiting));
  TaskSize share;
  share.threads = static_cast<int>(std::max<std::int64_t>(1, capacity.cores / sharing));
  const auto memory = [&] { return base_memory_mb + (share.threads - 1) * thread_memory_mb; };
  while (share.threads > 1 && memory() > capacity.memory_mb) --share.threads;
  share.memory_mb = memory();
  return share;
}

}  // namespace slicecorr::farm
