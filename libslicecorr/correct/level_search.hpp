/// Levels that print edges where they belong; docs/levels.md explains the method.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "correct/edges.hpp"

namespace slicecorr::detail {

/// Where a column's walk from the last slice to the first has come to: the run that the slice lies
/// in, and what lies below it.
struct RunAt {
  std::int32_t edge = 0;    ///< its upper end, in Edges; its coverage is that edge's `below`
  std::int32_t node = 0;    ///< the same as a node
  std::int32_t lower = 0;   ///< node of its lower end
  std::uint8_t below = 0;   ///< coverage there
  bool slit_below = false;  ///< what lies there is a gap of one slice between full layers
};

/// The run above, with `node` as its lower end.
RunAt run_above(const Edges& edges, const RunAt& run);

/// Levels of one column after the other, by index of ContinuousPlan::levels. Not thread-safe.
class LevelSearch {
 public:
  explicit LevelSearch(const Edges& edges);

  /// Most slices that are chosen at once.
  static constexpr int kMost = 64;
  /// Writes the levels of slice n and of those after it (n - 1, ...) that were chosen with it;
  /// returns how many. `below`: Omega(n + 1) as delivered.
  int choose(const RunAt& run, int n, double below, std::uint8_t* levels);
  /// The light of slice n where any can be shown.
  double exact(const RunAt& run, int n, double below) const;

 private:
  /// A slice of those that are chosen together.
  struct Step {
    std::int32_t edge;
    int j;  ///< nodes below that edge
    std::uint8_t coverage;
    bool upper, lower, slit_below, slit;
    LayerRule rule;
    DoseRange target;  ///< of its upper node
  };
  struct Light {
    double least, most;
  };
  struct LevelRange {
    int first, last;
    bool empty() const { return first > last; }
  };
  struct Survivor {
    double dose;
    std::int32_t before;
    std::uint8_t level;
  };

  Light light(const LayerRule& rule, double below, DoseRange target) const;
  LevelRange levels(const LayerRule& rule, double below, DoseRange target) const;
  LayerRule rule_of(const RunAt& run, int n, int rung) const;
  int one_slice(const RunAt& run, int n, double below) const;
  double grey_aim(const RunAt& run, int n, double below) const;
  /// The slices to choose together from n on; 0: slice n is chosen alone.
  int gather(const RunAt& run, int n);
  /// Rules and targets for edges within `tolerance`; false: no light does.
  bool aim(double tolerance);
  bool depth_first(double below, std::uint8_t* levels);
  bool survivors(double below, std::uint8_t* levels);

  const Edges& edges_;
  const ContinuousPlan& plan_;
  std::array<Step, kMost> steps_;
  int count_ = 0;
  int first_edge_ = 0;  ///< slices up to the first edge
  bool cut_ = false;
  std::vector<Survivor> kept_;
  std::vector<std::int32_t> begin_;
};

}  // namespace slicecorr::detail
