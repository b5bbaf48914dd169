// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/ladder.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "tomo/projection/block_solver.hpp"
#include "tomo/projection/certificate.hpp"
#include "tomo/projection/packed.hpp"

namespace slicecorr::tomo {
namespace detail {
namespace {

using slicecorr::detail::silent;

constexpr double kNone = std::numeric_limits<double>::infinity();
/// Slices that a proof goes on with: those with the least bounds.
constexpr std::size_t kProven = 7;
constexpr int kFirstProof = 40;
/// A proof goes on while its bound falls by this share.
constexpr double kFalls = 0.01;
/// What a proof's rung times the contrast found is at most. Nearer to 1 little is left of the loss,
/// and what rays lack weighs more than that; farther away the bound is of another problem.
constexpr double kBeyond = 0.9;
/// The same once more, farther away, where the bound is this many times the contrast found: little was left.
constexpr double kFartherBeyond = 0.7, kWide = 1.5;

/// The share of its loss that the second half of a slice's steps has to take away.
constexpr double kWorthGoingOn = 0.3;
/// A loss that rounding leaves: doses wrong by 1e-7 in some 10,000 voxels.
constexpr double kRounding = 1e-9;
/// And one that is none, whether or not it can still fall: a dose wrong by 1e-6.
constexpr double kNothing = 1e-12;

/// What is known of a slice on a rung.
struct Climb {
  int steps = 0;
  double loss = kNone;
  bool stuck = false;  ///< the loss can't fall
  /// Nothing is left of the loss, or what single precision can't tell from that.
  bool reached() const { return loss < kNothing || (stuck && loss < kRounding); }
  std::vector<SliceStep> history;
  /// Going on is worth it: the second half of the steps took this share of the loss away.
  bool falls(double share) const {
    const std::size_t n = history.size();
    return !stuck && n >= 2 && loss < (1 - share) * history[n / 2].loss;
  }
};

class Ladder {
 public:
  Ladder(const ExecutionContext& context, const Projector& projector, const CellKinds& cells,
         Array<float> start, const LadderOptions& options)
      : context_(context),
        projector_(projector),
        shape_(projector.shape()),
        cells_(cells),
        options_(options),
        gel_(problems_with_gel(shape_, cells)),
        light_(std::move(start)),
        dose_(shape_.field()),
        now_(static_cast<std::size_t>(shape_.problems())),
        kept_(now_.size(), -1.0) {
    found_.light.resize(shape_.light());
    found_.dose.resize(shape_.field());
  }

  FoundLight run() {
    std::vector<int> missed;
    if (options_.resume != nullptr) {
      go_on(*options_.resume);
      missed = options_.resume->missed;
    } else {
      adjoint(projector_, context_, light_, dose_);
      if (options_.scale_start) {
        scale_start();
      } else {
        look();
        keep(1, true);
      }
    }
    for (std::size_t r = 0; r < options_.rungs.size(); ++r) {
      const double rung = options_.rungs[r];
      if (options_.resume != nullptr && rung > options_.resume->rung) continue;
      if (missed.empty()) {
        missed = climb(penalty_of(rung));
        keep(rung, missed.empty());
        const double next = r + 1 < options_.rungs.size() ? options_.rungs[r + 1] : 0;
        tell_place(missed.empty() ? next : rung, missed);
      }
      if (missed.empty()) continue;
      prove(rung, missed);
      break;
    }
    finish();
    return std::move(found_);
  }

 private:
  void tell_place(double rung, const std::vector<int>& missed) {
    if (!options_.checkpoint) return;
    std::vector<double> of_slices = kept_;
    for (const SliceStep& s : now_) {
      of_slices.insert(of_slices.end(), {s.loss, s.min_gel, s.max_void, s.max_dose, s.void_gelled});
    }
    options_.checkpoint({.numbers = light_,
                         .dose = dose_,
                         .of_slices = std::move(of_slices),
                         .missed = missed,
                         .rung = rung,
                         .best = found_});
  }
  void go_on(const SolverState& from) {
    const std::size_t n = now_.size();
    if (from.of_slices.size() != 6 * n)
      throw InputError("solver", "resume", "is of another solver");
    light_ = from.numbers;
    dose_ = from.dose;
    found_ = from.best;
    kept_.assign(from.of_slices.begin(), from.of_slices.begin() + static_cast<std::ptrdiff_t>(n));
    for (std::size_t z = 0; z < n; ++z) {
      const double* const s = &from.of_slices[n + 5 * z];
      now_[z] = {};
      now_[z].loss = s[0];
      now_[z].min_gel = s[1];
      now_[z].max_void = s[2];
      now_[z].max_dose = s[3];
      now_[z].void_gelled = s[4];
    }
  }

  Penalty penalty_of(double rung) const {
    return {.rung = rung,
            .most_dose = options_.most_dose,
            .cap = options_.cap > 0 ? options_.cap : kNone};
  }

  /// One scale for each slice: they share nothing but the rung.
  void scale_start() {
    const Penalty penalty = penalty_of(options_.rungs.front());
    const ExecutionContext inside = inside_block(context_, shape_.blocks());
    parallel_for(context_, "start", shape_.blocks(), [&](std::size_t b) {
      const std::vector<double> factors =
          best_scales(shape_, BlockCells(cells_, b * shape_.field_of_block),
                      dose_.data() + b * shape_.field_of_block, penalty, inside);
      scale_block(b, {factors.begin(), factors.end()}, light_);
    });
  }
  /// Light and dose of a block, lane by lane.
  void scale_block(std::size_t block, const std::vector<float>& factors, Array<float>& light) {
    const auto scale = [&](float* numbers, std::size_t count) {
      for (std::size_t i = 0; i < count; ++i) numbers[i] *= factors[i % factors.size()];
    };
    scale(light.data() + block * shape_.light_of_block, shape_.light_of_block);
    scale(dose_.data() + block * shape_.field_of_block, shape_.field_of_block);
  }

  /// Extremes of the dose of each slice.
  void look() {
    const auto lanes = static_cast<std::size_t>(shape_.problem_lanes());
    std::fill(now_.begin(), now_.end(), SliceStep{});
    for (std::size_t i = 0; i < cells_.kinds.size(); ++i) {
      const double d = dose_[i];
      const bool banded = cells_.banded();
      if (!banded && cells_.kinds[i] == Kind::neither) continue;
      SliceStep& s = now_[i / shape_.field_of_block * lanes + i % lanes];
      s.max_dose = std::max(s.max_dose, d);
      if (banded) {
        if (cells_.least[i] > 0) s.min_gel = std::min(s.min_gel, d / cells_.least[i]);
        s.max_void = std::max(s.max_void, d / cells_.most[i]);
        continue;
      }
      if (cells_.kinds[i] == Kind::gel) {
        s.min_gel = std::min(s.min_gel, d);
      } else {
        s.max_void = std::max(s.max_void, d);
      }
    }
  }

  /// Keeps what was found: all slices of a rung that was reached; of one that was missed those that
  /// had less contrast than the part can have.
  void keep(double rung, bool reached) {
    // With a cap, light that the weakest voxel wants more of is none to keep in place of another.
    const auto gained = [&](int z) {
      const bool short_of = options_.cap > 0 && kept_[z] >= 0 && now_[z].min_gel < 1;
      return !reached && short_of ? -1.0 : now_[z].contrast();
    };
    double least_before = kNone, most_now = kNone;
    for (const int z : gel_) {
      least_before = std::min(least_before, kept_[z]);
      most_now = std::min(most_now, std::max(kept_[z], gained(z)));
    }
    // Where bands can't be kept to, their least error is what is wanted.
    const bool least_error = cells_.banded() && !reached && !any_reached_;
    any_reached_ = any_reached_ || (reached && rung < 1);
    if (!reached && !least_error && !(most_now > least_before)) return;
    std::vector<int> taken;
    for (const int z : gel_) {
      if (!reached && !least_error && kept_[z] >= most_now) continue;
      kept_[z] = now_[z].contrast();
      taken.push_back(z);
    }
    if (reached) {
      found_.light = light_;
    } else {
      for (const int z : taken) copy_slice(light_, z, found_.light);
    }
    found_.rung = rung;
  }
  void copy_slice(const Array<float>& from, int slice, Array<float>& to) const {
    const auto lanes = static_cast<std::size_t>(shape_.problem_lanes()),
               z = static_cast<std::size_t>(slice);
    const std::size_t per_block = from.size() / shape_.blocks();
    const std::size_t end = (z / lanes + 1) * per_block;
    for (std::size_t i = z / lanes * per_block + z % lanes; i < end; i += lanes) to[i] = from[i];
  }

  /// What a run made of a slice.
  void add_run(Climb& c, int slice, const BlockRun& run, const std::vector<SliceStep>& steps) {
    c.stuck = static_cast<int>(steps.size()) <= run.steps || run.steps == 0;
    c.steps += run.steps;
    c.history.insert(c.history.end(), steps.begin() + (c.history.empty() ? 0 : 1), steps.end());
    // Doses computed afresh may lack nothing where sums over steps did.
    c.history.back() = steps.back();
    c.loss = steps.back().loss;
    now_[slice] = steps.back();
  }

  /// Runs slices, in blocks of their own, up to as many steps in all as `most` on this rung.
  void descend(const Penalty& penalty, int most, std::vector<Climb>& climbs,
               const std::vector<int>& slices, std::string_view stage) {
    for (;;) {
      std::vector<int> active;
      for (const int z : slices) {
        const Climb& c = climbs[z];
        if (!c.reached() && !c.stuck && c.steps < most) active.push_back(z);
      }
      if (active.empty()) return;
      if (shape_.coupled) {
        const BlockRun run =
            solve_block(projector_, 0, BlockCells(cells_, 0), penalty, most - climbs[0].steps,
                        options_.memory, false, context_, light_.data(), dose_.data());
        add_run(climbs[0], 0, run, run.slices[0]);
        continue;
      }
      const PackedSlices packed(projector_, active);
      const ExecutionContext inside = inside_block(context_, packed.blocks());
      parallel_for(silent(context_), stage, packed.blocks(), [&](std::size_t b) {
        const std::vector<int> lanes = packed.of_block(b);
        int left = most;
        for (const int z : lanes) left = std::min(left, most - climbs[z].steps);
        Array<float> light = packed.take(b, light_), dose = packed.take(b, dose_);
        const CellKinds what = take_cells(packed, b, cells_);
        const BlockRun run =
            solve_block(packed.projector(), b, BlockCells(what, 0), penalty, left, options_.memory,
                        active.size() > 1, inside, light.data(), dose.data());
        packed.put_back(b, light, light_);
        packed.put_back(b, dose, dose_);
        for (std::size_t l = 0; l < lanes.size(); ++l) {
          add_run(climbs[lanes[l]], lanes[l], run, run.slices[l]);
        }
      });
    }
  }

  double least_kept() const {
    double least = kNone;
    for (const int z : gel_) least = std::min(least, kept_[z]);
    return least;
  }

  /// The slices that miss the rung. Goes on, twice as long each time, while their losses fall; one
  /// that does not is enough. More contrast is worth half of the steps that any is.
  std::vector<int> climb(const Penalty& penalty) {
    const int first = options_.steps == 0 ? 60 : options_.steps;
    const int most =
        std::max(first, least_kept() >= 1 ? options_.most_steps / 2 : options_.most_steps);
    std::vector<Climb> climbs(now_.size());
    std::vector<int> left = gel_;
    for (int steps = first;; steps = std::min(2 * steps, most)) {
      descend(penalty, steps, climbs, left, "solving");
      std::erase_if(left, [&](int z) { return climbs[z].reached(); });
      const bool over = std::any_of(left.begin(), left.end(),
                                    [&](int z) { return !climbs[z].falls(kWorthGoingOn); });
      if (left.empty() || steps == most || over) break;
    }
    add_history(climbs, penalty.rung);
    return left;
  }

  /// The steps of all slices as steps of the part; a slice that was done early stays as it was.
  void add_history(const std::vector<Climb>& climbs, double rung) {
    std::size_t most = 0;
    for (const Climb& c : climbs) most = std::max(most, c.history.size());
    for (std::size_t k = 0; k < most; ++k) {
      Step step{.rung = rung, .step = static_cast<int>(k)};
      double min_gel = kNone, max_void = 0, max_dose = 0, gelled = 0;
      for (const int z : gel_) {
        const auto& history = climbs[z].history;
        const SliceStep& s = history.empty() ? now_[z] : history[std::min(k, history.size() - 1)];
        step.loss += s.loss;
        min_gel = std::min(min_gel, s.min_gel);
        max_void = std::max(max_void, s.max_void);
        max_dose = std::max(max_dose, s.max_dose);
        gelled += s.void_gelled;
      }
      step.ver = std::min(1.0, gelled / static_cast<double>(cells_.gel + cells_.empty));
      // Of bands both are shares of what is wanted.
      if (cells_.banded()) max_dose = std::max(min_gel, max_void);
      step.pw = max_dose > 0 ? (min_gel - max_void) / max_dose : 0;
      step.contrast = max_void > 0 ? min_gel / max_void : kNone;
      found_.history.push_back(step);
    }
  }

  /// Takes the least of bounds that a dose proves; sorts their slices, the least first.
  void take_bounds(const std::vector<double>& bounds, const Array<float>& dose,
                   std::vector<int>& slices, double& least_of) {
    std::stable_sort(slices.begin(), slices.end(),
                     [&](int a, int b) { return bounds[a] < bounds[b]; });
    const int least = slices.front();
    if (bounds[least] >= least_of) return;
    least_of = bounds[least];
    found_.bound_slice = shape_.coupled ? hardest_slice(shape_, cells_, dose) : least;
  }

  /// The proof wants the minimum of the first two terms alone, without bounds on the light, of the
  /// slices that limit the part, on a rung that is out of reach. Where a prover proves the bound, which
  /// takes longer, it does so once, of the dose that promises most.
  void prove(double missed, const std::vector<int>& slices) {
    if (options_.proof_steps == 0) return;
    const double contrast = least_kept();
    const auto rung = [&](double beyond) {
      return contrast > 0 ? std::min(missed, beyond / contrast) : missed;
    };
    prove_on(rung(kBeyond), slices);
    if (rung(kFartherBeyond) < rung(kBeyond) && found_.contrast_bound > kWide * contrast) {
      prove_on(rung(kFartherBeyond), slices);
    }
  }
  void prove_on(double rung, std::vector<int> slices) {
    double promised = kNone;
    double& least = options_.prover == nullptr ? found_.contrast_bound : promised;
    Array<float> promising;
    const auto look = [&] {
      const double before = least;
      take_bounds(contrast_bounds(silent(context_), projector_, cells_, dose_, rung, slices), dose_,
                  slices, least);
      if (options_.prover != nullptr && (least < before || promising.empty())) promising = dose_;
    };
    look();
    slices.resize(std::min(slices.size(), kProven));
    std::vector<int> hardest = slices;
    const Penalty penalty{.rung = rung, .most_dose = kNone, .cap = kNone};
    std::vector<Climb> climbs(now_.size());
    for (int steps = kFirstProof;; steps *= 2) {
      steps = std::min(steps, options_.proof_steps);
      descend(penalty, steps, climbs, slices, "proving");
      std::erase_if(slices, [&](int z) { return climbs[z].reached(); });
      if (slices.empty()) break;
      const double before = least;
      look();
      if (steps == options_.proof_steps) break;
      if (steps > kFirstProof && least > before * (1 - kFalls)) break;
    }
    if (options_.prover != nullptr) {
      take_bounds(proven_bounds(silent(context_), projector_, *options_.prover, cells_, promising,
                                rung, hardest),
                  promising, hardest, found_.contrast_bound);
    }
    add_history(climbs, rung);
  }

  /// Each slice's weakest gel voxel gets 1; in bands doses are as far from the least as from the most. Doses are computed once more, of the whole part.
  void finish() {
    adjoint(projector_, silent(context_), found_.light, dose_);
    look();
    const auto lanes = static_cast<std::size_t>(shape_.problem_lanes());
    for (std::size_t b = 0; b < shape_.blocks(); ++b) {
      std::vector<float> factors(lanes, 1);
      for (int l = 0; l < shape_.problems_of(b); ++l) {
        const SliceStep& now = now_[b * lanes + static_cast<std::size_t>(l)];
        const double least = !cells_.banded()      ? now.min_gel
                             : now.contrast() >= 1 ? std::sqrt(now.min_gel * now.max_void)
                                                   : 1;
        if (least > 0 && least < kNone) factors[l] = static_cast<float>(1 / least);
      }
      scale_block(b, factors, found_.light);
    }
    found_.dose = std::move(dose_);
  }

  const ExecutionContext& context_;
  const Projector& projector_;
  const Shape shape_;
  const CellKinds& cells_;
  const LadderOptions& options_;
  FoundLight found_;
  std::vector<int> gel_;
  Array<float> light_, dose_;
  std::vector<SliceStep> now_;  ///< per slice, of `dose_`
  std::vector<double> kept_;    ///< per slice, the contrast that the solution has
  bool any_reached_ = false;    ///< a rung
};

}  // namespace
}  // namespace detail

FoundLight ladder(const ExecutionContext& context, const Projector& projector,
                  const CellKinds& cells, Array<float> start, const LadderOptions& options) {
  return detail::Ladder(context, projector, cells, std::move(start), options).run();
}

}  // namespace slicecorr::tomo
