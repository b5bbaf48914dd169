#include "correct/inhibited_column.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "correct/band_solvers.hpp"
#include "cure/inhibited_layer.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

struct InhibitedColumn::Impl {
  explicit Impl(const InhibitedPlan& p)
      : plan(p),
        node_light(p.node_light),
        middle_light(p.middle_light),
        near_dose(count()),
        near_middle(count()),
        far(count() + 1),
        far_middle(count() + 1),
        demand(count() + 1, 0.0),
        kind(count(), 0),
        levels(count()),
        best(count()),
        old(count()),
        layer(*p.kernel) {
    for (int i = 0; i < samples; ++i) {
      fade[i] = std::pow(p.kernel->a(), static_cast<double>(i + 1) / samples - 1.0);
    }
  }
  static constexpr int samples = InhibitedKernel::samples;

  /// Covered layers that follow each other: nodes upper .. lower have demands.
  struct Body {
    int upper = 0, lower = 0;
    bool platform = false;
    bool full = true;  ///< all of its demands are 1
    int lag = 1;
  };
  /// A run's edge: a node, and whether the gap is on its far side (towards the platform).
  struct Edge {
    int node;
    bool upper;
    std::size_t body;
  };

  std::size_t count() const { return static_cast<std::size_t>(plan.all_layers) + 1; }
  double ratio(int n) const {
    return plan.ratio.empty() ? 1.0 : plan.ratio[static_cast<std::size_t>(n)];
  }
  int cap(int n) const { return plan.caps[static_cast<std::size_t>(setting(n))]; }
  int setting(int n) const { return plan.uniform ? 0 : plan.kernel->setting_of_slice(n); }

  void read(const std::vector<CoverageRun>& runs);
  bool greedy(bool with_old);
  double promised(int n, int level, int k, int from) const;
  int least_level(int n, int k, double need, int from, double extra) const;
  void add(int n, int level);
  void change(int n, int from, int to);
  double node(int k) const {
    const auto i = static_cast<std::size_t>(k);
    return plan.dark_node[i] + near_dose[i] + far_at(far, k);
  }
  double middle(int k) const {
    const auto i = static_cast<std::size_t>(k);
    return plan.dark_middle[i] + near_middle[i] + far_at(far_middle, k);
  }
  /// Dose at node k from the slices at least `near` layers away: F(k + near) a.
  double far_at(const std::vector<double>& f, int k) const {
    const auto at = static_cast<std::size_t>(k + plan.near);
    return at < f.size() ? plan.kernel->a() * f[at] : 0.0;
  }
  /// Dose at node k of the slices after n, as chosen so far.
  double so_far(int k, int n) const {
    const auto i = static_cast<std::size_t>(k);
    if (n - k < plan.near) return node(k);
    // All of them lie further away than the tables reach.
    const int next = n + 1;
    return plan.dark_node[i] + far[static_cast<std::size_t>(next)] *
                                   std::pow(plan.kernel->a(), next - k - plan.near + 1);
  }
  /// Where a feature comes apart: the layer in which its dose is least between two printed pieces.
  struct Dip {
    int layer;
    double least;
  };
  double edge_error_um(const Edge& e) const;
  double score(bool* perfect, double most);
  void look_through();
  void look_inside(int k);
  bool demand_more(double times, bool edges_too);
  double least_sampled(int k) const;
  void polish();
  double local_cost(int low, int high) const;
  void rebuild();

  const InhibitedPlan& plan;
  const ExtraLight &node_light, &middle_light;
  std::vector<double> near_dose, near_middle;  ///< per node and layer, from slices nearer than near
  std::vector<double> far, far_middle;         ///< F(n) = D(l_n, near - 1) + a F(n + 1)
  std::vector<double> demand;                  ///< per node; 0: none
  std::vector<std::uint8_t> kind;              ///< per layer: coverage
  std::vector<Body> bodies;
  std::vector<Edge> edges;
  std::vector<std::uint8_t> levels, best, old;
  /// Light at the samples of each layer from slices nearer than near; kept while `fine` is set.
  std::vector<float> near_fine;
  bool fine = false;
  double dip_weight = 0;
  double fade[samples];  ///< of what is far away, from a layer's upper end to its samples
  InhibitedLayer layer;
  InsideLayer inside;
  std::vector<Dip> dips, best_dips;
  int last = 0;  ///< highest node with a demand
};

void InhibitedColumn::Impl::read(const std::vector<CoverageRun>& runs) {
  std::fill(demand.begin(), demand.end(), 0.0);
  std::fill(kind.begin(), kind.end(), std::uint8_t{0});
  bodies.clear();
  edges.clear();
  for (std::size_t r = 0; r < runs.size(); ++r) {
    for (int n = runs[r].first; n < runs[r].end; ++n) {
      kind[static_cast<std::size_t>(n)] = runs[r].coverage;
    }
  }
  const auto at = [&](int n) -> int {
    return n >= 0 && n < plan.layers ? kind[static_cast<std::size_t>(n)] : 0;
  };
  if (plan.merge_one_slice_gaps) {
    for (int n = 1; n + 1 < plan.layers; ++n) {
      if (at(n) == 0 && at(n - 1) == 255 && at(n + 1) == 255) {
        kind[static_cast<std::size_t>(n)] = 255;
      }
    }
  }
  // What each node demands; see goal_at() for the same without UV.
  for (std::size_t r = 0; r < runs.size(); ++r) {
    for (int k = runs[r].first; k <= runs[r].end; ++k) {
      const int above = k > 0 ? at(k - 1) : 0, below = at(k);
      double d = 0;
      if (above == 255 && below == 255) {
        // Between nodes the dose may dip by a little; edges get just what they need.
        d = plan.inside;
      } else if (above == 255 || below == 255) {
        d = 1.0;
      } else if (above != 0 && below != 0) {
        d = std::min(above, below) / 255.0;
      } else if (above != 0) {
        // The last grey layer: its middle lies about half way between its two nodes.
        const bool under_full = k > 1 && at(k - 2) == 255;
        d = under_full ? std::max(0.0, 2.0 * above / 255.0 - 1.0) : above / 255.0;
      }
      demand[static_cast<std::size_t>(k)] = std::max(demand[static_cast<std::size_t>(k)], d);
    }
  }
  const int nodes = plan.layers + 1;
  for (int k = 0; k < nodes; ++k) {
    if (demand[static_cast<std::size_t>(k)] <= 0) continue;
    Body body;
    body.upper = k;
    // A gap of one layer has demands on both of its nodes, with a layer of nothing between.
    body.full = demand[static_cast<std::size_t>(k)] >= 1.0;
    while (k + 1 < nodes && demand[static_cast<std::size_t>(k) + 1] > 0 && at(k) != 0) {
      ++k;
      body.full = body.full && demand[static_cast<std::size_t>(k)] >= 1.0;
    }
    body.lower = k;
    body.platform = body.upper == 0;
    body.lag = plan.lags.front();
    bodies.push_back(body);
  }
  if (!plan.merge_one_slice_gaps) {
    for (int n = 1; n + 1 < plan.layers; ++n) {
      if (at(n) != 0 || at(n - 1) != 255 || at(n + 1) != 255) continue;
      // The lower edge of the feature above gives way; its last layer prints in its middle still.
      demand[static_cast<std::size_t>(n)] = 0.98;
      double& next = demand[static_cast<std::size_t>(n) - 1];
      next = std::max(next, 1.03);
    }
  }
  for (int n = 0; n <= plan.layers; ++n) {
    const int above = n > 0 ? at(n - 1) : -1, below = at(n);
    if (above == 0 && below == 255) edges.push_back({n, true, 0});
    if (above == 255 && below == 0) edges.push_back({n, false, 0});
  }
  for (Edge& e : edges) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      if (e.node >= bodies[b].upper && e.node <= bodies[b].lower) e.body = b;
    }
  }
  last = bodies.empty() ? 0 : bodies.back().lower;
}

/// Dose at node k from slices n and those in [from, n) at `level`.
double InhibitedColumn::Impl::promised(int n, int level, int k, int from) const {
  if (plan.uniform) {
    const int start = std::min(std::max(from, k), n);
    return node_light.sum(0, level, n - k + 1) - node_light.sum(0, level, start - k);
  }
  double sum = 0;
  for (int i = std::min(std::max(from, k), n); i <= n; ++i) {
    sum += ratio(i) * node_light.one(setting(i), level, i - k);
  }
  return sum;
}

/// Least level with promised() >= need; the cap when there is none.
int InhibitedColumn::Impl::least_level(int n, int k, double need, int from, double extra) const {
  int low = 0, high = cap(n);
  while (low < high) {
    const int level = (low + high) / 2;
    if (promised(n, level, k, from) + extra >= need) {
      high = level;
    } else {
      low = level + 1;
    }
  }
  return low;
}

void InhibitedColumn::Impl::change(int n, int from, int to) {
  const int s = setting(n);
  const double r = ratio(n);
  const int end = std::min(plan.near, n + 1);
  for (int j = 0; j < end; ++j) {
    const auto k = static_cast<std::size_t>(n - j);
    const double* node_row = node_light.row(s, j);
    const double* middle_row = middle_light.row(s, j);
    near_dose[k] += r * (node_row[to] - node_row[from]);
    near_middle[k] += r * (middle_row[to] - middle_row[from]);
  }
  if (!fine) return;
  const float* const table = plan.kernel->fine(s);
  for (int j = 0; j < end; ++j) {
    const float* const more = table + static_cast<std::size_t>(j * plan.levels + to) * samples;
    const float* const less = table + static_cast<std::size_t>(j * plan.levels + from) * samples;
    float* const out = &near_fine[static_cast<std::size_t>(n - j) * samples];
    for (int i = 0; i < samples; ++i) out[i] += static_cast<float>(r) * (more[i] - less[i]);
  }
}

void InhibitedColumn::Impl::add(int n, int level) {
  const auto i = static_cast<std::size_t>(n);
  const double r = ratio(n), a = plan.kernel->a();
  far[i] = a * far[i + 1];
  far_middle[i] = a * far_middle[i + 1];
  levels[i] = static_cast<std::uint8_t>(level);
  if (level == 0) return;
  const int s = setting(n);
  far[i] += r * node_light.row(s, plan.near - 1)[level];
  far_middle[i] += r * middle_light.row(s, plan.near - 1)[level];
  change(n, 0, level);
}

/// Chooses all levels. `with_old`: light of other bodies is expected as it was chosen before.
bool InhibitedColumn::Impl::greedy(bool with_old) {
  std::fill(near_dose.begin(), near_dose.end(), 0.0);
  std::fill(near_middle.begin(), near_middle.end(), 0.0);
  std::fill(far.begin(), far.end(), 0.0);
  std::fill(far_middle.begin(), far_middle.end(), 0.0);
  std::fill(levels.begin(), levels.end(), std::uint8_t{0});
  bool other_light = false;
  int first_body = static_cast<int>(bodies.size()) - 1;
  int before = 0, same = 0, deep_until = plan.all_layers;
  for (int n = plan.all_layers; n-- > 0;) {
    int level = 0;
    // Nothing changes any more until the upper edge comes near. A level that is too dim by itself
    // may stand for long on the light of a burst, and must be looked at all the same.
    if (deep_until < n && same > 2 * plan.near && before >= plan.holding) {
      add(n, before);
      continue;
    }
    // Bodies that can ask for light of this slice: their nodes lie above it, within reach.
    while (first_body >= 0 && bodies[static_cast<std::size_t>(first_body)].upper > n) --first_body;
    bool deep = false;
    deep_until = plan.all_layers;
    for (int b = first_body; b >= 0; --b) {
      const Body& body = bodies[static_cast<std::size_t>(b)];
      const int reach = plan.reach + body.lag + 2;
      if (body.lower < n - reach) break;
      const int own = body.platform ? 0 : body.upper + body.lag;  // slices of its own end here
      const int begin = std::max(body.upper, n - reach), end = std::min(body.lower, n);
      if (body.full && n > own + plan.near && n + plan.near < body.lower) {
        deep = true;
        if (plan.uniform && level == 0) deep_until = own + plan.near;
      }
      for (int k = end; k >= begin; --k) {
        const double wanted = demand[static_cast<std::size_t>(k)];
        if (wanted <= 0) continue;
        const int from = body.platform ? k : std::max(k, own);
        double expected = 0;
        if (with_old && from > k) {
          for (int i = k; i < std::min(from, n); ++i) {
            const int l = old[static_cast<std::size_t>(i)];
            if (l) expected += ratio(i) * node_light.one(setting(i), l, i - k);
          }
          other_light = other_light || expected > 0;
        }
        const double need = wanted + kMargin - so_far(k, n) - expected;
        if (need <= 0) continue;
        if (n - k <= body.lag) {
          if (promised(n, level, k, from) >= need) continue;
          level = std::max(level, least_level(n, k, need, from, 0.0));
        } else {
          // What can still come: full light down to the lag, the steady level after it.
          double can = 0;
          if (plan.uniform) {
            can = node_light.sum(0, cap(n), n - k) -
                  node_light.sum(0, cap(n), std::min(n, std::max(from, k + body.lag)) - k);
            if (from < k + body.lag) {
              can += node_light.sum(0, plan.steady, body.lag) -
                     node_light.sum(0, plan.steady, from - k);
            }
          } else {
            for (int i = from; i < n; ++i) {
              const int l = i >= k + body.lag ? cap(i) : std::min(plan.steady, cap(i));
              can += ratio(i) * node_light.one(setting(i), l, i - k);
            }
          }
          if (can >= need) continue;
          const int alone = least_level(n, k, need - can, n, 0.0);
          level = std::max(level, alone);
        }
        if (level >= cap(n)) break;
      }
    }
    // Deep inside a body the level that is there may stay: levels that go to and fro by a few do
    // nothing but fill the archive.
    if (deep && before > 0 && level < before && level >= before - 3) level = before;
    same = level == before ? same + 1 : 1;
    before = level;
    add(n, level);
  }
  return other_light;
}

/// Distance of the printed edge from the designed one, um, positive into the gap; by straight lines
/// between nodes and middles.
double InhibitedColumn::Impl::edge_error_um(const Edge& e) const {
  const int end = 2 * plan.all_layers;
  // Half layers: 2k is node k, 2k + 1 the middle of layer k.
  const auto dose = [&](int h) {
    return h % 2 ? middle(h / 2) : h / 2 < plan.all_layers ? node(h / 2) : 0.0;
  };
  const int start = 2 * e.node;
  const bool printed = dose(start) >= 1.0;
  // Printed at the edge: follow it into the gap; else look for print inside the run.
  const int step = printed == e.upper ? -1 : 1;
  double value = dose(start);
  for (int h = start + step; h >= 0 && h <= end; h += step) {
    const double next = dose(h);
    if ((next >= 1.0) != printed) {
      const double t = (1.0 - value) / (next - value);
      const double um = (std::abs(h - step - start) + t) * 0.5 * plan.layer_um;
      return printed ? um : -um;
    }
    // Past the gap or the run.
    const int layer = (h + (step > 0 ? 0 : -1)) / 2;
    if (h % 2 == 0 && layer >= 0 && layer < plan.layers) {
      const bool full = kind[static_cast<std::size_t>(layer)] != 0;
      if (full == printed) break;
    }
    value = next;
    if (std::abs(h - start) > 200) break;
  }
  return printed ? 1000.0 : -1000.0;
}

/// How far a column is from its design, um, and whether its edges and voxels are right; infinite as
/// soon as it is beyond `most`. `dips` are those of levels within it.
double InhibitedColumn::Impl::score(bool* perfect, double most) {
  double sum = 0;
  *perfect = true;
  dips.clear();
  for (const Edge& e : edges) {
    const double um = std::abs(edge_error_um(e));
    if (um > plan.tolerance_um) *perfect = false;
    sum += std::min(um, 2 * plan.layer_um);
  }
  const int end = std::min(plan.layers + plan.reach, plan.all_layers);
  for (int n = 0; n < end; ++n) {
    const int c = n < plan.layers ? kind[static_cast<std::size_t>(n)] : 0;
    if (c != 0 && c != 255) continue;
    if ((middle(n) >= 1.0) == (c == 255)) continue;
    *perfect = false;
    // A feature that is lost is worse than one that grew.
    sum += (c == 255 ? 4 : 2) * plan.layer_um;
  }
  if (sum >= most) return std::numeric_limits<double>::infinity();
  look_through();
  for (const Dip& dip : dips) {
    // Pieces are worse than any edge; a crack is worse the deeper it is.
    sum += (16 + std::min(4.0, 100.0 * (1.0 - dip.least))) * plan.layer_um;
  }
  return sum;
}

/// The dose inside layer k of a feature.
void InhibitedColumn::Impl::look_inside(int k) {
  const double above = node(k), half = middle(k);
  const bool steps = plan.kernel->layer_by_layer();
  const double below = node(k + 1);
  inside.crossings.clear();
  inside.least = std::min({below, half, above});
  if (!steps && SmoothBounds(below, half, above).low >= 1.0) return;
  const double a = plan.kernel->a();
  const int end = std::min(k + plan.near, plan.all_layers);
  const double beyond = (plan.dark_far[static_cast<std::size_t>(k)] + far_at(far, k)) / a;
  const std::uint8_t level = levels[static_cast<std::size_t>(k)];
  bool same = plan.uniform && inside.least >= 1.0 && end == k + plan.near;
  for (int n = k + 1; n < end && same; ++n) same = levels[static_cast<std::size_t>(n)] == level;
  if (same && layer.steady_above(0, level, 1.0, beyond, 0.0)) return;
  layer.begin(beyond);
  for (int n = k; n < end; ++n) {
    layer.add(n - k, setting(n), levels[static_cast<std::size_t>(n)], ratio(n));
  }
  // Its own slice adds nothing at the window, unless it cures there.
  const double own =
      steps ? ratio(k) * plan.kernel->exact(setting(k), levels[static_cast<std::size_t>(k)], 0.0)
            : 0.0;
  layer.sample(below + own, half, above);
  layer.find(0.0, inside);
}

/// Finds the dips of all features; see Prediction::split_features.
void InhibitedColumn::Impl::look_through() {
  dips.clear();
  const auto full = [&](int n) { return n >= 0 && kind[static_cast<std::size_t>(n)] == 255; };
  for (int n = plan.layers; n-- > 0;) {
    if (!full(n)) continue;
    bool any = false, printed = false;
    Dip dip{n, 1.0};
    const auto turn = [&](bool prints) {
      if (prints == printed) return;
      printed = prints;
      if (!prints) return;
      if (any && dip.least < 1.0 - Prediction::same_dose) dips.push_back(dip);
      any = true;
      dip.least = 1.0;
    };
    for (; full(n); --n) {
      look_inside(n);
      bool prints = (node(n) >= 1.0) == (inside.crossings.size() % 2 == 0);
      turn(prints);
      for (std::size_t i = 0; i <= inside.crossings.size(); ++i) {
        if (inside.least < dip.least && (i == 0 || !printed)) dip = {n, inside.least};
        if (i == inside.crossings.size()) break;
        prints = !prints;
        turn(prints);
      }
    }
  }
}

/// Has the nodes around the dips of the best levels demand `times` as much more as is missing
/// there; false if none of them can. `edges_too`: where that does not help an edge gives way.
bool InhibitedColumn::Impl::demand_more(double times, bool edges_too) {
  const auto full = [&](int n) { return n >= 0 && kind[static_cast<std::size_t>(n)] == 255; };
  bool any = false;
  for (const Dip& dip : best_dips) {
    for (const int k : {dip.layer, dip.layer + 1}) {
      const bool edge = !full(k) || (k > 0 && !full(k - 1));
      if (edge && !edges_too) continue;
      demand[static_cast<std::size_t>(k)] += times * ((1.0 - dip.least) + 1e-3);
      any = true;
    }
  }
  return any;
}

/// The least of the samples of layer k; only while `fine` is set.
double InhibitedColumn::Impl::least_sampled(int k) const {
  const auto at = static_cast<std::size_t>(k) * samples;
  const auto beyond = static_cast<float>(far_at(far, k));
  float least = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < samples; ++i) {
    const float dose =
        plan.dark_fine[at + i] + near_fine[at + i] + beyond * static_cast<float>(fade[i]);
    least = std::min(least, dose);
  }
  return static_cast<double>(least);
}

/// Squares of what is wrong at nodes and middles of the layers [low, high).
double InhibitedColumn::Impl::local_cost(int low, int high) const {
  double cost = 0;
  for (const Edge& e : edges) {
    if (e.node < low || e.node >= high) continue;
    const double d = node(e.node) - 1.0;
    cost += 10.0 * d * d;
  }
  for (int n = std::max(low, 0); n < std::min(high, plan.all_layers); ++n) {
    const int c = n < plan.layers ? kind[static_cast<std::size_t>(n)] : 0;
    const double m = middle(n);
    if (c == 255) {
      const double dips = fine ? std::max(0.0, 1.003 - least_sampled(n)) : 0.0;
      cost += dip_weight * dips * dips;
      const double lacks = std::max(0.0, 1.004 - m), far_over = std::max(0.0, m - 1.15);
      cost += 400.0 * lacks * lacks + 0.02 * far_over * far_over;
    } else if (c == 0) {
      const double over = std::max(0.0, m - 0.99);
      cost += 100.0 * over * over;
    }
  }
  return cost;
}

void InhibitedColumn::Impl::rebuild() {
  std::fill(near_dose.begin(), near_dose.end(), 0.0);
  std::fill(near_middle.begin(), near_middle.end(), 0.0);
  std::fill(far.begin(), far.end(), 0.0);
  std::fill(far_middle.begin(), far_middle.end(), 0.0);
  if (fine) near_fine.assign(count() * samples, 0.0F);
  for (int n = plan.all_layers; n-- > 0;) add(n, levels[static_cast<std::size_t>(n)]);
}

/// Descends on the squares of what is wrong, one or two slices at a time. For the columns that the
/// rule leaves with wrong voxels: features and gaps thinner than the light can draw.
void InhibitedColumn::Impl::polish() {
  static constexpr int kSteps[] = {1, -1, 3, -3, 8, -8, 20, -20, 60, -60};
  static constexpr int kPairs[][2] = {{4, -4}, {-4, 4}, {15, -15}, {-15, 15}, {50, -50}, {-50, 50}};
  const int end = std::min(last + plan.reach + plan.lags.front() + 3, plan.all_layers);
  for (int sweep = 0; sweep < 6; ++sweep) {
    bool moved = false;
    for (int n = end; n-- > 0;) {
      // Light of this slice counts most within the tables; what is further off is taken as it is.
      const int low = n - plan.near + 1, high = n + 1;
      const int l0 = levels[static_cast<std::size_t>(n)];
      const double before = local_cost(low, high);
      if (before < 1e-5) continue;
      double least = before - 1e-9;
      int l_best = l0, p_best = -1;
      const auto try_level = [&](int l) {
        if (l < 0 || l > cap(n) || l == l0) return;
        change(n, l0, l);
        const double cost = local_cost(low, high);
        change(n, l, l0);
        if (cost < least) {
          least = cost;
          l_best = l;
          p_best = -1;
        }
      };
      for (const int step : kSteps) try_level(l0 + step);
      try_level(0);
      if (n > 0) {
        const int p0 = levels[static_cast<std::size_t>(n) - 1];
        for (const auto& pair : kPairs) {
          const int l = l0 + pair[0], p = p0 + pair[1];
          if (l < 0 || l > cap(n) || p < 0 || p > cap(n - 1)) continue;
          change(n, l0, l);
          change(n - 1, p0, p);
          const double cost = local_cost(low, high);
          change(n - 1, p, p0);
          change(n, l, l0);
          if (cost < least) {
            least = cost;
            l_best = l;
            p_best = p;
          }
        }
      }
      if (l_best == l0 && p_best < 0) continue;
      moved = true;
      change(n, l0, l_best);
      levels[static_cast<std::size_t>(n)] = static_cast<std::uint8_t>(l_best);
      if (p_best >= 0) {
        change(n - 1, levels[static_cast<std::size_t>(n) - 1], p_best);
        levels[static_cast<std::size_t>(n) - 1] = static_cast<std::uint8_t>(p_best);
      }
    }
    rebuild();
    if (!moved) break;
  }
}

InhibitedColumn::InhibitedColumn(const InhibitedPlan& plan) : impl_(std::make_unique<Impl>(plan)) {}
InhibitedColumn::~InhibitedColumn() = default;

const std::vector<std::uint8_t>& InhibitedColumn::solve(const std::vector<CoverageRun>& runs) {
  Impl& s = *impl_;
  s.read(runs);
  double least = std::numeric_limits<double>::infinity();
  bool perfect = false;
  const auto keep_if_better = [&](bool* is_perfect) {
    const double score = s.score(is_perfect, least);
    if (score >= least) return false;
    least = score;
    s.best = s.levels;
    s.best_dips = s.dips;
    return true;
  };
  const auto attempt = [&](bool* is_perfect) {
    s.greedy(false);
    s.old = s.levels;
    // Bodies that light each other: once more, knowing what the others will show.
    if (s.bodies.size() > 1 && s.greedy(true)) {
      bool second = false;
      const bool better = keep_if_better(&second);
      s.old = s.levels;
      s.greedy(true);
      const bool third = keep_if_better(is_perfect);
      *is_perfect = third ? *is_perfect : better && second;
      return third || better;
    }
    return keep_if_better(is_perfect);
  };
  std::vector<int> lags(s.bodies.size(), 0);
  for (const int lag : s.plan.lags) {
    for (Impl::Body& b : s.bodies) b.lag = lag;
    bool is_perfect = false;
    if (attempt(&is_perfect)) {
      perfect = is_perfect;
      for (std::size_t b = 0; b < lags.size(); ++b) lags[b] = lag;
    }
    if (perfect) break;
  }
  // Each body its own lag.
  if (!perfect && s.bodies.size() > 1 && s.bodies.size() <= 64) {
    for (std::size_t b = s.bodies.size(); b-- > 0 && !perfect;) {
      for (const int lag : s.plan.lags) {
        if (lag == lags[b]) continue;
        for (std::size_t i = 0; i < lags.size(); ++i) s.bodies[i].lag = i == b ? lag : lags[i];
        bool is_perfect = false;
        if (attempt(&is_perfect)) {
          lags[b] = lag;
          perfect = is_perfect;
        }
      }
    }
  }
  // Features that come apart.
  constexpr int kRounds = 10, kEdgesKept = 3;
  for (int round = 0; round < kRounds && !s.best_dips.empty(); ++round) {
    // Where levels are few, the next one is far: ever more of it.
    if (!s.demand_more(1.0 + round, round >= kEdgesKept) && round >= kEdgesKept) break;
    for (std::size_t b = 0; b < lags.size(); ++b) s.bodies[b].lag = lags[b];
    bool is_perfect = false;
    if (attempt(&is_perfect)) perfect = is_perfect;
  }
  perfect = perfect && s.best_dips.empty();
  s.fine = !s.plan.dark_fine.empty();
  for (const double weight : {4e3, 1e6}) {
    if (perfect) break;
    s.dip_weight = weight;
    s.levels = s.best;
    s.rebuild();
    s.polish();
    bool is_perfect = false;
    keep_if_better(&is_perfect);
    // Again only where cracks are in the way; light without the samples has none to weigh.
    if (!s.fine || s.dips.empty()) break;
  }
  s.fine = false;
  return s.best;
}

}  // namespace slicecorr::detail
