// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loops that tell nobody of their progress.
#pragma once

#include <algorithm>
#include <cstddef>

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// The same context without callbacks: for steps too short to be told of.
inline ExecutionContext silent(const ExecutionContext& context) {
  ExecutionContext quiet;
  quiet.threads = context.threads;
  quiet.cancel = context.cancel;
  return quiet;
}

/// Silent, and on no more threads than get `least` of `count` things each: to start and to end a thread takes tens of
/// microseconds, and many times that while other programs run.
inline ExecutionContext silent(const ExecutionContext& context, std::size_t count,
                               std::size_t least) {
  ExecutionContext quiet = silent(context);
  quiet.threads = static_cast<int>(
      std::clamp<std::size_t>(count / least, 1, static_cast<std::size_t>(thread_count(context))));
  return quiet;
}

}  // namespace slicecorr::detail
