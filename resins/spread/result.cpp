// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a fit of spread found, as text, JSON, and lines of a printer and a resin file.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "database/toml_edit.hpp"
#include "fit/figure_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/record.hpp"
#include "slicecorr/resins/spread_fit.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

constexpr const char* kScatter = "scatter_um2_per_um";

/// Of a parameter that not every fit has.
const SpreadParameter* find(const SpreadFit& fit, const std::string& name) {
  for (const SpreadParameter& p : fit.parameters) {
    if (p.name == name) return &p;
  }
  return nullptr;
}

std::string interval(const SpreadParameter& p) {
  return fmt::format("95 %: {} to {}", figure(p.ci95[0], p.standard_error),
                     figure(p.ci95[1], p.standard_error));
}

std::string spread_as_toml(const SpreadFit& fit) {
  std::string text;
  for (const SpreadGaussian& g : fit.spread().gaussians) {
    text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", toml_number(g.sigma_um, 6),
                        toml_number(g.weight, 6));
  }
  return fmt::format("[{}]", text);
}

}  // namespace

const SpreadParameter& SpreadFit::parameter(const std::string& name) const {
  if (const SpreadParameter* const p = find(*this, name)) return *p;
  throw InputError(fmt::format("'{}' is no parameter of this fit of spread", name));
}

LightSpread SpreadFit::spread() const {
  LightSpread s;
  const SpreadParameter* const weight = find(*this, "weight2");
  const double second = weight ? weight->value : 0;
  s.gaussians.push_back({parameter("sigma_um").value, 1 - second});
  if (second > 0) s.gaussians.push_back({parameter("sigma2_um").value, second});
  return s;
}

std::string SpreadFit::to_text() const {
  std::string text = fmt::format(
      "{} {}, {} off in the mean square, {} degrees of freedom\n", measurements,
      of_widths ? "widths" : "places at edges",
      of_widths ? fmt::format("{:.3g} um", rms) : fmt::format("{:.2g} % of the step", 100 * rms),
      freedom);
  for (const SpreadParameter& p : parameters) {
    text += fmt::format("  {:<18} {:>12} {:<7} ({})\n", p.name,
                        figure(p.value, p.fitted ? p.standard_error : 0), p.unit,
                        p.fitted ? interval(p) : "held");
  }
  for (const std::string& note : notes) text += note + "\n";
  return text + "\n" + to_toml();
}

std::string SpreadFit::to_json() const {
  const auto finite = [](double v) {
    return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr);
  };
  nlohmann::ordered_json j;
  j["source"] = source;
  j["kind"] = of_widths ? "widths" : "edges";
  j["measurements"] = measurements;
  j["freedom"] = freedom;
  j[of_widths ? "rms_um" : "rms_of_step"] = rms;
  for (const SpreadParameter& p : parameters) {
    nlohmann::ordered_json& out = j["parameters"][p.name];
    out["value"] = p.value;
    out["unit"] = p.unit;
    out["fitted"] = p.fitted;
    if (!p.fitted) continue;
    out["standard_error"] = p.standard_error;
    out["ci95"] = {p.ci95[0], p.ci95[1]};
  }
  j["spread"] = nlohmann::ordered_json::array();
  for (const SpreadGaussian& g : spread().gaussians) j["spread"].push_back({g.sigma_um, g.weight});
  j[kScatter] = parameter(kScatter).value;
  j["residuals"] = nlohmann::ordered_json::array();
  for (const SpreadResidual& r : residuals) {
    nlohmann::ordered_json row = {
        {"source", r.source}, {"line", r.line}, {"depth_um", finite(r.depth_um)}};
    if (of_widths) {
      row["kind"] = r.kind == WidthKind::gap ? "gap" : "line";
      row["designed_um"] = r.designed_um;
      row["printed_um"] = r.measured;
      row["found_um"] = std::max(0.0, r.found);
    } else {
      row["edge"] = r.edge;
      row["at_um"] = r.at_um;
      row["measured"] = r.measured;
      row["found"] = r.found;
    }
    row["left_out"] = r.left_out;
    j["residuals"].push_back(row);
  }
  j["notes"] = notes;
  j["toml"] = to_toml();
  return j.dump(2);
}

std::string SpreadFit::to_toml() const {
  std::string text = fmt::format("[{}]\nspread = {}", light, spread_as_toml(*this));
  const SpreadParameter& sigma = parameter("sigma_um");
  if (sigma.fitted) text += fmt::format("  # sigma, {}", interval(sigma));
  text += "\n";
  const SpreadParameter& scatter = parameter(kScatter);
  if (scatter.fitted) {
    text += fmt::format("# In the resin's file, [cure]: {} = {}  ({})\n", kScatter,
                        toml_number(std::max(0.0, scatter.value), 6), interval(scatter));
  }
  return text;
}

std::string printer_with_spread(const std::string& text, const std::string& source,
                                const SpreadFit& fit) {
  parse_printer(text, source);
  const SpreadParameter& sigma = fit.parameter("sigma_um");
  if (sigma.fitted && sigma.ci95[0] < 0) {
    throw InputError(source, "",
                     fmt::format("is not written: sigma_um can't be told from 0 ({}); expected "
                                 "measurements that tell it",
                                 interval(sigma)));
  }
  TomlEdit edit(text, source);
  edit.remove(fit.light, "spread_pitch_um");
  edit.set(fit.light, "spread", spread_as_toml(fit));
  parse_printer(edit.text(), source);
  return edit.text();
}

std::string resin_with_scatter(const std::string& text, const std::string& source,
                               const SpreadFit& fit) {
  parse_resin(text, source);
  const SpreadParameter& scatter = fit.parameter(kScatter);
  if (!scatter.fitted) {
    throw InputError(source, "",
                     "is not written: the scatter was not fitted; expected measurements at several "
                     "depths (depth_um)");
  }
  if (scatter.ci95[0] <= 0) {
    throw InputError(source, "",
                     fmt::format("is not written: the scatter can't be told from 0 ({}); expected "
                                 "depths further apart",
                                 interval(scatter)));
  }
  TomlEdit edit(text, source);
  edit.set(edit.has("", kScatter) ? "" : "cure", kScatter, toml_number(scatter.value, 6));
  parse_resin(edit.text(), source);
  return edit.text();
}

}  // namespace slicecorr::resins
