#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "base/band_tape.hpp"
#include "base/kernels.hpp"
#include "correct/band_solvers.hpp"
#include "correct/node_goal.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace detail {
namespace {

/// The intensity that makes Omega(n) = `dose` from `below`.
double intensity_for(const CureModel& model, double dose, double below) {
  return (dose - model.a * below) / model.one_minus_a;
}

/// The grey level for a goal. Levels that reach `least` beat `aim`.
int choose_level(const CorrectionPlan& plan, const Goal& goal, double below) {
  if (goal.aim == kNoDemand && goal.least == kNoDemand) return 0;
  const LevelTable& levels = plan.levels;
  const CureModel& model = plan.model;
  // Most voxels of a part are exposed fully or not at all.
  if (goal.aim >= model.step(model.phi_max(), below)) return levels.highest();
  const double darkest = model.step(model.phi_min(), below);
  if (goal.aim <= darkest && darkest >= goal.least) return 0;
  const double phi_least = intensity_for(model, goal.least, below);
  const double phi_aim = intensity_for(model, goal.aim, below);
  int level = levels.at_most(phi_aim);
  if (goal.nearest && level + 1 < levels.size()) {
    const int next = levels.at_least(phi_aim);
    if (levels.phi(next) - phi_aim < phi_aim - levels.phi(level)) level = next;
  }
  if (levels.phi(level) < phi_least) level = levels.at_least(phi_least);
  // Solving for phi and stepping forward round differently: the dose delivered is what counts.
  while (level + 1 < levels.size() && model.step(levels.phi(level), below) < goal.least) {
    level = levels.at_least(std::nextafter(levels.phi(level), 1e308));
  }
  if (goal.gap && level > 0 && model.middle(levels.phi(level), below) >= 1.0) {
    const double open = (1.0 - model.root_a * below) / (1.0 - model.root_a);
    level = levels.at_most(std::nextafter(open, -1.0));
    while (level > 0 && model.middle(levels.phi(level), below) >= 1.0) --level;
  }
  if (goal.top && level > 0 && model.step(levels.phi(level), below) > plan.open_fall(0)) {
    const int lower = levels.at_most(intensity_for(model, plan.open_fall(0), below));
    if (model.middle(levels.phi(lower), below) >= 1.0) level = lower;
  }
  return level;
}

/// One step of black light for a block.
SLICECORR_CLONES
void darken(double* omega, double a, double dark) {
  for (std::size_t i = 0; i < kBlock; ++i) omega[i] = dark + a * omega[i];
}

}  // namespace
}  // namespace detail

using detail::Around;
using detail::Demand;
using detail::kBlock;

namespace {

/// Continuous exposure without UV light.
class ContinuousSolver final : public detail::BandSolver {
 public:
  ContinuousSolver(const CorrectionPlan& p, std::size_t n)
      : plan(p),
        columns(n),
        tape(n),
        demand(n),
        block_last((n + kBlock - 1) / kBlock, Demand::kNone),
        before(n),
        before2(n),
        empty(n) {}

  void add_layer(const std::uint8_t* coverage) override;
  void solve(const BandCorrector::Sink& sink) override;

 private:
  /// A demand that a node replaced, to be put back when the solve has passed the node.
  struct Change {
    std::uint32_t column;
    Demand was;
  };

  void forward(int node, const std::uint8_t* above2, const std::uint8_t* above,
               const std::uint8_t* below);
  void undo(int node);
  void update_block(std::size_t block) {
    std::int32_t last = Demand::kNone;
    const std::size_t end = std::min((block + 1) * kBlock, columns);
    for (std::size_t i = block * kBlock; i < end; ++i) last = std::max(last, demand[i].node);
    block_last[block] = last;
  }

  const CorrectionPlan& plan;
  std::size_t columns;
  detail::BandTape tape;                 ///< coverage of the layers
  std::vector<Demand> demand;            ///< per column, as of the last node
  std::vector<std::int32_t> block_last;  ///< per block of columns: its last demanding node
  std::vector<std::uint8_t> before, before2, empty;
  std::vector<Change> changes;
  std::vector<std::size_t> changes_end;  ///< per node
};

void ContinuousSolver::forward(int node, const std::uint8_t* above2, const std::uint8_t* above,
                               const std::uint8_t* below) {
  for (std::size_t b = 0; b < columns; b += kBlock) {
    const std::size_t end = std::min(b + kBlock, columns);
    // In the middle of a feature or a gap nothing changes: most blocks of most layers.
    if (node > 0 && std::memcmp(above + b, below + b, end - b) == 0) {
      std::uint8_t grey = 0;
      for (std::size_t i = b; i < end; ++i) {
        grey |= static_cast<std::uint8_t>(below[i] != 0 && below[i] != detail::kFull);
      }
      if (!grey) continue;
    }
    for (std::size_t i = b; i < end; ++i) {
      const Around c{0, above2[i], above[i], below[i], 0};
      const Demand next = detail::next_demand(plan, node, c, demand[i]);
      if (next == demand[i]) continue;
      changes.push_back({static_cast<std::uint32_t>(i), demand[i]});
      demand[i] = next;
    }
  }
  changes_end.push_back(changes.size());
}

void ContinuousSolver::undo(int node) {
  const auto n = static_cast<std::size_t>(node);
  const std::size_t begin = n ? changes_end[n - 1] : 0;
  for (std::size_t i = changes_end[n]; i-- > begin;) demand[changes[i].column] = changes[i].was;
  // Changes lie in rising order of columns, so those of a block follow each other.
  std::size_t done = columns;
  for (std::size_t i = begin; i < changes_end[n]; ++i) {
    const std::size_t block = changes[i].column / kBlock;
    if (block != done) update_block(block);
    done = block;
  }
}

void ContinuousSolver::add_layer(const std::uint8_t* coverage) {
  ContinuousSolver& s = *this;
  const int n = s.tape.slices();
  if (n >= s.plan.layers) throw Error("more layers than the plan has");
  const std::uint8_t* rows = coverage ? coverage : s.empty.data();
  s.tape.append(coverage);
  s.forward(n, s.before2.data(), s.before.data(), rows);
  std::swap(s.before2, s.before);
  std::memcpy(s.before.data(), rows, s.columns);
}

void ContinuousSolver::solve(const BandCorrector::Sink& sink) {
  ContinuousSolver& s = *this;
  const CorrectionPlan& plan = s.plan;
  const CureModel& model = plan.model;
  const int layers = plan.layers;
  if (s.tape.slices() != layers) throw Error("the plan has more layers");
  // The node under the last layer has demands too; later ones only fade.
  s.forward(layers, s.before2.data(), s.before.data(), s.empty.data());

  const std::size_t columns = s.columns;
  for (std::size_t b = 0; b < s.block_last.size(); ++b) s.update_block(b);
  std::vector<double> omega(columns, 0.0);
  std::vector<std::uint8_t> out(columns);
  // Coverage of the layers n + 1, n, n - 1, n - 2 and n - 3, moving up with the solve.
  std::vector<std::uint8_t> below2(columns), below(columns), above(columns), above2(columns),
      above3(columns);
  s.tape.read(plan.all_layers - 1, below.data());
  s.tape.read(plan.all_layers - 2, above.data());
  s.tape.read(plan.all_layers - 3, above2.data());
  const double dark = model.phi_min() * model.one_minus_a;
  const double bright = model.phi_max() * model.one_minus_a;
  const double edge = 1.0 + detail::kMargin;
  const auto highest = static_cast<std::uint8_t>(plan.levels.highest());
  const int reach = static_cast<int>(plan.reach.size());
  std::vector<double> falling(plan.fall.size());
  std::transform(plan.fall.begin(), plan.fall.end(), falling.begin(),
                 [&](double f) { return std::min(f, plan.omega_max); });
  const double* const capped_fall = falling.data();
  for (int n = plan.all_layers; n-- > 0;) {
    s.tape.read(n - 3, above3.data());
    bool all_dark = true;
    for (std::size_t b = 0; b < columns; b += kBlock) {
      const std::size_t end = std::min(b + kBlock, columns);
      const bool black = s.block_last[b / kBlock] + reach <= n &&
                         detail::all_zero(below.data() + b, end - b) &&
                         detail::all_zero(above.data() + b, end - b);
      if (black) {
        if (end - b == kBlock) {
          detail::darken(&omega[b], model.a, dark);
        } else {
          for (std::size_t i = b; i < end; ++i) omega[i] = dark + model.a * omega[i];
        }
        std::memset(out.data() + b, 0, end - b);
        continue;
      }
      all_dark = false;
      for (std::size_t i = b; i < end; ++i) {
        const double w = omega[i];
        const Demand demand = s.demand[i];
        // The two commonest cases of goal_at(), decided without it.
        if (below[i] == 0 && above[i] != detail::kFull && demand.node + reach <= n &&
            (above[i] == 0 || demand.node != n)) {
          out[i] = 0;
          omega[i] = dark + model.a * w;
          continue;
        }
        if (below[i] == detail::kFull && above[i] != 0 && w >= edge) {
          const double aim =
              demand.node == 0 ? plan.platform_omega_max : capped_fall[n - demand.node];
          const double brightest = bright + model.a * w;
          if (aim >= brightest) {
            out[i] = highest;
            omega[i] = brightest;
            continue;
          }
          const double darkest = dark + model.a * w;
          if (aim <= darkest && darkest >= edge) {
            out[i] = 0;
            omega[i] = darkest;
            continue;
          }
        }
        const Around c{above3[i], above2[i], above[i], below[i], below2[i]};
        const detail::Goal goal = detail::goal_at(plan, n, c, demand, w, edge);
        const int level = detail::choose_level(plan, goal, w);
        out[i] = static_cast<std::uint8_t>(level);
        omega[i] = model.step(plan.levels.phi(level), w);
      }
    }
    sink(n, out.data(), below.data(), all_dark);
    if (n <= layers) s.undo(n);
    below2.swap(below);
    below.swap(above);
    above.swap(above2);
    above2.swap(above3);
  }
}

/// Walks one column from the last slice to the first: `choose(goal, below)` gives the intensity.
template <typename Choose>
void walk_column(const CorrectionPlan& plan, const std::vector<std::uint8_t>& coverage, double edge,
                 Choose choose) {
  const auto at = [&](int layer) {
    const bool inside = layer >= 0 && layer < plan.layers;
    return inside ? coverage[static_cast<std::size_t>(layer)] : std::uint8_t{0};
  };
  const auto around = [&](int n) {
    return Around{at(n - 3), at(n - 2), at(n - 1), at(n), at(n + 1)};
  };
  std::vector<Demand> demands;
  Demand demand;
  for (int n = 0; n < plan.all_layers; ++n) {
    demand = detail::next_demand(plan, n, around(n), demand);
    demands.push_back(demand);
  }
  double omega = 0;
  for (int n = plan.all_layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    const double phi =
        choose(k, detail::goal_at(plan, n, around(n), demands[k], omega, edge), omega);
    omega = plan.model.step(phi, omega);
  }
}

std::unique_ptr<detail::BandSolver> make_solver(const CorrectionPlan& plan, std::size_t columns) {
  if (plan.model.inhibited) return detail::make_inhibited_solver(plan, columns);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::make_layerwise_solver(plan, columns);
  }
  return std::make_unique<ContinuousSolver>(plan, columns);
}

}  // namespace

struct BandCorrector::Impl {
  std::unique_ptr<detail::BandSolver> solver;
};

BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns)
    : impl_(std::make_unique<Impl>(make_solver(plan, columns))) {}
BandCorrector::~BandCorrector() = default;
BandCorrector::BandCorrector(BandCorrector&&) noexcept = default;
void BandCorrector::add_layer(const std::uint8_t* coverage) { impl_->solver->add_layer(coverage); }
void BandCorrector::solve(const Sink& sink) { impl_->solver->solve(sink); }

std::vector<std::uint8_t> solve_column(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage) {
  if (plan.model.inhibited) return detail::solve_inhibited_column(plan, coverage);
  if (!plan.model.is_plain()) return detail::solve_layerwise_column(plan, coverage);
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  walk_column(plan, coverage, 1.0 + detail::kMargin,
              [&](std::size_t n, const detail::Goal& goal, double below) {
                const int level = detail::choose_level(plan, goal, below);
                levels[n] = static_cast<std::uint8_t>(level);
                return plan.levels.phi(level);
              });
  return levels;
}

std::vector<double> solve_column_exactly(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage) {
  if (plan.model.inhibited) return detail::solve_inhibited_column_exactly(plan, coverage);
  if (!plan.model.is_plain()) return detail::solve_layerwise_column_exactly(plan, coverage);
  std::vector<double> phi(static_cast<std::size_t>(plan.all_layers));
  walk_column(plan, coverage, 1.0, [&](std::size_t n, const detail::Goal& goal, double below) {
    phi[n] = std::clamp(detail::intensity_for(plan.model, std::max(goal.aim, goal.least), below),
                        plan.model.phi_min(), plan.model.phi_max());
    return phi[n];
  });
  return phi;
}

}  // namespace slicecorr
