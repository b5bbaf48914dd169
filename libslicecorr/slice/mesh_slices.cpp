// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Slices are cut from what mesh_slices_make.cpp made of a mesh.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "mesh/half_edges.hpp"
#include "parallel/silent.hpp"
#include "slice/inset.hpp"
#include "slice/mesh_slices_parts.hpp"
#include "slice/refine.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/slice.hpp"
#include "support/numbers/release.hpp"

namespace slicecorr {

namespace {

/// Share of the volume from which on missing surface shows in the print: 1 % of a part 50 pixels
/// wide is half a pixel on one side.
constexpr double kMuch = 0.01;

/// In words how far the volume can be trusted where surface is missing; empty: it can.
std::string doubt_of(const SliceReport& r) {
  const double share = r.bridged_volume_mm3 / r.volume_mm3;
  if (!(share < 1)) return "so much surface is missing that the volume is a guess";
  if (share < 1e-4) return "less than 0.01 % of the volume depends on them";
  return fmt::format("up to {:.2g} % of the volume depends on them{}", 100 * share,
                     share < kMuch ? "" : ": close the mesh first");
}

}  // namespace

/// The edge heights of all columns. Lies beside the slices that it belongs to.
class MeshSlices::Heights final : public SliceSource {
 public:
  explicit Heights(const Impl& slices) : slices_(slices), grid_(slices.grid) { ++grid_.layers; }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return slices_.bounds; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    read_slices(band, 0, grid_.layers, sink);
  }
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override {
    const detail::BandEdges edges = slices_.edges_of(band);
    std::vector<std::uint8_t> rows(band.empty() ? 0
                                                : static_cast<std::size_t>(band.width()) *
                                                      static_cast<std::size_t>(band.height()));
    for (int n = first; n < past; ++n) {
      for (const auto& e : edges.at(n)) rows[e.column] = e.height;
      sink(n, edges.at(n).empty() ? nullptr : rows.data());
      for (const auto& e : edges.at(n)) rows[e.column] = 0;
    }
  }

 private:
  const Impl& slices_;
  Grid grid_;
};

MeshSlices::Impl::~Impl() = default;

/// The two edges of a triangle that this slice cuts. Edges begin at the corner with the lower
/// index, so that both triangles of an edge get the same bits; `meet` gives these, too.
void MeshSlices::Impl::set_edges(Cut& cut, int slice) const {
  const auto& t = triangles[cut.triangle];
  const double n = slice;
  double least_above = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint32_t a = t[k], b = t[k == 2 ? 0 : k + 1];
    const bool a_above = corners[a][kZ] >= n, b_above = corners[b][kZ] >= n;
    if (a_above) least_above = std::min(least_above, corners[a][kZ]);
    if (a_above == b_above) continue;
    const int way = b_above ? 0 : 1;
    if (a > b) std::swap(a, b);
    const Corner &p = corners[a], &q = corners[b];
    cut.x[way] = p[kX], cut.y[way] = p[kY], cut.z[way] = p[kZ];
    cut.dx[way] = q[kX] - p[kX], cut.dy[way] = q[kY] - p[kY], cut.dz[way] = q[kZ] - p[kZ];
  }
  cut.until = static_cast<int>(std::min(std::floor(least_above), static_cast<double>(cut.last)));
}

/// The triangles of these rows and slices, sorted by the first of the slices that cuts them.
std::vector<MeshSlices::Impl::Entry> MeshSlices::Impl::entries_of(int y0, int y1, int first,
                                                                  int past) const {
  const std::size_t first_bin = bin_of(y0), last_bin = bin_of(y1 - 1);
  std::vector<Entry> found;
  found.reserve(bin_begin[last_bin + 1] - bin_begin[first_bin]);
  std::vector<std::size_t> at(static_cast<std::size_t>(past - first) + 1, 0);
  for (std::size_t b = first_bin; b <= last_bin; ++b) {
    for (std::size_t i = bin_begin[b]; i < bin_begin[b + 1]; ++i) {
      Entry e = binned[i];
      e.span = {std::max(e.span.first, first), std::min(e.span.last, past - 1)};
      if (e.span.first > e.span.last) continue;
      const auto& t = triangles[e.triangle];
      if (b > first_bin && bins_of(t).first < b) continue;  // found in an earlier bin
      const Span span = slices_of(t, e.span, y0, y1);
      if (span.first > span.last) continue;
      found.push_back({e.triangle, span});
      ++at[static_cast<std::size_t>(span.first - first) + 1];
    }
  }
  for (std::size_t n = 1; n < at.size(); ++n) at[n] += at[n - 1];
  std::vector<Entry> sorted(found.size());
  for (const Entry& e : found) sorted[at[static_cast<std::size_t>(e.span.first - first)]++] = e;
  return sorted;
}

/// The edges of a band's columns; rows that no bin has are empty.
detail::BandEdges MeshSlices::Impl::edges_of(const PixelBox& band) const {
  std::vector<std::uint32_t> candidates;
  if (!band.empty()) {
    const std::size_t first_bin = bin_of(band.y0), last_bin = bin_of(band.y1 - 1);
    candidates.reserve(bin_begin[last_bin + 1] - bin_begin[first_bin]);
    for (std::size_t b = first_bin; b <= last_bin; ++b) {
      for (std::size_t i = bin_begin[b]; i < bin_begin[b + 1]; ++i) {
        const std::uint32_t t = binned[i].triangle;
        if (b > first_bin && bins_of(triangles[t]).first < b) continue;  // found in an earlier bin
        candidates.push_back(t);
      }
    }
  }
  return detail::edges_of_columns(
      {corners, triangles, grid.layers, tags, rule.plain() ? nullptr : &rule}, candidates, band);
}

MeshSlices::MeshSlices(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
                       const ExecutionContext& context, const EdgeDefects* edge_defects)
    : impl_(std::make_unique<Impl>()) {
  if (!(options.layer_um >= 1.0) || !(options.layer_um <= 1000.0)) {
    throw InputError(fmt::format("slice height {:g} um; expected 1 to 1000", options.layer_um));
  }
  if (mesh.triangles.empty()) throw InputError("there is no triangle to slice");
  impl_->antialias = options.antialias;
  impl_->made_for = options.shrinkage;
  impl_->raised_um = options.raised_um;
  if (printer.distortion) {
    mesh = detail::refined(std::move(mesh), straight_mm(*printer.distortion, printer));
    edge_defects = nullptr;  // of another mesh
    context.tell("outlines lie where pixels land: " + distortion_in_words(printer));
  }
  const EdgeDefects defects = edge_defects ? *edge_defects : detail::edge_defects_of(mesh, context);
  const std::vector<TriangleMesh::Share> shares = mesh.shares;
  impl_->place(std::move(mesh), printer, options, context);
  for (const std::uint32_t t : defects.flipped) {
    std::swap(impl_->triangles[t][1], impl_->triangles[t][2]);
  }
  impl_->report.turned_triangles = defects.flipped.size();
  impl_->open = defects.open;
  impl_->divide_solids(shares);
  context.check_cancelled();
  impl_->close_contours(context);
  if (options.edge_heights) impl_->heights = std::make_unique<const Heights>(*impl_);
  impl_->bin_triangles(context);
  const SliceReport& r = impl_->report;
  if (r.turned_triangles) {
    context.tell(
        fmt::format("{} triangles face the wrong way; cut as if turned", r.turned_triangles));
  }
  if (r.bridges) {
    context.tell(
        fmt::format("open contours in {} slices closed by {} bridges, the longest {:.3f} mm; {}",
                    r.bridged_slices, r.bridges, r.longest_bridge_mm, doubt_of(r)));
  }
}

MeshSlices::~MeshSlices() = default;
MeshSlices::MeshSlices(MeshSlices&&) noexcept = default;
const Grid& MeshSlices::grid() const { return impl_->grid; }
PixelBox MeshSlices::bounds() const { return impl_->bounds; }
bool MeshSlices::ends_below_last_node() const {
  if (!edge_heights()) return false;
  double highest = 0;
  for (const Impl::Corner& c : impl_->corners) highest = std::max(highest, c[Impl::kZ]);
  // In slices from the platform; nearer to the node than half a step of the byte is at it.
  return highest + 0.5 - impl_->grid.layers > 0.5 / 254;
}
const std::array<Point3, 2>& MeshSlices::box_mm() const { return impl_->box_mm; }
const SliceReport& MeshSlices::report() const { return impl_->report; }
const SliceSource* MeshSlices::edge_heights() const { return impl_->heights.get(); }

ThinFeatures MeshSlices::thin_features(const ExecutionContext& context) const {
  const Impl& s = *impl_;
  ThinFeatures sum;
  if (!s.heights) return sum;
  const int rows = s.rows_per_bin;
  const int first = s.bounds.y0 / rows;
  const auto bands = static_cast<std::size_t>((s.bounds.y1 + rows - 1) / rows - first);
  // Added up in order: sums of doubles depend on it.
  std::vector<detail::BandEdges> of_bands(bands);
  parallel_for(context, "thin features", bands, [&](std::size_t i) {
    const int y0 = (first + static_cast<int>(i)) * rows;
    detail::BandEdges edges =
        s.edges_of({s.bounds.x0, y0, s.bounds.x1, std::min(y0 + rows, s.grid.height_px)});
    detail::release(edges.edges);
    detail::release(edges.begin);
    // Of the part's rows.
    edges.thickest_column += static_cast<std::uint32_t>((y0 - s.bounds.y0) * s.bounds.width());
    of_bands[i] = std::move(edges);
  });
  double slices = 0, thickest_slices = 0;
  for (const detail::BandEdges& edges : of_bands) {
    sum.columns += edges.thin_columns;
    sum.of_columns += edges.columns;
    slices += edges.thin_slices;
    if (edges.thickest_slices <= thickest_slices) continue;
    thickest_slices = edges.thickest_slices;
    const auto width = static_cast<std::uint32_t>(s.bounds.width());
    const std::uint32_t x = edges.thickest_column % width, y = edges.thickest_column / width;
    const PlatePlace place =
        place_on_plate(s.grid, {}, s.bounds.x0 + 0.5 + x, s.bounds.y0 + 0.5 + y);
    sum.x_mm = place.x_mm;
    sum.y_mm = place.y_mm;
    sum.z_mm = (edges.thickest_from + 0.5) * s.grid.layer_um * 1e-3;
  }
  sum.volume_mm3 = slices * s.grid.pixel_x_um * s.grid.pixel_y_um * s.grid.layer_um * 1e-9;
  sum.thickest_um = thickest_slices * s.grid.layer_um;
  return sum;
}

void MeshSlices::read_band(const PixelBox& band, const Sink& sink) const {
  read_slices(band, 0, impl_->grid.layers, sink);
}

ImageFrame MeshSlices::frame() const {
  ImageFrame frame;
  frame.made_for = impl_->made_for;
  return frame;
}

void MeshSlices::read_slices(const PixelBox& band, int first, int past, const Sink& sink) const {
  const Impl& s = *impl_;
  int n = first;
  for (; n < past; ++n) {
    const double by_um = s.inset_um(n);
    if (!(by_um > 0)) break;  // and so none of the slices above
    const detail::Inset how{by_um, s.grid.pixel_x_um, s.grid.pixel_y_um, s.antialias};
    // What a pixel is left with depends on those around it.
    const int reach = how.reach();
    const PixelBox wide{s.bounds.x0, std::max(s.bounds.y0, band.y0 - reach), s.bounds.x1,
                        std::min(s.bounds.y1, band.y1 + reach)};
    if (wide.empty()) {
      sink(n, nullptr);
      continue;
    }
    std::vector<std::uint8_t> rows(static_cast<std::size_t>(band.width()) *
                                   static_cast<std::size_t>(band.height()));
    bool lit = false;
    cut_slices(wide, n, n + 1, [&](int, const std::uint8_t* cut) {
      if (cut == nullptr) return;
      lit = true;
      const std::vector<std::uint8_t> left = detail::inset(cut, wide.width(), wide.height(), how);
      const int from = std::max(band.x0, wide.x0), to = std::min(band.x1, wide.x1);
      for (int y = std::max(band.y0, wide.y0); y < std::min(band.y1, wide.y1) && from < to; ++y) {
        const auto* row = left.data() + static_cast<std::ptrdiff_t>(y - wide.y0) * wide.width();
        std::copy(row + (from - wide.x0), row + (to - wide.x0),
                  rows.data() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width() +
                      (from - band.x0));
      }
    });
    sink(n, lit ? rows.data() : nullptr);
  }
  if (n < past) cut_slices(band, n, past, sink);
}

void MeshSlices::cut_slices(const PixelBox& band, int first, int past, const Sink& sink) const {
  const Impl& s = *impl_;
  const std::vector<Impl::Entry> entries = s.entries_of(band.y0, band.y1, first, past);
  // Drawn over the part's full width, because windings are summed from the left, and cropped where
  // less is asked for.
  const PixelBox full = {s.bounds.x0, band.y0, s.bounds.x1, band.y1};
  detail::Raster raster(full.x0, full.y0, full.x1, full.y1, s.antialias);
  std::vector<std::uint8_t> cropped;
  const bool crop = band.x0 != full.x0 || band.x1 != full.x1;
  if (crop) {
    cropped.resize(static_cast<std::size_t>(band.width()) *
                   static_cast<std::size_t>(band.height()));
  }
  std::vector<Impl::Cut> active;
  std::vector<detail::Segment> segments;
  std::vector<detail::SolidRule::Tag> tags;
  std::size_t next = 0;
  for (int n = first; n < past; ++n) {
    const auto& bridges = s.bridges[static_cast<std::size_t>(n)];
    segments.clear();
    tags.clear();
    for (std::size_t i = 0; i < active.size();) {
      Impl::Cut& cut = active[i];
      if (n > cut.until) {
        if (n > cut.last) {
          cut = active.back();  // order does not matter
          active.pop_back();
          continue;
        }
        s.set_edges(cut, n);
      }
      segments.push_back(cut.at(n));
      if (!s.tags.empty()) tags.push_back(s.tags[cut.triangle]);
      ++i;
    }
    for (; next < entries.size() && entries[next].span.first <= n; ++next) {
      Impl::Cut& cut = active.emplace_back();
      cut.triangle = entries[next].triangle;
      cut.last = entries[next].span.last;
      s.set_edges(cut, n);
      segments.push_back(cut.at(n));
      if (!s.tags.empty()) tags.push_back(s.tags[cut.triangle]);
    }
    segments.insert(segments.end(), bridges.begin(), bridges.end());
    const std::uint8_t* rows = nullptr;
    if (!segments.empty() && s.tags.empty()) rows = raster.draw(segments);
    if (!segments.empty() && !s.tags.empty()) {
      const auto& its = s.bridge_tags[static_cast<std::size_t>(n)];
      tags.insert(tags.end(), its.begin(), its.end());
      rows = raster.draw(segments, tags, s.rule);
    }
    if (rows == nullptr || !crop) {
      sink(n, rows);
      continue;
    }
    const int from = std::max(band.x0, full.x0), to = std::min(band.x1, full.x1);
    std::fill(cropped.begin(), cropped.end(), std::uint8_t{0});
    for (int y = 0; y < band.height() && from < to; ++y) {
      const auto* source = rows + static_cast<std::ptrdiff_t>(y) * full.width();
      std::copy(source + (from - full.x0), source + (to - full.x0),
                cropped.data() + static_cast<std::ptrdiff_t>(y) * band.width() + (from - band.x0));
    }
    sink(n, cropped.data());
  }
}

}  // namespace slicecorr
