// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The page about a resin.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/fit_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/resins/plots.hpp"
#include "support/chart/chart.hpp"
#include "support/page/page_style.hpp"
#include "support/text/escape.hpp"

namespace slicecorr::resins {

namespace {

using chart::figure;

std::string row(const std::string& name, const std::vector<std::string>& cells) {
  std::string html = fmt::format("<tr><th scope=\"row\">{}</th>", escape_markup(name));
  for (const std::string& c : cells) html += fmt::format("<td>{}</td>", escape_markup(c));
  return html + "</tr>";
}

std::string value(double v, const std::string& unit) {
  if (!(v > 0) || !std::isfinite(v)) return "-";
  return figure(v) + (unit.empty() ? "" : " " + unit);
}

std::string figures_table(const ResinRecord& record) {
  const ResinFigures f = figures_of(record.resin);
  const double m = record.resin.m;
  std::string html =
      "<h2>Figures</h2><div class=\"scroll\"><table class=\"figures\"><thead><tr><th "
      "scope=\"col\">Figure</th><th scope=\"col\">areal, base e</th><th scope=\"col\">volumetric, "
      "base 10</th></tr></thead><tbody>";
  html += row("Absorbance height",
              {value(f.height_e_um, "um (1/e)"), value(f.height10_um, "um (1/10)")});
  if (record.resin.has_gel_time()) {
    const double factor = record.resin.dose_factor, a = record.resin.gel_a_mj_cm2,
                 b = record.resin.gel_b_sqrt_mw_cm2_s;
    html += row("Time to gel A/i + B/√i: A", {value(a / factor, "mJ/cm²"), ""});
    html += row("B", {value(b / factor, "√(mW/cm²)·s"), ""});
    html += row("Aimed at: A", {value(a, "mJ/cm²"), ""});
    html += row("B", {value(b, "√(mW/cm²)·s"), ""});
    html += row("Aim over time to gel", {value(factor, ""), ""});
    return html + "</tbody></table></div>";
  }
  if (m == 1) {
    html += row("Gel dose", {value(f.gel_mj_cm2, "mJ/cm²"), value(f.gel_mj_cm3, "mJ/cm³")});
    html += row("Dose aimed at", {value(f.aim_mj_cm2, "mJ/cm²"), value(f.aim_mj_cm3, "mJ/cm³")});
  }
  if (f.gel_prime > 0 && (m != 1 || f.gel_mj_cm2 <= 0)) {
    html +=
        row("Gel dose D′c", {value(f.gel_prime, prime_unit(m)),
                             value(f.gel_prime_volumetric, fmt::format("(mW/cm³)^{:.3g} s", m))});
  }
  if (f.aim_prime > 0 && m != 1) {
    html += row("Aim D′", {value(f.aim_prime, prime_unit(m)),
                           value(f.aim_prime_volumetric, fmt::format("(mW/cm³)^{:.3g} s", m))});
  }
  html += row("Aim over gel dose", {value(f.dose_factor, ""), ""});
  html += row("Exponent m", {figure(m), ""});
  if (f.beta > 0) {
    html += row("Inhibition β", {value(f.beta, ""), value(f.beta_volumetric, "")});
    html += row("Absorbance height, UV",
                {value(f.huv_e_um, "um (1/e)"), value(f.huv10_um, "um (1/10)")});
    if (record.resin.inhibition) {
      html += row("Exponent m under UV", {figure(record.resin.inhibition->m), ""});
    }
  }
  return html + "</tbody></table></div>";
}

std::string list_of(const char* heading, const std::vector<std::string>& lines) {
  if (lines.empty()) return {};
  std::string html = fmt::format("<h3>{}</h3><ul>", heading);
  for (const std::string& line : lines) html += fmt::format("<li>{}</li>", escape_markup(line));
  return html + "</ul>";
}

std::string title_of(FitModel model) {
  switch (model) {
    case FitModel::jacobs:
      return "Jacobs fit";
    case FitModel::kinetic:
      return "Kinetic fit";
    case FitModel::gel_time:
      return "Gel-time fit";
    case FitModel::dead_zone_steady:
      return "Dead zone, steady fit";
    case FitModel::dead_zone_transient:
      return "Dead zone, transient fit";
    case FitModel::joint:
      return "Joint fit";
  }
  return {};
}

std::string fit_section(const FitResult& fit) {
  std::string html = fmt::format("<h3>{}</h3><p>", title_of(fit.model));
  for (const Parameter& p : fit.parameters) html += escape_markup(parameter_words(p)) + "<br>";
  html +=
      fmt::format("R² {:.4f}, RMSE {} um, {} measurements</p>", fit.r2, figure(fit.rmse_um), fit.n);
  if (fit.reciprocity) html += fmt::format("<p>{}</p>", escape_markup(fit.reciprocity->verdict));
  std::vector<std::string> outliers;
  for (const Outlier& o : fit.outliers) outliers.push_back(o.reason);
  return html + list_of("Warnings", fit.warnings) + list_of("Outliers", outliers);
}

std::string fronts_figures(const ResinRecord& record, const std::vector<FitResult>& fits) {
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
  std::string html;
  for (const double part : k.beta > 0 ? std::vector{1.0, 0.3} : std::vector{1.0}) {
    html += fmt::format("<figure>{}</figure>", fronts_svg(k, part * blue, part * uv));
  }
  return html;
}

std::string pictures(const ResinRecord& record, const std::vector<FitResult>& fits) {
  std::string html;
  const auto add = [&](auto draw) {
    try {
      html += fmt::format("<figure>{}</figure>", draw());
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
    if (f.model != FitModel::dead_zone_steady && f.model != FitModel::dead_zone_transient) {
      add([&] { return working_curve_svg(f, factor); });
    }
    if (f.model != FitModel::jacobs && f.model != FitModel::kinetic &&
        f.model != FitModel::gel_time) {
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
  return fmt::format("<h2>Pictures</h2><div class=\"pair\">{}</div>", html);
}

}  // namespace

std::string resin_page(const ResinRecord& record, const std::vector<FitResult>& fits,
                       const std::vector<Version>& versions) {
  std::string html = fmt::format(
      "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, "
      "initial-scale=1\"><title>{}</title><style>{}.slc-plot{{display:block;width:100%;height:auto}}ul{{margin:.3em "
      "0;padding-left:1.3em}}pre{{overflow-x:auto;font-size:.85rem}}td{{vertical-align:top}}.words "
      "th{{white-space:normal}}.words "
      "td{{white-space:normal;text-align:left;overflow-wrap:anywhere}}</style></head><body><main><h1>{}</h1>",
      escape_markup(record.name), detail::page_page_css, escape_markup(record.name));
  std::string about;
  for (const std::string& text : {record.maker, record.product, record.chemistry, record.colour}) {
    if (!text.empty()) about += (about.empty() ? "" : ", ") + text;
  }
  if (record.wavelength_nm > 0) {
    about += fmt::format("{}{:g} nm", about.empty() ? "" : ", ", record.wavelength_nm);
  }
  about += fmt::format("{}version {}", about.empty() ? "" : ", ", record.version);
  html += fmt::format("<p class=\"dim\">{}</p><p><strong>{}</strong></p>", escape_markup(about),
                      escape_markup(aim_words(record.resin)));
  if (!record.notes.empty()) html += fmt::format("<p>{}</p>", escape_markup(record.notes));
  html += figures_table(record);
  if (!fits.empty()) {
    html += "<h2>Fits</h2>";
    for (const FitResult& f : fits) html += fit_section(f);
  }
  html += pictures(record, fits);
  if (!record.provenance.empty()) {
    html += "<h2>Where it comes from</h2><div class=\"scroll\"><table class=\"words\"><tbody>";
    for (const auto& [key, text] : record.provenance) {
      std::string words = key;
      std::replace(words.begin(), words.end(), '_', ' ');
      html += row(words, {text});
    }
    html += "</tbody></table></div>";
  }
  if (!versions.empty()) {
    html +=
        "<h2>History</h2><div class=\"scroll\"><table class=\"words\"><thead><tr><th "
        "scope=\"col\">Version</th><th scope=\"col\">Date</th><th "
        "scope=\"col\">Why</th></tr></thead><tbody>";
    for (auto v = versions.rbegin(); v != versions.rend(); ++v) {
      html +=
          row(fmt::format("{}{}", v->number, v->current ? " (now)" : ""), {v->date, v->message});
    }
    html += "</tbody></table></div>";
  }
  if (!record.text.empty()) {
    html += fmt::format("<details><summary>The file</summary><pre>{}</pre></details>",
                        escape_markup(record.text));
  }
  return html + "</main></body></html>\n";
}

}  // namespace slicecorr::resins
