// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/views/dose_histogram.hpp"

#include <algorithm>

#include "support/chart/chart.hpp"

namespace slicecorr::tomo::detail {

DoseHistogram::DoseHistogram(double greatest, double gels)
    : most_(std::max(greatest, gels) * 1.02), gels_(gels) {
  for (auto& bins : bins_) bins.assign(kBins, 0);
}

void DoseHistogram::add(double value, bool part) {
  const auto bin = static_cast<std::size_t>(std::max(0.0, value / most_ * kBins));
  ++bins_[part ? 1 : 0][std::min(kBins - 1, bin)];
}

std::string DoseHistogram::svg(const Words& words) const {
  double tallest = 10;
  for (const auto& bins : bins_) {
    for (const double n : bins) tallest = std::max(tallest, n);
  }
  chart::Panel panel({words.axis, false, 0, most_}, {words.counted, true, 0.7, tallest * 1.5}, 260);
  panel.bins(bins_[0], most_, 0);
  panel.bins(bins_[1], most_, 1);
  panel.vertical(gels_, "gels");
  chart::Picture picture(words.title, words.text);
  picture.legend_band(chart::Style::series, words.outside, 0);
  picture.legend_band(chart::Style::series, "part", 1);
  picture.add(panel);
  picture.note(words.note);
  return picture.svg();
}

}  // namespace slicecorr::tomo::detail
