// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/beams/beam_solver.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/ladder.hpp"
#include "tomo/beams/beam_projector.hpp"
#include "tomo/projection/block_solver.hpp"
#include "tomo/projection/certificate.hpp"

namespace slicecorr::tomo::detail {
namespace {

using slicecorr::detail::silent;

constexpr double kNone = std::numeric_limits<double>::infinity();
/// Rungs fall by this factor first, then the one between the last reached and the first missed is
/// halved so often.
constexpr double kFall = 0.93;
constexpr int kHalvings = 4;
constexpr double kFirstRung = 0.998, kLastRung = 0.02;
/// Resin gels once and nothing turns: bright cells of the part do no harm.
constexpr double kMostDose = 1e6;
constexpr int kProofSteps = 320;
/// Contrast from which on nobody asks what stands against more.
constexpr double kNotWorthProving = 1.001;
/// Cells that weigh less than this in a proof, of the one that weighs most, are not told of.
constexpr float kWeighs = 0.05F;

class Grey {
 public:
  Grey(const Box<std::uint8_t>& part, const BeamSetup& setup, const ExecutionContext& context)
      : part_(part),
        setup_(setup),
        context_(context),
        cells_(part, setup),
        projector_(part, cells_, setup),
        target_(target()),
        enough_(enough()),
        best_(projector_.shape().light()) {}

  GreyImages find(std::vector<BeamImage> images) {
    take(images);
    best_contrast_ = scale(best_);
    if (!(best_contrast_ > 0)) {
      throw InfeasibleError("no light gets through to all of the part; expected less absorption");
    }
    std::vector<double> rungs;
    for (double rung = kFirstRung; rung > kLastRung; rung *= kFall) rungs.push_back(rung);
    const std::optional<double> missed = climb(rungs, kProofSteps);
    if (missed) {
      double low = *missed, high = 1 / std::max(best_contrast_, 1.0);
      for (int i = 0; i < kHalvings && high > low * 1.0005; ++i) {
        const double middle = std::sqrt(low * high);
        const bool reached = !climb({middle}, 0);
        if (!reached) low = middle;
        high = std::min(high, reached ? middle : 1 / best_contrast_);
      }
    }
    GreyImages found;
    if (!(best_contrast_ > kNotWorthProving)) prove(found);
    found.contrast_bound = std::max(bound_, 0.0);
    put(images);
    found.images = std::move(images);
    return found;
  }

 private:
  CellKinds target() const {
    CellKinds target;
    target.kinds.resize(projector_.shape().field());
    each_cell([&](int x, int y, int z, std::uint8_t v) {
      Kind& kind = target.kinds[projector_.cell(x, y, z)];
      kind = v == 255 ? Kind::gel : v == 0 ? Kind::empty : Kind::neither;
      target.gel += kind == Kind::gel ? 1 : 0;
      target.empty += kind == Kind::empty ? 1 : 0;
    });
    return target;
  }

  /// Per pixel what alone gives the part's cells on its ray a dose of 1; 0 where it meets none. More
  /// is of no use: with this, these cells still have enough, and all others have less.
  Array<float> enough() const {
    Array<float> light(projector_.shape().light());
    // Light that goes sideways is of use beside the part, too.
    if (setup_.goes_sideways()) {
      std::fill(light.begin(), light.end(), std::numeric_limits<float>::max());
      return light;
    }
    each_cell([&](int x, int y, int z, std::uint8_t v) {
      if (v != 255) return;
      for (std::size_t k = 0; k < setup_.beams.size(); ++k) {
        float& most = light[projector_.pixel(k, x, y, z)];
        most = std::max(most, 1 / projector_.left(k, x, y, z));
      }
    });
    return light;
  }

  /// The deciding cells: use(x, y, z among them, coverage).
  template <class Use>
  void each_cell(const Use& use) const {
    for (int z = 0; z < cells_.size(2); ++z) {
      for (int y = 0; y < cells_.size(1); ++y) {
        for (int x = 0; x < cells_.size(0); ++x) {
          use(x, y, z, part_.values[part_.at(of(2, z), of(1, y), of(0, x))]);
        }
      }
    }
  }
  int of(int axis, int i) const {
    return cells_.index[static_cast<std::size_t>(axis)][static_cast<std::size_t>(i)];
  }

  /// use(beam, place in light, row and column of the image)
  template <class Use>
  void each_pixel(const Use& use) const {
    for (std::size_t k = 0; k < setup_.beams.size(); ++k) {
      const int axis = setup_.beams[k].axis;
      const int across = axis == 0 ? 1 : 0, up = axis == 2 ? 1 : 2;
      for (int r = 0; r < cells_.size(up); ++r) {
        for (int c = 0; c < cells_.size(across); ++c) {
          use(k, projector_.pixel(k, c, r), of(up, r), of(across, c));
        }
      }
    }
  }
  static std::size_t place(const BeamImage& image, int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(image.columns) +
           static_cast<std::size_t>(column);
  }
  void take(const std::vector<BeamImage>& images) {
    each_pixel([&](std::size_t k, std::size_t at, int row, int column) {
      best_[at] = images[k].at(row, column);
    });
  }
  /// The best light as images whose brightest pixel is 1.
  void put(std::vector<BeamImage>& images) const {
    const float brightest = *std::max_element(best_.begin(), best_.end());
    each_pixel([&](std::size_t k, std::size_t at, int row, int column) {
      images[k].share[place(images[k], row, column)] = brightest > 0 ? best_[at] / brightest : 0;
    });
  }

  struct Extremes {
    double least = kNone, most = 0;  ///< of the part, and outside
  };
  Extremes look_at(const Array<float>& light) const {
    Array<float> dose(projector_.shape().field());
    adjoint(projector_, silent(context_), light, dose);
    Extremes e;
    for (std::size_t i = 0; i < dose.size(); ++i) {
      if (target_.kinds[i] == Kind::gel) e.least = std::min<double>(e.least, dose[i]);
      if (target_.kinds[i] == Kind::empty) e.most = std::max<double>(e.most, dose[i]);
    }
    return e;
  }
  /// Makes the least dose of the part 1, and no pixel brighter than is of use; returns the contrast.
  double scale(Array<float>& light) const {
    const Extremes before = look_at(light);
    if (!(before.least > 0)) return 0;
    for (std::size_t i = 0; i < light.size(); ++i) {
      light[i] = std::min(static_cast<float>(light[i] / before.least), enough_[i]);
    }
    const Extremes after = look_at(light);
    return after.most > 0 ? after.least / after.most : kNone;
  }

  /// The rung that was missed, nothing when all were reached.
  std::optional<double> climb(const std::vector<double>& rungs, int proof_steps) {
    LadderOptions options;
    options.steps = setup_.steps;
    options.most_dose = kMostDose;
    options.rungs = rungs;
    options.proof_steps = proof_steps;
    std::optional<double> missed;
    options.checkpoint = [&](const SolverPlace& place) {
      context_.report("solving", 1 - std::max(place.rung, 0.0));
      if (!place.missed.empty()) missed = place.rung;
    };
    FoundLight found = ladder(silent(context_), projector_, target_, best_, options);
    bound_ = std::min(bound_, found.contrast_bound);
    const double contrast = scale(found.light);
    if (contrast > best_contrast_) {
      best_contrast_ = contrast;
      best_ = std::move(found.light);
    }
    return missed;
  }

  /// Which cells outside the least sum of squares can't spare, on a rung that is out of reach.
  void prove(GreyImages& found) {
    const float rung = 0.9F;
    Array<float> light = best_, dose(projector_.shape().field());
    solve_block(projector_, 0, detail::BlockCells(target_, 0),
                {.rung = rung, .most_dose = kNone, .cap = kNone}, 2 * kProofSteps, 5, false,
                context_, light.data(), dose.data());
    const std::vector<double> proven =
        contrast_bounds(silent(context_), projector_, target_, dose, rung, {0});
    bound_ = std::min(bound_, proven.front());
    std::vector<std::pair<float, std::array<int, 3>>> weights;
    float most = 0;
    each_cell([&](int x, int y, int z, std::uint8_t v) {
      const float weight = dose[projector_.cell(x, y, z)] - rung;
      if (v != 0 || !(weight > 0)) return;
      most = std::max(most, weight);
      weights.push_back({weight, {of(0, x), of(1, y), of(2, z)}});
    });
    std::sort(weights.begin(), weights.end(), [](const auto& a, const auto& b) {
      return a.first > b.first || (a.first == b.first && a.second < b.second);
    });
    for (const auto& [weight, cell] : weights) {
      if (weight < kWeighs * most) break;
      found.in_the_way.push_back(cell);
    }
  }

  const Box<std::uint8_t>& part_;
  const BeamSetup& setup_;
  const ExecutionContext& context_;
  const DecidingCells cells_;
  const BeamProjector projector_;
  const CellKinds target_;
  const Array<float> enough_;
  Array<float> best_;
  double best_contrast_ = 0;
  double bound_ = kNone;
};

}  // namespace

GreyImages grey_images(const Box<std::uint8_t>& part, const BeamSetup& setup,
                       std::vector<BeamImage> start, const ExecutionContext& context) {
  return Grey(part, setup, context).find(std::move(start));
}

double bytes_of_grey(const Box<std::uint8_t>& part, const BeamSetup& setup) {
  const Shape shape = BeamProjector(part, DecidingCells(part, setup), setup).shape();
  // Doses of the solver and its proof, with limits and kinds; light with the pairs of its memory.
  return 49.0 * static_cast<double>(shape.field()) + 72.0 * static_cast<double>(shape.light());
}

}  // namespace slicecorr::tomo::detail
