// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer under UV light: the net dose that a slice's own exposure leaves in its layer, which is
/// what holds when the platform lifts (docs/lifts.md).
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// Keeps what levels leave once it is asked for. Not thread-safe.
class OwnDoses {
 public:
  /// `skin`: part of a layer that has gelled in a film. The kernel outlives this.
  OwnDoses(const InhibitedKernel& kernel, double skin);

  struct Own {
    double greatest = 0;  ///< relative dose, from the window's dead zone to the far edge
    double joint = 0;     ///< at the far edge
    bool film = false;    ///< at least `skin` of the layer gels
  };
  /// Of a column of a slice whose exposure is `ratio` times the normal one.
  Own of(std::span<const ImageShowing> showings, std::size_t column, double ratio);

  /// Of a level that is shown whole.
  Own of_level(int setting, int level, double ratio);

 private:
  static constexpr std::size_t kSamples = 16;
  /// At 1/16 to 16/16 of the layer from the window.
  using Samples = std::array<double, kSamples>;
  const Samples& samples(int setting, int level);
  Own own_of(const Samples& doses) const;

  const InhibitedKernel& kernel_;
  std::size_t film_;  ///< samples of a film that gel
  struct Known {
    bool is = false;
    Samples doses{};
  };
  std::vector<std::vector<Known>> known_;  ///< by setting and level
};

}  // namespace slicecorr::detail
