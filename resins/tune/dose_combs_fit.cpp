// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/dose_combs_fit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

double known_number(const MeasuringForm& form, std::size_t row, const char* column) {
  if (const auto value = form.number(row, column, 1e-3, 1e7)) return *value;
  throw InputError(form.source, fmt::format("line {}, {}", form.lines[row], column),
                   "is empty; expected a number");
}

/// What was measured of a comb.
struct CombEdges {
  double dose_factor = 0;
  int edges = 0, measured = 0;
  double squares = 0;             ///< of how far edges are off
  std::vector<double> growth_um;  ///< by how much each tooth begins too early
};

DoseCombsFit::Comb growth_of(const CombEdges& e) {
  DoseCombsFit::Comb c{e.dose_factor, e.measured, e.edges, 0, std::sqrt(e.squares / e.measured),
                       kUnknown};
  const auto n = static_cast<double>(e.growth_um.size());
  double scatter = 0;
  for (const double g : e.growth_um) c.growth_um += g / n;
  for (const double g : e.growth_um) scatter += (g - c.growth_um) * (g - c.growth_um);
  if (n > 1) c.stderr_um = std::sqrt(scatter / (n - 1) / n);
  return c;
}

/// Where teeth end hardly moves with the dose: what lies elsewhere was measured from another zero.
void check_ends(const std::vector<double>& ends_um, double layer_um, const std::string& path) {
  if (ends_um.empty()) return;
  constexpr double most_layers = 3, most_um = 100;
  double mean = 0;
  for (const double end : ends_um) mean += end / static_cast<double>(ends_um.size());
  if (std::abs(mean) <= std::max(most_layers * layer_um, most_um)) return;
  throw InputError(
      path, "measured_um",
      fmt::format(
          "teeth end {:.0f} um {} than designed in the mean, where no dose brings them; expected "
          "places from the platform's side of the part",
          std::abs(mean), mean > 0 ? "later" : "earlier"));
}

}  // namespace

bool is_dose_combs_table(const std::string& path) {
  const auto form = read_form(path);
  return form && form->part == "dose-combs";
}

DoseCombsFit fit_dose_combs(const std::string& path) {
  const MeasuringForm form = read_form_of(path, {"dose-combs"});
  const double layer_um = form.fact("layer_um", 1e-3, 1e4), tall_um = 100 * layer_um;
  std::vector<CombEdges> all;
  std::vector<double> ends_um;  // by how much teeth end too late
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    const double factor = known_number(form, i, "dose_factor"),
                 designed = known_number(form, i, "designed_um");
    const std::string kind = form.cell(i, "kind");
    if (kind != "upper" && kind != "lower") {
      throw InputError(path, fmt::format("line {}, kind", form.lines[i]),
                       fmt::format("is '{}'; expected upper or lower", text::printable(kind)));
    }
    if (all.empty() || all.back().dose_factor != factor) all.push_back({factor, 0, 0, 0, {}});
    ++all.back().edges;
    const auto measured = form.number(i, "measured_um", 0, 1e9);
    if (!measured) continue;
    const double growth = kind == "upper" ? designed - *measured : *measured - designed;
    if (std::abs(growth) > tall_um) {
      throw InputError(
          path, fmt::format("line {}, measured_um", form.lines[i]),
          fmt::format("is {:g}, and the edge is designed at {:g} um; expected um from the platform",
                      *measured, designed));
    }
    ++all.back().measured;
    all.back().squares += growth * growth;
    (kind == "upper" ? all.back().growth_um : ends_um).push_back(growth);
  }
  check_ends(ends_um, layer_um, path);
  DoseCombsFit fit;
  for (const CombEdges& e : all) {
    if (!e.growth_um.empty()) fit.combs.push_back(growth_of(e));
  }
  std::sort(fit.combs.begin(), fit.combs.end(),
            [](const auto& a, const auto& b) { return a.dose_factor < b.dose_factor; });
  if (fit.combs.size() < 2) {
    throw InputError(
        path, "",
        fmt::format("has beginnings of teeth of {} {}; expected those of two combs and more",
                    fit.combs.size(), fit.combs.size() == 1 ? "comb" : "combs"));
  }
  for (std::size_t k = 1; k < fit.combs.size(); ++k) {
    if (fit.combs[k].rms_um < fit.combs[fit.best].rms_um) fit.best = k;
  }
  for (std::size_t k = 1; k < fit.combs.size(); ++k) {
    const auto &a = fit.combs[k - 1], &b = fit.combs[k];
    if (!(a.growth_um <= 0 && b.growth_um > 0)) continue;
    const double share = -a.growth_um / (b.growth_um - a.growth_um);
    const double step = std::log(b.dose_factor / a.dose_factor);
    fit.dose_factor = a.dose_factor * std::exp(share * step);
    fit.stderr_ln = std::hypot((1 - share) * a.stderr_um, share * b.stderr_um) * step /
                    (b.growth_um - a.growth_um);
    fit.line_ln = step / 8;
    return fit;
  }
  const bool grown = fit.combs.front().growth_um > 0;
  throw InputError(
      path, "",
      fmt::format(
          "teeth begin {} by {:.3g} um in the comb of {:g} times the gel dose, the {}, and growth passes 0 "
          "nowhere: the dose to aim at lies {} it; expected combs on both sides, by a gel dose {} as high or so",
          grown ? "too early" : "too late",
          std::abs(grown ? fit.combs.front().growth_um : fit.combs.back().growth_um),
          grown ? fit.combs.front().dose_factor : fit.combs.back().dose_factor,
          grown ? "least" : "greatest", grown ? "below" : "above", grown ? "half" : "twice"));
}

std::string DoseCombsFit::to_text() const {
  std::string out = fmt::format("{:>14} {:>8} {:>20} {:>14}\n", "times gel dose", "edges",
                                "begin too early, um", "edges off, um");
  for (const Comb& c : combs) {
    out += fmt::format("{:>14g} {:>8} {:>20.1f} {:>14.1f}\n", c.dose_factor,
                       fmt::format("{}/{}", c.measured, c.edges), c.growth_um, c.rms_um);
  }
  out += fmt::format("edges print as designed at {:.3g} times the gel dose", dose_factor);
  if (std::isfinite(stderr_ln)) {
    out += fmt::format(
        " (standard error {:.2g} % by the scatter of edges; the line between two combs adds up to {:.2g} %)",
        100 * stderr_ln, 100 * line_ln);
  }
  return out + fmt::format("; of the combs that of {:g} is least off\n", combs[best].dose_factor);
}

std::string resin_with_dose_factor(const std::string& text, const std::string& source,
                                   const std::string& name, const DoseCombsFit& fit) {
  const Resin before = parse_resin(text, source);
  if (before.gel_dose_mj_cm3 == 0 && before.dose_factor == 1) {
    throw InputError(source, "cure.dose_factor",
                     "the file gives the dose aimed at alone; expected the dose of gel");
  }
  TomlEdit edit(text, source);
  edit.set("", "name", toml_text(name));
  edit.set("cure", "dose_factor", toml_number(fit.dose_factor));
  edit.set_comment("cure", "dose_factor", "");
  edit.set("provenance", "dose_factor",
           toml_text(fmt::format("{:.4g} by combs of {} critical doses", fit.dose_factor,
                                 fit.combs.size())));
  const Resin after = parse_resin(edit.text(), source);
  if (std::abs(after.dose_factor - fit.dose_factor) > 1e-6 * fit.dose_factor) {
    throw InputError(
        source, "cure.critical_dose_mj_cm3",
        "says the dose to aim at beside that of gel; expected the dose of gel alone, with dose_factor");
  }
  return edit.text();
}

}  // namespace slicecorr::resins
