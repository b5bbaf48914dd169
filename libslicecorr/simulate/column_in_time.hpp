// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A pixel column at a moment of its print, one class for each model of dose.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/simulate.hpp"

namespace slicecorr::detail {

/// What a column is like at a moment.
class Column {
 public:
  virtual ~Column() = default;
  /// Moments come in order; `slice` has been shown whole before a later one comes.
  virtual void finish_slice(int) {}
  virtual std::vector<GelledInterval> gelled(const PrintClock::Moment& now) = 0;
  virtual DoseProfile profile(const PrintClock::Moment& now) = 0;
};

/// The light of a slice for an inhibited kernel: of a grey level, or by its front.
struct KernelLight {
  int level = 0;  ///< of the kernel
  double amount = 1;
};

/// `phi`: relative intensity of each slice with its exposure. `lights`: under UV light, in its place.
std::unique_ptr<Column> make_column(const CureModel& model, std::vector<double> phi,
                                    std::vector<KernelLight> lights);

}  // namespace slicecorr::detail
