/// Loops that tell nobody of their progress.
#pragma once

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// The same job without callbacks: for steps too short to be told of.
inline Job silent(const Job& job) {
  Job quiet;
  quiet.threads = job.threads;
  quiet.cancel = job.cancel;
  return quiet;
}

}  // namespace slicecorr::detail
