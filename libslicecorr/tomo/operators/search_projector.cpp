// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/search_projector.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "tomo/operators/cell_lines.hpp"
#include "tomo/operators/directions.hpp"
#include "tomo/operators/node_table.hpp"

namespace slicecorr::tomo::detail {

namespace {

double first_line_mm(const TomoGrid& grid, const RayTables& optics) {
  return optics.line_mm.empty() ? grid.pixel_at_mm(0) : optics.line_mm[0];
}

class SearchProjector final : public Projector {
 public:
  SearchProjector(const TomoGrid& grid, const RayTables& optics, const Volume* insert,
                  double most_voxels)
      : grid_(grid) {
    grid.check();
    const double first_mm = first_line_mm(grid, optics);
    std::vector<float> weight(static_cast<std::size_t>(grid.pixels), 1.0F);
    for (std::size_t i = 0; i < optics.weight.size(); ++i) {
      weight[i] = static_cast<float>(optics.weight[i]);
    }
    directions_ = search_directions(grid, optics, most_voxels);
    lines_ = std::make_shared<const CellLines>(
        optics.turn_rad.empty() ? CellLines(grid, directions_, std::move(weight))
                                : CellLines(grid, optics, directions_, std::move(weight)));

    // Lanes are those of the grid: where voxels are one to two pixels wide slices may go one by one.
    const double step = grid.voxel_mm() / grid.pixel_mm;
    const bool alone = step >= 0.95 && step <= 2 + 1e-9;
    const double apart_mm = grid.voxel_mm() * (alone ? 0.5 : 0.49);
    const auto place = [&](double mm) { return (mm - first_mm) / grid.pixel_mm; };
    const NodePlaces places{place(-grid.radius_mm), place(grid.radius_mm),
                            2 * apart_mm / grid.pixel_mm, std::sqrt(2.0) * step};
    const NodeRow row = nodes_between(grid.pixels, places, {optics.lit, 0});
    std::vector<double> angles_rad;
    angles_rad.reserve(static_cast<std::size_t>(directions_.count()));
    for (int a = 0; a < directions_.count(); ++a) {
      angles_rad.push_back(2 * std::numbers::pi * a / directions_.count());
    }
    tables_ = std::make_shared<const DirectionTables>(
        row, std::vector<double>(static_cast<std::size_t>(grid.pixels), step), angles_rad);

    TomoGrid nodes = grid;
    nodes.angles = directions_.count();
    nodes.pixels = row.nodes;
    nodes.pixel_mm = apart_mm;
    std::shared_ptr<const Shadow> shadow;
    if (insert != nullptr) {
      Volume opaque(nodes);
      opaque.coverage = insert->coverage;
      shadow = std::make_shared<const Shadow>(cast_shadow(opaque));
    }
    of_nodes_ = make_projector(nodes, {.alpha_per_mm = optics.alpha_per_mm}, std::move(shadow));
    nodes_ = row.nodes;
  }

  Shape shape() const override { return grid_.shape(); }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    auto part = std::make_unique<SearchProjector>(*this);
    part->grid_.slices = static_cast<int>(slices.size());
    part->of_nodes_ = of_nodes_->of_slices(slices);
    return part;
  }

  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    Array<float>& nodes = scratch();
    nodes.resize(of_nodes_->shape().light_of_block);
    each_direction(quiet, [&](int a, float* pixels) {
      lines_->of_cell(cell_of(a), lanes(), light, pixels);
      tables_->of(a).spread(grid_.lanes(), pixels, nodes.data() + node(a));
    });
    of_nodes_->adjoint(block, nodes.data(), field, context);
  }

  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    Array<float>& nodes = scratch();
    nodes.resize(of_nodes_->shape().light_of_block);
    of_nodes_->forward(block, field, nodes.data(), context);
    const std::size_t of_frame = static_cast<std::size_t>(grid_.pixels) * lanes();
    // By cells, those of a frame one after another.
    Array<float> lines(static_cast<std::size_t>(directions_.count()) * of_frame);
    each_direction(quiet, [&](int a, float*) {
      tables_->of(a).gather(grid_.lanes(), nodes.data() + node(a),
                            lines.data() + static_cast<std::size_t>(cell_of(a)) * of_frame);
    });
    if (lines_->alike()) {
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.angles), [&](std::size_t m) {
        lines_->back_frame(static_cast<int>(m), lanes(), lines.data(), light);
      });
      return;
    }
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    constexpr int kPixels = 16;
    parallel_for(quiet, "", static_cast<std::size_t>((grid_.pixels + kPixels - 1) / kPixels),
                 [&](std::size_t piece) {
                   const int first = static_cast<int>(piece) * kPixels;
                   for (int k = 0; k < directions_.count(); ++k) {
                     for (int i = first; i < std::min(first + kPixels, grid_.pixels); ++i) {
                       lines_->back(k, i, lanes(),
                                    lines.data() + static_cast<std::size_t>(k) * of_frame, light);
                     }
                   }
                 });
  }

 private:
  static Array<float>& scratch() {
    static thread_local Array<float> numbers;
    return numbers;
  }
  ExecutionContext worth(const ExecutionContext& context) const {
    ExecutionContext quiet = slicecorr::detail::silent(context);
    const double work = static_cast<double>(grid_.light_of_block()) * directions_.cells / 5e5;
    quiet.threads = static_cast<int>(std::clamp(work, 1.0, 1.0 * thread_count(context)));
    return quiet;
  }
  std::size_t lanes() const { return static_cast<std::size_t>(grid_.lanes()); }
  std::size_t node(int a) const {
    return static_cast<std::size_t>(a) * static_cast<std::size_t>(nodes_) * lanes();
  }
  /// Cells are counted from half a step before the frame's own angle on.
  int cell_of(int a) const { return (a + (directions_.cells - 1) / 2) % directions_.count(); }
  /// Calls use(direction, room for a line of pixels).
  template <class Use>
  void each_direction(const ExecutionContext& context, const Use& use) const {
    constexpr int kAtOnce = 16;
    const int count = directions_.count();
    parallel_for(context, "", static_cast<std::size_t>((count + kAtOnce - 1) / kAtOnce),
                 [&](std::size_t piece) {
                   static thread_local Array<float> pixels;
                   pixels.resize(static_cast<std::size_t>(grid_.pixels) * lanes());
                   const int first = static_cast<int>(piece) * kAtOnce;
                   for (int a = first; a < std::min(first + kAtOnce, count); ++a) {
                     use(a, pixels.data());
                   }
                 });
  }

  TomoGrid grid_;
  Directions directions_;
  int nodes_ = 0;
  std::shared_ptr<const CellLines> lines_;
  std::shared_ptr<const DirectionTables> tables_;
  std::shared_ptr<const Projector> of_nodes_;
};

}  // namespace

Directions search_directions(const TomoGrid& grid, const RayTables& optics, double most_voxels) {
  double most_mm = 0;
  for (int i = 0; i < grid.pixels; ++i) {
    const double t = first_line_mm(grid, optics) + i * grid.pixel_mm;
    const bool lit = optics.weight.empty() || optics.weight[static_cast<std::size_t>(i)] > 0;
    if (lit) most_mm = std::max(most_mm, std::min(std::abs(t), grid.radius_mm));
  }
  const double arc = 2 * std::numbers::pi / grid.angles * most_mm / grid.voxel_mm();
  return Directions::odd(grid.angles, arc, most_voxels);
}

std::unique_ptr<Projector> make_search_projector(const TomoGrid& grid, const RayTables& optics,
                                                 const Volume* insert, double most_voxels) {
  return std::make_unique<SearchProjector>(grid, optics, insert, most_voxels);
}

}  // namespace slicecorr::tomo::detail
