// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/nodes.hpp"

#include <algorithm>
#include <cmath>

#include "parallel/silent.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/rays.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Pixels of this size, in voxels, are left as they are.
constexpr double kLargePixel = 0.95;
/// Nodes are so many voxels apart where pixels are very fine.
constexpr double kWider = 1.06;

void spread(const Nodes& nodes, std::size_t lanes, const float* from, float* to) {
  for (const Nodes::Between& p : nodes.pixels) {
    const float* const a = from + static_cast<std::size_t>(p.node) * lanes;
    for (std::size_t l = 0; l < lanes; ++l) {
      *to++ = (1 - p.share) * a[l] + p.share * a[lanes + l];
    }
  }
}

void gather(const Nodes& nodes, std::size_t lanes, const float* from, float* to) {
  std::fill_n(to, static_cast<std::size_t>(nodes.grid.pixels) * lanes, 0.0F);
  for (const Nodes::Between& p : nodes.pixels) {
    float* const a = to + static_cast<std::size_t>(p.node) * lanes;
    for (std::size_t l = 0; l < lanes; ++l, ++from) {
      a[l] += (1 - p.share) * *from;
      a[lanes + l] += p.share * *from;
    }
  }
}

class NodeProjector final : public Projector {
 public:
  NodeProjector(std::shared_ptr<const Nodes> nodes, std::shared_ptr<const Projector> of_pixels)
      : nodes_(std::move(nodes)), of_pixels_(std::move(of_pixels)) {}

  Shape shape() const override {
    Shape shape = of_pixels_->shape();
    shape.light_of_block = angles() * nodes_of_frame();
    return shape;
  }

  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    Array<float> pixels(of_pixels_->shape().light_of_block);
    of_pixels_->forward(block, field, pixels.data(), context);
    each_angle(context, [&](std::size_t m) {
      gather(*nodes_, lanes(), pixels.data() + m * pixels_of_frame(), light + m * nodes_of_frame());
    });
  }

  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    Array<float> pixels(of_pixels_->shape().light_of_block);
    each_angle(context, [&](std::size_t m) {
      spread(*nodes_, lanes(), light + m * nodes_of_frame(), pixels.data() + m * pixels_of_frame());
    });
    of_pixels_->adjoint(block, pixels.data(), field, context);
  }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    return std::make_unique<NodeProjector>(nodes_, of_pixels_->of_slices(slices));
  }

 private:
  std::size_t angles() const { return static_cast<std::size_t>(nodes_->grid.angles); }
  std::size_t lanes() const { return static_cast<std::size_t>(of_pixels_->shape().lanes); }
  std::size_t nodes_of_frame() const {
    return static_cast<std::size_t>(nodes_->grid.pixels) * lanes();
  }
  std::size_t pixels_of_frame() const { return nodes_->pixels.size() * lanes(); }
  template <class Each>
  void each_angle(const ExecutionContext& context, const Each& each) const {
    parallel_for(slicecorr::detail::silent(context), "", angles(), each);
  }

  std::shared_ptr<const Nodes> nodes_;
  std::shared_ptr<const Projector> of_pixels_;
};

}  // namespace

std::optional<Nodes> nodes_of(const Printer& printer, const Resin& resin, const Bench& bench) {
  const TomoGrid& fine = bench.grid;
  const double voxel_mm = fine.voxel_mm();
  if (fine.pixel_mm >= kLargePixel * voxel_mm) return std::nullopt;
  // Rays of groups of pixels are about a voxel apart.
  if (fine.coupled()) return std::nullopt;
  Nodes nodes{fine, {}, {}};
  // Fields must be laid out alike on both grids, however few slices there are.
  const auto lanes = [](TomoGrid grid, double pixel_mm) {
    grid.slices = 1;
    grid.pixel_mm = pixel_mm;
    return grid.lanes();
  };
  nodes.grid.pixel_mm = voxel_mm;
  if (lanes(fine, voxel_mm) != lanes(fine, fine.pixel_mm)) nodes.grid.pixel_mm *= kWider;
  nodes.grid.pixels =
      static_cast<int>(std::ceil(2 * fine.radius_mm / nodes.grid.pixel_mm - 1e-9)) + 1;
  nodes.rays.alpha_per_mm = bench.rays.alpha_per_mm;
  const Vial& vial = *printer.vial;
  const double n = index_of(resin), magnified = n / vial.n_outside;
  for (int j = 0; j < nodes.grid.pixels; ++j) {
    const RayAt ray = ray_at(vial, n, nodes.grid.pixel_at_mm(j) * magnified,
                             nodes.rays.alpha_per_mm, fine.radius_mm);
    nodes.rays.weight.push_back(ray.weight);
    nodes.rays.turn_rad.push_back(ray.turn_rad);
  }
  for (int i = 0; i < fine.pixels; ++i) {
    const double t = pixel_x_mm(printer, bench.window.first_column + i) / magnified;
    const double at = std::clamp(t / nodes.grid.pixel_mm + 0.5 * (nodes.grid.pixels - 1), 0.0,
                                 nodes.grid.pixels - 1.0);
    const int node = std::min(static_cast<int>(at), nodes.grid.pixels - 2);
    nodes.pixels.push_back({node, static_cast<float>(at - node)});
  }
  return nodes;
}

std::unique_ptr<Projector> make_node_projector(std::shared_ptr<const Nodes> nodes,
                                               std::shared_ptr<const Projector> of_pixels) {
  return std::make_unique<NodeProjector>(std::move(nodes), std::move(of_pixels));
}

Light light_of_pixels(const Nodes& nodes, const TomoGrid& grid, const Light& light) {
  Light pixels(grid);
  const auto lanes = static_cast<std::size_t>(grid.lanes());
  const std::size_t frames = grid.blocks() * static_cast<std::size_t>(grid.angles);
  const std::size_t from = light.values.size() / frames, to = pixels.values.size() / frames;
  for (std::size_t m = 0; m < frames; ++m) {
    spread(nodes, lanes, light.values.data() + m * from, pixels.values.data() + m * to);
  }
  return pixels;
}

}  // namespace slicecorr::tomo::detail
