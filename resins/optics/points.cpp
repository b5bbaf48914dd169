// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Points of a fit of optics, as a table.
#include <cmath>

#include "measure/number_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/optics_fit.hpp"

namespace slicecorr::resins {

namespace {

struct Column {
  NumberColumn column;
  double OpticsPoint::*field;
};
const Column kColumns[] = {{{"angle_deg", -1e6, 1e6, true, false}, &OpticsPoint::angle_deg},
                           {{"radius_mm", 0, 1e4, true, false}, &OpticsPoint::radius_mm},
                           {{"pin_deg", -360, 360}, &OpticsPoint::pin_deg},
                           {{"z_mm", -1e4, 1e4}, &OpticsPoint::z_mm},
                           {{"column_px", -1e5, 1e5}, &OpticsPoint::column_px},
                           {{"row_px", -1e5, 1e5}, &OpticsPoint::row_px},
                           {{"sigma_px", 1e-6, 1e5, false, false}, &OpticsPoint::sigma_px}};

}  // namespace

OpticsPoints read_optics_points(const std::string& path) {
  OpticsPoints all{path, {}};
  std::vector<NumberColumn> columns;
  for (const Column& c : kColumns) columns.push_back(c.column);
  read_number_table(
      path, columns,
      "angle_deg, radius_mm, column_px, and pin_deg, z_mm, row_px, sigma_px as needed", "points",
      [&](int line, const std::string& place, const std::vector<double>& values) {
        OpticsPoint point;
        point.line = line;
        for (std::size_t i = 0; i < values.size(); ++i) {
          if (std::isfinite(values[i])) point.*kColumns[i].field = values[i];
        }
        const bool marked = std::isfinite(point.z_mm);
        if (!std::isfinite(point.column_px) && !(marked && std::isfinite(point.row_px))) {
          throw InputError(path, place,
                           "measures nothing; expected column_px, or z_mm with row_px");
        }
        all.points.push_back(point);
      });
  return all;
}

}  // namespace slicecorr::resins
