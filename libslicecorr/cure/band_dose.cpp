#include <algorithm>
#include <cmath>
#include <vector>

#include "base/kernels.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

using detail::kBlock;

namespace detail {

void block_phi(const PixelCurve& curve, std::span<const ShownPart> parts, std::size_t first,
               std::size_t n, double* phi) {
  bool begun = false;
  for (const ShownPart& part : parts) {
    const std::uint8_t* const pixels = part.pixels + first;
    // Most blocks show one value.
    const bool one = n == kBlock && uniform(pixels);
    for (std::size_t i = 0; i < n; ++i) {
      const double added = part.light * curve[pixels[one ? 0 : i]];
      phi[i] = begun ? phi[i] + added : added;
    }
    begun = true;
  }
  if (!begun) std::fill_n(phi, n, 0.0);
}

}  // namespace detail

namespace {

/// (A.32), (A.35).
class ContinuousWalker final : public BandDose::Walker {
 public:
  ContinuousWalker(const CureModel& model, std::size_t columns)
      : model_(model), curve_(pixel_curve(model)), phi_(columns) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
  }
  void add_slice(int, std::span<const ShownPart> parts) override {
    lower.swap(upper);
    cut(parts);
    turning.assign(pieces_.empty() ? 0 : phi_.size(), 1);
    if (!pieces_.empty()) return add_pieces();
    for (std::size_t b = 0; b < phi_.size(); b += kBlock) {
      detail::block_phi(curve_, parts, b, std::min(kBlock, phi_.size() - b), &phi_[b]);
    }
    for (std::size_t i = 0; i < phi_.size(); ++i) {
      middle[i] = model_.middle(phi_[i], lower[i]);
      upper[i] = model_.step(phi_[i], lower[i]);
    }
  }
  void inside(std::size_t i, double, InsideLayer& out) const override {
    out.crossings.clear();
    out.least = std::min(lower[i], upper[i]);
    if (pieces_.empty()) {
      if ((lower[i] >= 1.0) != (upper[i] >= 1.0)) {
        out.crossings.push_back(model_.crossing(phi_[i], lower[i]));
      }
      return;
    }
    double below = lower[i];
    for (auto piece = pieces_.rbegin(); piece != pieces_.rend(); ++piece) {
      double phi = 0;
      detail::block_phi(curve_, piece->lit, i, 1, &phi);
      const double above = phi * piece->one_minus_a + piece->a * below;
      out.least = std::min(out.least, above);
      if ((above >= 1.0) != (below >= 1.0)) {
        const double d = -std::log1p((1.0 - below) / (below - phi)) / (model_.eta * units::ln10);
        out.crossings.push_back(1.0 - piece->to + std::clamp(d, 0.0, piece->to - piece->from));
      }
      below = above;
    }
  }

 private:
  /// A stretch of the slice in which the same images are lit; their light is its density there.
  struct Piece {
    double from, to, a, one_minus_a;
    std::vector<ShownPart> lit;
  };

  /// Into thin slices with one phi each, none where all parts are spread over the slice.
  void cut(std::span<const ShownPart> parts) {
    pieces_.clear();
    const auto spread = [](const ShownPart& p) { return p.from <= 0 && p.to >= 1; };
    if (std::all_of(parts.begin(), parts.end(), spread)) return;
    std::vector<double> ends{0.0, 0.5, 1.0};
    for (const ShownPart& p : parts) ends.insert(ends.end(), {p.from, p.to});
    std::sort(ends.begin(), ends.end());
    ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
    for (std::size_t k = 0; k + 1 < ends.size(); ++k) {
      const double exponent = -(ends[k + 1] - ends[k]) * model_.eta * units::ln10;
      Piece piece{ends[k], ends[k + 1], std::exp(exponent), -std::expm1(exponent), {}};
      for (const ShownPart& p : parts) {
        if (p.from > piece.from || p.to < piece.to) continue;
        piece.lit.push_back(p);
        piece.lit.back().light = p.light / (p.to - p.from);
      }
      pieces_.push_back(std::move(piece));
    }
  }
  void add_pieces() {
    upper = lower;
    double phi[kBlock];
    for (auto piece = pieces_.rbegin(); piece != pieces_.rend(); ++piece) {
      for (std::size_t b = 0; b < phi_.size(); b += kBlock) {
        const std::size_t n = std::min(kBlock, phi_.size() - b);
        detail::block_phi(curve_, piece->lit, b, n, phi);
        for (std::size_t i = 0; i < n; ++i) {
          upper[b + i] = phi[i] * piece->one_minus_a + piece->a * upper[b + i];
        }
      }
      if (piece->from == 0.5) middle = upper;
    }
  }

  const CureModel& model_;
  PixelCurve curve_;
  std::vector<double> phi_;
  std::vector<Piece> pieces_;  ///< of the slice at hand, from the platform's side
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

/// Appendix A.6: W(n) = (phi'_n + W(n + 1)) a.
class LayerwiseWalker final : public BandDose::Walker {
 public:
  LayerwiseWalker(const CureModel& model, std::size_t columns)
      : model_(model), curve_(pixel_curve(model)) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
  }
  void add_slice(int slice, std::span<const ShownPart> parts) override {
    const double ratio = model_.ratio(slice);
    double phi[kBlock];
    for (std::size_t b = 0; b < lower.size(); b += kBlock) {
      const std::size_t n = std::min(kBlock, lower.size() - b);
      detail::block_phi(curve_, parts, b, n, phi);
      add(&lower[b], &upper[b], phi, ratio, n);
      fade(&lower[b], &middle[b], &upper[b], model_.root_a, model_.a, n);
    }
  }
  void inside(std::size_t i, double, InsideLayer& out) const override {
    out.crossings.clear();
    out.least = upper[i];
    if (lower[i] >= 1.0 && upper[i] < 1.0) {
      const double d = std::log(lower[i]) / (model_.eta * units::ln10);
      out.crossings.push_back(std::clamp(d, 0.0, 1.0));
    }
  }

 private:
  const CureModel& model_;
  PixelCurve curve_;
};

std::unique_ptr<BandDose::Walker> make_walker(const CureModel& model, std::size_t columns) {
  if (model.inhibited) return detail::make_inhibited_walker(model, columns);
  if (model.mode == ExposureMode::layerwise) {
    return std::make_unique<LayerwiseWalker>(model, columns);
  }
  return std::make_unique<ContinuousWalker>(model, columns);
}

}  // namespace

BandDose::BandDose(const CureModel& model, std::size_t columns)
    : model_(model), walker_(make_walker(model, columns)) {}
BandDose::~BandDose() = default;
BandDose::BandDose(BandDose&&) noexcept = default;
void BandDose::add_slice(int slice, const std::uint8_t* pixels) {
  if (!pixels) return walker_->add_slice(slice, {});
  const int setting = model_.inhibited ? model_.inhibited->setting_of_slice(slice) : 0;
  const ShownPart whole{pixels, 1.0, setting};
  walker_->add_slice(slice, {&whole, 1});
}
void BandDose::add_slice(int slice, std::span<const ShownPart> parts) {
  walker_->add_slice(slice, parts);
}
const double* BandDose::lower() const { return walker_->lower.data(); }
const double* BandDose::middle() const { return walker_->middle.data(); }
const double* BandDose::upper() const { return walker_->upper.data(); }

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
