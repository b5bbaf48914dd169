// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a law of dose must say that goes on from slice to slice: the dose further up follows from the
/// one below and the light between. Walkers, and searches that try levels, are made of it.
///
/// `phi` is the light of the slice, continuous; layer by layer doses only fall in a layer, from what
/// its exposure and the layers after it leave at its window.
#pragma once

#include <algorithm>
#include <cmath>

#include "slicecorr/bleaching.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

/// (A.32), (A.35), and layer by layer W(n).
class SummedSteps {
 public:
  explicit SummedSteps(const CureModel& model)
      : model_(&model),
        eta_(model.eta),
        a_(model.a),
        one_minus_a_(model.one_minus_a),
        root_a_(model.root_a) {}
  /// Whether a dose costs so much that columns which are alike are worth a look.
  static constexpr bool kDear = false;

  /// Continuous: goes on to a slice, of its own height. Lengths are parts of it.
  void enter(int slice) {
    if (model_->heights.alike()) return;
    eta_ = model_->eta_of(slice);
    a_ = model_->a_of(slice);
    one_minus_a_ = model_->one_minus_a_of(slice);
    root_a_ = model_->root_a_of(slice);
  }
  /// A part of a slice, of this length.
  struct Part {
    double a, one_minus_a;
  };
  Part part(double length) const {
    const double exponent = -length * eta_ * units::kLn10;
    return {std::exp(exponent), -std::expm1(exponent)};
  }
  double after(const Part& part, double phi, double below) const {
    return phi * part.one_minus_a + part.a * below;
  }
  double node(double phi, double below) const { return phi * one_minus_a_ + a_ * below; }
  double middle(double phi, double below) const { return phi * (1.0 - root_a_) + root_a_ * below; }
  /// Where in `length` the dose is 1, if it is on different sides of it at the ends.
  double crossing(double phi, double below, double length) const {
    const double d = -std::log1p((1.0 - below) / (below - phi)) / (eta_ * units::kLn10);
    return std::clamp(d, 0.0, length);
  }
  double faded(double near) const { return near * model_->a; }
  double faded_half(double near) const { return near * model_->root_a; }
  /// How far from the window a dose of `near` has fallen to 1, in layers, at most `most`.
  double faded_to_one(double near, double most) const {
    return std::clamp(std::log(near) / (model_->eta * units::kLn10), 0.0, most);
  }

 private:
  const CureModel* model_;
  double eta_, a_, one_minus_a_, root_a_;  ///< of the slice at hand
};

/// Of a resin that bleaches (bleaching.hpp).
class BleachingSteps {
 public:
  explicit BleachingSteps(const CureModel& model)
      : model_(&model), law_(*model.bleaching()), per_phi_(law_.absorbed(1.0)) {}
  static constexpr bool kDear = true;

  void enter(int slice) { height_ = model_->height(slice); }
  using Part = double;
  /// Lengths are parts of the slice at hand.
  Part part(double length) const { return length * height_; }
  double after(Part part, double phi, double below) const {
    return law_.after(below, part, phi * per_phi_);
  }
  double node(double phi, double below) const { return after(part(1.0), phi, below); }
  double middle(double phi, double below) const { return after(part(0.5), phi, below); }
  double crossing(double phi, double below, double length) const {
    const bool prints = below >= 1.0;
    return halved({0.0, length}, 50,
                  [&](double d) { return (after(part(d), phi, below) >= 1.0) == prints; })
        .middle();
  }
  double faded(double near) const { return law_.after(near, part(1.0), 0.0); }
  double faded_half(double near) const { return law_.after(near, part(0.5), 0.0); }
  double faded_to_one(double near, double most) const {
    return std::clamp(law_.length(near, 1.0), 0.0, most);
  }

 private:
  const CureModel* model_;
  BleachingLaw law_;
  double per_phi_, height_ = 1;
};

}  // namespace slicecorr::detail
