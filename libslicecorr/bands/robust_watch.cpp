// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/robust_watch.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "bands/uncertain_walk.hpp"

namespace slicecorr::detail {

namespace {

/// 95 % of all draws of so many inputs lie in an ellipsoid of so many standard deviations: roots of
/// the quantiles of chi².
double chi_of(std::size_t inputs) {
  constexpr std::array<double, 8> chi = {1.960, 2.448, 2.796, 3.080, 3.327, 3.548, 3.751, 3.938};
  return chi[std::clamp<std::size_t>(inputs, 1, chi.size()) - 1];
}

}  // namespace

CaseDoses::CaseDoses(const CureModel& model, const RobustAsk& ask, std::size_t columns)
    : variance_(ask.uncertainty, model.m, light_acts(model, ask.cases.nearby.get())),
      chi_(chi_of(ask.uncertainty.inputs.size())) {
  if (ask.uncertainty.from_fit) {
    derivatives_ = std::make_unique<BandDerivatives>(model, columns, variance_.wanted(),
                                                     ask.cases.nearby.get());
    for (auto* dose : {&weak_[0], &weak_[1], &strong_[0], &strong_[1]}) dose->assign(columns, 0.0);
    return;
  }
  weak_dose_ = std::make_unique<BandDose>(ask.cases.weak, columns);
  strong_dose_ = std::make_unique<BandDose>(ask.cases.strong, columns);
}

void CaseDoses::add_slice(int slice, const std::uint8_t* pixels) {
  if (!derivatives_) {
    weak_dose_->add_slice(slice, pixels);
    strong_dose_->add_slice(slice, pixels);
    return;
  }
  derivatives_->add_slice(slice, pixels);
  const bool jumps = derivatives_->model().mode == ExposureMode::layerwise;
  for (auto* dose : {&weak_, &strong_}) std::swap((*dose)[0], (*dose)[1]);
  for (std::size_t at = jumps ? 0 : 1; at < 2; ++at) {
    for (std::size_t i = 0; i < weak_[at].size(); ++i) {
      const DoseGradient g = derivatives_->at(i, static_cast<double>(at));
      const double share = g.dose > 0 ? std::exp(chi_ * variance_.sd_ln(g)) : 1.0;
      weak_[at][i] = g.dose / share;
      strong_[at][i] = g.dose * share;
    }
  }
}

RobustWatch::RobustWatch(const CorrectionPlan& plan, const RobustAsk& ask, std::size_t columns)
    : merged_(plan.merge_one_slice_gaps),
      doses_(plan.model, ask, columns),
      as_said_(plan.model, columns),
      columns_(columns) {
  for (Column& c : columns_) c.bottom = plan.all_layers;
}

void RobustWatch::add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage) {
  doses_.add_slice(slice, pixels);
  as_said_.add_slice(slice, pixels);
  const double* const said[2] = {as_said_.lower(), as_said_.upper()};
  const double* const weak[2] = {doses_.weak_lower(), doses_.weak_upper()};
  const double* const strong[2] = {doses_.strong_lower(), doses_.strong_upper()};
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& c = columns_[i];
    const CoverKind kind = cover_kind(coverage[i]);
    if (kind != c.kind) {
      close(i, slice + 1);
      c.run_below = kind == CoverKind::gap && c.kind == CoverKind::run;
      c.kind = kind;
      c.bottom = slice + 1;
      c.extreme = c.as_said =
          kind == CoverKind::run ? 0.0 : std::numeric_limits<double>::infinity();
    }
    if (kind == CoverKind::run) {
      c.extreme = std::max({c.extreme, weak[0][i], weak[1][i]});
      c.as_said = std::max({c.as_said, said[0][i], said[1][i]});
    }
    if (kind == CoverKind::gap) {
      c.extreme = std::min({c.extreme, strong[0][i], strong[1][i]});
      c.as_said = std::min({c.as_said, said[0][i], said[1][i]});
    }
  }
}

std::vector<RobustTrouble> RobustWatch::finish() {
  for (std::size_t i = 0; i < columns_.size(); ++i) close(i, 0);
  return std::move(troubles_);
}

void RobustWatch::close(std::size_t i, int top) {
  const Column& c = columns_[i];
  const double miss = std::abs(std::log(std::max(c.extreme, 1e-9)));
  if (c.kind == CoverKind::run && c.extreme < 1) {
    troubles_.push_back({i, false, top, c.bottom, miss, c.as_said < 1});
  }
  const bool meant = merged_ && c.bottom - top == 1;
  if (c.kind == CoverKind::gap && c.run_below && c.extreme >= 1 && !meant) {
    troubles_.push_back({i, true, top, c.bottom, miss, c.as_said >= 1});
  }
}

}  // namespace slicecorr::detail
