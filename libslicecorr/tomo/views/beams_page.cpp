// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/beams_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/embed.hpp"
#include "slicecorr/tomo/section.hpp"
#include "slicecorr/version.hpp"
#include "support/chart/chart.hpp"
#include "support/numbers/bracket.hpp"
#include "support/page/html_page.hpp"
#include "support/text/display_text.hpp"
#include "tomo/views/dose_histogram.hpp"
#include "tomo/views/gel_cells.hpp"
#include "tomo/views/page_text.hpp"

namespace slicecorr::tomo {

namespace {

using chart::figure;
using namespace page;

/// Pixels along the longer side of a picture of a beam.
constexpr int kImagePx = 260;

std::string count(std::size_t n) { return text::count(static_cast<std::int64_t>(n)); }

std::string seconds(double s) { return std::isfinite(s) ? figure(s) + " s" : "never"; }

/// The light that gels in the time of the exposure, mW/cm².
double gelling_mw_cm2(const BeamReport& r) {
  const GelTimeOf time = time_to_gel_of(r.job.resin);
  return halved_by_ratio({1e-9, 1e9}, 100, 1,
                         [&](double mw_cm2) { return time(mw_cm2) > r.job.exposure_s; })
      .high;
}

Markup figures_table(const BeamReport& r) {
  Table table("figures");
  table.columns("Figure", "Value", "What it means");
  const BeamFigures& f = r.figures;
  const double light = r.job.brightest_mw_cm2;
  table.row("Contrast", std::isfinite(f.contrast) ? figure(f.contrast) : "outside is dark",
            "least light of the part over most outside, as the displays show it");
  table.row("Contrast of the images",
            std::isfinite(r.print.figures.contrast) ? figure(r.print.figures.contrast)
                                                    : "outside is dark",
            "the same without grey levels and without the light of black");
  if (std::isfinite(r.print.contrast_bound)) {
    table.row("Bound", figure(r.print.contrast_bound),
              "no images of these beams have a higher contrast");
  }
  table.row("Least light of the part", figure(f.least_inside * light) + " mW/cm²",
            "gels last: " + seconds(r.job.window.first_s));
  table.row("Most light outside", figure(f.most_outside * light) + " mW/cm²",
            "gels first: " + seconds(r.job.window.last_s));
  table.row("Exposure", seconds(r.job.exposure_s), "what the job asks for, or would print best");
  table.row(
      "Overlap", figure(f.jaccard),
      "Jaccard index of what gels and what should, when all of the part has gelled; 1 is all right");
  table.row("Best overlap", figure(f.best_jaccard), "the same at the exposure that suits best");
  table.row("Overlap of the hull", figure(r.print.hull_jaccard),
            fmt::format("of what silhouettes mark out, which has {} cells too many",
                        count(r.print.hull_cells)));
  table.row("Outside that gels with the part",
            fmt::format("{} of {} cells", count(f.wrong_cells), count(f.outside_cells)),
            "cells with at least the light of the part's darkest one");
  table.row("Absorption", figure(r.job.setup.alpha_per_mm) + " / mm",
            fmt::format("of light that crosses the vat {} is left along x",
                        figure(std::exp(-r.job.setup.alpha_per_mm * r.job.vat.inside_mm[0]))));
  return table;
}

Markup tiles(const BeamReport& r) {
  Tiles tiles;
  const bool good = r.job.window.open();
  tiles.add(good ? "prints as designed" : "not as designed",
            good ? "all of the part gels before anything else does"
                 : "something outside gels before all of the part does",
            good ? "good" : "bad");
  tiles.add(std::isfinite(r.figures.contrast) ? figure(r.figures.contrast) : "∞", "contrast");
  if (good) {
    tiles.add(figure(r.job.exposure_s) + " s",
              fmt::format("exposure; from {} to {}", seconds(r.job.window.first_s),
                          seconds(r.job.window.last_s)));
  }
  tiles.add(figure(r.figures.best_jaccard), "best overlap with the part");
  return tiles;
}

ColourImage picture_of(const GreyImage& grey) {
  const int longest = std::max(grey.width_px, grey.height_px);
  const int scale = std::max(1, kImagePx / longest);
  const int every = std::max(1, (longest + 2 * kImagePx - 1) / (2 * kImagePx));
  ColourImage image{
      std::max(1, grey.width_px / every) * scale, std::max(1, grey.height_px / every) * scale, {}};
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {
      const std::size_t at =
          static_cast<std::size_t>(y / scale * every) * static_cast<std::size_t>(grey.width_px) +
          static_cast<std::size_t>(x / scale * every);
      image.rgb.insert(image.rgb.end(), 3, grey.pixels[at]);
    }
  }
  return image;
}

Markup beam_pictures(const BeamReport& r) {
  Markup html = markup(
      R"(<h2>Beams</h2><p class="dim">As seen from their displays, a cell of {:g} mm to a square. White is {} mW/cm² at the wall.</p><div class="strip">)",
      r.job.setup.cell_mm, figure(r.job.brightest_mw_cm2));
  for (std::size_t k = 0; k < r.print.images.size(); ++k) {
    const BeamImage& image = r.print.images[k];
    const BeamWay& way = way_of(r.job.vat, image.beam);
    std::string words = fmt::format("from {}, display {}", side_of(image.beam), way.display);
    if (k < r.job.shown.laser_mw.size()) {
      words +=
          fmt::format("; {} mW of laser light, {} % of it on the image",
                      figure(r.job.shown.laser_mw[k]), figure(100 * r.job.shown.efficiency[k]));
    }
    html += slicecorr::detail::captioned_image(picture_of(seen_image(image, way)), words);
  }
  return html + markup("</div>");
}

/// Cells that are drawn: the part and what gels, with a margin.
struct Extent {
  int low[3], high[3];
};
Extent extent_of(const BeamReport& r, double gels) {
  const Box<std::uint8_t>& part = r.part;
  const int sizes[3] = {part.nx, part.ny, part.nz};
  Extent e{{part.nx, part.ny, part.nz}, {-1, -1, -1}};
  std::size_t k = 0;
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x, ++k) {
        if (part.values[k] == 0 && r.light.values[k] * r.job.brightest_mw_cm2 < gels) continue;
        const int at[3] = {x, y, z};
        for (int i = 0; i < 3; ++i) {
          e.low[i] = std::min(e.low[i], at[i]);
          e.high[i] = std::max(e.high[i], at[i]);
        }
      }
    }
  }
  for (int i = 0; i < 3; ++i) {
    const int margin = std::max(2, sizes[i] / 12);
    e.low[i] = std::max(0, e.low[i] - margin);
    e.high[i] = std::min(sizes[i] - 1, e.high[i] + margin);
  }
  return e;
}

/// The middle of the part along each axis.
std::array<int, 3> middle_of(const Box<std::uint8_t>& part) {
  int low[3] = {part.nx, part.ny, part.nz}, high[3] = {0, 0, 0};
  std::size_t k = 0;
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x, ++k) {
        if (part.values[k] != 255) continue;
        const int at[3] = {x, y, z};
        for (int i = 0; i < 3; ++i) {
          low[i] = std::min(low[i], at[i]);
          high[i] = std::max(high[i], at[i]);
        }
      }
    }
  }
  return {(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2};
}

Markup sections(const BeamReport& r, double gels) {
  const Box<std::uint8_t>& part = r.part;
  const double cell = r.job.setup.cell_mm;
  const double per_light = curing_absorption_per_cm(r.job.resin) * r.job.exposure_s;
  const Extent e = extent_of(r, gels);
  const std::array<int, 3> middle = middle_of(part);
  const int sizes[3] = {part.nx, part.ny, part.nz};
  std::vector<PrintSection> drawn;
  std::size_t missing = 0, gelled = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int across = axis == 0 ? 1 : 0, up = axis == 2 ? 1 : 2;
    PrintSection s;
    s.axis = axis == 0 ? Axis::x : axis == 1 ? Axis::y : Axis::z;
    const auto m = middle[static_cast<std::size_t>(axis)];
    s.at_mm = (m - 0.5 * (sizes[axis] - 1)) * cell;
    s.width = e.high[across] - e.low[across] + 1;
    s.height = e.high[up] - e.low[up] + 1;
    s.voxel_mm = cell;
    s.gel_dose = gels * per_light;
    for (int row = 0; row < s.height; ++row) {
      for (int column = 0; column < s.width; ++column) {
        int at[3];
        at[axis] = m;
        at[across] = e.low[across] + column;
        at[up] = e.low[up] + row;
        const std::size_t k = part.at(at[2], at[1], at[0]);
        s.dose.push_back(
            static_cast<float>(r.light.values[k] * r.job.brightest_mw_cm2 * per_light));
        s.target.push_back(part.values[k]);
        s.matter.push_back(Matter::resin);
      }
    }
    missing += s.missing();
    gelled += s.gelled();
    drawn.push_back(std::move(s));
  }
  return markup(
      "<h2>Dose against target</h2>{}",
      drawing(sections_svg(drawn, ColouredBy::dose, "Through the middle of the part"),
              fmt::format("At the end of {} of exposure, from the vat's middle: in these "
                          "planes {} cells of the part are missing, and {} gel that should "
                          "not.",
                          seconds(r.job.exposure_s), missing, gelled)));
}

/// How many cells have how much light.
Markup histogram(const BeamReport& r, double gels) {
  double most = 0;
  for (const float v : r.light.values) most = std::max(most, v * r.job.brightest_mw_cm2);
  detail::DoseHistogram light(most, gels);
  for (std::size_t k = 0; k < r.part.values.size(); ++k) {
    if (r.part.values[k] == 255 || r.part.values[k] == 0) {
      light.add(r.light.values[k] * r.job.brightest_mw_cm2, r.part.values[k] == 255);
    }
  }
  const std::string svg = light.svg(
      {"Light of the part and outside",
       "How many cells have how much light, on a logarithmic scale.", "light, mW/cm²", "cells",
       "outside",
       "To the right of the line resin gels by the end of the exposure: all of the part should lie "
       "there, nothing else."});
  return markup(
      "<h2>Light</h2>{}",
      drawing(svg, "All cells of the vat; grey ones, which are partly part, are in neither."));
}

detail::RoundSource round_of(const BeamReport& r, const GelTimeOf& gel_time) {
  detail::RoundSource source;
  source.nx = r.part.nx;
  source.ny = r.part.ny;
  source.nz = r.part.nz;
  source.voxel_mm = r.job.setup.cell_mm;
  source.kept = [&r](std::size_t k, int, int) {
    const std::uint8_t v = r.part.values[k];
    return v == 255 ? Kept::part : v == 0 ? Kept::empty : Kept::neither;
  };
  source.has_part = [&r](std::size_t k) { return r.part.values[k] > 0; };
  source.share_of_time = [&r, &gel_time](std::size_t k) {
    return gel_time(r.light.values[k] * r.job.brightest_mw_cm2) / r.job.exposure_s;
  };
  return source;
}

}  // namespace

std::string beams_page(const BeamReport& r, const std::string& title,
                       const ExecutionContext& context) {
  Page page(title,
            {page_tiles_css, detail::page_print_css, ".strip img{image-rendering:pixelated}"});
  const auto& inside = r.job.vat.inside_mm;
  page += markup(
      R"(<p>{} images, shown at once by {} beams into a vat of {:g} x {:g} x {:g} mm, print a part of {} cells of {:g} mm.</p><p class="dim">Printer {}, resin {}. Light at a cell is the sum of all beams, each dimmed by the resin on its way from the wall.</p>)",
      name_of(r.job.setup.images), r.print.images.size(), inside[0], inside[1], inside[2],
      count(r.figures.part_cells), r.job.setup.cell_mm, r.job.printer.name, r.job.resin.name);
  page += tiles(r);
  if (!r.why_not.empty()) page += markup("<p><strong>Why not:</strong> {}.</p>", r.why_not);
  page += markup("<h2>Figures</h2>{}", figures_table(r));
  context.check_cancelled();
  page += beam_pictures(r);
  if (std::isfinite(r.job.exposure_s) && r.job.exposure_s > 0) {
    const double gels = gelling_mw_cm2(r);
    page += sections(r, gels);
    context.check_cancelled();
    page += histogram(r, gels);
    const GelTimeOf gel_time = time_to_gel_of(r.job.resin);
    detail::add_round(page, round_of(r, gel_time),
                      {.time_s = r.job.exposure_s,
                       .turns = 0,
                       .insert = false,
                       .grows = "A cell gels when its light has lasted for its time to gel: the "
                                "slider is also one over the light that counts; beyond 100 % the "
                                "exposure would go on."});
  } else {
    page += markup("<p>Some of the part gets no light at all, so no exposure prints it.</p>");
  }
  page += markup(R"(<p class="dim">slicecorr {}</p>)", slicecorr::version);
  return page.html() + "\n";
}

}  // namespace slicecorr::tomo
