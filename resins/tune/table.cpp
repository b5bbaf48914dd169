// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of measured test parts.
#include <fmt/format.h>

#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/resins/tune.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

double required(const MeasuringForm& form, std::size_t row, const char* column, double least,
                double most) {
  if (const auto value = form.number(row, column, least, most)) return *value;
  throw InputError(form.source, fmt::format("line {}, {}", form.lines[row], column),
                   "is empty; expected a number");
}

}  // namespace

TuningTable read_tuning_table(const std::string& path) {
  const MeasuringForm form = read_form_of(path, {"comb", "lift-comb", "staircase", "wedge"});
  TuningTable table;
  table.kind = form.part;
  table.part.source = path;
  const auto whole = [&](const char* name) { return static_cast<int>(form.fact(name, 0, 65536)); };
  table.part.layer_um = form.fact("layer_um", 1e-3, 1e4);
  table.width_px = whole("width_px");
  table.height_px = whole("height_px");
  const bool comb = table.printed();
  if (comb) {
    table.x_px = whole("x_px");
    table.y_px = whole("y_px");
  }
  form.expect_column(comb ? "measured_um" : "cured_height_um");
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    MeasuredEdge e;
    e.name = form.cell(i, "name");
    if (comb) {
      const std::string kind = form.cell(i, "kind");
      if (kind != "upper" && kind != "lower") {
        throw InputError(path, fmt::format("line {}, kind", form.lines[i]),
                         fmt::format("is '{}'; expected upper or lower", text::printable(kind)));
      }
      e.kind = kind == "upper" ? MeasuredKind::upper : MeasuredKind::lower;
      e.designed_um = required(form, i, "designed_um", 0, 1e7);
    } else {
      e.kind = MeasuredKind::plug;
      e.intensity_mw_cm2 = required(form, i, "intensity_mw_cm2", 0, 1e7);
      e.exposure_s = required(form, i, "shown_s", 0, 1e7);
      e.dark_s = required(form, i, "dark_s", 0, 1e7);
      e.dark_mw_cm2 = required(form, i, "dark_mw_cm2", 0, 1e7);
    }
    const auto measured = form.number(i, comb ? "measured_um" : "cured_height_um", 0, 1e9);
    e.measured_um = measured ? *measured : std::numeric_limits<double>::quiet_NaN();
    table.part.edges.push_back(e);
  }
  return table;
}

}  // namespace slicecorr::resins
