// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/merged_slits.hpp"

#include <algorithm>
#include <utility>

#include "base/coded_band.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

std::vector<std::uint8_t> merged_slits(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage) {
  std::vector<std::uint8_t> merged = coverage;
  if (!plan.merge_one_slice_gaps) return merged;
  const auto layers = std::min(coverage.size(), static_cast<std::size_t>(std::max(plan.layers, 0)));
  for (std::size_t n = 1; n + 1 < layers; ++n) {
    if (is_slit(coverage[n - 1], coverage[n], coverage[n + 1])) merged[n] = kFull;
  }
  return merged;
}

MergedSlits::MergedSlits(std::unique_ptr<BandSolver> solver, int layers, std::size_t columns)
    : solver_(std::move(solver)),
      layers_(layers),
      columns_(columns),
      coded_(columns),
      room_(columns) {}

void MergedSlits::keep_light(BandCorrector::ColumnLevels most) {
  solver_->keep_light(std::move(most));
}

void MergedSlits::add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                            const std::uint8_t* left_alone) {
  if (taken_ > layers_ || (taken_ == layers_ && coverage)) {
    throw Error("more layers than the plan has");
  }
  const auto row = [&](const std::uint8_t* from) {
    return from ? std::vector<std::uint8_t>(from, from + columns_) : std::vector<std::uint8_t>();
  };
  Layer layer{row(coverage), row(heights), row(left_alone)};
  if (taken_ > 0) give(taken_ < layers_ ? layer : Layer{});
  above_ = std::exchange(here_, std::move(layer));
  if (taken_ < layers_) coded_.append(coverage);
  ++taken_;
}

void MergedSlits::give(const Layer& below) {
  const auto rows = [](const std::vector<std::uint8_t>& row) {
    return row.empty() ? nullptr : row.data();
  };
  const std::uint8_t* coverage = rows(here_.coverage);
  if (!above_.coverage.empty() && !below.coverage.empty()) {
    for (std::size_t i = 0; i < columns_; ++i) {
      const bool slit = !at(here_.left_alone, i) &&
                        is_slit(beside(above_, i), at(here_.coverage, i), beside(below, i));
      room_[i] = slit ? kFull : at(here_.coverage, i);
    }
    coverage = room_.data();
  }
  solver_->add_layer(coverage, rows(here_.heights), rows(here_.left_alone));
}

void MergedSlits::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (taken_ < layers_) throw Error("the plan has more layers");
  if (taken_ > 0) give({});
  std::vector<std::uint8_t> coverage(columns_);
  solver_->solve(
      [&](int n, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
        if (n < coded_.slices()) {
          coded_.read(n, coverage.data());
        } else {
          std::fill(coverage.begin(), coverage.end(), std::uint8_t{0});
        }
        const bool nothing =
            dark || (all_zero(levels, columns_) && all_zero(coverage.data(), columns_));
        sink(n, levels, coverage.data(), nothing);
      },
      {});
}

}  // namespace slicecorr::detail
