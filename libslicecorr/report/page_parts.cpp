// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "report/page_parts.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "picture/embed.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

using namespace page;

namespace {

using Counts = std::vector<std::uint64_t>;

double share(std::uint64_t part, std::uint64_t all) {
  return all ? 100.0 * static_cast<double>(part) / static_cast<double>(all) : 0.0;
}

/// Bars of shares, before hatched and after filled, and the same as a table.
Markup histogram(const char* title, const char* axis, const std::vector<std::string>& names,
                 const Counts* before, const Counts& after) {
  constexpr double width = 520, height = 240, left = 46, ceiling = 34, floor = 190;
  const auto total = [](const Counts& c) {
    std::uint64_t sum = 0;
    for (const std::uint64_t n : c) sum += n;
    return sum;
  };
  const std::uint64_t all_after = total(after), all_before = before ? total(*before) : 0;
  double most = 1;
  for (std::size_t i = 0; i < after.size(); ++i) {
    most = std::max(most, share(after[i], all_after));
    if (before) most = std::max(most, share((*before)[i], all_before));
  }
  const double slot = (width - left - 8) / static_cast<double>(names.size());
  const auto y = [&](double percent) { return floor - percent / most * (floor - ceiling); };
  Markup svg = markup(
      R"(<svg viewBox="0 0 {} {}" class="plot small" role="img" aria-label="{}; the numbers are in the table below"><text x="{}" y="18" class="h">{}</text>)",
      width, height, title, left, title);
  for (const double percent : {0.0, most / 2, most}) {
    svg += markup(
        R"(<text x="{}" y="{:.1f}" class="tick" text-anchor="end">{:.3g} %</text><line class="grid" x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}"/>)",
        left - 5, y(percent) + 4, percent, left, width - 8, y(percent), y(percent));
  }
  Table table;
  table.column(axis);
  if (before) table.column("uncorrected");
  table.column("this stack");
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double x = left + slot * static_cast<double>(i);
    const auto bar = [&](const char* kind, double at, double percent) {
      if (percent <= 0) return;
      const double top = std::min(y(percent), floor - 1.5);  // rare ones are seen, too
      svg += markup(R"(<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)",
                    kind, at, top, slot * 0.4, floor - top);
    };
    if (before) bar("bar-before", x + slot * 0.08, share((*before)[i], all_before));
    bar("bar-after", x + slot * (before ? 0.5 : 0.3), share(after[i], all_after));
    svg += markup(R"(<text x="{:.1f}" y="{}" class="tick" text-anchor="middle">{}</text>)",
                  x + slot / 2, floor + 15, names[i]);
    table.row(names[i]);
    if (before) table.cells((*before)[i]);
    table.cells(after[i]);
  }
  svg += markup(R"(<text x="{}" y="{}" class="tick" text-anchor="middle">{}</text></svg>)",
                (left + width) / 2, floor + 34, axis);
  const Markup key = markup(
      R"(<span class="key"><b><i class="swatch-before"></i>uncorrected (outlined)</b> <b><i class="swatch-after"></i>this stack (filled)</b></span>)");
  return markup(
      "<figure>{}<figcaption>{}</figcaption><details><summary>Numbers</summary>{}</details></figure>",
      scrolled(svg), before ? key : Markup(), table);
}

struct ExampleGroup {
  FeatureExample first;
  int last_x;
};

/// Neighbours in a row with the same slices are one place.
std::vector<ExampleGroup> groups_of(const FeatureExamples& examples) {
  std::vector<ExampleGroup> list;
  auto sorted = examples.sorted();
  std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) {
    return std::tie(a.y, a.first, a.last, a.x) < std::tie(b.y, b.first, b.last, b.x);
  });
  for (const FeatureExample& e : sorted) {
    if (!list.empty()) {
      ExampleGroup& p = list.back();
      if (p.first.y == e.y && p.first.first == e.first && p.first.last == e.last &&
          p.last_x + 1 == e.x) {
        p.last_x = e.x;
        continue;
      }
    }
    list.push_back({e, e.x});
  }
  std::stable_sort(list.begin(), list.end(), [](const ExampleGroup& a, const ExampleGroup& b) {
    return std::tie(a.first.y, a.first.x, a.first.first) <
           std::tie(b.first.y, b.first.x, b.first.first);
  });
  return list;
}

std::string range(int from, int to) {
  return from == to ? fmt::format("{}", from) : fmt::format("{}–{}", from, to);
}

/// Lets the explorer, where there is one, show a voxel.
Markup go_button(int x, int y, int slice) {
  return markup(
      R"(<button type="button" class="go" data-x="{}" data-y="{}" data-n="{}" hidden>show</button>)",
      x, y, slice);
}

/// Where pixels and slices are.
struct Places {
  Grid grid;
  LayerHeights heights;
  double z_mm(int slice) const { return heights.place_um(slice, grid.layer_um) * 1e-3; }
};

Markup feature_table(const std::string& words, const FeatureExamples& examples, std::uint64_t count,
                     const Places& places, bool open) {
  if (count == 0) return markup("<p>{}: none.</p>", words);
  const Grid& grid = places.grid;
  const auto list = groups_of(examples);
  std::size_t listed = 0;
  for (const ExampleGroup& p : list) listed += static_cast<std::size_t>(p.last_x - p.first.x + 1);
  Table table({}, words, true);
  table.columns("image columns", "row", "slices", "x, mm", "y, mm", "z, mm", "look");
  for (const ExampleGroup& p : list) {
    const FeatureExample& e = p.first;
    const double x0 = e.x * grid.pixel_x_um * 1e-3, x1 = (p.last_x + 1) * grid.pixel_x_um * 1e-3;
    const double y = (grid.height_px - e.y - 0.5) * grid.pixel_y_um * 1e-3;
    table.begin();
    table.cells(range(e.x, p.last_x), e.y, range(e.first, e.last),
                fmt::format("{:.2f}–{:.2f}", x0, x1), fmt::format("{:.2f}", y),
                fmt::format("{:.3f}–{:.3f}", places.z_mm(e.first), places.z_mm(e.last + 1)),
                go_button((e.x + p.last_x) / 2, e.y, (e.first + e.last) / 2));
  }
  return markup("<details{}><summary>{}: {}{}</summary>{}</details>", open ? " open" : "", words,
                count, listed < count ? fmt::format(" (the first {} are listed)", listed) : "",
                table);
}

}  // namespace

Markup histograms(const ReportContent& c) {
  Markup html;
  const std::vector<double> errors{0, 0.01, 0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 1e9};
  const std::vector<std::string> error_names{"< .01", ".01", ".1",  ".3",  "1",    "3",
                                             "10",    "30",  "100", "300", "1000+"};
  const auto edges = [&](const char* title, Histogram Prediction::*of) {
    if ((c.after.*of).count() == 0) return;
    Counts before;
    if (c.before) before = ((*c.before).*of).coarse(errors);
    html += histogram(title, "um, from", error_names, c.before ? &before : nullptr,
                      (c.after.*of).coarse(errors));
  };
  edges("Height error of edges", &Prediction::height_error_um);
  edges("Distance of edges to the mesh", &Prediction::surface_error_um);
  edges("Error of outlines in the plane", &Prediction::plane_error_um);
  if (c.after.gap_contrast.count() > 0) {
    std::vector<double> contrasts;
    std::vector<std::string> names;
    for (int i = 0; i <= 10; ++i) {
      contrasts.push_back(0.1 * i);
      if (i < 10) names.push_back(fmt::format("{:.1f}", 0.1 * i));
    }
    const Counts after = c.after.gap_contrast.coarse(contrasts);
    Counts before;
    if (c.before) before = c.before->gap_contrast.coarse(contrasts);
    html += histogram("Contrast of gaps", "1 - least dose in the gap, from", names,
                      c.before ? &before : nullptr, after);
  }
  if (html.empty()) return html;
  return markup(R"(<h2>How it is spread</h2><div class="pair">{}</div>)", html);
}

Markup feature_lists(const ReportContent& c) {
  const Places places{c.info.grid, c.after.heights};
  Markup html = markup(
      "<h2>Lost and merged features</h2><p class=\"dim\">Counted per pixel column. A feature is "
      "lost when nothing of it prints, in pieces when light too weak leaves a crack inside it, a "
      "gap merged when nothing of it stays open.</p>");
  html +=
      feature_table("Lost, this stack", c.after.lost_examples, c.after.lost_features, places, true);
  const bool any_split = c.after.split_features > 0 || (c.before && c.before->split_features > 0);
  if (any_split) {
    html += feature_table("In pieces, this stack", c.after.split_examples, c.after.split_features,
                          places, true);
  }
  html += feature_table("Merged, this stack", c.after.merged_examples, c.after.merged_features,
                        places, true);
  const auto in_plane = [&](const Prediction& figures, const char* which, bool open) {
    if (figures.plane_error_um.count() == 0) return;
    html += feature_table(fmt::format("Closed up in the plane, {}", which),
                          figures.plane_closed_examples, figures.plane_closed, places, open);
    html += feature_table(fmt::format("Lines lost in the plane, {}", which),
                          figures.plane_lost_examples, figures.plane_lost, places, open);
  };
  in_plane(c.after, "this stack", true);
  if (c.before) {
    html += feature_table("Lost, uncorrected", c.before->lost_examples, c.before->lost_features,
                          places, false);
    if (any_split) {
      html += feature_table("In pieces, uncorrected", c.before->split_examples,
                            c.before->split_features, places, false);
    }
    html += feature_table("Merged, uncorrected", c.before->merged_examples,
                          c.before->merged_features, places, false);
    in_plane(*c.before, "uncorrected", false);
  }
  return html;
}

Markup dose_tables(const ReportContent& c) {
  if (c.after.regions.empty()) return {};
  Table table;
  table.columns("Region", "voxels", "wanted", "least", "mean", "greatest", "mean difference",
                "most below", "most above");
  for (const RegionDose& r : c.after.regions) {
    if (r.voxels == 0) {
      table.row(r.name, 0, "-", "-", "-", "-", "-", "-", "-");
      continue;
    }
    const std::string wanted =
        r.least_wanted == r.greatest_wanted
            ? fmt::format("{:.4g}", r.least_wanted)
            : fmt::format("{:.4g} to {:.4g}", r.least_wanted, r.greatest_wanted);
    table.row(r.name, r.voxels, wanted);
    for (const double dose : {r.least, r.mean(), r.greatest}) table.cell(markup("{:.4g}", dose));
    for (const double off : {r.mean_off(), r.most_below, r.most_above}) {
      table.cell(markup("{:.3g}", off));
    }
  }
  Markup html = markup(
      R"(<h2>Doses wanted, and those that print</h2>{}<p class="dim">Doses in the middle of voxels of features; 1 just gels. Near gaps a dose must come down to 1, however much is wanted.</p>)",
      table);
  for (const auto& s : c.sections) {
    if (s.dose_after.rgb.empty()) continue;
    html += markup(R"(<h3>Dose at {}</h3><p class="key dim">Platform up: )", s.place);
    for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const double dose = 1 + share * (c.most_wanted - 1);
      html += markup(R"(<b><i style="background:{}"></i>{:.3g}{}</b> )",
                     dose_colour(dose, c.most_wanted), dose, share == 1.0 ? " and more" : "");
    }
    html +=
        markup(R"(<b><i style="background:{}"></i>not gelled</b></p><div class="pair">{}{}</div>)",
               dose_colour(0.99, c.most_wanted),
               captioned_image(s.dose_wanted, "The doses that are wanted"),
               captioned_image(s.dose_after, "This stack: doses that print"));
  }
  return html;
}

Markup bodies_section(const Prediction& p) {
  if (!p.bodies) return {};
  const Bodies& b = p.bodies->printed;
  const std::vector<std::string> words = bodies_in_words(*p.bodies);
  if (words.empty() && b.cups_in_all == 0) return {};
  Markup html = markup("<h2>What hangs on nothing, and what is trapped</h2>");
  for (const std::string& sentence : words) html += markup("<p>{}.</p>", sentence);
  Table table("bodies");
  for (const std::string name : {"what", "from, um", "to, um", "size", "x, mm", "y, mm", "look"}) {
    table.column(name);
  }
  // A screen full; the figures beside the page have more of them.
  constexpr std::size_t most = 10;
  struct Voxel {
    int x, y, slice;
  };
  /// `middle`: where it is on the plate; `voxel`: one of it, for the explorer.
  const auto row = [&](const char* what, int first, const std::string& past,
                       const std::string& size, const PlatePlace& middle, const Voxel& voxel,
                       std::string_view kind) {
    table.begin(kind);
    table.head(markup("{}", what));
    table.cells(fmt::format("{:.6g}", b.slice_um(first)), past, size,
                fmt::format("{:.2f}", middle.x_mm), fmt::format("{:.2f}", middle.y_mm));
    table.cell(go_button(voxel.x, voxel.y, voxel.slice));
  };
  const auto um = [&](int slice) { return fmt::format("{:.6g}", b.slice_um(slice)); };
  for (std::size_t i = 0; i < std::min(most, b.islands.size()); ++i) {
    const Island& v = b.islands[i];
    row("hangs on nothing", v.first, v.until < 0 ? "never joined" : um(v.until),
        fmt::format("{:.4g} mm³", b.voxels_mm3(v.voxels)), b.place(v.column, v.row),
        {v.x, v.y, v.first}, "loose");
  }
  for (std::size_t i = 0; i < std::min(most, b.necks.size()); ++i) {
    const Neck& v = b.necks[i];
    row("hangs by too little", v.slice, "",
        fmt::format("{:.4g} mm³ by {:.3g} mm²", b.voxels_mm3(v.borne), b.pixels_mm2(v.voxels)),
        b.place(v.column, v.row), {static_cast<int>(v.column), static_cast<int>(v.row), v.slice},
        "loose");
  }
  for (std::size_t i = 0; i < std::min(most, b.sealed_cavities.size()); ++i) {
    const SealedCavity& v = b.sealed_cavities[i];
    row("sealed cavity", v.first, um(v.past), fmt::format("{:.4g} mm³", b.voxels_mm3(v.voxels)),
        b.place(v.column, v.row), {v.x, v.y, v.first}, {});
  }
  for (std::size_t i = 0; i < std::min(most, b.cups.size()); ++i) {
    const Cup& v = b.cups[i];
    row("cup", v.first, um(v.past), fmt::format("{:.4g} mm² wide", b.pixels_mm2(v.opening)),
        b.place(v.column, v.row), {v.x, v.y, v.first}, {});
  }
  html += table;
  if (std::max({b.islands_in_all, b.necks_in_all, b.sealed_in_all, b.cups_in_all}) > most) {
    html += markup(
        R"(<p class="dim">The largest of {} bodies on nothing, {} that hang by too little, {} cavities and {} cups.</p>)",
        b.islands_in_all, b.necks_in_all, b.sealed_in_all, b.cups_in_all);
  }
  if (!b.in_time) {
    html += Markup::raw(
        R"(<p class="dim">All is taken to gel while its own slice is shown: when it does is not known of this print.</p>)");
  } else if (b.time_step > 1) {
    html += markup(
        R"(<p class="dim">What hangs on nothing is looked for every {:.6g} um: what does so for less may not be listed.</p>)",
        b.slice_um(b.time_step));
  }
  return html;
}

int row_of_bodies(const Prediction& p) {
  if (!p.bodies) return -1;
  const Bodies& b = p.bodies->printed;
  // What makes a print go wrong comes first.
  if (!b.islands.empty()) return static_cast<int>(b.islands.front().row);
  if (!b.necks.empty()) return static_cast<int>(b.necks.front().row);
  if (!b.sealed_cavities.empty()) return static_cast<int>(b.sealed_cavities.front().row);
  const bool told = !b.cups.empty() && b.pixels_mm2(b.cups.front().opening) >= kCupToldMm2;
  return told ? static_cast<int>(b.cups.front().row) : -1;
}

Markup comparison_table(const ComparisonTable& comparison) {
  Table table;
  for (const std::string& name : comparison.columns) table.column(name);
  for (const auto& row : comparison.rows) table.row_of(row);
  Markup html = markup("<h2>Compared with other ways</h2>{}", table);
  if (!comparison.note.empty()) html += markup(R"(<p class="dim">{}</p>)", comparison.note);
  return html;
}

}  // namespace slicecorr::detail
