// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "picture/embed.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/version.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"
#include "support/text/display_text.hpp"
#include "tomo/views/dose_histogram.hpp"
#include "tomo/views/gel_cells.hpp"
#include "tomo/views/page_text.hpp"

namespace slicecorr::tomo {

namespace {

using chart::axis_over;
using chart::figure;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;
using namespace page;
using slicecorr::detail::captioned_image;

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr double kNever = std::numeric_limits<double>::infinity();
/// Just after the print.
constexpr double kLater = 1.0000001;

bool in_resin(const Box<std::uint8_t>& part, int x, int y) {
  const double r = 0.5 * (part.nx - 1), dx = x - r, dy = y - r;
  return dx * dx + dy * dy <= r * r;
}

std::string percent(double share) { return fmt::format("{} %", figure(100 * share)); }

void add_wanted(const WantedFigures& w, Table& table) {
  table.row("Wanted doses",
            fmt::format("{} of {} voxels within", text::count(static_cast<std::int64_t>(w.within)),
                        text::count(static_cast<std::int64_t>(w.voxels))),
            fmt::format("within their tolerance; {} by weight", percent(w.share_within)));
  table.row(
      "Off by",
      fmt::format("{} mJ/cm³ rms, {:+.3g} at worst", figure(w.rms_off_mj_cm3), w.worst_off_mj_cm3),
      fmt::format("outside of the tolerance; worst in voxel {}, {}, {}", w.worst[0], w.worst[1],
                  w.worst[2]));
  table.row("Slack", figure(w.slack),
            "tolerances could be narrower by this factor; below 1 some doses are outside");
  if (std::isfinite(w.slack_bound)) {
    table.row("Bound of slack", figure(w.slack_bound), "no light whatever has more");
  }
}

Markup figures_table(const Printed& p) {
  const PrintFigures& f = p.figures;
  const Metrics& m = f.metrics;
  Table table("figures");
  table.columns("Figure", "Value", "What it means");
  table.row(
      "Contrast C", figure(m.contrast),
      "least dose of the part over most of void: void begins to gel after so many times the print's "
      "time");
  if (std::isfinite(f.contrast_bound)) {
    table.row("Bound of C", figure(f.contrast_bound),
              "no light whatever has more, as the solve of this job proved");
  }
  table.row("Void that gels with the part",
            fmt::format("{} of {} voxels", text::count(static_cast<std::int64_t>(m.void_gelled)),
                        text::count(static_cast<std::int64_t>(m.empty))),
            "void voxels with at least the dose of the weakest voxel of the part");
  table.row("VER", figure(m.ver), "these over all voxels of part and void");
  table.row("Process window PW", figure(m.pw),
            "least dose of the part less most of void, over the largest dose; above 0 is good");
  table.row("PW, trimmed", figure(m.trimmed_pw),
            "the same without the weakest 0.05 % of the part and the strongest 0.05 % of void");
  table.row("Range in the part, IPDR", figure(m.ipdr),
            "largest less least dose of the part, over the largest dose; small is even");
  table.row("Overlap at the gel dose", figure(f.jaccard_at_dose),
            "Jaccard index of what gels and what should; 1 is all right");
  table.row("Best overlap", figure(m.best_jaccard),
            "the same at the gel dose that would suit this light best");
  table.row("Dose in the part",
            fmt::format("{} to {} mJ/cm³", figure(m.min_gel), figure(m.max_gel)),
            "of the whole print");
  table.row("Dose in void", fmt::format("up to {} mJ/cm³", figure(m.max_void)),
            "of the whole print");
  table.row("Gel dose", fmt::format("{} mJ/cm³", figure(f.gel_dose_mj_cm3)),
            "with what inhibitors take; what comes back of them is taken off doses");
  table.row("Black light", fmt::format("up to {} mJ/cm³", figure(f.floor_mj_cm3)),
            "what black frames alone would leave in that time");
  table.row("Time", fmt::format("{} turns, {}", f.turns, text::duration(f.print_time_s)),
            "whole turns, so that all directions count alike");
  table.row("Mean over largest light", percent(f.efficiency),
            "how much of the projector's light is used; contrast costs light");
  table.row("Absorption times radius", figure(f.alpha_r),
            "1 is the fastest on the axis; much more leaves it dark");
  if (f.surface.voxels > 0) {
    table.row(
        "Surface",
        fmt::format("{:+.3g} um in the mean, {:.3g} um rms", f.surface.mean_um, f.surface.rms_um),
        fmt::format("by which {} voxels that the part fills in part gel too far",
                    text::count(static_cast<std::int64_t>(f.surface.voxels))));
  }
  if (f.wanted) add_wanted(*f.wanted, table);
  const Vial& vial = *p.job.printer.vial;
  const double n = index_of(p.job.resin), r = part_radius_mm(p.job.part, p.job.sampling.voxel_mm);
  const double q = r * n / vial.n_outside;
  // Of light that is traced there is no closed form.
  if (!vial.traced() && !misses(vial, n, q, 0)) {
    table.row("Light through the wall",
              fmt::format("{} to {}", percent(transmittance(vial, n, q, 0)),
                          percent(transmittance(vial, n, 0, 0))),
              fmt::format("at {:.3f} mm from the axis, where the part ends, and at the axis", r));
  }
  return table;
}

Markup tiles(const PrintFigures& f) {
  Tiles tiles;
  const bool good = f.feasible();
  tiles.add(good ? "as designed" : "not as designed",
            good ? "all of the part gels, and no void" : std::string(f.fault()),
            good ? "good" : "bad");
  tiles.add(figure(f.metrics.contrast), "contrast");
  tiles.add(text::count(static_cast<std::int64_t>(f.metrics.void_gelled)),
            "void voxels gel with the part");
  tiles.add(text::duration(f.print_time_s), fmt::format("in {} turns", f.turns));
  return tiles;
}

/// How many voxels of part and void have which dose.
std::string histogram_svg(const Printed& p) {
  const Box<std::uint8_t>& part = p.job.part;
  const PrintFigures& f = p.figures;
  detail::DoseHistogram doses(std::max(f.metrics.max_gel, f.metrics.max_void), f.gel_dose_mj_cm3);
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        const std::size_t k = part.at(z, y, x);
        if (!in_resin(part, x, y)) continue;
        if (!p.job.insert.values.empty() && p.job.insert.values[k] > 0) continue;
        if (part.values[k] == 255 || part.values[k] == 0) {
          doses.add(p.dose.values[k], part.values[k] == 255);
        }
      }
    }
  }
  return doses.svg(
      {"Doses of part and void",
       "How many voxels have which dose at the end of the print, on a logarithmic scale.",
       "dose, mJ/cm³", "voxels", "void",
       "To the right of the line resin gels: all of the part should lie there, no void."});
}

std::string convergence_svg(const std::vector<Step>& history) {
  // No more points than the picture shows, but the ends of rungs.
  const std::size_t stride = 1 + history.size() / 1500;
  std::vector<Point> loss, contrast;
  std::vector<double> losses, contrasts{1};
  std::vector<std::pair<double, double>> rungs;
  for (std::size_t i = 0; i < history.size(); ++i) {
    const Step& s = history[i];
    const auto x = static_cast<double>(i);
    const bool new_rung = i == 0 || s.rung != history[i - 1].rung;
    if (new_rung && s.rung > 0) rungs.emplace_back(x, s.rung);
    const bool last = i + 1 == history.size() || history[i + 1].rung != s.rung;
    if (i % stride != 0 && !new_rung && !last) continue;
    if (new_rung) loss.push_back({x, kNothing});
    loss.push_back({x, s.loss > 0 ? s.loss : kNothing});
    contrast.push_back({x, s.contrast});
    if (s.loss > 0) losses.push_back(s.loss);
    if (std::isfinite(s.contrast)) contrasts.push_back(s.contrast);
  }
  const chart::Axis steps{"step", false, 0, std::max(1.0, static_cast<double>(history.size()) - 1)};
  Picture picture("How the solve went",
                  "Contrast of the light, and what was left of the loss, step by step.");
  Panel above(steps, axis_over("contrast", false, contrasts), 200, losses.empty());
  above.line(contrast, Style::fit);
  above.horizontal(1, "void gels below");
  if (!losses.empty()) {
    Panel below(steps, axis_over("loss", true, losses), 200);
    below.line(loss, Style::series, 0);
    int row = 0;
    for (const auto& [x, rung] : rungs) {
      above.vertical(x, "");
      below.vertical(x, rungs.size() <= 10 ? figure(rung) : "", row++ % 3);
    }
    picture.add(above);
    picture.add(below);
    picture.note(
        "Vertical lines: a new rung begins, with the share of the gel dose that void may have. The "
        "loss of a rung is 0 where its line ends.");
  } else {
    picture.add(above);
  }
  return picture.svg();
}

std::string height_svg(const Printed& p) {
  const std::vector<SliceContrast> slices = contrast_of_slices(p);
  std::vector<Point> contrast, least, most;
  std::vector<double> contrasts{1}, doses{p.figures.gel_dose_mj_cm3};
  for (const SliceContrast& s : slices) {
    contrast.push_back({s.z_mm, s.contrast});
    least.push_back({s.z_mm, s.min_gel});
    most.push_back({s.z_mm, s.max_void});
    if (std::isfinite(s.contrast)) contrasts.push_back(s.contrast);
    for (const double d : {s.min_gel, s.max_void}) {
      if (std::isfinite(d)) doses.push_back(d);
    }
  }
  const double half = 0.5 * p.job.sampling.voxel_mm;
  const chart::Axis z{"z, mm from the optical axis", false, slices.front().z_mm - half,
                      slices.back().z_mm + half};
  Picture picture(
      "Contrast over the height",
      "Contrast of each slice, and its doses: the least of the part and the most of void.");
  // Far above what counts, a slice of its own says nothing more.
  chart::Axis y = axis_over("contrast of the slice", false, contrasts);
  y.high = std::min(y.high, 5.0);
  for (Point& c : contrast) c.y = std::isnan(c.y) ? c.y : std::min(c.y, y.high);
  Panel above(z, y, 200, false);
  above.line(contrast, Style::fit);
  above.horizontal(1, "void gels below");
  Panel below(z, axis_over("dose, mJ/cm³", false, doses, true), 220);
  below.line(least, Style::series, 1);
  below.line(most, Style::series, 0);
  below.horizontal(p.figures.gel_dose_mj_cm3, "gels");
  for (std::size_t i = 0; slices.size() == 1 && i < 1; ++i) {
    above.dot(contrast[0]);
    below.point(least[0], 1);
    below.point(most[0], 0);
  }
  picture.legend_line(Style::series, "least dose of the part", 1);
  picture.legend_line(Style::series, "most dose of void", 0);
  picture.add(above);
  picture.add(below);
  picture.note(
      std::string(slices_share_light(p.job.printer, p.job.resin)
                      ? "Light of a slice reaches others, too."
                      : "Slices light each other not at all; one "
                        "exposure serves all.") +
      " The contrast of the print is the least dose of the part anywhere over the most of void "
      "anywhere.");
  return picture.svg();
}

/// Light of a job in mW/cm², and which part of it is to be shown.
struct Shine {
  const Bench bench;
  const std::vector<std::uint16_t>& levels;
  double most = 0;         ///< of all frames
  int first = 0, end = 0;  ///< pixels that are ever brighter than black
  int low = 0, high = 0;   ///< rows of light: [low, high)

  explicit Shine(const TomoJob& job)
      : bench(make_bench(job.printer, job.resin, job.sampling)), levels(job.levels) {
    const TomoGrid& g = bench.grid;
    first = g.pixels;
    low = g.light_rows();
    std::uint16_t brightest = 0;
    for (int m = 0; m < g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int z = 0; z < g.light_rows(); ++z) {
          const std::uint16_t level = levels[g.pixel(m, i, z)];
          if (level == 0) continue;
          brightest = std::max(brightest, level);
          first = std::min(first, i);
          end = std::max(end, i + 1);
          low = std::min(low, z);
          high = std::max(high, z + 1);
        }
      }
    }
    most = bench.mw_cm2[brightest];
    if (end == 0) {
      first = low = 0;
      end = g.pixels;
      high = g.light_rows();
    }
  }
  /// Paler than in proportion, so that weak light is seen.
  std::uint8_t grey(double sum, int count) const {
    const double share = most > 0 ? sum / count / most : 0;
    return static_cast<std::uint8_t>(std::lround(255 * std::sqrt(std::clamp(share, 0.0, 1.0))));
  }
};

/// A picture of this size of columns x rows numbers, `value(column, row)`, which are averaged where
/// there are more than pixels, and repeated where there are fewer.
template <typename Value>
ColourImage grey_image(const Shine& shine, int columns, int rows, int width, int height,
                       Value value) {
  ColourImage image{width, height, {}};
  const auto range = [](int i, int pixels, int n) {
    const auto from = static_cast<int>(static_cast<std::int64_t>(i) * n / pixels);
    const auto to = static_cast<int>(static_cast<std::int64_t>(i + 1) * n / pixels);
    return std::pair(from, std::max(from + 1, to));
  };
  for (int py = 0; py < image.height_px; ++py) {
    const auto [r0, r1] = range(py, image.height_px, rows);
    for (int px = 0; px < image.width_px; ++px) {
      const auto [c0, c1] = range(px, image.width_px, columns);
      double sum = 0;
      for (int r = r0; r < r1; ++r) {
        for (int c = c0; c < c1; ++c) sum += value(c, r);
      }
      image.rgb.insert(image.rgb.end(), 3, shine.grey(sum, (r1 - r0) * (c1 - c0)));
    }
  }
  return image;
}

/// `most` or fewer, a whole number to each of `n` where there is room.
int whole_times(int n, int most) { return n <= most ? n * (most / n) : most; }

Markup light_pictures(const Printed& p, const ExecutionContext& context) {
  const Shine shine(p.job);
  const TomoGrid& g = shine.bench.grid;
  // The slice where contrast is least.
  int slice = g.slices / 2;
  double least = std::numeric_limits<double>::infinity();
  const std::vector<SliceContrast> slices = contrast_of_slices(p);
  for (int z = 0; z < g.slices; ++z) {
    const double c = slices[static_cast<std::size_t>(z)].contrast;
    if (c < least) {
      least = c;
      slice = z;
    }
  }
  const int row = row_of_slice(shine.bench, slice);
  const auto light = [&](int m, int i, int z) {
    return shine.bench.mw_cm2[p.job.levels[g.pixel(m, i, z)]];
  };
  const int columns = shine.end - shine.first, rows = shine.high - shine.low;
  const std::string scale = fmt::format(
      "White is the brightest pixel of all frames, {} mW/cm²; greys show the square root.",
      figure(shine.most));
  Markup html = markup(
      R"(<h2>Light</h2><p class="dim">Columns {} to {} of the image, where there is light, are shown. {}</p>)",
      shine.bench.window.first_column + shine.bench.window.wide * shine.first,
      shine.bench.window.first_column + shine.bench.window.wide * shine.end - 1, scale);
  context.check_cancelled();
  const std::string words = fmt::format(
      "Sinogram of the slice at z = {:.3f} mm, where contrast is least: angles 0 to 360° downwards, "
      "pixels across.",
      slices[static_cast<std::size_t>(slice)].z_mm);
  const ColourImage sinogram =
      grey_image(shine, columns, g.angles, whole_times(columns, 640), whole_times(g.angles, 480),
                 [&](int c, int r) { return light(r, shine.first + c, row); });
  html += captioned_image(sinogram, words) + markup(R"(<h3>Frames</h3><div class="strip">)");
  constexpr int kFrames = 8;
  // True to scale.
  const double width_mm = columns * shine.bench.window.wide * p.job.printer.pixel_x_um * 1e-3,
               height_mm = g.coupled()
                               ? rows * shine.bench.window.high * p.job.printer.pixel_y_um * 1e-3
                               : rows * p.job.sampling.voxel_mm;
  const double per_mm = std::min(480 / width_mm, 240 / height_mm);
  const int width = std::max(1, static_cast<int>(std::lround(width_mm * per_mm))),
            height = std::max(1, static_cast<int>(std::lround(height_mm * per_mm)));
  for (int k = 0; k < std::min(kFrames, g.angles); ++k) {
    context.check_cancelled();
    const int frame = k * g.angles / std::min(kFrames, g.angles);
    const int m = shine.bench.frame_of_angle(frame);
    const ColourImage image = grey_image(shine, columns, rows, width, height, [&](int c, int r) {
      return light(m, shine.first + c, shine.high - 1 - r);
    });
    html +=
        captioned_image(image, fmt::format("frame {}, {:.1f}°", frame, 360.0 * frame / g.angles));
  }
  return html +
         markup(
             R"(</div><p class="dim">As seen from the projector, in the order in which they are shown while the vial turns {}; each for {} s of a turn of {} s.</p>)",
             name_of(p.job.printer.rotation->direction),
             figure(shine.bench.exposure.turn_s / g.angles), figure(shine.bench.exposure.turn_s));
}

/// What of a print is shown in the round.
detail::RoundSource round_of(const Printed& p) {
  const Box<std::uint8_t>& part = p.job.part;
  const double gel = p.figures.gel_dose_mj_cm3;
  detail::RoundSource source;
  source.nx = part.nx;
  source.ny = part.ny;
  source.nz = part.nz;
  source.voxel_mm = p.job.sampling.voxel_mm;
  source.kept = [&, beyond = beyond_walls(*p.job.printer.vial, part.nx, source.voxel_mm)](
                    std::size_t k, int x, int y) {
    const std::size_t column = static_cast<std::size_t>(y) * static_cast<std::size_t>(part.nx) +
                               static_cast<std::size_t>(x);
    if (!beyond.empty() && beyond[column]) return Kept::neither;
    if (!p.job.insert.values.empty() && p.job.insert.values[k] > 0) return Kept::insert;
    if (!in_resin(part, x, y)) return Kept::neither;
    return part.values[k] == 255 ? Kept::part : part.values[k] == 0 ? Kept::empty : Kept::neither;
  };
  // The dose grows evenly.
  source.share_of_time = [&p, gel](std::size_t k) {
    const double d = p.dose.values[k];
    // What gels within the print says so, whatever was rounded.
    return !(d > 0) ? kNever : d >= gel ? std::min(1.0, gel / d) : std::max(gel / d, kLater);
  };
  source.has_part = [&](std::size_t k) { return part.values[k] > 0; };
  return source;
}

}  // namespace

std::vector<SliceContrast> contrast_of_slices(const Printed& p) {
  const Box<std::uint8_t>& part = p.job.part;
  std::vector<SliceContrast> slices;
  for (int z = 0; z < part.nz; ++z) {
    SliceContrast s{p.job.sampling.z_mm(z), kNothing, kNothing, kNothing};
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        const std::size_t k = part.at(z, y, x);
        if (!in_resin(part, x, y)) continue;
        if (!p.job.insert.values.empty() && p.job.insert.values[k] > 0) continue;
        const double d = p.dose.values[k];
        // Comparisons with NaN are false: the first one counts.
        if (part.values[k] == 255 && !(d >= s.min_gel)) s.min_gel = d;
        if (part.values[k] == 0 && !(d <= s.max_void)) s.max_void = d;
      }
    }
    s.contrast = s.min_gel / s.max_void;
    slices.push_back(s);
  }
  return slices;
}

GelTimes gel_times(const Printed& p, int voxels_per_cell) {
  return detail::gel_cells(round_of(p), voxels_per_cell);
}

std::string report_page(const Printed& p, const std::string& title,
                        const ExecutionContext& context) {
  const TomoJob& job = p.job;
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  Page page(title, {page_tiles_css, detail::page_print_css,
                    ".drawn{display:block;min-width:56rem;margin:0 auto}"});
  page += markup(
      R"(<p>{} frames of {} x {} pixels, shown in each of {} turns of {} s, for a part of {} voxels of {:g} mm.</p><p class="dim">Printer {} ({} to {} mW/cm², {} mm of resin from axis to wall), resin {} (absorbs {} of the light per mm, gels at {} mJ/cm³).</p>)",
      bench.grid.angles, bench.frame_width, bench.frame_height, job.turns,
      figure(bench.exposure.turn_s), text::count(static_cast<std::int64_t>(p.figures.metrics.gel)),
      job.sampling.voxel_mm, job.printer.name, figure(bench.mw_cm2.front()),
      figure(bench.mw_cm2.back()), figure(bench.radius_mm), job.resin.name,
      percent(1 - std::exp(-absorption_per_mm(job.resin))), figure(bench.exposure.critical_mj_cm3));
  page += markup("{}<h2>Figures</h2>{}", tiles(p.figures), figures_table(p));

  const std::vector<PrintSection> sections = sections_of(p, middle_planes(p));
  std::size_t missing = 0, gelled = 0;
  for (const PrintSection& section : sections) {
    missing += section.missing();
    gelled += section.gelled();
  }
  context.check_cancelled();
  page += markup(
      "<h2>Dose against target</h2>{}",
      drawing(sections_svg(sections, ColouredBy::dose, "Through the middle of the part"),
              fmt::format("In these planes {} voxels of the part are missing, and {} of void gel.",
                          missing, gelled)));
  page += markup(R"(<h2>Doses</h2><div class="views">{}{}</div>)",
                 drawing(histogram_svg(p), "The whole print; grey voxels are in neither."),
                 drawing(height_svg(p), "Every slice by itself."));
  page += light_pictures(p, context);
  page +=
      markup("<h2>How the solve went</h2>{}",
             job.history.empty()
                 ? markup(R"(<p class="dim">This job does not say how its light was found.</p>)")
                 : drawing(convergence_svg(job.history), "As the job holds it."));
  detail::add_round(page, round_of(p),
                    {.time_s = p.figures.print_time_s,
                     .turns = p.figures.turns,
                     .insert = job.printer.vial->traced() ? !job.printer.vial->rods.empty()
                                                          : !job.insert.values.empty(),
                     .grows = "Doses are taken to grow evenly, as they do turn by turn; beyond "
                              "100 % the print would go on at the same light."});
  page += markup(R"(<p class="dim">slicecorr {}</p>)", slicecorr::version);
  return page.html() + "\n";
}

}  // namespace slicecorr::tomo
