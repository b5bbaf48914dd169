// Points of a fit of optics, as a table.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/optics_fit.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

namespace {

struct Column {
  const char* name;
  double OpticsPoint::*field;
  double low, high;
  bool required;
};
constexpr Column kColumns[] = {{"angle_deg", &OpticsPoint::angle_deg, -1e6, 1e6, true},
                               {"radius_mm", &OpticsPoint::radius_mm, 0, 1e4, true},
                               {"pin_deg", &OpticsPoint::pin_deg, -360, 360, false},
                               {"z_mm", &OpticsPoint::z_mm, -1e4, 1e4, false},
                               {"column_px", &OpticsPoint::column_px, -1e5, 1e5, false},
                               {"row_px", &OpticsPoint::row_px, -1e5, 1e5, false},
                               {"sigma_px", &OpticsPoint::sigma_px, 1e-6, 1e5, true}};
constexpr std::size_t kMostPoints = 100000;

const Column* column_named(const std::string& name) {
  for (const Column& c : kColumns) {
    if (name == c.name) return &c;
  }
  return nullptr;
}

}  // namespace

OpticsPoints read_optics_points(const std::string& path) {
  CsvReader reader = CsvReader::of_file(
      path,
      {.skip_empty_rows = true, .control_bytes_are_faults = true, .longest_line_bytes = 65536});
  CsvRow row;
  if (!reader.next(row)) throw InputError(path, "", "is empty; expected a header and points");
  std::vector<const Column*> columns;
  for (const std::string& name : row.cells) {
    const Column* const column = column_named(name);
    if (!column || std::find(columns.begin(), columns.end(), column) != columns.end()) {
      throw InputError(path, reader.place(),
                       fmt::format("column '{}'{}; expected a header with angle_deg, radius_mm, "
                                   "column_px, and pin_deg, z_mm, row_px, sigma_px as needed",
                                   name, column ? " stands twice" : " is not known"));
    }
    columns.push_back(column);
  }
  for (const char* name : {"angle_deg", "radius_mm"}) {
    if (std::find(columns.begin(), columns.end(), column_named(name)) == columns.end()) {
      throw InputError(path, reader.place(), fmt::format("has no column {}", name));
    }
  }
  OpticsPoints all{path, {}};
  while (reader.next(row)) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() != columns.size()) {
      throw InputError(path, reader.place(),
                       fmt::format("has {} cells; expected {}, as the header", row.cells.size(),
                                   columns.size()));
    }
    OpticsPoint point;
    point.line = row.line;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const Column& c = *columns[i];
      if (row.cells[i].empty() && !c.required) continue;
      const auto value = number_in_text(row.cells[i]);
      if (!value || *value < c.low || *value > c.high) {
        throw InputError(path, reader.place(),
                         fmt::format("{} is '{}'; expected a number from {:g} to {:g}", c.name,
                                     row.cells[i], c.low, c.high));
      }
      point.*c.field = *value;
    }
    const bool marked = std::isfinite(point.z_mm);
    if (!std::isfinite(point.column_px) && !(marked && std::isfinite(point.row_px))) {
      throw InputError(path, reader.place(),
                       "measures nothing; expected column_px, or z_mm with row_px");
    }
    if (all.points.size() == kMostPoints) {
      throw InputError(path, reader.place(),
                       fmt::format("has more points than expected; at most {}", kMostPoints));
    }
    all.points.push_back(point);
  }
  if (all.points.empty())
    throw InputError(path, "", "has no points; expected rows below its header");
  return all;
}

}  // namespace slicecorr::resins
