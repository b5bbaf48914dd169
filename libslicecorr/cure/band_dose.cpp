// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "base/kernels.hpp"
#include "cure/steps.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr {

using detail::kBlock;

namespace detail {

void block_phi(const PixelCurve& curve, std::span<const ImageShowing> showings, std::size_t first,
               std::size_t n, double* phi) {
  bool begun = false;
  for (const ImageShowing& showing : showings) {
    if (showing.phi) {
      const double* const spread = showing.phi + first;
      for (std::size_t i = 0; i < n; ++i) {
        const double added = showing.light * spread[i];
        phi[i] = begun ? phi[i] + added : added;
      }
      begun = true;
      continue;
    }
    const std::uint8_t* const pixels = showing.pixels + first;
    // Most blocks show a single value, which needs one look-up.
    const bool one = n == kBlock && uniform(pixels);
    for (std::size_t i = 0; i < n; ++i) {
      const double added = showing.light * curve[pixels[one ? 0 : i]];
      phi[i] = begun ? phi[i] + added : added;
    }
    begun = true;
  }
  if (!begun) std::fill_n(phi, n, 0.0);
}

}  // namespace detail

namespace {

/// The slices that are still in the bath, and the one that has just left it.
class Bath {
 public:
  explicit Bath(const CureModel& model)
      : held_(static_cast<std::size_t>(model.bath_slices)), beyond_(model.beyond) {}
  /// Whether the bath ends at all.
  bool ends() const { return !held_.empty(); }
  /// Takes from `from` what slice `slice` + bath_slices shows at each column, times `beyond` and its
  /// exposure, and puts `showings` in its place. Before the doses of `slice`.
  void pass(int slice, std::span<const ImageShowing> showings, const PixelCurve& curve,
            double far_ratio, std::vector<double>& from) {
    Held& held = held_[static_cast<std::size_t>(slice) % held_.size()];
    double phi[kBlock];
    for (std::size_t b = 0; !held.showings.empty() && b < from.size(); b += kBlock) {
      const std::size_t n = std::min(kBlock, from.size() - b);
      detail::block_phi(curve, held.showings, b, n, phi);
      for (std::size_t i = 0; i < n; ++i) from[b + i] -= beyond_ * (phi[i] * far_ratio);
    }
    held.showings.assign(showings.begin(), showings.end());
    held.pixels.resize(showings.size() * from.size());
    const bool spread = std::any_of(showings.begin(), showings.end(),
                                    [](const ImageShowing& showing) { return showing.phi; });
    held.phi.resize(spread ? showings.size() * from.size() : 0);
    for (std::size_t s = 0; s < showings.size(); ++s) {
      ImageShowing& kept = held.showings[s];
      kept.pixels = keep(showings[s].pixels, from.size(), s, held.pixels);
      kept.phi = keep(showings[s].phi, from.size(), s, held.phi);
    }
  }

 private:
  struct Held {
    std::vector<std::uint8_t> pixels;
    std::vector<double> phi;
    std::vector<ImageShowing> showings;
  };
  /// Copies the values of showing `index`, if it has any, into `room`.
  template <typename T>
  static const T* keep(const T* values, std::size_t columns, std::size_t index,
                       std::vector<T>& room) {
    if (!values) return nullptr;
    T* const kept = room.data() + index * columns;
    std::copy_n(values, columns, kept);
    return kept;
  }
  std::vector<Held> held_;  ///< by slice, modulo their number
  double beyond_;
};

/// Continuous exposure, where doses go on from slice to slice.
template <typename Steps>
class ContinuousWalker final : public detail::DoseWalker {
 public:
  ContinuousWalker(const CureModel& model, std::size_t columns)
      : model_(model), steps_(model), curve_(pixel_curve(model)), bath_(model), phi_(columns) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
  }
  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    lower.swap(upper);
    steps_.enter(slice);
    cut(showings);
    ratio_ = model_.ratio(slice);
    if (bath_.ends()) {
      far_.assign(phi_.size(), 0.0);
      bath_.pass(slice, showings, curve_, model_.ratio(slice + model_.bath_slices), far_);
    }
    turning.assign(thin_slices_.empty() ? 0 : phi_.size(), 1);
    if (!thin_slices_.empty()) return add_pieces();
    for (std::size_t b = 0; b < phi_.size(); b += kBlock) {
      detail::block_phi(curve_, showings, b, std::min(kBlock, phi_.size() - b), &phi_[b]);
    }
    if (ratio_ != 1.0) {
      for (double& phi : phi_) phi *= ratio_;
    }
    for (std::size_t i = 0; i < far_.size(); ++i) phi_[i] += far_[i];
    for (std::size_t i = 0; i < phi_.size(); ++i) {
      if (Steps::kDear && i > 0 && phi_[i] == phi_[i - 1] && lower[i] == lower[i - 1]) {
        middle[i] = middle[i - 1];
        upper[i] = upper[i - 1];
        continue;
      }
      middle[i] = steps_.middle(phi_[i], lower[i]);
      upper[i] = steps_.node(phi_[i], lower[i]);
    }
  }
  void inside(std::size_t i, double, InsideLayer& out) const override {
    out.crossings.clear();
    out.least = std::min(lower[i], upper[i]);
    if (thin_slices_.empty()) {
      if ((lower[i] >= 1.0) != (upper[i] >= 1.0)) {
        out.crossings.push_back(steps_.crossing(phi_[i], lower[i], 1.0));
      }
      return;
    }
    double below = lower[i];
    for (auto thin = thin_slices_.rbegin(); thin != thin_slices_.rend(); ++thin) {
      const double phi = phi_of(*thin, i);
      const double above = steps_.after(thin->part, phi, below);
      out.least = std::min(out.least, above);
      if ((above >= 1.0) != (below >= 1.0)) {
        out.crossings.push_back(1.0 - thin->to +
                                steps_.crossing(phi, below, thin->to - thin->from));
      }
      below = above;
    }
  }
  void stretches(std::size_t i, std::vector<detail::Stretch>& out) const override {
    if (thin_slices_.empty()) return out.assign(1, {0, 1, phi_[i], lower[i]});
    out.clear();
    double below = lower[i];
    for (auto thin = thin_slices_.rbegin(); thin != thin_slices_.rend(); ++thin) {
      const double phi = phi_of(*thin, i);
      out.push_back({1.0 - thin->to, 1.0 - thin->from, phi, below});
      below = steps_.after(thin->part, phi, below);
    }
  }

 private:
  /// A stretch of the slice in which the same images are lit; their light is its density there.
  struct ThinSlice {
    double from, to;
    typename Steps::Part part;
    std::vector<ImageShowing> lit;
  };

  double phi_of(const ThinSlice& thin, std::size_t i) const {
    double phi = 0;
    detail::block_phi(curve_, thin.lit, i, 1, &phi);
    phi *= ratio_;
    return bath_.ends() ? phi + far_[i] : phi;
  }
  /// Cuts the slice into thin slices with one phi each; none where all showings are spread over the
  /// slice.
  void cut(std::span<const ImageShowing> showings) {
    thin_slices_.clear();
    const auto spread = [](const ImageShowing& p) { return p.from <= 0 && p.to >= 1; };
    if (std::all_of(showings.begin(), showings.end(), spread)) return;
    std::vector<double> ends{0.0, 0.5, 1.0};
    for (const ImageShowing& p : showings) ends.insert(ends.end(), {p.from, p.to});
    std::sort(ends.begin(), ends.end());
    ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
    for (std::size_t k = 0; k + 1 < ends.size(); ++k) {
      ThinSlice thin{ends[k], ends[k + 1], steps_.part(ends[k + 1] - ends[k]), {}};
      for (const ImageShowing& p : showings) {
        if (p.from > thin.from || p.to < thin.to) continue;
        thin.lit.push_back(p);
        thin.lit.back().light = p.light / (p.to - p.from);
      }
      thin_slices_.push_back(std::move(thin));
    }
  }
  void add_pieces() {
    upper = lower;
    double phi[kBlock];
    for (auto thin = thin_slices_.rbegin(); thin != thin_slices_.rend(); ++thin) {
      for (std::size_t b = 0; b < phi_.size(); b += kBlock) {
        const std::size_t n = std::min(kBlock, phi_.size() - b);
        detail::block_phi(curve_, thin->lit, b, n, phi);
        for (std::size_t i = 0; i < n; ++i) phi[i] *= ratio_;
        for (std::size_t i = 0; bath_.ends() && i < n; ++i) phi[i] += far_[b + i];
        for (std::size_t i = 0; i < n; ++i) {
          upper[b + i] = steps_.after(thin->part, phi[i], upper[b + i]);
        }
      }
      if (thin->from == 0.5) middle = upper;
    }
  }

  const CureModel& model_;
  Steps steps_;
  PixelCurve curve_;
  Bath bath_;
  std::vector<double> phi_;
  double ratio_ = 1;         ///< of the slice at hand
  std::vector<double> far_;  ///< what leaves the bath takes from phi; empty where it has no end
  std::vector<ThinSlice> thin_slices_;  ///< of the slice at hand, from the platform's side
};

/// What is left of a dose in the middle of a layer and at its far edge.
SLICECORR_CLONES
void fade(const double* __restrict near, double* __restrict middle, double* __restrict far,
          double root_a, double a, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    middle[i] = near[i] * root_a;
    far[i] = near[i] * a;
  }
}
SLICECORR_CLONES
void add(double* __restrict near, const double* __restrict far, const double* __restrict phi,
         double ratio, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) near[i] = phi[i] * ratio + far[i];
}

/// The greatest dose that a place has had at any lift, where each exchanges a share x of the liquid
/// (docs/lifts.md): D_k = (1 - x) D_(k-1) + phi_k a^(k-n) at the window of layer n, k from n on. One slice
/// further up all D_k become (1 - x)^(k-n) phi + a D_k, a of the layer that light passes on its way there, so
/// each k is carried on by itself. What lies beyond the end of the resin takes no more light, and what it
/// had before was no less.
class ExchangedDose {
 public:
  /// `bath`: slices that the resin is deep; 0: without end.
  ExchangedDose(double exchange, double most, int bath, std::size_t columns)
      : keeps_(1 - exchange), most_(most), bath_(bath) {
    if (keeps_ > 0 || bath > 0) after_.resize(columns);
  }
  /// To be said before each slice: what the layer after it leaves of a dose.
  void pass(int slice, double a) {
    slice_ = slice;
    a_ = a;
  }
  /// `far`: what later slices leave at the window; `near`: with the slice at hand.
  void add(std::size_t first, std::size_t n, const double* phi, double ratio, const double* far,
           double* near) {
    for (std::size_t i = 0; i < n; ++i) {
      const double light = phi[i] * ratio;
      near[i] = after_.empty() ? std::max(light, far[i]) : add(after_[first + i], light);
    }
  }

 private:
  struct After {
    double dose, kept;
    int slice;
  };
  double add(std::vector<After>& after, double light) const {
    if (bath_ > 0) {
      const auto is_in = [&](const After& k) { return k.slice - slice_ < bath_; };
      after.erase(after.begin(), std::find_if(after.begin(), after.end(), is_in));
    }
    double dose = light;
    for (After& k : after) {
      k.kept *= keeps_;
      k.dose = k.kept * light + a_ * k.dose;
      dose = std::max(dose, k.dose);
    }
    if (light > 0) after.push_back({light, 1, slice_});
    // One slice further up doses become keeps (kept phi + kept a/keeps h): where a nearer lift, which has kept
    // more, has the greater dose now, it has so further up, too. The furthest are the first to count for
    // nothing.
    constexpr double nothing = 1e-10;
    double nearer = 0;
    std::size_t to = after.size();
    for (std::size_t k = after.size(); k-- > 0;) {
      const After here = after[k];
      if (here.dose <= nearer || here.dose + here.kept * most_ <= nothing) continue;
      nearer = here.dose;
      after[--to] = here;
    }
    after.erase(after.begin(), after.begin() + static_cast<std::ptrdiff_t>(to));
    return dose;
  }

  double keeps_, most_, a_ = 0;
  int bath_, slice_ = 0;
  std::vector<std::vector<After>> after_;  ///< of each column, the furthest first
};

/// Layer by layer exposure, by appendix A.6: W(n) = (phi'_n + W(n + 1)) a, or as it fades in the
/// resin.
template <typename Steps>
class LayerwiseWalker final : public detail::DoseWalker {
 public:
  LayerwiseWalker(const CureModel& model, std::size_t columns)
      : model_(model), steps_(model), curve_(pixel_curve(model)), bath_(model) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
    const double exchange = model.lifts ? model.lifts->exchange.value_or(0) : 0;
    if (exchange > 0) {
      exchanged_.emplace(exchange, model.phi_max() * model.greatest_ratio(), model.bath_slices,
                         columns);
    }
  }
  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    const double ratio = model_.ratio(slice), a = model_.a_of(slice),
                 root_a = model_.root_a_of(slice);
    height_ = model_.height(slice);
    steps_.enter(slice);
    if (exchanged_) exchanged_->pass(slice, model_.a_of(slice + 1));
    if (bath_.ends() && !exchanged_) {
      bath_.pass(slice, showings, curve_, model_.ratio(slice + model_.bath_slices), upper);
    }
    double phi[kBlock];
    for (std::size_t b = 0; b < lower.size(); b += kBlock) {
      const std::size_t n = std::min(kBlock, lower.size() - b);
      detail::block_phi(curve_, showings, b, n, phi);
      if (exchanged_) {
        exchanged_->add(b, n, phi, ratio, &upper[b], &lower[b]);
      } else {
        add(&lower[b], &upper[b], phi, ratio, n);
      }
      if constexpr (Steps::kDear) {
        fade_by_steps(b, n);
      } else {
        fade(&lower[b], &middle[b], &upper[b], root_a, a, n);
      }
    }
  }
  void inside(std::size_t i, double, InsideLayer& out) const override {
    out.crossings.clear();
    out.least = upper[i];
    if (lower[i] >= 1.0 && upper[i] < 1.0) {
      const double layers = steps_.faded_to_one(lower[i], height_);
      out.crossings.push_back(layers / height_);
    }
  }
  void stretches(std::size_t i, std::vector<detail::Stretch>& out) const override {
    out.assign(1, {0, 1, 0, lower[i]});
  }

 private:
  void fade_by_steps(std::size_t first, std::size_t n) {
    for (std::size_t i = first; i < first + n; ++i) {
      const bool alike = i > first && lower[i] == lower[i - 1];
      middle[i] = alike ? middle[i - 1] : steps_.faded_half(lower[i]);
      upper[i] = alike ? upper[i - 1] : steps_.faded(lower[i]);
    }
  }

  const CureModel& model_;
  Steps steps_;
  PixelCurve curve_;
  Bath bath_;
  std::optional<ExchangedDose> exchanged_;
  double height_ = 1;  ///< of the layer at hand, in layers
};

template <typename Steps>
std::unique_ptr<detail::DoseWalker> make_walker_by(const CureModel& model, std::size_t columns) {
  if (model.mode == ExposureMode::layerwise) {
    return std::make_unique<LayerwiseWalker<Steps>>(model, columns);
  }
  return std::make_unique<ContinuousWalker<Steps>>(model, columns);
}

std::unique_ptr<detail::DoseWalker> make_walker(const CureModel& model, std::size_t columns) {
  if (model.inhibited()) return detail::make_inhibited_walker(model, columns);
  if (model.gel_time()) return detail::make_gel_time_walker(model, columns);
  auto walker = model.bleaching() ? make_walker_by<detail::BleachingSteps>(model, columns)
                                  : make_walker_by<detail::SummedSteps>(model, columns);
  if (model.mirrored_slices == 0) return walker;
  return detail::with_returned_light(model, std::move(walker));
}

}  // namespace

BandDose::BandDose(const CureModel& model, std::size_t columns)
    : model_(model), walker_(make_walker(model, columns)) {}
BandDose::~BandDose() = default;
BandDose::BandDose(BandDose&&) noexcept = default;
void BandDose::add_slice(int slice, const std::uint8_t* pixels) {
  if (!pixels) return walker_->add_slice(slice, {});
  const int setting = model_.inhibited() ? model_.inhibited()->setting_of_slice(slice) : 0;
  const ImageShowing whole{pixels, 1.0, setting};
  walker_->add_slice(slice, {&whole, 1});
}
void BandDose::add_slice(int slice, std::span<const ImageShowing> showings) {
  walker_->add_slice(slice, showings);
}
const double* BandDose::lower() const { return walker_->lower.data(); }
const double* BandDose::middle() const { return walker_->middle.data(); }
const double* BandDose::upper() const { return walker_->upper.data(); }
const std::uint8_t* BandDose::turning() const {
  return walker_->turning.empty() ? nullptr : walker_->turning.data();
}
void BandDose::inside(std::size_t column, double known, InsideLayer& out) const {
  walker_->inside(column, known, out);
}
bool BandDose::steady(std::size_t column, SteadyLayer& out) const {
  return walker_->steady(column, out);
}
void BandDose::inside(const SteadyLayer& layer, double known, InsideLayer& out) const {
  walker_->inside(layer, known, out);
}

ColumnDose column_dose(const CureModel& model, const std::vector<std::uint8_t>& pixels) {
  ColumnDose dose;
  for (auto* values : {&dose.lower, &dose.middle, &dose.upper}) values->resize(pixels.size());
  BandDose band(model, 1);
  for (std::size_t n = pixels.size(); n-- > 0;) {
    band.add_slice(static_cast<int>(n), &pixels[n]);
    dose.lower[n] = *band.lower();
    dose.middle[n] = *band.middle();
    dose.upper[n] = *band.upper();
  }
  return dose;
}

}  // namespace slicecorr
