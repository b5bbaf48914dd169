// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/trial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <numeric>
#include <optional>
#include <set>
#include <tuple>

#include "bands/correct_group.hpp"
#include "bands/place_plans.hpp"
#include "bands/uv_of_slices.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"

namespace slicecorr::detail {

namespace {

/// Rounding of doses and of edges, far below what anybody measures.
constexpr double kSameContrast = 1e-9, kSameUm = 1e-6;
/// Columns that are corrected together.
constexpr std::size_t kBlock = 512;

/// Size, scale and frame of a target without its voxels.
class Outline final : public SliceSource {
 public:
  explicit Outline(const SliceSource& target) : target_(target) {}
  const Grid& grid() const override { return target_.grid(); }
  ImageFrame frame() const override { return target_.frame(); }
  PixelBox bounds() const override { return {}; }
  void read_band(const PixelBox&, const Sink&) const override {}
  bool ends_below_last_node() const override { return target_.ends_below_last_node(); }

 private:
  const SliceSource& target_;
};

bool before(const PlanPlace& a, const PlanPlace& b) {
  return std::tie(a.y, a.x, a.first) < std::tie(b.y, b.x, b.first);
}

/// What is found of columns, whatever their order.
struct Findings {
  double worst_um = -1, least_contrast = 2;
  PlanPlace worst_at, contrast_at, lost_at, split_at;
  double sum_um = 0;  ///< over pixels
  std::uint64_t edges = 0, lost = 0, split = 0, narrow = 0, off = 0;

  void edge(double um, PlanPlace at, std::uint64_t pixels) {
    const double size = std::abs(um);
    sum_um += size * static_cast<double>(pixels);
    edges += pixels;
    if (size > worst_um || (size == worst_um && before(at, worst_at))) {
      worst_um = size;
      worst_at = at;
    }
  }
  void gap(double contrast, PlanPlace at) {
    if (contrast < least_contrast || (contrast == least_contrast && before(at, contrast_at))) {
      least_contrast = contrast;
      contrast_at = at;
    }
  }
  static void count(std::uint64_t& counter, PlanPlace& first, PlanPlace at) {
    if (counter++ == 0 || before(at, first)) first = at;
  }
  void merge(const Findings& o) {
    if (o.worst_um > worst_um || (o.worst_um == worst_um && before(o.worst_at, worst_at))) {
      worst_um = o.worst_um;
      worst_at = o.worst_at;
    }
    if (o.contrast_at.x >= 0) gap(o.least_contrast, o.contrast_at);
    if (o.lost > 0 && (lost == 0 || before(o.lost_at, lost_at))) lost_at = o.lost_at;
    if (o.split > 0 && (split == 0 || before(o.split_at, split_at))) split_at = o.split_at;
    sum_um += o.sum_um;
    edges += o.edges;
    lost += o.lost;
    split += o.split;
    narrow += o.narrow;
    off += o.off;
  }
};

std::string place_in_words(const PlanPlace& p) {
  return fmt::format("at pixel {}, {}, {}", p.x, p.y,
                     p.first == p.last ? fmt::format("slice {}", p.first)
                                       : fmt::format("slices {} to {}", p.first, p.last));
}

}  // namespace

/// What a band's predictor tells, kept until the band is done: a gap's edges come before the gap.
class Trials::Block {
 public:
  Block(const Trials& trials, std::span<const std::uint32_t> which)
      : trials_(trials), which_(which) {}

  void listen(BandPredictor& predictor) {
    predictor.keep_no_histograms();
    predictor.tell_edges([this](std::size_t column, int node, bool upper, double um) {
      edges_.push_back({static_cast<std::uint32_t>(column), node, upper, um});
    });
    predictor.tell_gaps([this](std::size_t column, int first, int last, double least) {
      gaps_.push_back({static_cast<std::uint32_t>(column), first, last, least});
    });
    predictor.tell_runs([this](std::size_t column, int first, int last, bool lost, bool split) {
      if (lost || split) {
        runs_.push_back({static_cast<std::uint32_t>(column), first, last, lost});
      }
    });
  }

  /// `failing`, `places`: as in `TrialAsk`.
  Findings finish(std::vector<std::uint32_t>* failing, std::vector<PlanPlace>* places) const {
    const PlanAsk& ask = trials_.ask_;
    Findings f;
    std::vector<bool> fails(which_.size(), false);
    const auto fail = [&](std::uint32_t column, const PlanPlace& at) {
      fails[column] = true;
      if (places) places->push_back(at);
    };
    // Nodes whose edges can't be right: those of gaps that are left out.
    std::set<std::pair<std::uint32_t, int>> left_out;
    for (const Gap& g : gaps_) {
      if (g.last - g.first + 1 < trials_.least_gap_slices_) {
        left_out.insert({g.column, g.first});
        left_out.insert({g.column, g.last + 1});
        continue;
      }
      const double contrast = std::max(0.0, 1.0 - g.least);
      const PlanPlace at = place(g.column, g.first, g.last);
      f.gap(contrast, at);
      if (contrast >= ask.gap_contrast - kSameContrast) continue;
      ++f.narrow;
      fail(g.column, at);
    }
    for (const Edge& e : edges_) {
      if (left_out.contains({e.column, e.node})) continue;
      const int layer = e.upper ? e.node : e.node - 1;
      const PlanPlace at = place(e.column, layer, layer);
      f.edge(e.um, at, trials_.columns_.columns()[which_[e.column]].pixels);
      if (std::abs(e.um) <= ask.tolerance_um + kSameUm) continue;
      ++f.off;
      fail(e.column, at);
    }
    for (const Run& r : runs_) {
      // Beside a gap that is left out a feature may vanish; that one comes apart nobody left out.
      const bool beside =
          left_out.contains({r.column, r.first}) || left_out.contains({r.column, r.last + 1});
      if (r.lost && beside) continue;
      const PlanPlace at = place(r.column, r.first, r.last);
      r.lost ? Findings::count(f.lost, f.lost_at, at) : Findings::count(f.split, f.split_at, at);
      fail(r.column, at);
    }
    for (std::size_t i = 0; failing && i < fails.size(); ++i) {
      if (fails[i]) failing->push_back(which_[i]);
    }
    return f;
  }

 private:
  struct Edge {
    std::uint32_t column;
    int node;
    bool upper;
    double um;
  };
  struct Gap {
    std::uint32_t column;
    int first, last;
    double least;
  };
  struct Run {
    std::uint32_t column;
    int first, last;
    bool lost;
  };
  PlanPlace place(std::uint32_t column, int first, int last) const {
    const DesignColumns::Column& c = trials_.columns_.columns()[which_[column]];
    return {c.x, c.y, first, last};
  }

  const Trials& trials_;
  std::span<const std::uint32_t> which_;
  std::vector<Edge> edges_;
  std::vector<Gap> gaps_;
  std::vector<Run> runs_;
};

Trials::Trials(const SliceSource& target, const DesignColumns& columns, const PlanAsk& ask)
    : target_(target), columns_(columns), ask_(ask), least_gap_slices_(2) {
  // A gap of just the least height is planned for, whatever the rounding of heights.
  const double slices = ask.least_gap_um / target.grid().layer_um;
  if (ask.least_gap_um > 0) least_gap_slices_ = static_cast<int>(std::ceil(slices - 1e-9));
  least_gap_slices_ = std::max(1, least_gap_slices_);
}

std::string Trials::height_in_words(int slices) const {
  return fmt::format("{:g} um ({} slice{})", slices * target_.grid().layer_um, slices,
                     slices == 1 ? "" : "s");
}

bool keeps_within(const PlanPoint& p, double tolerance_um) {
  return p.prints && p.limited_by != "uv" && p.lost + p.split + p.narrow == 0 &&
         p.max_abs_um <= tolerance_um + kSameUm;
}

Setup as_machine_moves(Setup setup, const StageChange& stage) {
  if (stage.motion) {
    const double m = make_kinetics(setup.resin, setup.process.uv.kind != UvKind::off, true).m;
    take_ramp(*stage.motion, m, setup.resin.absorbance_height10_um, setup.process);
  }
  return setup;
}

namespace {

PlanPoint point_at(const Process& process) {
  PlanPoint point;
  const bool continuous = process.mode == ExposureMode::continuous;
  (continuous ? point.speed_mm_h : point.exposure_s) =
      continuous ? process.speed_mm_h : process.exposure_s;
  return point;
}

/// A point that does not print.
PlanPoint refused_at(const Process& process, const InfeasibleError& e) {
  PlanPoint point = point_at(process);
  point.why = e.what();
  const bool black = point.why.find("black") != std::string::npos;
  const bool travel = point.why.find("travels") != std::string::npos;
  point.limited_by = travel ? "travel" : black ? "black" : "light";
  return point;
}

}  // namespace

/// UV light of each slice, where it is to be chosen: by the brightest pixels of all columns, whichever of them are
/// looked at.
Process Trials::with_uv(const Setup& setup, const ExecutionContext& context) const {
  if (!chooses_uv_of_slices(setup.process)) return setup.process;
  const Outline outline(target_);
  const PlacePlans plans(outline, setup, context);
  const CorrectionPlan& plan = plans.plan();
  PlaceWindows all(plans.models(), plan.all_layers);
  std::vector<std::uint32_t> which(columns_.columns().size());
  std::iota(which.begin(), which.end(), 0U);
  const ExecutionContext quiet = silent(context);
  std::mutex merging;
  parallel_for(quiet, "", (which.size() + kBlock - 1) / kBlock, [&](std::size_t b) {
    const auto some = std::span<const std::uint32_t>(which).subspan(
        b * kBlock, std::min(kBlock, which.size() - b * kBlock));
    WindowWatch watch(plan.model, plan.all_layers, some.size());
    DesignGroup group;
    group.columns = some.size();
    group.made = columns_.reader(some);
    correct_group(plan, group, {.put = [](int, const std::uint8_t*) {}, .watch = &watch}, quiet);
    const std::lock_guard lock(merging);
    all.merge(plans.models().map().reference(), watch);
  });
  return with_uv_of_slices(setup, plans.models(), all.greatest_mw_cm2());
}

PlanPoint Trials::correct(const Setup& asked, std::span<const std::uint32_t> which,
                          const TrialAsk& ask, const ExecutionContext& context) const {
  Setup setup = as_machine_moves(asked, ask_.stage);
  if (!setup.printer.flat_field) {
    try {
      setup.process = with_uv(setup, context);
    } catch (const InfeasibleError& e) {
      return refused_at(setup.process, e);
    }
    return correct_evenly(setup, which, ask, context);
  }
  // Where light is uneven every column must keep what is asked for in the least and in the most light that
  // the part gets anywhere.
  const LightMap map(setup.printer, target_.grid(), target_.frame());
  const auto counts = map.counts(target_.bounds());
  int least = 1, most = 255;
  while (least < 255 && counts[static_cast<std::size_t>(least)] == 0) ++least;
  while (most > least && counts[static_cast<std::size_t>(most)] == 0) --most;
  Setup place = setup;
  place.printer.flat_field.reset();
  const auto at = [&](int value) {
    place.printer = dimmed(setup.printer, map.factor(static_cast<std::uint8_t>(value)));
    place.printer.flat_field.reset();
    return correct_evenly(place, which, ask, context);
  };
  PlanPoint dim = at(least);
  if (!dim.keeps || most == least) return dim;
  PlanPoint bright = at(most);
  if (!bright.keeps) return bright;
  if (dim.max_abs_um > bright.max_abs_um) std::swap(dim.max_abs_um, bright.max_abs_um);
  bright.contrast = std::min(dim.contrast, bright.contrast);
  bright.mean_abs_um = std::max(dim.mean_abs_um, bright.mean_abs_um);
  bright.extra_slices = std::max(dim.extra_slices, bright.extra_slices);
  bright.time_s = std::max(dim.time_s, bright.time_s);
  if (dim.dark_s && bright.dark_s) bright.dark_s = std::max(*dim.dark_s, *bright.dark_s);
  return bright;
}

PlanPoint Trials::correct_evenly(const Setup& setup, std::span<const std::uint32_t> which,
                                 const TrialAsk& ask, const ExecutionContext& context) const {
  PlanPoint point = point_at(setup.process);
  const Outline outline(target_);
  std::optional<PlacePlans> plans;
  try {
    plans.emplace(outline, setup, context);
    plans->plan();
  } catch (const InfeasibleError& e) {
    return refused_at(setup.process, e);
  }
  const CorrectionPlan& plan = plans->plan();
  const int slices = plan.all_layers;
  const int predicted = columns_.has_heights() ? std::max(slices, plan.layers + 1) : slices;
  const PixelCurve curve = pixel_curve(plan.model);
  const std::size_t blocks = (which.size() + kBlock - 1) / kBlock;
  const ExecutionContext quiet = silent(context);
  Findings all;
  std::vector<std::vector<std::uint32_t>> failing_of(blocks);
  std::vector<std::vector<PlanPlace>> places_of(blocks);
  std::vector<Findings> findings(blocks);
  std::optional<WindowTotal> window;
  if (plan.model.inhibited()) window.emplace(plan.model, slices);
  std::mutex merging;
  std::atomic<std::uint64_t> not_holding{0};
  parallel_for(quiet, "", blocks, [&](std::size_t b) {
    const auto some = which.subspan(b * kBlock, std::min(kBlock, which.size() - b * kBlock));
    BandPredictor predictor(plan.model, curve, predicted, some.size());
    if (columns_.has_heights()) predictor.aim_at_heights();
    Block block(*this, some);
    block.listen(predictor);
    std::optional<WindowWatch> watch;
    if (window) watch.emplace(plan.model, slices, some.size());
    detail::DesignGroup group;
    group.columns = some.size();
    group.made = columns_.reader(some);
    correct_group(plan, group,
                  {.put = [](int, const std::uint8_t*) {},
                   .after = &predictor,
                   .watch = watch ? &*watch : nullptr},
                  quiet);
    const Prediction p = predictor.finish(0, 0, static_cast<int>(some.size()));
    if (p.joints) not_holding += p.joints->not_holding_voxels;
    findings[b] =
        block.finish(ask.failing ? &failing_of[b] : nullptr, ask.places ? &places_of[b] : nullptr);
    if (!watch) return;
    const std::lock_guard lock(merging);
    window->merge(*watch);
  });
  for (const Findings& f : findings) all.merge(f);
  for (std::size_t b = 0; b < blocks; ++b) {
    if (ask.failing) {
      ask.failing->insert(ask.failing->end(), failing_of[b].begin(), failing_of[b].end());
    }
    if (ask.places) ask.places->insert(ask.places->end(), places_of[b].begin(), places_of[b].end());
  }
  point.prints = true;
  point.extra_slices = slices - plan.layers;
  const PrintTime time =
      print_time(setup.process, setup.lift_times, plan.model.m, target_.grid().layer_um, slices);
  point.time_s = time.light_s;
  point.dark_s = time.dark_s;
  point.max_abs_um = std::max(0.0, all.worst_um);
  point.max_abs_at = all.worst_at;
  point.mean_abs_um = all.edges > 0 ? all.sum_um / static_cast<double>(all.edges) : 0;
  point.contrast = std::min(1.0, all.least_contrast);
  point.contrast_at = all.contrast_at;
  point.lost = all.lost;
  point.split = all.split;
  point.narrow = all.narrow;
  point.off = all.off;
  point.all_columns = which.size() == columns_.columns().size();
  if (window) {
    try {
      check_window(window->result(), setup.process);
    } catch (const InfeasibleError& e) {
      point.limited_by = "uv";
      point.why = e.what();
      return point;
    }
  }
  const auto fails = [&](const char* word, const PlanPlace& at, std::string why) {
    point.limited_by = word;
    point.place = at;
    point.why = std::move(why) + " " + place_in_words(at);
  };
  if (all.narrow > 0) {
    const PlanPlace& at = all.contrast_at;
    fails("contrast", at,
          fmt::format("a gap of {} keeps a contrast of {:.6g} only, where {:g} is asked for,",
                      height_in_words(at.last - at.first + 1), all.least_contrast,
                      ask_.gap_contrast));
  } else if (all.lost > 0) {
    fails("lost", all.lost_at,
          fmt::format("nothing prints of a feature of {}",
                      height_in_words(all.lost_at.last - all.lost_at.first + 1)));
  } else if (all.split > 0) {
    fails("split", all.split_at, "a feature prints in two pieces");
  } else if (not_holding > 0) {
    point.limited_by = "joints";
    point.why = fmt::format(
        "in {} voxels of the columns that are looked at layers do not hold when the platform lifts",
        not_holding.load());
  } else if (all.off > 0) {
    fails(
        "edges", all.worst_at,
        fmt::format("an edge lies {:.4g} um from where it is designed, where {:g} um are allowed,",
                    all.worst_um, ask_.tolerance_um));
  } else {
    point.keeps = true;
  }
  return point;
}

}  // namespace slicecorr::detail
