// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The tables and the picture of docs/flow-chapter-iv.md from the library: flow_table [PICTURE.svg]
// prints chapter IV's figures beside ours, and the check values of discs, strips and other sections.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "../flow_shapes.hpp"
#include "slicecorr/flow_disc.hpp"
#include "support/chart/chart.hpp"

using namespace slicecorr;
using test::chapter_iv_resin1;
using test::chapter_iv_resin2;

namespace {

constexpr double kPlaces[] = {0.1, 0.3, 0.5, 0.7, 0.9};
const DiscPrint kDisc{DiscShape::disc, 10, 300}, kStrip{DiscShape::strip, 10, 300};

FlowResin changed(FlowResin resin, double diffusion, double life_s) {
  resin.diffusion_m2_s = diffusion;
  resin.inhibitor_life_s = life_s;
  return resin;
}
const double kForEver = std::numeric_limits<double>::infinity();

std::string values(const RadialCurve& curve, const char* form, const std::vector<double>& places) {
  std::string text;
  for (const double r : places) {
    text += (text.empty() ? "" : ", ") + fmt::format(fmt::runtime(form), curve.at(r));
  }
  return text;
}
std::string fronts(const DiscDose& dose) {
  return values(dose.front, "{:.4f}", {std::begin(kPlaces), std::end(kPlaces)});
}

void check_values() {
  fmt::print("| what | check value | default grid | 256 levels, 800 steps |\n|---|---|---|---|\n");
  const auto row = [](const std::string& what, const std::string& page, const FlowResin& resin,
                      const DiscPrint& print, double gap, const DiscLight& light) {
    const RadialCurve h = even_curve(gap);
    fmt::print("| {} | {} | {} | {} |\n", what, page, fronts(disc_dose(resin, print, h, light)),
               fronts(disc_dose(resin, print, h, light, {256, 800, 0.02})));
  };
  const FlowResin r2 = chapter_iv_resin2(), r1 = chapter_iv_resin1();
  const DiscLight light = even_light(164, 275);
  row("R2, 164/275, c = 0, signed", "0.5151, 1.6047, 1.2730, 0.8813, 0.4495",
      changed(r2, 0, kForEver), kDisc, 80, light);
  for (const double life : {0.0, 1.0, 3.0, 10.0}) {
    const char* page = life == 0   ? "1.6311 at 0.1"
                       : life == 1 ? "1.525"
                       : life == 3 ? "1.228"
                                   : "0.841";
    row(fmt::format("same, inhibitor_life_s {:g}", life), page, changed(r2, 0, life), kDisc, 80,
        light);
  }
  row("same, c = 1e-10", "1.011, 1.380, 1.237, 0.8735, 0.4417", r2, kDisc, 80, light);
  row("strip, c = 0", "1.5869, 1.1805, 0.8672, 0.5985, 0.3110", changed(r2, 0, kForEver), kStrip,
      80, light);
  row("strip, c = 1e-10", "1.382, 1.157, 0.858, 0.590, 0.301", r2, kStrip, 80, light);
  row("R1, 100/130, h 150, c = 1e-10", "2.905, 2.028, 1.409, 0.896, 0.425", r1, kDisc, 150,
      even_light(100, 130));

  fmt::print("\n| what | ours |\n|---|---|\n");
  fmt::print(
      "| Finv(0.25), Finv(0.81); under way r 0.1, 0.5, 0.9 | {:.5f}, {:.5f}; {:.4f}, {:.4f}, {:.5f} s |\n",
      flow_share_inverse(0.25), flow_share_inverse(0.81), seconds_under_way(0.01, 80, 300),
      seconds_under_way(0.25, 80, 300), seconds_under_way(0.81, 80, 300));
  const DiscSuction s = disc_suction(r2, kDisc, even_curve(80), 0.2e5);
  fmt::print(
      "| disc 10 mm: suction, force; fastest at 0.2, 0.5 bar | {:.1f} Pa, {:.4f} N; {:.1f}, {:.1f} mm/h |\n",
      s.most_pa, s.force_n, s.fastest_mm_h,
      disc_suction(r2, kDisc, even_curve(80), 0.5e5).fastest_mm_h);
  const DiscPrint wide{DiscShape::disc, 25, 300};
  const DiscSuction first = disc_suction(r2, wide, even_curve(25));
  fmt::print("| disc 25 mm, h 100, 0.5 bar | {:.1f} mm/h |\n",
             disc_suction(r2, wide, even_curve(100), 0.5e5).fastest_mm_h);
  fmt::print(
      "| first instant: mean, greatest at the rim; flow | {:.1f}, {:.1f} mm/s; {:.4f} cm3/s |\n",
      first.rim_mm_s, 1.5 * first.rim_mm_s, 1e-3 * first.flow_mm3_s);
  fmt::print("| still resin, signed, clamped | {:.5f}; {:.5f} |\n",
             still_dose(r2, 300, 80, 164, 275, false), still_dose(r2, 300, 80, 164, 275, true));
  fmt::print("| changeover | {:.2f} um |\n", part_takes_over_um(25, 5, 100));
}

/// Figures of sections from closed forms and from 64 cells across (96 for the ring).
void section_values() {
  using namespace flow_shapes;
  const auto pa = [](double phi_um2) { return suction_pa(phi_um2, 0.3, 300, 80); };
  const auto newtons = [](double um4) { return suction_force_n(um4, 0.3, 300, 80); };
  const auto solved = [](const FlowSection& s) { return solve_pressure(s); };
  fmt::print("\n| section | check value | closed form | on cells |\n|---|---|---|---|\n");
  const GapPressure disc = solved(test::disc_section(10e3, 64));
  fmt::print(
      "| disc of 10 mm: suction, force | 14,648 Pa, 2.3010 N | {:.0f}, {:.4f} | {:.0f}, {:.4f} |\n",
      pa(disc_phi_um2(10e3, 0)), newtons(disc_integral_um4(10e3)), pa(disc.max_phi_um2),
      newtons(disc.integral_um4));
  // The outline lies within the outermost cells.
  const double pitch_um = 10e3 / 64.5;
  const GapPressure oblong =
      solved(test::section_where(5e3, 10e3, pitch_um, [](double x, double y) {
        return std::abs(x) < 5e3 && std::abs(y) < 10e3;
      }));
  fmt::print(
      "| rectangle of 10 x 20 mm: middle, mean | 6,672.2, 3,349.8 Pa | {:.1f}, {:.1f} | {:.1f}, {:.1f} |\n",
      pa(rectangle_max_phi_um2(10e3, 20e3)), pa(rectangle_mean_phi_um2(10e3, 20e3)),
      pa(oblong.max_phi_um2), pa(oblong.integral_um4 / 200e6));
  const FlowSection square = test::full_section(64, 64, 125);
  const GapPressure of_square = solved(square);
  fmt::print("| square of 8 mm: middle | 2,762.7 Pa | {:.1f} | {:.1f} |\n",
             pa(rectangle_max_phi_um2(8e3, 8e3)), pa(of_square.max_phi_um2));
  const GapPressure ellipse =
      solved(test::section_where(9e3, 4.5e3, 18e3 / 64, [](double x, double y) {
        return x * x / 81e6 + y * y / 20.25e6 < 1;
      }));
  fmt::print(
      "| ellipse of 9 x 4.5 mm half axes: suction, force | 4,746.1 Pa, 0.30193 N | {:.1f}, {:.5f} | {:.1f}, {:.5f} |\n",
      pa(ellipse_phi_um2(9e3, 4.5e3, 0, 0)), newtons(ellipse_integral_um4(9e3, 4.5e3)),
      pa(ellipse.max_phi_um2), newtons(ellipse.integral_um4));
  const double peak_um = ring_peak_um(3e3, 9e3);
  fmt::print(
      "| ring of 3 to 9 mm, hole open: most, at | 2,721.2 Pa at 5.724 mm | {:.1f} at {:.3f} | {:.1f} |\n",
      pa(ring_phi_um2(3e3, 9e3, peak_um)), peak_um * 1e-3,
      pa(solved(test::ring_section(18e3 / 96)).max_phi_um2));
  fmt::print("| the same, hole blind: in the hole | 10,547 Pa | {:.0f} | {:.0f} |\n",
             pa(disc_phi_um2(9e3, 3e3)),
             pa(solved(test::ring_section(18e3 / 96, FlowCell::blind)).max_phi_um2));

  const auto along = [&](const std::vector<double>& values, const char* form) {
    std::string text;
    for (const double x_um : {1e3, 2e3, 3e3}) {
      text += (text.empty() ? "" : ", ") +
              fmt::format(fmt::runtime(form), test::value_at(square, values, x_um, 0));
    }
    return text;
  };
  fmt::print("| square: F_in at 1, 2, 3 mm | 0.08314, 0.31174, 0.63547 | | {} |\n",
             along(share_in(square, of_square), "{:.5f}"));
  const SectionDose dose = test::even_dose(test::sweep_of(square, chapter_iv_resin2()), 164, 275);
  fmt::print("| square: Omega_f there, R2 164/275 | 1.376, 1.141, 0.677 | | {} |\n",
             along(dose.front, "{:.3f}"));
  fmt::print("| square: share within 10 % | 15 % | | {:.1f} % |\n",
             100 * summarise(square, dose).within_10);
  const FlowSection coarse = test::full_section(32, 32, 250);
  const auto share = [&](FlowPattern pattern, double gap_um) {
    SectionGoal goal;
    goal.pattern = pattern;
    goal.min_gap_um = goal.max_gap_um = gap_um;
    goal.max_blue_mw_cm2 = 200;
    goal.max_uv_mw_cm2 = 275;
    return 100 * optimise_section(coarse, solved(coarse), chapter_iv_resin2(), 300, goal)
                     .summary.within_10;
  };
  fmt::print(
      "| square, best light: constant h 80; blue by place h 120; both h 200 | 20; 77; 93 % | | {:.0f}; {:.0f}; {:.0f} % |\n",
      share(FlowPattern::constant, 80), share(FlowPattern::blue, 120),
      share(FlowPattern::both, 200));
}

/// Omega_f of a disc of 10 mm by cells across, and by the march.
void section_accuracy() {
  fmt::print("\n| cells | 0.1 | 0.3 | 0.5 | 0.7 | 0.9 |\n|---|---|---|---|---|---|\n");
  const auto row = [](const std::string& name, const auto& at) {
    std::string text;
    for (const double dose : at) text += fmt::format(" {:.3f} |", dose);
    fmt::print("| {} |{}\n", name, text);
  };
  for (const int cells : {32, 64, 113}) {
    const FlowSection disc = test::disc_section(10e3, cells);
    const SectionDose dose = test::even_dose(test::sweep_of(disc, chapter_iv_resin2()), 164, 275);
    row(fmt::format("{}", cells), test::around(disc, dose.front, 10e3));
  }
  const DiscDose march = disc_dose(chapter_iv_resin2(), kDisc, even_curve(80), even_light(164, 275),
                                   {480, 1600, 0.02});
  std::vector<double> at;
  for (const double r : kPlaces) at.push_back(march.front.at(r));
  row("march along the radius, 480 levels", at);
}

void dead_zones() {
  fmt::print(
      "\n| resin, light | cut off at | slope | Rp, mm | h at 0.1, 0.25, 0.5, 0.75 | window | adheres |\n"
      "|---|---|---|---|---|---|---|\n");
  const auto row = [](const char* name, const FlowResin& resin, double blue, double uv,
                      double largest, double slope, double radius) {
    DeadZoneSearch search;
    search.largest_um = largest;
    search.slope = slope;
    const DiscDeadZone z =
        disc_dead_zone(resin, {DiscShape::disc, radius, 300}, even_light(blue, uv), search);
    fmt::print("| {} | {} | {} | {} | {} | {:.2f} | {} |\n", name, largest,
               slope > 100 ? "any" : fmt::format("{}", slope), radius,
               values(z.gap_um, "{:.0f}", {0.1, 0.25, 0.5, 0.75}),
               *std::max_element(z.dose.window.value.begin(), z.dose.window.value.end()),
               z.adheres ? "yes" : "no");
  };
  for (const double largest : {200.0, 300.0, 400.0, 500.0}) {
    row("R2 164/275", chapter_iv_resin2(), 164, 275, largest, 1e6, 10);
  }
  for (const double largest : {400.0, 500.0})
    row("R2 164/275", chapter_iv_resin2(), 164, 275, largest, 0.7, 10);
  for (const double largest : {300.0, 400.0, 500.0})
    row("R1 100/130", chapter_iv_resin1(), 100, 130, largest, 1e6, 10);
  row("R1 100/130", chapter_iv_resin1(), 100, 130, 400, 1, 10);
  row("R1 100/130", chapter_iv_resin1(), 100, 130, 400, 1, 2);
}

struct Print {
  const char* name;
  double blue, uv, speed, radius;
  DiscGrowth growth = {};
  FlowResin resin = chapter_iv_resin1();
};

DiscGrown grown(const Print& p) {
  return grow_disc(p.resin, {DiscShape::disc, p.radius, p.speed}, even_light(p.blue, p.uv),
                   p.growth);
}

void prints() {
  fmt::print(
      "\n| print | middle | least, at | 0.9 R | level front: mean, deviation, share | adheres after, at |\n"
      "|---|---|---|---|---|---|\n");
  DiscGrowth fine, fine_cells;
  fine.cells = 60;
  fine.level_um = 3;
  fine_cells.cells = 80;
  fine_cells.slope = 1;
  DiscGrowth slow, slower;
  slow.seconds = 80;
  slower.seconds = 160;
  Print clamp{"70/130, clamped (c 0)", 70, 130, 300, 1};
  clamp.resin.inhibitor_life_s = 0;
  Print brief{"70/130, inhibitor lives 1 ms, c 1e-10", 70, 130, 300, 1};
  brief.resin.inhibitor_life_s = 1e-3;
  std::vector<Print> all{
      {"70/130", 70, 130, 300, 1}, {"70/130, 60 cells, 3 um", 70, 130, 300, 1, fine}, clamp, brief};
  for (const double blue : {80.0, 90.0, 100.0, 110.0, 112.0, 114.0, 116.0, 118.2}) {
    all.push_back({"", blue, 130, 300, 1});
  }
  Print finer{"114/130, 60 cells, 3 um", 114, 130, 300, 1, fine};
  all.push_back(finer);
  finer = {"116/130, 60 cells, 3 um", 116, 130, 300, 1, fine};
  all.push_back(finer);
  all.push_back({"100/130, 75 mm/h", 100, 130, 75, 1, slower});
  all.push_back({"100/130, 150 mm/h", 100, 130, 150, 1, slow});
  all.push_back({"100/130, 450 mm/h", 100, 130, 450, 1});
  all.push_back({"100/130, Rp 0.5", 100, 130, 300, 0.5});
  all.push_back({"100/130, Rp 1.5", 100, 130, 300, 1.5});
  all.push_back({"100/130, Rp 2", 100, 130, 300, 2});
  all.push_back({"100/130, Rp 2, 80 cells, slope 1", 100, 130, 300, 2, fine_cells});
  all.push_back({"200/260", 200, 260, 300, 1});
  for (const Print& p : all) {
    const DiscGrown g = grown(p);
    const auto least = std::min_element(g.gap_um.value.begin(), g.gap_um.value.end());
    const LevelFront level = level_front(g.gap_um, p.radius);
    const std::string name = *p.name != 0 ? p.name : fmt::format("{:g}/130", p.blue);
    fmt::print(
        "| {} | {:.0f} | {:.0f}, {:.2f} | {:.0f} | {:.0f}, {:.0f}, {:.2f} | {} |\n", name,
        g.gap_um.value.front(), *least,
        g.gap_um.r[static_cast<std::size_t>(least - g.gap_um.value.begin())], g.gap_um.at(0.9),
        level.mean_um, level.deviation_um, level.share,
        g.adhesion ? fmt::format("{:.1f} s, {:.2f}", g.adhesion->seconds, g.adhesion->r) : "-");
    std::fflush(stdout);
  }
}

DiscOptimum best(DiscPattern pattern, bool by_area, const DiscPrint& print = kDisc, int nodes = 0,
                 double diffusion = 1e-10) {
  DiscGoal goal;
  goal.blue_most_mw_cm2 = 200;
  goal.uv_most_mw_cm2 = 275;
  goal.pattern = pattern;
  goal.by_area = by_area;
  goal.free_nodes = nodes;
  return best_disc_light(changed(chapter_iv_resin2(), diffusion, kForEver), print, goal);
}

void optima() {
  fmt::print(
      "\n| light | mean over | h | blue at 0, 0.2, 0.4, 0.6, 0.8, 1 | UV | share within 10 % | mean square | window |\n"
      "|---|---|---|---|---|---|---|---|\n");
  const auto row = [](const std::string& name, bool by_area, const DiscOptimum& o) {
    const std::vector<double> at{0, 0.2, 0.4, 0.6, 0.8, 1};
    fmt::print("| {} | {} | {:.0f} | {} | {} | {:.1f} % | {:.4f} | {:.2f} |\n", name,
               by_area ? "r dr" : "dr", o.gap_um, values(o.light.blue_mw_cm2, "{:.0f}", at),
               values(o.light.uv_mw_cm2, "{:.0f}", at), 100 * o.share_within, o.mean_square,
               o.window_most);
  };
  for (const bool by_area : {true, false}) {
    row("constant", by_area, best(DiscPattern::none, by_area));
    row("constant, c 1.45e-12", by_area, best(DiscPattern::none, by_area, kDisc, 0, 1.45e-12));
    row("patterned UV", by_area, best(DiscPattern::uv, by_area));
    row("patterned blue", by_area, best(DiscPattern::blue, by_area));
    row("patterned blue, 20 free nodes", by_area, best(DiscPattern::blue, by_area, kDisc, 20));
    row("both", by_area, best(DiscPattern::both, by_area));
  }
  row("strip, constant", false, best(DiscPattern::none, false, kStrip));
  row("strip, patterned blue", false, best(DiscPattern::blue, false, kStrip));
}

std::vector<chart::Point> points(const RadialCurve& curve, double from = 0) {
  std::vector<chart::Point> out;
  for (std::size_t i = 0; i < curve.r.size(); ++i) {
    if (curve.r[i] >= from) out.push_back({curve.r[i], curve.value[i]});
  }
  return out;
}

std::string picture() {
  chart::Picture picture(
      "Dead zones of chapter IV, and light that evens them",
      "Dead zone thickness over the radius for blue light of 70 to 110 mW/cm² and for 75 to 450 mm/h; "
      "relative dose of what gels with constant and with patterned light.");
  chart::Axis r{.title = ""}, words{.title = "r / Rp"};
  chart::Axis h{.title = "h, µm", .low = 0, .high = 450};
  chart::Panel blues(r, h, 190, false), speeds(r, h, 190, false);
  int series = 0;
  for (const double blue : {70.0, 80.0, 90.0, 100.0, 110.0}) {
    const RadialCurve gap = grown({"", blue, 130, 300, 1}).gap_um;
    blues.line(points(gap), chart::Style::series, series++);
    blues.words({0, gap.value.front()}, fmt::format("{:g}", blue), 10, blue < 110 ? -6 : -1);
  }
  blues.words({0.5, 380}, "blue light, mW/cm², at 300 mm/h", 0, 0, "middle");
  series = 0;
  for (const double speed : {75.0, 150.0, 300.0, 450.0}) {
    DiscGrowth growth;
    growth.seconds = 40 * std::max(1.0, 300 / speed);
    const RadialCurve gap = grown({"", 100, 130, speed, 1, growth}).gap_um;
    speeds.line(points(gap), chart::Style::series, series++);
    // The lowest has its word below, where no curve is.
    speeds.words({0.9, gap.at(0.9)}, fmt::format("{:g}", speed), -4, speed > 75 ? -6 : 16, "end");
  }
  speeds.words({0.5, 380}, "speed, mm/h, at 100 mW/cm²", 0, 0, "middle");
  chart::Panel doses(words, {.title = "relative dose", .low = 0, .high = 1.6}, 190);
  doses.line(points(best(DiscPattern::none, false).dose.front), chart::Style::reference);
  doses.line(points(best(DiscPattern::blue, false).dose.front), chart::Style::other);
  doses.line(points(best(DiscPattern::both, false).dose.front), chart::Style::fit);
  doses.horizontal(1, "");
  picture.legend_line(chart::Style::reference, "constant light");
  picture.legend_line(chart::Style::other, "blue patterned");
  picture.legend_line(chart::Style::fit, "both patterned");
  picture.add(blues);
  picture.add(speeds);
  picture.add(doses);
  picture.note(
      "Above: table 4.1's resin 1, UV light 130 mW/cm², Rp 1 mm, 40 s after the start (slow prints after as many mm). Below: resin 2, "
      "Rp 10 mm, 300 mm/h, each with the best light and dead zone within 200 and 275 mW/cm².");
  return picture.svg();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1) {
    std::ofstream(argv[1]) << picture();
    return 0;
  }
  check_values();
  section_values();
  section_accuracy();
  dead_zones();
  prints();
  optima();
  return 0;
}
