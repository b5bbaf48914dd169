// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the pages of prints that gel as a whole have alike.
#pragma once

#include <string>
#include <vector>

#include "support/chart/chart.hpp"

namespace slicecorr::tomo::detail {

/// A table of figures: name, value, what it means.
class FigureTable {
 public:
  void row(const char* name, const std::string& value, const std::string& meaning);
  std::string html() const;

 private:
  std::string rows_;
};

/// A figure in a box; `kind`: "good", "bad" or empty.
std::string tile(const char* kind, const std::string& value, const std::string& what);

/// Bins from 0 to `most` as steps over a logarithmic axis from 0.7; single ones are seen, too.
void draw_bins(chart::Panel& panel, const std::vector<double>& bins, double most, int series);

}  // namespace slicecorr::tomo::detail
