/// @file eventually.hpp
/// Waits for what other processes do.
#pragma once

#include <poll.h>

#include <algorithm>
#include <chrono>

namespace slicecorr::test {

/// Waits until something holds; false when it does not in this time. It looks again after a tenth
/// of the time that has passed: to look, at a database or at all processes, may cost more than what
/// is waited for, and what comes soon is seen soon.
template <typename Holds>
bool eventually(Holds holds, std::chrono::milliseconds most = std::chrono::seconds(120)) {
  using std::chrono::milliseconds;
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    if (holds()) return true;
    const auto passed =
        std::chrono::duration_cast<milliseconds>(std::chrono::steady_clock::now() - begin);
    if (passed > most) return false;
    const auto pause = std::clamp(passed / 10, milliseconds(5), milliseconds(100));
    ::poll(nullptr, 0, static_cast<int>(pause.count()));
  }
}

}  // namespace slicecorr::test
