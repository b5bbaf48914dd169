// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/projection/certificate.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "tomo/projection/packed.hpp"

namespace slicecorr::tomo::detail {
namespace {

constexpr double kWithoutEnd = std::numeric_limits<double>::infinity();
/// For the projector's single precision.
constexpr double kMargin = 1e-4;
/// Rounds in which `high` is raised where rays miss something, and by how much of that.
constexpr int kRounds = 12;
/// The same with the weights of a prover, which takes longer.
constexpr int kProverRounds = 4;
constexpr float kRaise = 10;
/// Rounds after these in which all rays count alike, however little of a voxel they meet: as many as it takes
/// until what all void gets for the worst ray is less than this of the bound.
constexpr int kEvenRounds = 8;
constexpr double kLittle = 0.01;
/// Bands that reach as high have no most.
constexpr float kFree = 1e30F;

/// What a bound is made of, fields of a block.
struct Witness {
  Array<float> low, high, empty;  ///< lo, hi, and 1 in void
  Array<float> least, most;       ///< of bands: what they count for; empty: 1
};

Witness witness_of(const CellKinds& cells, const Array<float>& dose, double rung) {
  const Array<Kind>& kinds = cells.kinds;
  const std::size_t voxels = kinds.size();
  Witness w{Array<float>(voxels), Array<float>(voxels), Array<float>(voxels), {}, {}};
  if (cells.banded()) {
    w.least = cells.least;
    w.most = cells.most;
    for (std::size_t i = 0; i < voxels; ++i) {
      const float of_most = cells.least[i] > 0 ? 1 : static_cast<float>(rung);
      w.low[i] = std::max(0.0F, cells.least[i] - dose[i]);
      w.empty[i] = w.most[i] < kFree ? 1 : 0;
      w.high[i] = w.empty[i] * std::max(0.0F, dose[i] - of_most * w.most[i]);
    }
    return w;
  }
  for (std::size_t i = 0; i < voxels; ++i) {
    if (kinds[i] == Kind::gel) {
      w.low[i] = std::max(0.0f, 1.0f - dose[i]);
    } else if (kinds[i] == Kind::empty) {
      w.high[i] = std::max(0.0f, dose[i] - static_cast<float>(rung));
      w.empty[i] = 1;
    }
  }
  return w;
}

/// Bounds of each slice of a block.
class BlockBounds {
 public:
  BlockBounds(const Projector& projector, std::size_t block, Witness witness,
              const ExecutionContext& context)
      : projector_(projector),
        block_(block),
        context_(context),
        lanes_(static_cast<std::size_t>(projector.shape().problem_lanes())),
        now_(std::move(witness)),
        a_low_(pixels()),
        a_high_(pixels()),
        a_empty_(pixels()),
        ray_(pixels()),
        sum_low_(lanes_),
        count_(lanes_),
        bounds_(lanes_, kWithoutEnd),
        best_(now_.high) {
    forward(now_.low, a_low_);
    forward(now_.empty, a_empty_);
    // What gel lacks on rays that meet no void is nobody's.
    bool alone = false;
    for (std::size_t i = 0; i < pixels(); ++i) {
      ray_[i] = a_low_[i] > 0 && !(a_empty_[i] > 0) ? 1.0f : 0.0f;
      alone = alone || ray_[i] > 0;
    }
    if (alone) {
      const Array<float> met = adjoint(ray_);
      for (std::size_t i = 0; i < met.size(); ++i) now_.low[i] = met[i] > 0 ? 0.0f : now_.low[i];
      forward(now_.low, a_low_);
    }
    for (std::size_t i = 0; i < now_.low.size(); ++i) {
      sum_low_[i % lanes_] += worth(now_.least, i) * now_.low[i];
      if (now_.empty[i] > 0) count_[i % lanes_] += worth(now_.most, i);
    }
  }

  /// Bounds with `high` as it is, the least so far of each slice. The largest share of one that all void gets
  /// for the worst ray.
  double look() {
    double share_of_worst = 0;
    forward(now_.high, a_high_);
    std::vector<double> sum_high(lanes_), delta(lanes_);
    for (std::size_t i = 0; i < now_.high.size(); ++i) {
      if (now_.high[i] > 0) sum_high[i % lanes_] += worth(now_.most, i) * now_.high[i];
    }
    for (std::size_t i = 0; i < pixels(); ++i) {
      const double missing = a_low_[i] * (1 + kMargin) - a_high_[i] * (1 - kMargin);
      ray_[i] = 0;
      if (missing <= 0) continue;
      double& most = delta[i % lanes_];
      if (!(a_empty_[i] > 0)) {
        most = kWithoutEnd;
        continue;
      }
      const double share = missing / (a_empty_[i] * (1 - kMargin));
      most = std::max(most, share);
      ray_[i] = static_cast<float>(share);
    }
    for (std::size_t l = 0; l < lanes_; ++l) {
      if (!(sum_low_[l] > 0 && delta[l] < kWithoutEnd)) continue;
      const double bound = (sum_high[l] + delta[l] * count_[l]) / sum_low_[l];
      if (bound > 0) {
        share_of_worst = std::max(share_of_worst, delta[l] * count_[l] / sum_low_[l] / bound);
      }
      if (!(bound < bounds_[l])) continue;
      bounds_[l] = bound;
      for (std::size_t i = l; i < best_.size(); i += lanes_) best_[i] = now_.high[i];
    }
    return share_of_worst;
  }

  /// Void on rays that miss something gets the mean of what they miss, and more.
  void raise() {
    const Array<float> missed = adjoint(ray_);
    if (seen_.empty()) seen_ = adjoint(Array<float>(pixels(), 1.0f));
    for (std::size_t i = 0; i < missed.size(); ++i) {
      if (now_.empty[i] > 0 && seen_[i] > 0) now_.high[i] += kRaise * missed[i] / seen_[i];
    }
  }

  /// The same, where each ray counts by its share of all that it meets of void: one that meets a corner of a
  /// voxel is made up for, too.
  void raise_evenly() {
    Array<float> ones(pixels());
    for (std::size_t i = 0; i < pixels(); ++i) {
      ones[i] = a_empty_[i] > 0 ? 1 / a_empty_[i] : 0.0F;
      ray_[i] *= ones[i];
    }
    const Array<float> missed = adjoint(ray_), met = adjoint(ones);
    for (std::size_t i = 0; i < missed.size(); ++i) {
      if (now_.empty[i] > 0 && met[i] > 0) now_.high[i] += kRaise * missed[i] / met[i];
    }
  }

  std::vector<double> bounds() const {
    std::vector<double> all = bounds_;
    all.resize(static_cast<std::size_t>(projector_.shape().problems_of(block_)));
    return all;
  }
  /// `high` of the least bounds.
  const Array<float>& best() const { return best_; }

 private:
  static double worth(const Array<float>& of, std::size_t i) { return of.empty() ? 1 : of[i]; }
  std::size_t pixels() const { return projector_.shape().light_of_block; }
  void forward(const Array<float>& field, Array<float>& light) const {
    projector_.forward(block_, field.data(), light.data(), context_);
  }
  Array<float> adjoint(const Array<float>& light) const {
    Array<float> field(projector_.shape().field_of_block);
    projector_.adjoint(block_, light.data(), field.data(), context_);
    return field;
  }

  const Projector& projector_;
  std::size_t block_;
  const ExecutionContext& context_;
  std::size_t lanes_;
  Witness now_;
  Array<float> a_low_, a_high_, a_empty_, ray_, seen_;
  std::vector<double> sum_low_, count_, bounds_;
  Array<float> best_;
};

/// Raises `high` round by round.
BlockBounds found_in(const Projector& projector, std::size_t block, Witness witness,
                     const ExecutionContext& context, int rounds = kRounds) {
  BlockBounds bounds(projector, block, std::move(witness), context);
  for (int round = 0;; ++round) {
    const double of_worst = bounds.look();
    if (round >= rounds && (of_worst < kLittle || round == rounds + kEvenRounds)) return bounds;
    if (round < rounds) {
      bounds.raise();
    } else {
      bounds.raise_evenly();
    }
  }
}

/// Calls use(projector, block, take, put, slices) for each block that holds these slices.
template <class Use>
void each_block(const ExecutionContext& context, const Projector& projector,
                const std::vector<int>& slices, const Use& use) {
  const PackedSlices packed(projector, slices);
  const ExecutionContext inside = inside_block(context, packed.blocks());
  parallel_for(context, "proving", packed.blocks(), [&](std::size_t b) { use(packed, b, inside); });
}

}  // namespace

std::vector<double> contrast_bounds(const ExecutionContext& context, const Projector& projector,
                                    const CellKinds& cells, const Array<float>& dose, double rung,
                                    const std::vector<int>& slices) {
  const Shape shape = projector.shape();
  if (shape.coupled) {
    return found_in(projector, 0, witness_of(cells, dose, rung), context).bounds();
  }
  std::vector<double> bounds(static_cast<std::size_t>(shape.slices), kWithoutEnd);
  each_block(context, projector, slices,
             [&](const PackedSlices& packed, std::size_t b, const ExecutionContext& inside) {
               const std::vector<int> lanes = packed.of_block(b);
               const std::vector<double> found =
                   found_in(packed.projector(), b,
                            witness_of(take_cells(packed, b, cells), packed.take(b, dose), rung),
                            inside)
                       .bounds();
               for (std::size_t l = 0; l < lanes.size(); ++l) bounds[lanes[l]] = found[l];
             });
  return bounds;
}

std::vector<double> proven_bounds(const ExecutionContext& context, const Projector& projector,
                                  const Projector& prover, const CellKinds& cells,
                                  const Array<float>& dose, double rung,
                                  const std::vector<int>& slices) {
  const Shape shape = projector.shape();
  if (shape.coupled) {
    Witness witness = witness_of(cells, dose, rung);
    witness.high = found_in(projector, 0, witness, context).best();
    return found_in(prover, 0, std::move(witness), context, kProverRounds).bounds();
  }
  Array<float> high(shape.field());
  each_block(
      context, projector, slices,
      [&](const PackedSlices& packed, std::size_t b, const ExecutionContext& inside) {
        packed.put_back(
            b,
            found_in(packed.projector(), b,
                     witness_of(take_cells(packed, b, cells), packed.take(b, dose), rung), inside)
                .best(),
            high);
      });
  const CellKinds kinds = cells_in_lanes(shape, prover.shape(), cells);
  const Array<float> doses = in_lanes(shape, prover.shape(), dose);
  high = in_lanes(shape, prover.shape(), high);
  std::vector<double> all(static_cast<std::size_t>(shape.slices), kWithoutEnd);
  each_block(
      context, prover, slices,
      [&](const PackedSlices& packed, std::size_t b, const ExecutionContext& inside) {
        Witness witness = witness_of(take_cells(packed, b, kinds), packed.take(b, doses), rung);
        witness.high = packed.take(b, high);
        const std::vector<int> lanes = packed.of_block(b);
        const std::vector<double> found =
            found_in(packed.projector(), b, std::move(witness), inside, kProverRounds).bounds();
        for (std::size_t l = 0; l < lanes.size(); ++l) all[lanes[l]] = found[l];
      });
  return all;
}

}  // namespace slicecorr::tomo::detail
