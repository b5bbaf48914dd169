// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "bands/robust_edges.hpp"

namespace slicecorr::detail {

namespace {

/// Places of an edge: so many to either side of the design's, so far from each other, in slices.
constexpr int kPlaces = 12;
constexpr double kApart = 0.25;
/// What counts: a feature or gap that fails with inputs as said, and in a case; else the squares of how
/// far edges are moved.
constexpr double kFailsAsSaid = 1e6, kFailsInACase = 1e3;
/// By how much doses of the cases are to pass 1: levels place edges to a part of a slice only.
constexpr double kPass = 2e-3;

/// Doses of both cases at an edge, where that with inputs as said is 1.
struct Doses {
  double weak = 0, strong = 0;
};

/// The best way from the last edge to one place of an edge.
struct Way {
  double cost = std::numeric_limits<double>::infinity();
  Doses doses;
  int before = -1;  ///< place of the edge below
};

/// The dose after so many slices of a light.
double after(double dose, double phi, double per_slice, double slices) {
  return phi + (dose - phi) * std::exp(-per_slice * slices);
}

/// A stretch from the place `from` to `to`, nearer to the platform: in the light `first` down to `turn`,
/// in `second` from there.
struct Part {
  double from, turn, to;
  bool lit_first;
  double at(const EdgeCases::Light& light, double dose, double place) const {
    const double first = lit_first ? light.full : light.black,
                 second = lit_first ? light.black : light.full;
    if (place >= turn) return after(dose, first, light.per_slice, from - place);
    return after(after(dose, first, light.per_slice, from - turn), second, light.per_slice,
                 turn - place);
  }
  /// The nodes beside where it turns, of layers between two nodes; nothing: none lies in the stretch.
  std::optional<std::pair<int, int>> nodes(int top, int bottom) const {
    const int low = std::max(top, static_cast<int>(std::ceil(to))),
              high = std::min(bottom, static_cast<int>(std::floor(from)));
    if (low > high) return std::nullopt;
    return std::pair{std::clamp(static_cast<int>(std::floor(turn)), low, high),
                     std::clamp(static_cast<int>(std::ceil(turn)), low, high)};
  }
};

class EdgePlan {
 public:
  EdgePlan(const EdgeCases& cases, const MovedEdges& column) : cases_(cases), column_(column) {}

  std::vector<double> run() {
    const std::size_t edges = column_.size();
    if (edges < 2 || !alternates()) return {};
    ways_.assign(edges, std::vector<Way>(2 * kPlaces + 1));
    begin();
    for (std::size_t k = edges - 1; k-- > 1;) {
      for (int i = 0; i < places(k); ++i) reach(k, i);
    }
    int best = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < places(1); ++i) {
      const double cost = ways_[1][index(i)].cost + first_layers(i);
      if (cost < least) {
        least = cost;
        best = i;
      }
    }
    if (best < 0) return {};
    std::vector<double> shifts(edges, 0.0);
    for (std::size_t k = 1; k < edges; ++k) {
      shifts[k] = shift(k, best);
      best = ways_[k][index(best)].before;
    }
    return shifts;
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  int places(std::size_t k) const { return column_[k].movable ? 2 * kPlaces + 1 : 1; }
  double shift(std::size_t k, int i) const {
    return column_[k].movable ? (i - kPlaces) * kApart : 0.0;
  }
  double place(std::size_t k, int i) const { return column_[k].place() + shift(k, i); }
  bool alternates() const {
    for (std::size_t k = 0; k < column_.size(); ++k) {
      if (cover_kind(column_[k].below) == CoverKind::grey) return false;
      if (k > 0 && column_[k].below == column_[k - 1].below) return false;
    }
    return column_.back().below == 0;
  }
  /// The lower edge of the last feature: all before it is dark.
  void begin() {
    const std::size_t k = column_.size() - 1;
    const EdgeCases::Light& said = cases_.said;
    const double burst = std::log(said.full / (said.full - 1)) / said.per_slice;
    for (int i = 0; i < places(k); ++i) {
      if (place(k, i) + burst > cases_.slices) continue;
      Way& way = ways_[k][index(i)];
      way.cost = shift(k, i) * shift(k, i);
      way.doses = {after(0, cases_.weak.full, cases_.weak.per_slice, burst),
                   after(0, cases_.strong.full, cases_.strong.per_slice, burst)};
    }
  }
  /// What lies between edge k and the next one further from the platform.
  Part stretch(std::size_t k, double from, double to) const {
    const EdgeCases::Light& l = cases_.said;
    const double grown = std::exp(l.per_slice * (from - to)), range = l.full - l.black;
    // Both turn where the dose comes to 1 at `to`.
    const bool feature = column_[k].below == 255;
    const double first = feature ? ((l.full - 1) + (1 - l.black) * grown) / range
                                 : ((l.full - 1) * grown + (1 - l.black)) / range;
    const double slices = std::clamp(std::log(first) / l.per_slice, 0.0, from - to);
    return {from, from - slices, to, feature};
  }
  /// What it costs that what lies between edge k and the one below fails; doses of `from` become those at
  /// the other end.
  double cost_of(std::size_t k, const Part& s, Doses& doses) const {
    const int top = column_[k].node, bottom = column_[k + 1].node;
    const auto at = s.nodes(top, bottom);
    double cost = kFailsAsSaid;
    if (at) {
      const auto dose = [&](const EdgeCases::Light& light, double from, int node) {
        return s.at(light, from, node);
      };
      const bool feature = column_[k].below == 255;
      const bool holds = feature
                             ? std::max(dose(cases_.weak, doses.weak, at->first),
                                        dose(cases_.weak, doses.weak, at->second)) >= 1 + kPass
                             : std::min(dose(cases_.strong, doses.strong, at->first),
                                        dose(cases_.strong, doses.strong, at->second)) < 1 - kPass;
      cost = holds ? 0 : kFailsInACase;
    }
    doses = {s.at(cases_.weak, doses.weak, s.to), s.at(cases_.strong, doses.strong, s.to)};
    return cost;
  }
  void reach(std::size_t k, int i) {
    Way& way = ways_[k][index(i)];
    const double to = place(k, i), moved = shift(k, i) * shift(k, i);
    for (int j = 0; j < places(k + 1); ++j) {
      const Way& before = ways_[k + 1][index(j)];
      const double from = place(k + 1, j);
      if (!(before.cost + moved < way.cost) || from < to + 1) continue;
      Doses doses = before.doses;
      const double cost = before.cost + moved + cost_of(k, stretch(k, from, to), doses);
      if (cost < way.cost) way = {cost, doses, j};
    }
  }
  /// The layers beside the platform: lit all through, or dark.
  double first_layers(int i) const {
    if (column_[0].below != 255) return 0;
    Doses doses = ways_[1][index(i)].doses;
    const double from = place(1, i);
    return cost_of(0, {from, 0, 0, true}, doses);
  }

  const EdgeCases& cases_;
  const MovedEdges& column_;
  std::vector<std::vector<Way>> ways_;  ///< by edge and place
};

}  // namespace

std::vector<double> plan_edges(const EdgeCases& cases, const MovedEdges& column) {
  return EdgePlan(cases, column).run();
}

}  // namespace slicecorr::detail
