// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "parallel/silent.hpp"
#include "tomo/operators/footprint_kernels.hpp"
#include "tomo/operators/node_kernels.hpp"
#include "tomo/operators/node_table.hpp"
#include "tomo/operators/ray_cells.hpp"
#include "tomo/operators/search_projector.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Directions whose light is made ready together.
constexpr int kAtOnce = 16;
/// Nodes of maps along z, to the vial's radius.
constexpr int kMapUp = 8;

class RaySearchProjector final : public Projector {
 public:
  RaySearchProjector(const TomoGrid& grid, const LabRays& rays, const Volume* insert,
                     double most_voxels)
      : grid_(grid), cells_(grid, rays, insert, {most_voxels, true, kMapUp}) {
    const std::vector<double> side = columns_of_voxel(rays);
    const double widest = *std::max_element(side.begin(), side.end());
    // A voxel on the axis, halfway up.
    const RayMap& map = cells_.map(0);
    std::vector<float> parts(static_cast<std::size_t>(map.heights()) * RayMapPart::count);
    map.over(0, 0, parts.data());
    const auto middle = [&](int part) {
      return double{parts[static_cast<std::size_t>(part * map.heights() + map.heights() / 2)]};
    };
    const double across = middle(RayMapPart::along) * grid.voxel_mm(),
                 up = middle(RayMapPart::up) * grid.slice_height_mm();
    const double tilted =
        middle(RayMapPart::up) * std::abs(middle(RayMapPart::slope)) * grid.voxel_mm();
    columns_ = nodes_between(grid.pixels,
                             {-1.0 - widest, grid.pixels + widest, across, std::sqrt(2.0) * widest},
                             rays.across);
    rows_ = nodes_between(grid.rows, {-1.0 - up, grid.rows + up, up, up + tilted}, rays.up);
    const auto n = static_cast<std::size_t>(grid.rows);
    of_rows_ = std::make_unique<NodeTable>(rows_, std::vector<double>(n, up),
                                           std::vector<double>(n, tilted));
    std::vector<double> angles_rad;
    angles_rad.reserve(static_cast<std::size_t>(cells_.count()));
    for (int k = 0; k < cells_.count(); ++k) angles_rad.push_back(cells_.angle_rad(k));
    of_columns_ = std::make_unique<DirectionTables>(columns_, side, angles_rad);
  }

  Shape shape() const override { return grid_.shape(); }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = slicecorr::detail::silent(context);
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    Array<float> nodes(kAtOnce * nodes_size());
    each_batch([&](int first, int count) {
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        to_nodes(first + static_cast<int>(i), light, nodes.data() + i * nodes_size());
      });
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.voxels), [&](std::size_t y) {
        for (int i = 0; i < count; ++i) {
          const float* const from = nodes.data() + static_cast<std::size_t>(i) * nodes_size();
          each_column(first + i, static_cast<int>(y), [&](int x, const NodeColumn& at) {
            gather_nodes(at, from, field + grid_.voxel(x, static_cast<int>(y), 0));
          });
        }
      });
    });
  }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = slicecorr::detail::silent(context);
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    const std::size_t of_frame =
        static_cast<std::size_t>(grid_.pixels) * static_cast<std::size_t>(grid_.rows);
    Array<float> lines(kAtOnce * of_frame);
    each_batch([&](int first, int count) {
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        Array<float>& nodes = thread_scratch().nodes;
        nodes.assign(nodes_size(), 0.0F);
        for (int y = 0; y < grid_.voxels; ++y) {
          each_column(first + static_cast<int>(i), y, [&](int x, const NodeColumn& at) {
            scatter_nodes(at, field + grid_.voxel(x, y, 0), nodes.data());
          });
        }
        from_nodes(first + static_cast<int>(i), nodes.data(), lines.data() + i * of_frame);
      });
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.pixels), [&](std::size_t c) {
        for (int i = 0; i < count; ++i) {
          cells_.back_from(first + i, static_cast<int>(c),
                           lines.data() + static_cast<std::size_t>(i) * of_frame +
                               c * static_cast<std::size_t>(grid_.rows),
                           light);
        }
      });
    });
  }

 private:
  struct Scratch {
    Array<float> parts, places, pixels, between, nodes;
  };
  static Scratch& thread_scratch() {
    static thread_local Scratch scratch;
    return scratch;
  }

  /// A voxel's side in columns, per column: on the axis's plane, halfway up. Where rays miss, as in the
  /// nearest column that meets.
  std::vector<double> columns_of_voxel(const LabRays& rays) const {
    const auto at = [&](int c) -> const LabRay& {
      return rays.rays[(static_cast<std::size_t>(c) * static_cast<std::size_t>(rays.rows) +
                        static_cast<std::size_t>(rays.rows / 2)) *
                       static_cast<std::size_t>(rays.per_pixel)];
    };
    const auto lit = [&](int c) { return c >= 0 && c < rays.columns && at(c).half_mm > 0; };
    std::vector<double> side(static_cast<std::size_t>(rays.columns), 0);
    double known = 0;
    for (int c = 0; c < rays.columns; ++c) {
      const int a = lit(c - 1) ? c - 1 : c, b = lit(c + 1) ? c + 1 : c;
      if (lit(c) && b > a) known = grid_.voxel_mm() * (b - a) / (at(b).t_mm - at(a).t_mm);
      side[static_cast<std::size_t>(c)] = known;
    }
    for (std::size_t c = side.size(); c-- > 0;) {
      if (side[c] == 0) side[c] = c + 1 < side.size() ? side[c + 1] : 1;
    }
    return side;
  }

  std::size_t nodes_size() const {
    return static_cast<std::size_t>(columns_.nodes) * static_cast<std::size_t>(rows_.nodes);
  }
  template <class Use>
  void each_batch(const Use& use) const {
    for (int first = 0; first < cells_.count(); first += kAtOnce) {
      use(first, std::min(kAtOnce, cells_.count() - first));
    }
  }

  void to_nodes(int k, const float* light, float* nodes) const {
    Scratch& s = thread_scratch();
    const auto rows = static_cast<std::size_t>(grid_.rows);
    s.pixels.assign(static_cast<std::size_t>(grid_.pixels) * rows, 0.0F);
    cells_.lines_of(k, light, s.pixels.data(), grid_.rows);
    for (float& v : s.pixels) v /= static_cast<float>(cells_.directions().cells);
    s.between.resize(static_cast<std::size_t>(columns_.nodes) * rows);
    of_columns_->of(k).spread(grid_.rows, s.pixels.data(), s.between.data());
    for (int c = 0; c < columns_.nodes; ++c) {
      of_rows_->spread(1, s.between.data() + static_cast<std::size_t>(c) * rows,
                       nodes + static_cast<std::size_t>(c) * static_cast<std::size_t>(rows_.nodes));
    }
  }
  void from_nodes(int k, const float* nodes, float* lines) const {
    Scratch& s = thread_scratch();
    const auto rows = static_cast<std::size_t>(grid_.rows);
    s.between.resize(static_cast<std::size_t>(columns_.nodes) * rows);
    for (int c = 0; c < columns_.nodes; ++c) {
      of_rows_->gather(1,
                       nodes + static_cast<std::size_t>(c) * static_cast<std::size_t>(rows_.nodes),
                       s.between.data() + static_cast<std::size_t>(c) * rows);
    }
    of_columns_->of(k).gather(grid_.rows, s.between.data(), lines);
    const std::size_t count = static_cast<std::size_t>(grid_.pixels) * rows;
    for (std::size_t i = 0; i < count; ++i) {
      lines[i] /= static_cast<float>(cells_.directions().cells);
    }
  }

  /// Calls use(x, place among the nodes) for the columns of voxels of a row that hold resin.
  template <class Use>
  void each_column(int k, int y, const Use& use) const {
    const TomoGrid::Range in = grid_.inside(y);
    if (in.first >= in.end) return;
    Scratch& scratch = thread_scratch();
    const RayMap& map = cells_.map(k);
    const double th = cells_.angle_rad(k), c = std::cos(th), s = std::sin(th);
    const auto n = static_cast<std::size_t>(grid_.slices);
    scratch.parts.resize(static_cast<std::size_t>(map.heights()) * RayMapPart::kPlaces);
    scratch.places.resize(3 * n);
    VoxelColumn voxels;
    voxels.slices = grid_.slices;
    voxels.heights = map.heights();
    voxels.parts = scratch.parts.data();
    voxels.height = cells_.height();
    voxels.above = cells_.above();
    NodeColumn at;
    at.slices = grid_.slices;
    at.column = scratch.places.data();
    at.row = scratch.places.data() + n;
    at.light = scratch.places.data() + 2 * n;
    at.first_column = static_cast<float>(columns_.first);
    at.by_column = static_cast<float>(1 / columns_.apart);
    at.first_row = static_cast<float>(rows_.first);
    at.by_row = static_cast<float>(1 / rows_.apart);
    at.columns = columns_.nodes;
    at.rows = rows_.nodes;
    DarkVoxels dark(cells_.dark(k, y));
    const double py = grid_.voxel_at_mm(y);
    for (int x = in.first; x < in.end; ++x) {
      const double px = grid_.voxel_at_mm(x);
      map.over(px * c + py * s, py * c - px * s, scratch.parts.data(), RayMapPart::kPlaces);
      places_of(voxels, scratch.places.data());
      if (const std::vector<int>* const slices = dark.at(x)) {
        for (const int z : *slices) scratch.places[2 * n + static_cast<std::size_t>(z)] = 0;
      }
      use(x, at);
    }
  }

  TomoGrid grid_;
  RayCells cells_;
  NodeRow columns_, rows_;
  std::unique_ptr<NodeTable> of_rows_;
  std::unique_ptr<DirectionTables> of_columns_;
};

}  // namespace

std::unique_ptr<Projector> make_ray_search_projector(const TomoGrid& grid, const LabRays& rays,
                                                     const Volume* insert, double most_voxels) {
  return std::make_unique<RaySearchProjector>(grid, rays, insert, most_voxels);
}

}  // namespace slicecorr::tomo::detail
