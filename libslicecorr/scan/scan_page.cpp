// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "scan/page_text.hpp"
#include "scan/vectors.hpp"
#include "slicecorr/scan.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr {

using namespace detail;
using page::captioned;
using page::drawing;
using page::markup;
using page::Markup;

namespace {

constexpr int kCells = 80;  ///< along the longest side, in the round

std::string words_of(const Deviation& d) {
  return d.against == "design" ? "the design" : "what was predicted to print";
}

/// Places of a deviation in cells: their mean, and which way the surface faces.
nlohmann::json cells_of(const Deviation& d, const PointBox& box, double side,
                        const std::array<int, 3>& counts) {
  struct Cell {
    double um = 0, points = 0;
    Point3 normal{};
  };
  std::map<std::int64_t, Cell> cells;
  for (std::size_t i = 0; i < d.places.size(); ++i) {
    std::array<std::int64_t, 3> at{};
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] = std::clamp<std::int64_t>(
          static_cast<std::int64_t>(std::floor((d.places[i][k] - box.low[k]) / side)), 0,
          counts[k] - 1);
    }
    // Rows of images run against y of the plate.
    at[1] = counts[1] - 1 - at[1];
    Cell& cell = cells[(at[2] * counts[1] + at[1]) * counts[0] + at[0]];
    cell.um += static_cast<double>(d.off_um[i]);
    cell.points += 1;
    for (std::size_t k = 0; k < 3; ++k) {
      cell.normal[k] += (k == 1 ? -1 : 1) * static_cast<double>(d.normals[i][k]);
    }
  }
  nlohmann::json j = {{"against", d.against}};
  auto at = nlohmann::json::array(), um = at, normals = at;
  for (const auto& [index, cell] : cells) {
    at.push_back(index);
    um.push_back(std::round(10 * cell.um / cell.points) / 10);
    const Point3 n = scaled(cell.normal, 10 / std::max(length(cell.normal), 1e-9));
    for (const double c : n) normals.push_back(static_cast<int>(std::lround(c)));
  }
  j["at"] = std::move(at);
  j["um"] = std::move(um);
  j["normals"] = std::move(normals);
  return j;
}

/// Where surfaces and the points of a scan meet a plane.
class SectionDrawing {
 public:
  /// The plane of all points whose coordinate `axis` (0: x, 1: y) is `at`.
  SectionDrawing(const PointBox& box, std::size_t axis, double at) : axis_(axis), at_(at) {
    const std::size_t across = 1 - axis;
    left_ = box.low[across];
    width_ = box.high[across] - left_;
    height_ = box.high[2];
    scale_ = std::min(600 / std::max(width_, 1e-9), 420 / std::max(height_, 1e-9));
  }
  void outline(const TriangleMesh& mesh, std::string_view kind) {
    std::string path;
    for (const auto& t : mesh.triangles) {
      std::array<Point3, 2> ends{};
      std::size_t found = 0;
      for (std::size_t i = 0; i < 3 && found < 2; ++i) {
        const Point3 &a = mesh.vertices[t[i]], &b = mesh.vertices[t[(i + 1) % 3]];
        if ((a[axis_] < at_) == (b[axis_] < at_)) continue;
        ends[found++] = sum(a, difference(b, a), (at_ - a[axis_]) / (b[axis_] - a[axis_]));
      }
      if (found == 2) {
        path += fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}", x(ends[0]), y(ends[0]), x(ends[1]),
                            y(ends[1]));
      }
    }
    body_ += fmt::format(R"(<path class="{}" d="{}"/>)", kind, path);
  }
  void point(const Point3& p) {
    if (std::abs(p[axis_] - at_) > 0.004 * std::max(width_, height_) || x(p) < -6 || x(p) > 616)
      return;
    if (y(p) < -6 || y(p) > 436) return;
    points_ += fmt::format("M{:.1f} {:.1f}h0", x(p), y(p));
  }
  std::string svg() const {
    return fmt::format(
        R"(<svg class="outlines" viewBox="-6 -6 {:.0f} {:.0f}" role="img" aria-label="Section">{}<path class="scan" d="{}"/></svg>)",
        width_ * scale_ + 12, height_ * scale_ + 12, body_, points_);
  }

 private:
  double x(const Point3& p) const { return (p[1 - axis_] - left_) * scale_; }
  double y(const Point3& p) const { return p[2] * scale_; }
  std::size_t axis_;
  double at_, left_ = 0, width_ = 0, height_ = 0, scale_ = 1;
  std::string body_, points_;
};

Markup table_of(std::string_view label, const std::vector<DeviationFigures>& groups) {
  page::Table table("", label);
  table.columns(label, "points", "mean, um", "mean of absolute values", "95 % within", "largest");
  for (const DeviationFigures& f : groups) {
    if (f.points == 0) continue;
    table.row(f.name, f.points, fmt::format("{:+.1f}", f.mean_um),
              fmt::format("{:.1f}", f.mean_abs_um), fmt::format("{:.1f}", f.p95_um),
              fmt::format("{:.1f}", f.largest_um));
  }
  return table;
}

Markup histogram_of(const Deviation& d) {
  constexpr int bins = 60;
  const double reach = std::max(1.0, 1.2 * d.all.p95_um), step = 2 * reach / bins;
  std::vector<double> counts(bins, 0.0);
  for (const float um : d.off_um) {
    const double bin = (static_cast<double>(um) + reach) / step;
    ++counts[static_cast<std::size_t>(std::clamp(std::floor(bin), 0.0, bins - 1.0))];
  }
  std::vector<chart::Point> line;
  for (int i = 0; i < bins; ++i) {
    const double share = 100 * counts[static_cast<std::size_t>(i)] /
                         std::max(1.0, static_cast<double>(d.off_um.size()));
    line.push_back({-reach + i * step, share});
    line.push_back({-reach + (i + 1) * step, share});
  }
  std::vector<double> shares;
  shares.reserve(line.size());
  for (const chart::Point& p : line) shares.push_back(p.y);
  chart::Picture picture("Against " + words_of(d),
                         "Histogram of the distances between scan and " + words_of(d));
  chart::Panel panel({"too little, below 0; too much, above 0, um", false, -reach, reach},
                     chart::axis_over("% of the points", false, shares, true), 180);
  panel.line(line, chart::Style::series, 0);
  panel.vertical(0, "");
  picture.add(panel);
  picture.note("What lies farther off is in the outermost steps.");
  return drawing(picture.svg());
}

Markup lists_of(const Deviation& d) {
  Markup html;
  std::vector<std::string> worst, unseen;
  for (const WorstPlace& w : d.worst) {
    worst.push_back(fmt::format("{:+.1f} um at {:.3f}, {:.3f}, {:.3f} mm", w.deviation_um,
                                w.place[0], w.place[1], w.place[2]));
  }
  for (const UnseenPlace& u : d.unseen) {
    unseen.push_back(fmt::format("{:.3g} mm² about {:.2f}, {:.2f}, {:.2f} mm", u.area_mm2,
                                 u.place[0], u.place[1], u.place[2]));
  }
  html += markup("<h3>Worst places</h3><ol>{}</ol>", page::items(worst));
  html += markup("<h3>Not seen by the scan: {:.1f} % of the surface</h3><ul>{}</ul>",
                 100 * d.unseen_share, page::items(unseen));
  if (d.beside > 0) {
    html += markup(
        "<p>{} points lie more than {:.0f} um from the surface: supports, dust or what broke off. They "
        "are counted nowhere else.</p>",
        d.beside, d.reach_um);
  }
  return html;
}

}  // namespace

std::string scan_page(const ScanComparison& comparison, const Scan& scan,
                      const std::vector<const TriangleMesh*>& surfaces) {
  const std::string name = std::filesystem::path(comparison.scan).filename().string();
  page::Page page(
      name + " measured",
      {page::page_tiles_css,
       ".outlines{width:100%;max-width:620px}.outlines path{fill:none;stroke-linecap:round}"
       ".outlines .design{stroke:#777;stroke-width:1.4}.outlines .predicted{stroke:#0b57d0;stroke-width:1}"
       ".outlines .scan{stroke:#d62828;stroke-width:1.6}#solid-canvas{width:100%;height:26rem}"});
  page::Tiles tiles;
  for (const Deviation& d : comparison.deviations) {
    tiles.add(fmt::format("{:.1f} um", d.all.mean_abs_um), "mean distance from " + words_of(d));
    tiles.add(fmt::format("{:.1f} um", d.all.p95_um),
              "95 % of the points are within, of " + words_of(d));
  }
  page += tiles;
  page += markup("<p>{} points, {}. Laid onto {}, by {} rounds.</p>", comparison.points,
                 comparison.triangles > 0 ? fmt::format("from {} triangles", comparison.triangles)
                                          : std::string("as they are"),
                 comparison.posed_by == "design" ? "the design" : "what was predicted to print",
                 comparison.registration.rounds);
  page += markup("<ul>{}</ul>", page::items(comparison.notes));
  page += Markup::raw(detail::page_scan_html);
  PointBox box;
  for (const TriangleMesh* surface : surfaces) {
    for (const Point3& v : surface->vertices) box.add(v);
  }
  page += markup(
      R"(<h2>Sections</h2><p class="key dim">Platform up. Grey: design; blue: predicted; red: points of the scan.</p>)");
  for (const std::size_t axis : {std::size_t{1}, std::size_t{0}}) {
    // Not the very middle, where edges of meshes lie.
    const double at = box.low[axis] + 0.4931 * (box.high[axis] - box.low[axis]);
    SectionDrawing section(box, axis, at);
    for (std::size_t i = 0; i < surfaces.size(); ++i) {
      section.outline(*surfaces[i], comparison.deviations[i].against);
    }
    for (const Point3& p : scan.points) section.point(comparison.registration.pose.of(p));
    page += captioned(
        Markup::raw(section.svg()),
        markup("{} = {:.3f} mm, along {}", axis == 0 ? "x" : "y", at, axis == 0 ? "y" : "x"));
  }
  for (const Deviation& d : comparison.deviations) {
    page += markup("<h2>Against {}</h2>", words_of(d));
    page += table_of("the surface", d.facing);
    page += table_of("depth of the gap, of faces towards the platform", d.gaps);
    page += table_of("height from the platform", d.heights);
    page += histogram_of(d);
    page += lists_of(d);
  }
  const Point3 size = difference(box.high, box.low);
  const double side = std::max({size[0], size[1], size[2], 1e-6}) / kCells;
  std::array<int, 3> counts{};
  for (std::size_t k = 0; k < 3; ++k) counts[k] = static_cast<int>(size[k] / side) + 1;
  nlohmann::json data;
  data["cells"] = counts;
  data["sizeMm"] = std::array<double, 3>{side, side, side};
  data["sides"] = nlohmann::json::array();
  double scale = 1;
  for (const Deviation& d : comparison.deviations) {
    data["sides"].push_back(cells_of(d, box, side, counts));
    scale = std::max(scale, d.all.p95_um);
  }
  data["scaleUm"] = scale;
  page.scripts("scan-data", data.dump(), {page::page_round_js, detail::page_scan_js});
  return page.html() + "\n";
}

}  // namespace slicecorr
