#include <algorithm>
#include <cmath>

#include "base/kernels.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {

using detail::kBlock;

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// The numbers of the model that the loops need.
struct Factors {
  double a, one_minus_a, r, one_minus_r;
};

/// Steps a block whose columns see `phi`. `low`, `high`: least and greatest dose at mid-layer so
/// far, per lane: no reduction, so that the loop runs in vector registers. True when all doses,
/// before and after, lie on one side of 1: below (`below_one`) or not.
SLICECORR_CLONES
bool step_block(const Factors f, const double* __restrict phi, const double* __restrict omega,
                double* __restrict dose, double* __restrict low, double* __restrict high,
                bool below_one) {
  double middle[kBlock];
  std::int64_t crossed = 0;
  for (std::size_t i = 0; i < kBlock; ++i) {
    dose[i] = phi[i] * f.one_minus_a + f.a * omega[i];
    middle[i] = phi[i] * f.one_minus_r + f.r * omega[i];
  }
  if (below_one) {
    for (std::size_t i = 0; i < kBlock; ++i) crossed |= (dose[i] >= 1.0) | (omega[i] >= 1.0);
  } else {
    for (std::size_t i = 0; i < kBlock; ++i) crossed |= (dose[i] < 1.0) | (omega[i] < 1.0);
  }
  if (crossed) return false;
  for (std::size_t i = 0; i < kBlock; ++i) {
    low[i] = middle[i] < low[i] ? middle[i] : low[i];
    high[i] = middle[i] > high[i] ? middle[i] : high[i];
  }
  return true;
}

SLICECORR_CLONES
void lower(double* __restrict least, const double* __restrict dose) {
  for (std::size_t i = 0; i < kBlock; ++i) least[i] = dose[i] < least[i] ? dose[i] : least[i];
}

}  // namespace

int level_of_pixel(int value, int levels) { return (value * (levels - 1) + 127) / 255; }
int pixel_of_level(int level, int levels) {
  return levels > 1 ? (level * 255 + (levels - 1) / 2) / (levels - 1) : 0;
}

PixelCurve pixel_curve(const CureModel& model) {
  PixelCurve curve{};
  const int levels = static_cast<int>(model.level_phi.size());
  for (int v = 0; v < 256; ++v) {
    curve[static_cast<std::size_t>(v)] =
        model.level_phi[static_cast<std::size_t>(level_of_pixel(v, levels))];
  }
  return curve;
}

BandPredictor::BandPredictor(const CureModel& model, const PixelCurve& curve, int all_layers,
                             std::size_t columns)
    : model_(model),
      curve_(curve),
      all_layers_(all_layers),
      omega_(columns, 0.0),
      gap_min_(columns, kNever),
      class_(columns, gap),
      columns_(columns),
      empty_(columns, 0),
      block_class_((columns + kBlock - 1) / kBlock, gap) {
  inside_low_.fill(kNever);
  inside_high_.fill(-kNever);
  outside_low_.fill(kNever);
  outside_high_.fill(-kNever);
  for (Column& c : columns_) {
    c.start = all_layers;
    c.lower = all_layers;
  }
}

void BandPredictor::error(std::size_t i, double slices) {
  const double um = slices * model_.layer_um;
  const double size = std::abs(um);
  prediction_.height_error_um.add(size);
  if (um > 0) {
    prediction_.greatest_overreach_um = std::max(prediction_.greatest_overreach_um, um);
  } else {
    prediction_.greatest_shortfall_um = std::max(prediction_.greatest_shortfall_um, -um);
  }
  if (size > worst_ || (size == worst_ && i < worst_column_)) {
    worst_ = size;
    worst_column_ = i;
  }
}

void BandPredictor::lose(const Column& c, int top) {
  ++prediction_.runs;
  if (c.any_printed) return;
  ++prediction_.lost_features;
  if (c.lower - top >= 2) ++prediction_.lost_thick_features;
}

void BandPredictor::close_gap(std::size_t i) {
  Column& c = columns_[i];
  if (c.run_below && c.gap_seen) {
    ++prediction_.gaps;
    prediction_.gap_contrast.add(std::max(0.0, 1.0 - gap_min_[i]));
    if (gap_min_[i] >= 1.0) {
      ++prediction_.merged_features;
      if (c.gap_layers >= 2) ++prediction_.merged_thick_gaps;
    }
  }
}

void BandPredictor::enter(std::size_t i, int node, Class next, double dose) {
  Column& c = columns_[i];
  const bool printed = dose >= 1.0;
  const Class old = class_[i];
  if (old == run) {
    if (c.seeks_print) error(i, -(c.lower - node));
    c.seeks_print = false;
    lose(c, node);
    if (next == gap) {
      if (printed) {
        c.seeks_end = true;
      } else {
        error(i, -(c.any_printed ? c.start - node : c.lower - node));
      }
    }
    c.run_below = true;
    c.gap_seen = false;
    c.gap_layers = 0;
    gap_min_[i] = kNever;
  } else if (old == gap) {
    c.gap_layers += c.lower - node;
    if (c.seeks_end) error(i, c.lower - node);
    c.seeks_end = false;
    if (next == run) {
      if (printed) {
        error(i, std::min<double>(c.start, c.lower) - node);
      } else {
        c.seeks_print = true;
      }
    }
  }
  if (next == run) {
    close_gap(i);
    c.any_printed = printed;
  } else if (next == gap) {
    c.gap_seen = true;
    gap_min_[i] = std::min(gap_min_[i], dose);
  }
  c.lower = node;
  class_[i] = next;
}

void BandPredictor::slow(std::size_t i, int slice, double phi, std::uint8_t coverage) {
  Prediction& p = prediction_;
  const Class now = coverage == 0 ? gap : coverage == 255 ? run : grey;
  const double below = omega_[i];
  if (now != class_[i]) enter(i, slice + 1, now, below);
  const double dose = model_.step(phi, below);
  const double middle = model_.middle(phi, below);
  if ((below >= 1.0) != (dose >= 1.0)) {
    Column& c = columns_[i];
    c.start = slice + 1 - model_.crossing(phi, below);
    if (dose >= 1.0) {
      if (now == run) {
        c.any_printed = true;
        if (c.seeks_print) error(i, -(c.lower - c.start));
        c.seeks_print = false;
      }
    } else if (c.seeks_end) {
      error(i, c.lower - c.start);
      c.seeks_end = false;
    }
  }
  const bool printed = middle >= 1.0;
  if (now == run) {
    ++p.target_voxels;
    p.printed_voxels += printed;
    p.undercure_voxels += !printed;
    p.min_dose_inside = std::min(p.min_dose_inside, middle);
    p.max_dose_inside = std::max(p.max_dose_inside, middle);
  } else if (now == gap) {
    gap_min_[i] = std::min(gap_min_[i], dose);
    p.printed_voxels += printed;
    p.cure_through_voxels += printed;
    p.max_dose_outside = std::max(p.max_dose_outside, middle);
  } else {
    ++p.grey_voxels;
    p.grey_dose_error.add(std::abs(middle - coverage / 255.0));
  }
  omega_[i] = dose;
}

void BandPredictor::add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage) {
  const std::uint8_t* cover = coverage ? coverage : empty_.data();
  const std::size_t columns = omega_.size();
  const Factors f{model_.a, model_.one_minus_a, model_.root_a, 1.0 - model_.root_a};
  alignas(64) double phi[kBlock];
  alignas(64) double dose[kBlock];
  std::uint64_t printed_inside = 0;
  for (std::size_t b = 0; b < columns; b += kBlock) {
    const std::size_t n = std::min(kBlock, columns - b);
    if (pixels && n == kBlock && detail::uniform(pixels + b)) {
      std::fill_n(phi, kBlock, curve_[pixels[b]]);
    } else {
      for (std::size_t i = 0; i < n; ++i) phi[i] = pixels ? curve_[pixels[b + i]] : 0.0;
    }
    // A block inside a gap and unprinted, or inside features and printed, has no events: sums only.
    Class& block = block_class_[b / kBlock];
    if (n == kBlock && block != grey) {
      const detail::BlockBits bits = detail::block_bits(cover + b);
      if (block == gap && bits.any == 0) {
        if (step_block(f, phi, &omega_[b], dose, outside_low_.data(), outside_high_.data(), true)) {
          std::copy_n(dose, kBlock, &omega_[b]);
          lower(&gap_min_[b], dose);
          continue;
        }
      } else if (block == run && bits.all == ~std::uint64_t{0}) {
        if (step_block(f, phi, &omega_[b], dose, inside_low_.data(), inside_high_.data(), false)) {
          std::copy_n(dose, kBlock, &omega_[b]);
          printed_inside += kBlock;
          continue;
        }
      }
    }
    for (std::size_t i = 0; i < n; ++i) slow(b + i, slice, phi[i], cover[b + i]);
    block = class_[b];
    for (std::size_t i = 1; i < n; ++i) {
      if (class_[b + i] != block) block = grey;  // mixed
    }
  }
  prediction_.target_voxels += printed_inside;
  prediction_.printed_voxels += printed_inside;
}

Prediction BandPredictor::finish(int x0, int y0, int width) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    prediction_.min_dose_inside = std::min(prediction_.min_dose_inside, inside_low_[i]);
    prediction_.max_dose_inside = std::max(prediction_.max_dose_inside, inside_high_[i]);
    prediction_.max_dose_outside = std::max(prediction_.max_dose_outside, outside_high_[i]);
  }
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& c = columns_[i];
    if (class_[i] == run) {
      if (c.seeks_print) error(i, -c.lower);
      lose(c, 0);
    } else {
      if (class_[i] == gap) {
        if (c.seeks_end) error(i, c.lower);
        c.gap_layers += c.lower;
      }
      close_gap(i);
    }
  }
  if (worst_ >= 0) {
    prediction_.worst_x = x0 + static_cast<int>(worst_column_ % static_cast<std::size_t>(width));
    prediction_.worst_y = y0 + static_cast<int>(worst_column_ / static_cast<std::size_t>(width));
  }
  return prediction_;
}

Prediction predict_black_columns(const CureModel& model, int slices, std::uint64_t columns) {
  Prediction p;
  if (columns == 0) return p;
  double omega = 0;
  for (int n = slices; n-- > 0;) {
    p.max_dose_outside = std::max(p.max_dose_outside, model.middle(model.phi_min(), omega));
    omega = model.step(model.phi_min(), omega);
  }
  return p;
}

}  // namespace slicecorr
