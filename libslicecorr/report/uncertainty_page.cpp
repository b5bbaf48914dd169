// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "picture/embed.hpp"
#include "report/page_parts.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

using namespace page;

Markup uncertainty_section(const ReportContent& c) {
  if (!c.after.uncertain) return {};
  const UncertainPrint& p = *c.after.uncertain;
  Markup html = markup(
      R"(<h2>How sure this is</h2><p>With {}{}: ha is the absorbance height, dc the areal dose that gels; numbers are standard deviations. Bands hold 95 % of the prints.</p>)",
      p.inputs.text, p.inputs.from_fit ? ", those of the fit together" : "");
  const auto um = [](const EdgeBands& b, double value) {
    return b.edges ? fmt::format("{:.3g} um", value) : std::string("-");
  };
  Table table("figures");
  table.columns("Figure", "all edges", "upper edges", "lower edges");
  const bool any = p.upper.edges + p.lower.edges > 0;
  table.row("Mean height error to expect",
            any ? fmt::format("{:.3g} um", p.expected_mean_abs_um()) : std::string("-"),
            um(p.upper, p.upper.mean(p.upper.expected_abs_um)),
            um(p.lower, p.lower.mean(p.lower.expected_abs_um)));
  if (any) {
    table.row("The same in a bad print, 1 of 20", fmt::format("{:.3g} um", p.bad_mean_abs_um()), "",
              "");
  }
  table.row("Half of the band, mean", "", um(p.upper, p.upper.half_width_um.mean()),
            um(p.lower, p.lower.half_width_um.mean()));
  table.row("Half of the band, 95 % of edges within", "",
            um(p.upper, p.upper.half_width_um.quantile(0.95)),
            um(p.lower, p.lower.half_width_um.quantile(0.95)));
  for (std::size_t s = 0; s < kErrorSources; ++s) {
    const double upper = p.upper.mean(p.upper.by_source_um[s]);
    const double lower = p.lower.mean(p.lower.by_source_um[s]);
    if (!(upper > 0) && !(lower > 0)) continue;
    table.row(fmt::format("of it from {}", word_of(static_cast<ErrorSource>(s))), "",
              um(p.upper, upper), um(p.lower, lower));
  }
  table.row("Features that may vanish (2.5 % or more)",
            fmt::format("{} of {}; {:.1f} lost in the mean", p.may_vanish, p.runs, p.lost.value()),
            "", "");
  table.row(
      "Gaps that may fill (2.5 % or more)",
      fmt::format("{} of {}; {:.1f} filled in the mean", p.may_join, p.gaps, p.filled.value()), "",
      "");
  if (p.robust) {
    const RobustFigures& r = *p.robust;
    table.row("Robust: features lost, gaps filled in the range",
              fmt::format("{}, {}; without {}, {}", r.lost, r.filled, r.features, r.gaps), "", "");
    table.row("Robust: mean height error, inputs as they are said",
              fmt::format("{:.3g} um; without {:.3g} um", r.mean_abs_um, r.plain_mean_abs_um), "",
              "");
  }
  html += table;
  const auto worst = p.places.sorted();
  if (!worst.empty()) {
    constexpr std::size_t most = 8;
    std::string places;
    for (std::size_t i = 0; i < std::min(most, worst.size()); ++i) {
      const DoubtfulPlace& w = worst[i];
      places += fmt::format("{}{} of pixel {}, {} ({:.3g} %)", i ? "; " : "", place_in_words(w),
                            w.where.x, w.where.y, 100 * w.probability);
    }
    html += markup(R"(<p class="dim">Most doubtful: {}.</p>)", places);
  }
  if (!p.maps || !any) return html;
  const double scale_um = p.map_scale_um();
  const auto picture = [&](bool upper, const char* words) {
    return captioned_image(sensitivity_picture(*p.maps, upper, scale_um), words);
  };
  return html +
         markup(
             R"(<p class="key dim">Where edges are sure, as the images lie: the widest band of each column, from pale (sure) to black ({:.3g} um and more either way).</p><div class="pair">{}{}</div>)",
             scale_um, picture(true, "Upper edges, towards the platform"),
             picture(false, "Lower edges, away from it"));
}

}  // namespace slicecorr::detail
