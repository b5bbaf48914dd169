// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/views/page_parts.hpp"

#include <fmt/format.h>

#include "support/text/escape.hpp"

namespace slicecorr::tomo::detail {

using chart::Point;
using chart::Style;

void FigureTable::row(const char* name, const std::string& value, const std::string& meaning) {
  rows_ += fmt::format(
      R"(<tr><th scope="row">{}</th><td>{}</td><td style="white-space:normal;text-align:left">{}</td></tr>)",
      name, value, escape_markup(meaning));
}

std::string FigureTable::html() const {
  return R"(<div class="scroll"><table class="figures"><thead><tr><th scope="col">Figure</th><th scope="col">Value</th><th scope="col" style="text-align:left">What it means</th></tr></thead><tbody>)" +
         rows_ + "</tbody></table></div>";
}

std::string tile(const char* kind, const std::string& value, const std::string& what) {
  return fmt::format(R"(<div class="tile {}"><b>{}</b><span>{}</span></div>)", kind, value, what);
}

void draw_bins(chart::Panel& panel, const std::vector<double>& bins, double most, int series) {
  const auto count = static_cast<double>(bins.size());
  std::vector<Point> low, high;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double n = bins[i] > 0 ? bins[i] : 0.7;
    for (const std::size_t edge : {i, i + 1}) {
      low.push_back({most * static_cast<double>(edge) / count, 0.7});
      high.push_back({most * static_cast<double>(edge) / count, n});
    }
  }
  panel.band(low, high, Style::series, series);
  panel.line(high, Style::series, series);
}

}  // namespace slicecorr::tomo::detail
