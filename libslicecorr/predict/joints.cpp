// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/joints.hpp"

#include <algorithm>
#include <cmath>

#include "base/kernels.hpp"
#include "cure/margin.hpp"
#include "cure/own_exposure.hpp"
#include "cure/spread_band.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

constexpr std::uint8_t kWhole = 255;

}  // namespace

JointWalker::JointWalker(const CureModel& model, std::size_t columns)
    : model_(model),
      curve_(pixel_curve(model)),
      tells_edges_(model.adds_up() && !model.inhibited() && model.bath_slices == 0),
      columns_(columns),
      brightest_(columns, 0.0),
      all_(columns, 0.0) {
  if (inhibited()) {
    under_uv_.emplace(*model.inhibited(), model.lifts->skin);
  } else {
    phi_.resize(columns);
  }
}

/// A layer of a feature with solid resin above: its own exposure must reach there.
void JointWalker::join(const Own& own) {
  figures_.least = std::min(figures_.least, own.joint);
  if (own.joint < model_.lifts->green_strength - kMargin) ++figures_.not_holding_voxels;
}

JointWalker::Own JointWalker::own_of(int slice, std::size_t column,
                                     std::span<const ImageShowing> showings) {
  if (!model_.adds_up()) {
    const OwnExposure own = own_exposure(model_, slice, phi_[column] / model_.ratio(slice));
    return {own.window, own.far, own.skin >= 1 - kMargin};
  }
  if (!inhibited()) {
    const double at_window = phi_[column] * model_.returned(slice + 1);
    return {at_window, phi_[column] * model_.a_of(slice) * model_.returned(slice),
            at_window >= model_.film_of(slice) - kMargin};
  }
  const OwnDoses::Own own = under_uv_->of(showings, column, model_.ratio(slice));
  return {own.greatest, own.joint, own.film};
}

void JointWalker::take_light(int slice, std::span<const ImageShowing> showings,
                             std::vector<double>& light) const {
  const double ratio = model_.ratio(slice);
  for (std::size_t b = 0; b < light.size(); b += kBlock) {
    const std::size_t n = std::min(kBlock, light.size() - b);
    block_phi(curve_, showings, b, n, &light[b]);
    for (std::size_t i = b; i < b + n; ++i) light[i] *= ratio;
  }
}

void JointWalker::add_slice(int slice, std::span<const ImageShowing> showings,
                            const DesignRow& design, bool at_heights) {
  const std::uint8_t* const coverage = design.coverage;
  if (!inhibited()) {
    from_beside_.clear();
    // What light from beside adds comes last, where it scatters.
    if (!showings.empty() && showings.back().setting == kNoExposure) {
      from_beside_.resize(phi_.size());
      take_light(slice, showings.last(1), from_beside_);
      showings = showings.first(showings.size() - 1);
    }
    take_light(slice, showings, phi_);
  }
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& c = columns_[i];
    // What the layer's window sees at its brightest exposure; `far`: at the node below it.
    const double phi = tells_edges_ ? phi_[i] : 0.0;
    const double far = brightest_[i];
    const double near = std::max(phi, far);
    brightest_[i] = near * model_.a_of(slice);
    const double beside = tells_edges_ && !from_beside_.empty() ? from_beside_[i] : 0.0;
    const double all_far = all_[i], all = phi + beside + all_far;
    all_[i] = all * model_.a_of(slice);
    const bool full = coverage[i] == kWhole;
    if (!full) {
      if (c.full) {
        end_feature(c);
        // Edges are those of features that end at a gap.
        if (coverage[i] == 0 && tells_edges_) {
          begin_gap(c, slice + 1, near, at_heights ? heights_[i] : std::uint8_t{0});
          begin_staying(c, slice + 1, all_far, all);
        }
      } else if (coverage[i] != 0) {
        c.edge_node = -1;
      } else if (c.goes_on) {
        go_on(c, slice + 1, all);
      }
      continue;
    }
    if (!c.full) {
      end_gap(c, slice + 1);
      // Its edge towards the window is the window's own.
      if (tells_edges_) {
        figures_.exchanged_error_um.add(0);
        figures_.staying_error_um.add(0);
      }
      c.candidate = own_of(slice, i, showings);
      c.liquid = 0;
      c.full = true;
      continue;
    }
    // The layer below has this one above it.
    const Own own = own_of(slice, i, showings);
    if (own.greatest < 1.0) {
      ++c.liquid;
      continue;
    }
    if (c.liquid > 0) {
      // Liquid between solid layers: neither they nor the one below them hold on to anything.
      figures_.not_holding_voxels += static_cast<std::uint64_t>(c.liquid) + 1;
      figures_.least = 0;
      c.liquid = 0;
    } else {
      join(c.candidate);
    }
    c.candidate = own;
  }
  heights_.assign(columns_.size(), 0);
  if (design.heights) std::copy_n(design.heights, columns_.size(), heights_.begin());
}

/// The first layer of the feature, below this node, has nothing solid above it.
void JointWalker::end_feature(Column& c) {
  c.full = false;
  figures_.liquid_layers_max = std::max(figures_.liquid_layers_max, c.liquid);
  if (c.candidate.film) {
    ++figures_.films;
  } else {
    ++figures_.not_holding_voxels;
  }
  c.liquid = 0;
}

/// How far a print goes beyond a node that it has this dose at.
double JointWalker::reach_um(double dose, int node) const {
  const double um =
      model_.layer_um / (model_.eta * units::kLn10) * std::log(dose * model_.returned(node));
  return std::max(um, -1e9);
}

/// Where all resin stays: doses just below the node, and above it, with what the gap's own slice leaves.
void JointWalker::begin_staying(Column& c, int node, double below, double above) {
  c.goes_on = above * model_.returned(node) >= 1;
  if (c.goes_on) return go_on(c, node, above);
  c.staying_um = reach_um(below, node);
}

/// The print goes on into the gap's layer above a node; whether it does into the next, too.
void JointWalker::go_on(Column& c, int node, double above) {
  c.staying_um = between_um(node, c.edge_node) + reach_um(above, node);
  c.goes_on = above * model_.a_of(node - 1) * model_.returned(node - 1) >= 1;
}

/// `exchanged`: the brightest exposure just above the node.
void JointWalker::begin_gap(Column& c, int node, double exchanged, std::uint8_t height) {
  c.edge_node = node;
  c.edge_um = reach_um(exchanged, node);
  c.beyond_um = height != 0 ? edge_height_slices(height) * model_.layer_um : 0.0;
}

/// The gap above the last edge ends at this node: the print goes no further.
void JointWalker::end_gap(Column& c, int node) {
  if (c.edge_node < 0) return;
  const double most_um = between_um(node, c.edge_node);
  const auto take = [&](double edge_um, Histogram& errors, double& most) {
    const double um = std::abs(std::min(edge_um, most_um) + c.beyond_um);
    errors.add(um);
    most = std::max(most, um);
  };
  take(c.edge_um, figures_.exchanged_error_um, figures_.exchanged_max_um);
  take(c.staying_um, figures_.staying_error_um, figures_.staying_max_um);
  c.edge_node = -1;
}

void JointWalker::finish(JointFigures& figures) {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& c = columns_[i];
    if (!c.full) {
      end_gap(c, 0);
      continue;
    }
    // On the platform every layer is to hold, the first one, too.
    if (c.liquid > 0) {
      figures_.not_holding_voxels += static_cast<std::uint64_t>(c.liquid) + 1;
      figures_.least = 0;
    } else {
      join(c.candidate);
    }
  }
  figures_.exchange = model_.lifts->exchange;
  figures.merge(figures_);
}

}  // namespace slicecorr::detail
