// Tables of measured test parts.
#include <fmt/format.h>

#include <limits>
#include <map>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/tuning_part.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

double number_at(const CsvReader& reader, const std::string& column, const std::string& cell,
                 double low, double high) {
  const auto value = number_in_text(cell);
  if (!value || *value < low || *value > high) {
    throw InputError(reader.source(), reader.place() + ", " + column,
                     fmt::format("is '{}'; expected a number of {:g} to {:g}",
                                 text::printable(cell), low, high));
  }
  return *value;
}

std::string joined(const std::vector<std::string>& cells, std::size_t first, std::size_t past) {
  std::string out;
  for (std::size_t i = first; i < past; ++i) out += (i > first ? "," : "") + cells[i];
  return out + "\n";
}

}  // namespace

TuningTable read_tuning_table(const std::string& path) {
  CsvRules rules;
  rules.skip_empty_rows = true;
  rules.longest_line_bytes = 1 << 16;
  CsvReader reader = CsvReader::of_file(path, rules);
  TuningTable table;
  table.part.source = path;
  CsvRow row;
  if (!reader.next(row) || row.cells.size() < 16 || row.cells[0] != "part") {
    throw InputError(path, "", "is no table of a test part; expected one of slicecorr testpart");
  }
  std::map<std::string, std::string> head;
  for (std::size_t i = 0; i + 1 < row.cells.size(); i += 2) head[row.cells[i]] = row.cells[i + 1];
  std::string known = joined(row.cells, 0, 14);
  table.kind = head["part"];
  if (head["unit"] != "um") {
    throw InputError(path, reader.place() + ", unit",
                     fmt::format("is '{}'; expected um", text::printable(head["unit"])));
  }
  const auto whole = [&](const char* key) {
    return static_cast<int>(number_at(reader, key, head[key], 0, 65536));
  };
  table.part.layer_um = number_at(reader, "layer_um", head["layer_um"], 1e-3, 1e4);
  table.width_px = whole("width_px");
  table.height_px = whole("height_px");
  table.x_px = whole("x_px");
  table.y_px = whole("y_px");
  const std::string expected = "name,kind,designed_um,exposure_s,intensity_mw_cm2,measured_um\n";
  if (!reader.next(row) || joined(row.cells, 0, row.cells.size()) != expected) {
    throw InputError(path, reader.place(),
                     "is not the header of a test part; expected " + expected);
  }
  while (reader.next(row)) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() < 5 || row.cells.size() > 6) {
      throw InputError(path, reader.place(),
                       fmt::format("has {} cells; expected 6", row.cells.size()));
    }
    known += joined(row.cells, 0, 5);
    MeasuredEdge e;
    e.name = row.cells[0];
    if (row.cells[1] == "upper") {
      e.kind = MeasuredKind::upper;
    } else if (row.cells[1] == "lower") {
      e.kind = MeasuredKind::lower;
    } else if (row.cells[1] != "plug") {
      throw InputError(
          path, reader.place() + ", kind",
          fmt::format("is '{}'; expected plug, upper or lower", text::printable(row.cells[1])));
    }
    e.designed_um = number_at(reader, "designed_um", row.cells[2], 0, 1e7);
    e.exposure_s = number_at(reader, "exposure_s", row.cells[3], 0, 1e7);
    e.intensity_mw_cm2 = number_at(reader, "intensity_mw_cm2", row.cells[4], 0, 1e7);
    const std::string measured = row.cells.size() > 5 ? row.cells[5] : "";
    e.measured_um = measured.empty() ? std::numeric_limits<double>::quiet_NaN()
                                     : number_at(reader, "measured_um", measured, 0, 1e9);
    table.part.edges.push_back(e);
  }
  if (table.part.edges.empty()) throw InputError(path, "", "has no rows; expected those of a part");
  if (head["hash"] != tuning_hash(known)) {
    throw InputError(
        path, "hash",
        fmt::format(
            "is {} and not {}, that of its rows: they are of another part, or were changed; "
            "expected only measured_um to be filled in",
            text::printable(head["hash"]), tuning_hash(known)));
  }
  return table;
}

}  // namespace slicecorr::resins
