// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a fit of optics found, as text, JSON, lines of a printer file, and a picture.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "database/toml_edit.hpp"
#include "fit/figure_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/optics_fit.hpp"
#include "slicecorr/vial.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::resins {

namespace {

/// Keys of the printer file that a fit may find, by table.
const std::map<std::string, std::string>& tables() {
  static const std::map<std::string, std::string> all = {
      {"distance_mm", "optics"}, {"axis_right_px", "optics"}, {"axis_up_px", "optics"},
      {"tilt_deg", "optics"},    {"outer_mm", "vial"},        {"inner_mm", "vial"},
      {"n_wall", "vial"}};
  return all;
}

std::string line_of(const OpticsParameter& p) {
  return fmt::format("  {:<14} {:>12} {:<8} (95 %: {} to {}; was {})\n", p.name,
                     figure(p.value, p.standard_error), p.unit, figure(p.ci95[0], p.standard_error),
                     figure(p.ci95[1], p.standard_error), figure(p.before));
}

}  // namespace

const OpticsParameter& OpticsFit::parameter(const std::string& name) const {
  for (const OpticsParameter& p : parameters) {
    if (p.name == name) return p;
  }
  throw InputError(fmt::format("'{}' is no parameter of optics", name));
}

std::string OpticsFit::to_text() const {
  std::string text =
      fmt::format("{} columns and rows, {} off in the mean square, {} degrees of freedom\n",
                  measurements, fmt::format("{:.3g} pixels", rms_px), freedom);
  for (const OpticsParameter& p : parameters) {
    if (p.fitted) text += line_of(p);
  }
  for (const std::string& note : notes) text += note + "\n";
  return text + "\n" + to_toml();
}

std::string OpticsFit::to_json() const {
  const auto finite = [](double v) {
    return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr);
  };
  nlohmann::ordered_json j;
  j["source"] = source;
  j["printer"] = printer.name;
  j["measurements"] = measurements;
  j["freedom"] = freedom;
  j["rms_px"] = rms_px;
  j["apart_px"] = apart_px;
  j["fits"] = fits;
  j["n"] = n;
  for (const OpticsParameter& p : parameters) {
    nlohmann::ordered_json& out = j["parameters"][p.name];
    out["value"] = p.value;
    out["unit"] = p.unit;
    out["before"] = p.before;
    out["fitted"] = p.fitted;
    if (!p.fitted) continue;
    out["standard_error"] = p.standard_error;
    out["ci95"] = {p.ci95[0], p.ci95[1]};
  }
  j["residuals"] = nlohmann::ordered_json::array();
  for (const OpticsResidual& r : residuals) {
    j["residuals"].push_back({{"line", r.line},
                              {"angle_deg", r.angle_deg},
                              {"column_px", finite(r.column_px)},
                              {"row_px", finite(r.row_px)},
                              {"column_left_out", r.column_left_out},
                              {"row_left_out", r.row_left_out}});
  }
  j["notes"] = notes;
  j["toml"] = to_toml();
  return j.dump(2);
}

std::string OpticsFit::to_toml() const {
  std::string text;
  for (const char* table : {"vial", "optics"}) {
    std::string lines;
    for (const OpticsParameter& p : parameters) {
      const auto home = tables().find(p.name);
      if (home == tables().end() || home->second != table) continue;
      if (!p.fitted && p.value == p.before) continue;
      lines += fmt::format("{} = {:.6f}", p.name, p.value);
      if (p.fitted) {
        lines += fmt::format("  # 95 %: {} to {}", figure(p.ci95[0], p.standard_error),
                             figure(p.ci95[1], p.standard_error));
      }
      lines += "\n";
    }
    if (!lines.empty()) text += fmt::format("[{}]\n{}", table, lines);
  }
  const OpticsParameter& index = parameter("n");
  if (index.fitted || index.value != index.before) {
    text += fmt::format("# In the resin's file: n = {:.5f}\n", index.value);
  }
  return text;
}

std::string OpticsFit::wobble_csv() const {
  struct Sum {
    double right = 0, up = 0;
    int columns = 0, rows = 0;
  };
  std::map<double, Sum> by_angle;
  for (const OpticsResidual& r : residuals) {
    double angle = std::round((r.angle_deg - 360 * std::floor(r.angle_deg / 360)) * 1e6) * 1e-6;
    if (angle >= 360) angle = 0;
    Sum& s = by_angle[angle];
    if (std::isfinite(r.column_px) && !r.column_left_out) {
      s.right += r.column_px;
      ++s.columns;
    }
    if (std::isfinite(r.row_px) && !r.row_left_out) {
      s.up -= r.row_px;
      ++s.rows;
    }
  }
  std::string text = "angle_deg,right_px,up_px\n";
  for (const auto& [angle, s] : by_angle) {
    const AxisWobble was = wobble_at(*printer.rotation, angle);
    text += fmt::format("{:g},{:.4f},{:.4f}\n", angle,
                        was.right_px + (s.columns ? s.right / s.columns : 0),
                        was.up_px + (s.rows ? s.up / s.rows : 0));
  }
  return text;
}

std::string printer_with_optics(const std::string& text, const std::string& source,
                                const OpticsFit& fit) {
  require_tomographic(parse_printer(text, source));
  TomlEdit edit(text, source);
  for (const OpticsParameter& p : fit.parameters) {
    const auto home = tables().find(p.name);
    if (home == tables().end() || (!p.fitted && p.value == p.before)) continue;
    edit.set(home->second, p.name, toml_number(p.value, 8));
  }
  parse_printer(edit.text(), source);
  return edit.text();
}

std::string optics_fit_svg(const OpticsFit& fit) {
  using namespace chart;
  std::vector<double> angles, off;
  std::map<std::pair<double, double>, int> pins;
  bool rows = false, outliers = false;
  for (const OpticsResidual& r : fit.residuals) {
    angles.push_back(r.angle_deg);
    pins.emplace(std::pair{r.radius_mm, r.pin_deg}, static_cast<int>(pins.size()));
    rows = rows || std::isfinite(r.row_px);
    outliers = outliers || r.column_left_out || r.row_left_out;
    for (const auto& [v, out] :
         {std::pair{r.column_px, r.column_left_out}, {r.row_px, r.row_left_out}}) {
      if (std::isfinite(v) && !out) off.insert(off.end(), {v, -v});
    }
  }
  if (off.empty()) throw InputError(fit.source, "", "has no points to draw");
  Picture picture(
      fmt::format("{}: columns{} measured less found", fit.printer.name, rows ? " and rows" : ""),
      "Residuals of a fit of optics, in pixels, by the angle of the stage");
  const auto panel_of = [&](double OpticsResidual::*value, bool OpticsResidual::*out,
                            const std::string& title) {
    Panel panel(axis_over("angle of the stage, degrees", false, angles),
                axis_over(title, false, off), 240);
    panel.horizontal(0, "");
    for (const OpticsResidual& r : fit.residuals) {
      if (!std::isfinite(r.*value)) continue;
      const Point at{r.angle_deg, std::clamp(r.*value, *std::min_element(off.begin(), off.end()),
                                             *std::max_element(off.begin(), off.end()))};
      panel.point(at, pins.at({r.radius_mm, r.pin_deg}),
                  fmt::format("line {}: {:.3f} pixels", r.line, r.*value));
      if (r.*out) panel.ring(at, fmt::format("line {}: {:.1f}", r.line, r.*value));
    }
    picture.add(panel);
  };
  panel_of(&OpticsResidual::column_px, &OpticsResidual::column_left_out, "column, pixels");
  if (rows) panel_of(&OpticsResidual::row_px, &OpticsResidual::row_left_out, "row, pixels");
  int shown = 0;
  for (const auto& [pin, series] : pins) {
    if (++shown > 8) break;
    picture.legend_point(series, fmt::format("pin {} mm from the axis, at {} degrees",
                                             figure(pin.first), figure(pin.second)));
  }
  if (outliers) picture.legend_ring("left out");
  for (const OpticsParameter& p : fit.parameters) {
    if (!p.fitted) continue;
    picture.note(fmt::format(
        "{} = {} {} (95 %: {} to {})", p.name, resins::figure(p.value, p.standard_error), p.unit,
        resins::figure(p.ci95[0], p.standard_error), resins::figure(p.ci95[1], p.standard_error)));
  }
  return picture.svg();
}

}  // namespace slicecorr::resins
