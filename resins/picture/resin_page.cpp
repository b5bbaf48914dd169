// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The page about a resin.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/fit_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/resins/plots.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::resins {

namespace {

using chart::figure;
using namespace page;

std::string value(double v, const std::string& unit) {
  if (!(v > 0) || !std::isfinite(v)) return "-";
  return figure(v) + (unit.empty() ? "" : " " + unit);
}

Markup figures_table(const ResinRecord& record) {
  const ResinFigures f = figures_of(record.resin);
  const double m = record.resin.m;
  Table table("figures");
  table.columns("Figure", "areal, base e", "volumetric, base 10");
  table.row("Absorbance height", value(f.height_e_um, "um (1/e)"),
            value(f.height10_um, "um (1/10)"));
  if (record.resin.has_gel_time()) {
    const double factor = record.resin.dose_factor, a = record.resin.gel_a_mj_cm2,
                 b = record.resin.gel_b_sqrt_mw_cm2_s;
    table.row("Time to gel A/i + B/√i: A", value(a / factor, "mJ/cm²"), "");
    table.row("B", value(b / factor, "√(mW/cm²)·s"), "");
    table.row("Aimed at: A", value(a, "mJ/cm²"), "");
    table.row("B", value(b, "√(mW/cm²)·s"), "");
    table.row("Aim over time to gel", value(factor, ""), "");
    return table;
  }
  if (is_relative(record.resin)) {
    const std::string unit(unit_of_dose(record.resin.unit));
    table.row("Gel dose", value(f.gel_mj_cm2, unit), "");
    table.row("Dose aimed at", value(f.aim_mj_cm2, unit), "");
  } else if (m == 1) {
    table.row("Gel dose", value(f.gel_mj_cm2, "mJ/cm²"), value(f.gel_mj_cm3, "mJ/cm³"));
    table.row("Dose aimed at", value(f.aim_mj_cm2, "mJ/cm²"), value(f.aim_mj_cm3, "mJ/cm³"));
  }
  if (f.gel_prime > 0 && (m != 1 || f.gel_mj_cm2 <= 0)) {
    table.row("Gel dose D′c", value(f.gel_prime, prime_unit(m)),
              value(f.gel_prime_volumetric, fmt::format("(mW/cm³)^{:.3g} s", m)));
  }
  if (f.aim_prime > 0 && m != 1) {
    table.row("Aim D′", value(f.aim_prime, prime_unit(m)),
              value(f.aim_prime_volumetric, fmt::format("(mW/cm³)^{:.3g} s", m)));
  }
  table.row("Aim over gel dose", value(f.dose_factor, ""), "");
  table.row("Exponent m", figure(m), "");
  if (f.beta > 0) {
    table.row("Inhibition β", value(f.beta, ""), value(f.beta_volumetric, ""));
    table.row("Absorbance height, UV", value(f.huv_e_um, "um (1/e)"),
              value(f.huv10_um, "um (1/10)"));
    if (record.resin.inhibition) {
      table.row("Exponent m under UV", figure(record.resin.inhibition->m), "");
    }
  }
  return table;
}

Markup list_of(const char* heading, const std::vector<std::string>& lines) {
  if (lines.empty()) return {};
  return markup("<h3>{}</h3><ul>{}</ul>", heading, items(lines));
}

Markup fit_section(const FitResult& fit) {
  Markup html = markup("<h3>{}</h3><p>", kind_of(fit.model).title);
  for (const Parameter& p : fit.parameters) html += markup("{}<br>", parameter_words(p));
  html += markup("R² {:.4f}, RMSE {} um, {} measurements</p>", fit.r2, figure(fit.rmse_um), fit.n);
  if (fit.reciprocity) html += markup("<p>{}</p>", fit.reciprocity->verdict);
  std::vector<std::string> outliers;
  for (const Outlier& o : fit.outliers) outliers.push_back(o.reason);
  return html + list_of("Warnings", fit.warnings) + list_of("Outliers", outliers);
}

Markup fronts_figures(const ResinRecord& record, const std::vector<FitResult>& fits) {
  // Fronts under so many mW/cm² say nothing of a resin whose doses are in another unit.
  if (is_relative(record.resin)) return {};
  const Kinetics k = make_kinetics(record.resin, record.resin.inhibition.has_value(), false);
  // As measured where dead zones were; else round numbers with UV twice as strong as is needed to
  // keep the window free.
  double blue = 100, uv = k.beta > 0 ? 2 * blue / k.beta : 0;
  for (const FitResult& f : fits) {
    for (const FitPoint& p : f.points) {
      if (p.is_dead_zone && k.beta * p.uv_mw_cm2 > p.blue_mw_cm2) {
        blue = p.blue_mw_cm2;
        uv = p.uv_mw_cm2;
      }
    }
  }
  Markup html;
  for (const double part : k.beta > 0 ? std::vector{1.0, 0.3} : std::vector{1.0}) {
    html += markup("<figure>{}</figure>", Markup::raw(fronts_svg(k, part * blue, part * uv)));
  }
  return html;
}

Markup pictures(const ResinRecord& record, const std::vector<FitResult>& fits) {
  Markup html;
  const auto add = [&](auto draw) {
    try {
      html += markup("<figure>{}</figure>", Markup::raw(draw()));
    } catch (const InputError&) {
      // A fit without measurements of this kind, a record without a dose: nothing to draw.
    }
  };
  const ResinFigures figures = figures_of(record.resin);
  const double factor = figures.dose_factor > 1 ? figures.dose_factor : kDefaultDoseFactor;
  const FitResult *jacobs = nullptr, *kinetic = nullptr;
  for (const FitResult& f : fits) {
    if (f.model == FitModel::jacobs) jacobs = &f;
    if (f.model == FitModel::kinetic || f.model == FitModel::joint) kinetic = &f;
    if (kind_of(f.model).heights) {
      add([&] { return working_curve_svg(f, factor); });
    }
    if (kind_of(f.model).dead_zones) {
      add([&] { return dead_zone_svg(f); });
    }
  }
  if (jacobs && kinetic) add([&] { return collapse_svg(*jacobs, *kinetic); });
  if (fits.empty()) add([&] { return record_svg(record); });
  try {
    html += fronts_figures(record, fits);
  } catch (const InputError&) {
  }
  if (html.empty()) return {};
  return markup(R"(<h2>Pictures</h2><div class="pair">{}</div>)", html);
}

}  // namespace

std::string resin_page(const ResinRecord& record, const std::vector<FitResult>& fits,
                       const std::vector<Version>& versions) {
  Page page(
      record.name,
      {".slc-plot{display:block;width:100%;height:auto}ul{margin:.3em "
       "0;padding-left:1.3em}pre{overflow-x:auto;font-size:.85rem}td{vertical-align:top}.words "
       "th{white-space:normal}.words "
       "td{white-space:normal;text-align:left;overflow-wrap:anywhere}"});
  std::string about;
  for (const std::string& text : {record.maker, record.product, record.chemistry, record.colour}) {
    if (!text.empty()) about += (about.empty() ? "" : ", ") + text;
  }
  if (record.wavelength_nm > 0) {
    about += fmt::format("{}{:g} nm", about.empty() ? "" : ", ", record.wavelength_nm);
  }
  about += fmt::format("{}version {}", about.empty() ? "" : ", ", record.version);
  page +=
      markup(R"(<p class="dim">{}</p><p><strong>{}</strong></p>)", about, aim_words(record.resin));
  if (!record.notes.empty()) page += markup("<p>{}</p>", record.notes);
  page += markup("<h2>Figures</h2>{}", figures_table(record));
  if (!fits.empty()) page += markup("<h2>Fits</h2>");
  for (const FitResult& f : fits) page += fit_section(f);
  page += pictures(record, fits);
  if (!record.provenance.empty()) {
    Table table("words");
    for (const auto& [key, text] : record.provenance) {
      std::string words = key;
      std::replace(words.begin(), words.end(), '_', ' ');
      table.row(words, text);
    }
    page += markup("<h2>Where it comes from</h2>{}", table);
  }
  if (!versions.empty()) {
    Table table("words");
    table.columns("Version", "Date", "Why");
    for (auto v = versions.rbegin(); v != versions.rend(); ++v) {
      table.row(fmt::format("{}{}", v->number, v->current ? " (now)" : ""), v->date, v->message);
    }
    page += markup("<h2>History</h2>{}", table);
  }
  if (!record.text.empty()) {
    page += markup("<details><summary>The file</summary><pre>{}</pre></details>", record.text);
  }
  return page.html() + "\n";
}

}  // namespace slicecorr::resins
