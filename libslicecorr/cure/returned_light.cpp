// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/returned_light.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

/// Halvings of a piece of a layer: below rounding.
constexpr int kHalvings = 52;

/// The dose along a piece of a layer. Its logarithm is convex where the dose falls towards the
/// platform, and it rises otherwise, so it has one minimum at most. (A piece that counts for less
/// than nothing, where more light leaves the bath than is shown, only falls.)
class Along {
 public:
  Along(const CureModel& model, int slice, const Stretch& piece)
      : model_(model),
        slice_(slice),
        piece_(piece),
        fall_(model.eta_of(slice) * units::kLn10),
        returns_(2 * fall_ / model.m) {}

  double dose(double d) const {
    const double left = std::exp(-fall_ * (d - piece_.from));
    return (piece_.phi + (piece_.begin - piece_.phi) * left) * model_.returned(slice_ + 1 - d);
  }
  /// Whether the dose rises towards the platform.
  bool rises(double d) const {
    const double left = (piece_.begin - piece_.phi) * std::exp(-fall_ * (d - piece_.from));
    const double zeta = slice_ + 1 - d;
    const double back = zeta < model_.mirrored_slices
                            ? model_.reflectance * std::exp(-2 * model_.eta * units::kLn10 /
                                                            model_.m * model_.depth(zeta))
                            : 0.0;
    // The logarithms' slopes: -fall left / (phi + left), and m returns back / (1 + back).
    return model_.m * returns_ * back * (piece_.phi + left) > fall_ * left * (1 + back);
  }
  /// Where the dose is least.
  double lowest() const {
    double low = piece_.from, high = piece_.to;
    if (rises(low)) return low;
    if (!rises(high)) return high;
    return halved({low, high}, kHalvings, [&](double z) { return !rises(z); }).high;
  }
  /// Where between `low` and `high` the dose passes 1; it is not below 1 at `low` if `printed`.
  double crossing(double low, double high, bool printed) const {
    return halved({low, high}, kHalvings, [&](double z) { return (dose(z) >= 1.0) == printed; })
        .middle();
  }

 private:
  const CureModel& model_;
  int slice_;
  const Stretch& piece_;
  double fall_, returns_;
};

}  // namespace

void look_along(const CureModel& model, int slice, const std::vector<Stretch>& pieces, double begin,
                double end, InsideLayer& out) {
  double at_from = begin;
  for (const Stretch& piece : pieces) {
    const Along along(model, slice, piece);
    const double at_to = &piece == &pieces.back() ? end : along.dose(piece.to);
    const double lowest = along.lowest();
    const bool turns = lowest > piece.from && lowest < piece.to;
    const double least = turns ? along.dose(lowest) : std::min(at_from, at_to);
    out.least = std::min({out.least, at_from, at_to, least});
    if (turns && at_from >= 1.0 && at_to >= 1.0 && least < 1.0) {
      out.crossings.push_back(along.crossing(piece.from, lowest, true));
      out.crossings.push_back(along.crossing(lowest, piece.to, false));
    } else if ((at_from >= 1.0) != (at_to >= 1.0)) {
      out.crossings.push_back(along.crossing(piece.from, piece.to, at_from >= 1.0));
    }
    at_from = at_to;
  }
}

namespace {

class ReturnedLight final : public DoseWalker {
 public:
  ReturnedLight(const CureModel& model, std::unique_ptr<DoseWalker> doses)
      : model_(model), doses_(std::move(doses)) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(doses_->lower.size(), 0.0);
  }
  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    doses_->add_slice(slice, showings);
    slice_ = slice;
    multiply(doses_->lower, slice + 1.0, lower);
    multiply(doses_->middle, slice + 0.5, middle);
    multiply(doses_->upper, slice, upper);
    turning = doses_->turning;
    if (!turning.empty() || slice >= model_.mirrored_slices) return;
    // Where the dose falls towards the platform at the layer's lower end, and rises at the upper.
    turning.assign(lower.size(), 0);
    std::vector<Stretch>& pieces = pieces_;
    for (std::size_t i = 0; i < lower.size(); ++i) {
      if (doses_->upper[i] >= doses_->lower[i]) continue;
      doses_->stretches(i, pieces);
      const Along along(model_, slice, pieces.front());
      turning[i] = !along.rises(0) && along.rises(1);
    }
  }
  void inside(std::size_t i, double known, InsideLayer& out) const override {
    if (slice_ >= model_.mirrored_slices) return doses_->inside(i, known, out);
    std::vector<Stretch> pieces;
    doses_->stretches(i, pieces);
    out.crossings.clear();
    out.least = std::min(lower[i], upper[i]);
    look_along(model_, slice_, pieces, lower[i], upper[i], out);
  }
  void stretches(std::size_t i, std::vector<Stretch>& out) const override {
    doses_->stretches(i, out);
  }

 private:
  void multiply(const std::vector<double>& from, double zeta, std::vector<double>& to) const {
    const double factor = model_.returned(zeta);
    for (std::size_t i = 0; i < from.size(); ++i) to[i] = factor * from[i];
  }

  const CureModel& model_;
  std::unique_ptr<DoseWalker> doses_;  ///< without the light that returns
  std::vector<Stretch> pieces_;
  int slice_ = 0;
};

}  // namespace

std::unique_ptr<DoseWalker> with_returned_light(const CureModel& model,
                                                std::unique_ptr<DoseWalker> doses) {
  return std::make_unique<ReturnedLight>(model, std::move(doses));
}

}  // namespace slicecorr::detail
