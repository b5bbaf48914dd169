/// The preview picture of a stack: the part seen from the window, lit from one side.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// Collects the last lit slice of every pixel, reduced to a small picture. Thread-safe; the order
/// of bands does not matter.
class Relief {
 public:
  Relief(const PixelBox& bounds, int layers);
  /// Takes the last lit slices + 1 (0: never lit) of a band's columns.
  void add(const PixelBox& band, const std::vector<std::int32_t>& last_lit);
  GreyImage picture() const;
  bool empty() const;

 private:
  PixelBox bounds_;
  int layers_, step_, width_, height_;
  std::vector<std::int32_t> depth_;
  std::mutex mutex_;
};

}  // namespace slicecorr::detail
