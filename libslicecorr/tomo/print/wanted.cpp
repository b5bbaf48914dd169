// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/wanted.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::tomo {

namespace {

template <class T>
bool same_size(const Box<float>& a, const Box<T>& b) {
  return a.nx == b.nx && a.ny == b.ny && a.nz == b.nz;
}

void check_size(const char* what, const Box<float>& box, const Box<float>& wanted) {
  if (same_size(wanted, box)) return;
  throw InputError(
      fmt::format("the {} has {} x {} x {} voxels, what is wanted {} x {} x {}; expected the same",
                  what, box.nx, box.ny, box.nz, wanted.nx, wanted.ny, wanted.nz));
}

[[noreturn]] void wrong_voxel(const Box<float>& box, std::size_t i, const std::string& what) {
  const auto nx = static_cast<std::size_t>(box.nx), ny = static_cast<std::size_t>(box.ny);
  throw InputError(fmt::format("voxel {}, {}, {}: {}", i % nx, i / nx % ny, i / nx / ny, what));
}

void check_curve(const std::vector<CurvePoint>& curve) {
  if (curve.size() == 1) throw InputError("the curve has one point; expected two or more");
  for (std::size_t k = 0; k < curve.size(); ++k) {
    const bool rises = k == 0 || (curve[k].dose_mj_cm3 > curve[k - 1].dose_mj_cm3 &&
                                  curve[k].value > curve[k - 1].value);
    if (rises && curve[k].dose_mj_cm3 >= 0) continue;
    throw InputError(fmt::format("the curve's point {} ({:g} mJ/cm³, {:g}) does not rise", k + 1,
                                 curve[k].dose_mj_cm3, curve[k].value));
  }
}

/// The dose that this value needs; 0 below the curve, without end above it.
double dose_for(double value, const std::vector<CurvePoint>& curve) {
  if (curve.empty()) return std::max(0.0, value);
  if (value < curve.front().value) return 0;
  if (value > curve.back().value) return kNoMostDose;
  const auto above = std::find_if(curve.begin() + 1, curve.end() - 1,
                                  [&](const CurvePoint& p) { return p.value >= value; });
  const CurvePoint &high = *above, &low = *(above - 1);
  const double share = (value - low.value) / (high.value - low.value);
  return low.dose_mj_cm3 + share * (high.dose_mj_cm3 - low.dose_mj_cm3);
}

/// Calls use(place, i, weight) for the voxels that are judged.
template <class Use>
void each_judged(const DoseBands& wanted, const Box<std::uint8_t>& insert, const Use& use) {
  const Box<float>& box = wanted.least;
  const double middle = 0.5 * (box.nx - 1);
  for (int z = 0; z < box.nz; ++z) {
    for (int y = 0; y < box.ny; ++y) {
      for (int x = 0; x < box.nx; ++x) {
        const std::size_t i = box.at(z, y, x);
        const double weight = wanted.weight_at(i);
        if (!(weight > 0) || (!insert.values.empty() && insert.values[i] > 0)) continue;
        if ((x - middle) * (x - middle) + (y - middle) * (y - middle) > middle * middle) continue;
        use(std::array<int, 3>{x, y, z}, i, weight);
      }
    }
  }
}

/// By how much a dose lies outside of its band; above 0: too much.
double off_by(double dose, double least, double most) {
  return std::max(0.0, dose - most) - std::max(0.0, least - dose);
}

/// By which doses have the least sum of weighed squares outside of their bands.
double least_error_scale(const Box<float>& dose, const DoseBands& wanted,
                         const Box<std::uint8_t>& insert) {
  const auto slope = [&](double scale) {
    double sum = 0;
    each_judged(wanted, insert, [&](const auto&, std::size_t i, double weight) {
      const double d = dose.values[i];
      sum += weight * d * off_by(scale * d, wanted.least.values[i], wanted.most.values[i]);
    });
    return sum;
  };
  double low = 0.1, high = 10;
  for (int k = 0; k < 40 && high > low * (1 + 1e-5); ++k) {
    const double middle = std::sqrt(low * high);
    (slope(middle) > 0 ? high : low) = middle;
  }
  return std::sqrt(low * high);
}

}  // namespace

DoseBands wanted_doses(const WantedValues& v, const std::vector<CurvePoint>& curve,
                       double gel_dose_mj_cm3) {
  check_curve(curve);
  const bool one = v.tolerance.values.size() == 1;
  if (!one) check_size("tolerance", v.tolerance, v.wanted);
  if (!v.weight.values.empty()) check_size("weight", v.weight, v.wanted);
  DoseBands doses{v.wanted, v.wanted, v.weight};
  for (std::size_t i = 0; i < v.wanted.values.size(); ++i) {
    const double wanted = v.wanted.values[i], off = v.tolerance.values[one ? 0 : i];
    if (!(wanted >= 0)) wrong_voxel(v.wanted, i, fmt::format("{:g} is wanted, below 0", wanted));
    if (doses.weight_at(i) < 0) {
      wrong_voxel(v.wanted, i, fmt::format("has a weight of {:g}, below 0", doses.weight_at(i)));
    }
    doses.least.values[i] = 0;
    doses.most.values[i] = static_cast<float>(gel_dose_mj_cm3);
    if (wanted == 0) continue;
    if (!(off > 0)) {
      wrong_voxel(v.wanted, i, fmt::format("has a tolerance of {:g}; expected one above 0", off));
    }
    if (!curve.empty() && (wanted < curve.front().value || wanted > curve.back().value)) {
      wrong_voxel(v.wanted, i,
                  fmt::format("{:g} is wanted; expected what the curve has, {:g} to {:g}", wanted,
                              curve.front().value, curve.back().value));
    }
    doses.least.values[i] = static_cast<float>(dose_for(wanted - off, curve));
    doses.most.values[i] = static_cast<float>(dose_for(wanted + off, curve));
  }
  return doses;
}

Box<std::uint8_t> part_of(const DoseBands& wanted, double gel_dose_mj_cm3) {
  const auto gels = static_cast<float>(gel_dose_mj_cm3);
  Box<std::uint8_t> part{wanted.least.nz, wanted.least.ny, wanted.least.nx, {}};
  for (std::size_t i = 0; i < wanted.least.values.size(); ++i) {
    const bool judged = wanted.weight_at(i) > 0;
    part.values.push_back(judged && wanted.least.values[i] >= gels  ? 255
                          : judged && wanted.most.values[i] <= gels ? 0
                                                                    : 128);
  }
  return part;
}

WantedFigures judge_wanted(const Box<float>& dose, const DoseBands& wanted,
                           const Box<std::uint8_t>& insert) {
  check_size("dose", dose, wanted.least);
  WantedFigures f;
  f.slack_bound = wanted.slack_bound;
  double all = 0, within = 0, squares = 0;
  double least = std::numeric_limits<double>::infinity(), most = 0;
  each_judged(wanted, insert, [&](const std::array<int, 3>& at, std::size_t i, double weight) {
    const double d = dose.values[i], low = wanted.least.values[i], high = wanted.most.values[i];
    const double off = off_by(d, low, high);
    ++f.voxels;
    f.within += off == 0 ? 1 : 0;
    all += weight;
    within += off == 0 ? weight : 0;
    squares += weight * off * off;
    if (low > 0) least = std::min(least, d / low);
    most = std::max(most, d / high);
    if (std::abs(off) <= std::abs(f.worst_off_mj_cm3)) return;
    f.worst_off_mj_cm3 = off;
    f.worst = at;
  });
  if (f.voxels == 0) return f;
  f.share_within = within / all;
  f.rms_off_mj_cm3 = std::sqrt(squares / all);
  if (!std::isfinite(least)) return f;
  f.slack = most > 0 ? least / most : std::numeric_limits<double>::infinity();
  f.brighter = f.slack >= 1 ? 1 / std::sqrt(least * most) : least_error_scale(dose, wanted, insert);
  return f;
}

}  // namespace slicecorr::tomo
