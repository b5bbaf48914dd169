/// Loops that tell nobody of their progress.
#pragma once

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// The same context without callbacks: for steps too short to be told of.
inline ExecutionContext silent(const ExecutionContext& context) {
  ExecutionContext quiet;
  quiet.threads = context.threads;
  quiet.cancel = context.cancel;
  return quiet;
}

}  // namespace slicecorr::detail
