// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A print of any part from its first instant: the cells of each slice as a plan that grows, with flows
// from the pressure under the gap as it is.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"
#include "flow/in_time.hpp"
#include "flow/net.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

using detail::FlowNet;

/// Flows are found anew when gaps have changed by so much against each other since.
constexpr double kStaleShare = 0.02;

/// A net's faces in a fixed order, each once: what changes with the gap is their flow.
struct NetFace {
  std::size_t node = 0, direction = 0;
  bool leaks = false;  ///< of a void, straight to the bath
};

class PartGrowth {
 public:
  PartGrowth(const FlowPart& part, const FlowPull& pull, const InTime& how,
             const LightInTime& light, const ExecutionContext& context)
      : part_(part),
        pull_(pull),
        how_(how),
        light_(light),
        context_(context),
        speed_um_s_(disc::um_s(pull.speed_mm_h)),
        levels_(static_cast<std::size_t>(std::ceil(how.top_um / how.level_um))),
        growth_(*pull.resin, {speed_um_s_, how.first_gap_um, how.slope, how.level_um, levels_}) {}

  PrintInTime run() {
    PrintInTime all;
    all.top_um = how_.top_um;
    int slices = std::min(how_.slices, part_.slices());
    // Corrected stacks go on behind the part: what is shown there has nothing above it that draws resin in.
    while (slices > 1 && part_.mask_of(slices - 1) < 0) --slices;
    for (int n = 0; n < slices && !all.sticks; ++n) {
      context_.report("follow the print", static_cast<double>(n) / slices);
      const int mask = part_.mask_of(n);
      const double until_s = how_.heights.place_um(n + 1, part_.layer_um()) / speed_um_s_;
      if (mask < 0) {
        throw InputError(
            fmt::format("slice {}: no cell has gelled material above; expected a part whose slices "
                        "hang together, or finer cells",
                        n));
      }
      const bool same = n > 0 && mask == part_.mask_of(n - 1) && !light_;
      if (n == 0 || mask != part_.mask_of(n - 1)) {
        take_mask(static_cast<std::size_t>(mask), n);
      } else if (light_) {
        growth_.set_light(blue_of(n), uv_of(n));
      }
      if (same && rest_.holds()) {
        growth_.wait(until_s - growth_.seconds());
      } else {
        expose(until_s, n, all);
        rest_.add(growth_, how_.top_um, same);
      }
      all.slices.push_back(look(n));
    }
    context_.report("follow the print", 1);
    all.undone_places = growth_.undone();
    detail::find_steady(all);
    return all;
  }

 private:
  FlowLight light_of(int slice, std::size_t cell) const {
    return light_ ? light_(slice, cell) : *pull_.light;
  }
  /// Voids are dark: their cells show no curing light.
  std::vector<double> blue_of(int slice) const {
    std::vector<double> blue(net_.nodes(), 0.0);
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      blue[n] = light_of(slice, net_.cell_of[n]).blue_mw_cm2;
    }
    return blue;
  }
  std::vector<double> uv_of(int slice) const {
    std::vector<double> uv(net_.nodes(), 0.0);
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      uv[n] = light_of(slice, net_.cell_of[n]).uv_mw_cm2;
    }
    for (std::size_t k = 0; k < section_.size(); ++k) {
      const int node = net_.node_of[k];
      if (node < static_cast<int>(net_.parts())) continue;
      const auto v = static_cast<std::size_t>(node);
      uv[v] += light_of(slice, k).uv_mw_cm2 / net_.area[v];
    }
    return uv;
  }

  void expose(double until_s, int slice, PrintInTime& all) {
    while (until_s - growth_.seconds() > 1e-9 * until_s) {
      context_.check_cancelled();
      growth_.find_gap();
      if (stale()) find_fluxes();
      growth_.step(until_s - growth_.seconds());
      if (const auto at = growth_.stuck()) {
        const std::size_t cell =
            *at < net_.parts() ? net_.cell_of[*at] : cell_of_void(static_cast<int>(*at));
        const auto [x_mm, y_mm] = part_.grid().place_mm(cell);
        all.sticks = StuckInTime{slice, growth_.seconds(), x_mm, y_mm};
        return;
      }
    }
  }

  std::size_t cell_of_void(int node) const {
    const auto at = std::find(net_.node_of.begin(), net_.node_of.end(), node);
    return static_cast<std::size_t>(at - net_.node_of.begin());
  }

  /// Whether gaps have changed against each other; all alike, they leave the flows as they are.
  bool stale() const {
    double least = std::numeric_limits<double>::infinity(), most = 0;
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      const double ratio = growth_.felt_um()[n] / solved_um_[n];
      least = std::min(least, ratio);
      most = std::max(most, ratio);
    }
    return most > (1 + kStaleShare) * least;
  }

  /// The gap that the flow feels, of cells.
  std::vector<double> felt_cells() const {
    std::vector<double> felt(section_.size(), 0.0);
    for (std::size_t n = 0; n < net_.parts(); ++n) felt[net_.cell_of[n]] = growth_.felt_um()[n];
    return felt;
  }

  void find_fluxes() {
    const std::vector<double> felt = felt_cells();
    const double reference_um = *std::max_element(felt.begin(), felt.end());
    pressure_ = solve_pressure(section_, felt, reference_um, detail::silent(context_));
    std::vector<double> mobility(section_.size(), 0.0);
    for (std::size_t k = 0; k < felt.size(); ++k) {
      mobility[k] = std::pow(felt[k] / reference_um, 3);
    }
    const FlowNet net = detail::make_net(section_, mobility);
    std::vector<double> phi(net.nodes(), 0.0), fluxes;
    for (std::size_t k = 0; k < section_.size(); ++k) {
      if (net.node_of[k] >= 0) {
        phi[static_cast<std::size_t>(net.node_of[k])] = pressure_.phi_um2[k];
      }
    }
    // Phi obeys div(mobility grad Phi) = -12: a twelfth of S times its slope is what flows.
    const double per_phi = speed_um_s_ / 12;
    const auto phi_at = [&](int node) {
      return node < 0 ? 0.0 : phi[static_cast<std::size_t>(node)];
    };
    for (const NetFace& f : faces_) {
      const double conductance =
          f.leaks ? net.leak[f.node - net.parts()] : net.faces[f.node][f.direction].conductance;
      const int beyond = f.leaks ? -1 : net.faces[f.node][f.direction].node;
      fluxes.push_back(per_phi * conductance * (phi[f.node] - phi_at(beyond)));
    }
    growth_.set_fluxes(fluxes);
    solved_um_ = growth_.felt_um();
  }

  void take_mask(std::size_t mask, int slice) {
    const FlowNet before = std::move(net_);
    const std::vector<double> dose = growth_.dose();
    section_ = part_.section(mask);
    try {
      check_section(section_);
    } catch (const InputError&) {
      throw InputError(fmt::format(
          "slice {} is less than three cells of {:g} um across; expected finer cells to follow it in "
          "time",
          slice, section_.pitch_x_um));
    }
    net_ = detail::make_net(section_, {});
    distance_um_ = distances();
    // What resin is there stays; what is new is fresh, and a void is the mean of its cells.
    std::vector<double> now(net_.nodes() * levels_, 0.0);
    for (std::size_t k = 0; k < section_.size(); ++k) {
      if (net_.node_of[k] < 0 || before.node_of.empty() || before.node_of[k] < 0) continue;
      const auto to = static_cast<std::size_t>(net_.node_of[k]);
      const auto from = static_cast<std::size_t>(before.node_of[k]);
      const double share = 1 / net_.area[to];
      for (std::size_t j = 0; j < levels_; ++j) {
        now[to * levels_ + j] += share * dose[from * levels_ + j];
      }
    }
    detail::GrowthPlan plan = make_plan();
    plan.blue_mw_cm2 = blue_of(slice);
    plan.uv_mw_cm2 = uv_of(slice);
    growth_.set_plan(std::move(plan), std::move(now));
    solved_um_.assign(net_.nodes(), 1.0);
    find_fluxes();
  }

  std::vector<double> distances() const {
    const std::vector<double> cells = outline_distance_um(section_);
    std::vector<double> distance(net_.nodes(), 0.0);
    for (std::size_t n = 0; n < net_.parts(); ++n) distance[n] = cells[net_.cell_of[n]];
    return distance;
  }

  double pitch_of(std::size_t direction) const {
    return direction < 2 ? section_.pitch_x_um : section_.pitch_y_um;
  }

  detail::GrowthPlan make_plan() {
    detail::GrowthPlan plan;
    faces_.clear();
    for (const double area : net_.area) plan.area_um2.push_back(area * section_.cell_um2());
    plan.near = neighbours();
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      for (std::size_t d = 0; d < 4; ++d) {
        const int beyond = net_.faces[n][d].node;
        const bool is_part = beyond >= 0 && beyond < static_cast<int>(net_.parts());
        // Between two cells of part the one to the left, or above, has the face.
        if (is_part && d % 2 == 1) continue;
        detail::GrowthFace face;
        face.to = static_cast<int>(n);
        face.from = beyond;
        face.beyond_to = net_.faces[n][d ^ 1U].node;
        face.beyond_from =
            is_part ? net_.faces[static_cast<std::size_t>(beyond)][d].node : detail::kMirror;
        if (beyond < 0) face.beyond_from = detail::kFreshBath;
        face.exchange = beyond >= 0 ? pitch_of(d ^ 2U) / pitch_of(d) : 0;
        face.reach_um = 0.5 * pitch_of(d);
        plan.faces.push_back(face);
        faces_.push_back({n, d, false});
      }
    }
    for (std::size_t v = 0; v < net_.leak.size(); ++v) {
      if (!(net_.leak[v] > 0)) continue;
      detail::GrowthFace face;
      face.to = static_cast<int>(net_.parts() + v);
      face.reach_um = 0.5 * section_.pitch_x_um;
      plan.faces.push_back(face);
      faces_.push_back({net_.parts() + v, 0, true});
    }
    return plan;
  }

  /// The eight cells around, and whatever a void touches.
  std::vector<std::vector<std::pair<int, double>>> neighbours() const {
    std::vector<std::vector<std::pair<int, double>>> near(net_.nodes());
    for (std::size_t k = 0; k < section_.size(); ++k) {
      const int node = net_.node_of[k];
      if (node < 0) continue;
      const int x = static_cast<int>(k % static_cast<std::size_t>(section_.width));
      const int y = static_cast<int>(k / static_cast<std::size_t>(section_.width));
      for (int v = std::max(0, y - 1); v <= std::min(section_.height - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(section_.width - 1, x + 1); ++u) {
          const int other = net_.node_of[section_.index(u, v)];
          if (other < 0 || other == node) continue;
          near[static_cast<std::size_t>(node)].emplace_back(
              other, std::hypot((u - x) * section_.pitch_x_um, (v - y) * section_.pitch_y_um));
        }
      }
    }
    return near;
  }

  SliceInTime look(int slice) {
    growth_.find_gap();
    if (stale()) find_fluxes();
    SliceInTime s = detail::look_at(growth_, distance_um_, how_.top_um);
    s.slice = slice;
    double area = 0;
    for (const double cells : net_.area) area += cells;
    s.area_mm2 = area * section_.cell_um2() * 1e-6;
    s.inflow_mm3_s = s.area_mm2 * speed_um_s_ * 1e-3;
    // Gaps that have all grown alike since flows were found leave Phi, and change what it is relative to.
    double now_um = 0;
    for (std::size_t n = 0; n < net_.parts(); ++n) now_um = std::max(now_um, growth_.felt_um()[n]);
    s.suction_pa =
        suction_pa(pressure_.max_phi_um2, pull_.viscosity_pa_s, pull_.speed_mm_h, now_um);
    s.force_n =
        suction_force_n(pressure_.integral_um4, pull_.viscosity_pa_s, pull_.speed_mm_h, now_um);
    look_at_rim(s);
    s.level = level_cells();
    look_along(s);
    return s;
  }

  void look_at_rim(SliceInTime& s) const {
    for (std::size_t f = 0; f < faces_.size(); ++f) {
      const detail::GrowthFace& face = growth_.plan().faces[f];
      if (face.from >= 0 || faces_[f].leaks) continue;
      const double width_um = pitch_of(faces_[f].direction ^ 2U);
      const double h = growth_.felt_um()[static_cast<std::size_t>(face.to)];
      s.rim_mm_s = std::max(s.rim_mm_s, 1e-3 * face.flux_um3_s / (width_um * h));
    }
  }

  /// Where the front is level to 10 degrees towards all neighbours of part.
  LevelFront level_cells() const {
    const double level = std::tan(10 * 3.14159265358979323846 / 180);
    LevelFront front;
    double sum = 0, squares = 0, all = 0;
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      ++all;
      const double h = growth_.gap_um()[n];
      bool flat = h < std::min(how_.top_um, growth_.platform_um());
      for (std::size_t d = 0; d < 4; ++d) {
        const int other = net_.faces[n][d].node;
        if (other < 0 || other >= static_cast<int>(net_.parts())) continue;
        const double rise = growth_.gap_um()[static_cast<std::size_t>(other)] - h;
        flat = flat && std::abs(rise) <= level * pitch_of(d);
      }
      if (!flat) continue;
      ++front.share;
      sum += h;
      squares += h * h;
    }
    if (front.share <= 0) return front;
    front.mean_um = sum / front.share;
    front.deviation_um =
        std::sqrt(std::max(0.0, squares / front.share - front.mean_um * front.mean_um));
    front.share /= all;
    return front;
  }

  /// The row of cells through the place that is furthest from outlines.
  void look_along(SliceInTime& s) const {
    std::size_t middle = 0;
    for (std::size_t n = 0; n < net_.parts(); ++n) {
      if (distance_um_[n] > distance_um_[middle] * (1 + 1e-9)) middle = n;
    }
    const auto width = static_cast<std::size_t>(section_.width);
    const std::size_t row = net_.cell_of[middle] / width;
    for (std::size_t k = row * width; k < (row + 1) * width; ++k) {
      const int node = net_.node_of[k];
      if (node < 0 || node >= static_cast<int>(net_.parts())) continue;
      s.place_mm.push_back(part_.grid().place_mm(k)[0]);
      s.gap_um.push_back(growth_.gap_um()[static_cast<std::size_t>(node)]);
      s.window_along.push_back(growth_.window_dose(static_cast<std::size_t>(node)));
    }
  }

  const FlowPart& part_;
  const FlowPull& pull_;
  const InTime& how_;
  const LightInTime& light_;
  const ExecutionContext& context_;
  double speed_um_s_;
  std::size_t levels_;
  detail::GapGrowth growth_;
  FlowSection section_;
  FlowNet net_;
  std::vector<NetFace> faces_;
  std::vector<double> distance_um_;
  std::vector<double> solved_um_;  ///< of nodes, the felt gap when flows were found
  GapPressure pressure_;
  detail::AtRest rest_;
};

}  // namespace

PrintInTime follow_part(const FlowPart& part, const FlowPull& pull, const InTime& how,
                        const LightInTime& light, const ExecutionContext& context) {
  detail::check_in_time(how);
  if (!pull.resin || !(pull.light || light)) {
    throw InputError("resin flow", "light",
                     "is missing; expected light and resin to follow a print");
  }
  disc::check_resin(*pull.resin);
  disc::check_positive(pull.speed_mm_h, "speed_mm_h");
  disc::check_positive(pull.viscosity_pa_s, "viscosity_pa_s");
  if (pull.light) {
    const DiscLight even = even_light(pull.light->blue_mw_cm2, pull.light->uv_mw_cm2);
    disc::check_light(even);
    disc::check_inhibited(even);
  }
  return PartGrowth(part, pull, how, light, context).run();
}

}  // namespace slicecorr
