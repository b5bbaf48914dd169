#include <algorithm>
#include <cmath>

#include "slicecorr/predict.hpp"

namespace slicecorr {

namespace {
constexpr std::size_t kBlock = 32;
constexpr double kNever = std::numeric_limits<double>::infinity();
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
      empty_(columns, 0) {
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
  const double a = model_.a, one_minus_a = model_.one_minus_a;
  const double r = model_.root_a, one_minus_r = 1.0 - model_.root_a;
  double phi[kBlock], dose[kBlock];
  for (std::size_t b = 0; b < columns; b += kBlock) {
    const std::size_t n = std::min(kBlock, columns - b);
    for (std::size_t i = 0; i < n; ++i) phi[i] = pixels ? curve_[pixels[b + i]] : 0.0;
    // A block inside a gap and unprinted, or inside features and printed, has no events: sums only.
    std::uint8_t any = 0, all = 255, classes = 0;
    bool runs = true;
    for (std::size_t i = 0; i < n; ++i) {
      any |= cover[b + i];
      all &= cover[b + i];
      classes |= class_[b + i];
      runs &= class_[b + i] == run;
    }
    const bool dark = any == 0 && classes == gap;
    if (dark || (all == 255 && runs)) {
      const double* omega = omega_.data() + b;
      double low = kNever, high = -kNever, mid_low = kNever, mid_high = -kNever;
      for (std::size_t i = 0; i < n; ++i) {
        dose[i] = phi[i] * one_minus_a + a * omega[i];
        const double middle = phi[i] * one_minus_r + r * omega[i];
        low = std::min(low, std::min(dose[i], omega[i]));
        high = std::max(high, std::max(dose[i], omega[i]));
        mid_low = std::min(mid_low, middle);
        mid_high = std::max(mid_high, middle);
      }
      if (dark && high < 1.0) {
        for (std::size_t i = 0; i < n; ++i) {
          omega_[b + i] = dose[i];
          gap_min_[b + i] = std::min(gap_min_[b + i], dose[i]);
        }
        prediction_.max_dose_outside = std::max(prediction_.max_dose_outside, mid_high);
        continue;
      }
      if (!dark && low >= 1.0) {
        for (std::size_t i = 0; i < n; ++i) omega_[b + i] = dose[i];
        prediction_.target_voxels += n;
        prediction_.printed_voxels += n;
        prediction_.min_dose_inside = std::min(prediction_.min_dose_inside, mid_low);
        prediction_.max_dose_inside = std::max(prediction_.max_dose_inside, mid_high);
        continue;
      }
    }
    for (std::size_t i = 0; i < n; ++i) slow(b + i, slice, phi[i], cover[b + i]);
  }
}

Prediction BandPredictor::finish(int x0, int y0, int width) {
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
