// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <optional>

#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

namespace {

/// Columns that mean something to us, and their index in `Row`.
enum Column { kIntensity, kExposure, kDose, kHeight, kBlue, kUv, kDeadZone, kSigma, kColumns };
/// Columns of the forms of test parts that say nothing to a fit.
constexpr std::array<std::string_view, 4> kOfForms = {"name", "shown_s", "dark_s", "dark_mw_cm2"};
constexpr std::array<std::string_view, kColumns> kColumnNames = {
    "intensity_mw_cm2", "exposure_s", "dose_mj_cm2",  "cured_height_um",
    "blue_mw_cm2",      "uv_mw_cm2",  "dead_zone_um", "sigma_um"};

constexpr const char* kExpectedHeader =
    "a header row with intensity_mw_cm2,exposure_s,cured_height_um or dose_mj_cm2,cured_height_um "
    "or blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um";

// No row of measurements comes near.
constexpr std::size_t kLongestLine = std::size_t{1} << 16;

constexpr CsvRules kRules = {.comments_behind_cells = true,
                             .skip_empty_rows = true,
                             .control_bytes_are_faults = true,
                             .longest_line_bytes = kLongestLine};

/// A field as it may stand in a message: short, on one line, printable.
std::string shown(std::string_view field) {
  constexpr std::size_t longest = 40;
  std::string text(field.substr(0, longest));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < 0x20 || c == 0x7F; }, '?');
  return field.size() > longest ? text + "..." : text;
}

struct Number {
  double value = 0;
  const char* wrong = nullptr;  ///< what is wrong with it, and what was expected
};

Number parse_number(std::string_view field) {
  if (field.empty()) return {0, "is empty; expected a number"};
  const char* begin = field.data();
  const char* const end = begin + field.size();
  if (*begin == '+' && field.size() > 1 && begin[1] != '-') ++begin;
  Number number;
  const auto [stop, error] = std::from_chars(begin, end, number.value);
  if (stop != end || error == std::errc::invalid_argument) {
    const bool comma = field.find(',') != std::string_view::npos;
    number.wrong = comma ? "is written with a decimal comma; expected a decimal point"
                         : "is no number; expected digits with a decimal point";
  } else if (error == std::errc::result_out_of_range) {
    number.wrong = "is too large or too small for a number";
  } else if (!std::isfinite(number.value)) {
    number.wrong = "is not finite; expected a measured number";
  }
  return number;
}

/// Reads one table.
class Table {
 public:
  Table(CsvReader reader, int source, Measurements& into)
      : reader_(std::move(reader)), source_(source), into_(into) {}

  void read(const ExecutionContext& context) {
    read_header();
    int rows = 0;
    while (next_row()) {
      const std::vector<std::string>& fields = row_.cells;
      if ((rows & 0xFFF) == 0) context.check_cancelled();
      check_count(fields);
      if (into_.cured.size() + into_.dead_zones.size() >=
          static_cast<std::size_t>(kMaxMeasurements)) {
        fail(
            fmt::format("is measurement number {}; at most {} can be fitted together: take "
                        "averages, or a part of them",
                        kMaxMeasurements + 1, kMaxMeasurements));
      }
      ++rows;
      if (fields[static_cast<std::size_t>(*columns_[is_dead_zone_ ? kDeadZone : kHeight])]
              .empty() &&
          is_form_) {
        if (not_measured_++ == 0) first_not_measured_ = row_.line;
        continue;
      }
      is_dead_zone_ ? add_dead_zone(fields) : add_cured(fields);
    }
    if (rows == 0) {
      throw InputError(reader_.source(), "", "has a header row and no measurements below it");
    }
    if (not_measured_ > 0) {
      warn(fmt::format("{} rows of {}, the first in line {}, were not measured and are left out",
                       not_measured_, rows, first_not_measured_));
    }
    if (not_measured_ == rows) fail("is the last row, and none was measured; expected heights");
    // The contract's unit is um; nobody measures a cured height of a few micrometres.
    if (!is_dead_zone_ && highest_ < 5) {
      warn(fmt::format("no cured height is above {:.3g} um: are the heights in mm?", highest_));
    }
    // Nor exposes anybody for hours, or with light that would burn.
    if (longest_s_ > 3600) {
      warn(fmt::format("exposures go up to {:g} s: are they in ms?", longest_s_));
    }
    if (brightest_mw_cm2_ > 5000) {
      warn(fmt::format("intensities go up to {:g} mW/cm2: are they in uW/cm2?", brightest_mw_cm2_));
    }
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw InputError(reader_.source(), reader_.place(), message);
  }
  [[noreturn]] void fail(Column column, const std::string& message) const {
    const int at = *columns_[column];
    throw InputError(
        reader_.source(),
        fmt::format("{}, column {} ({})", reader_.place(), at + 1, kColumnNames[column]), message);
  }
  void warn(const std::string& text) { into_.warnings.push_back(reader_.source() + ": " + text); }
  bool has(Column column) const { return columns_[column].has_value(); }

  /// Reads a row into `row_`; false at the end.
  bool next_row() {
    if (!reader_.next(row_)) return false;
    switch (row_.fault) {
      case CsvRow::Fault::none:
        break;
      case CsvRow::Fault::open_quote:
        fail(fmt::format("the quote before '{}' is not closed on its line", shown(row_.at_fault)));
      case CsvRow::Fault::text_after_quote:
        fail(fmt::format("'{}' follows a closing quote; expected a comma", shown(row_.at_fault)));
      case CsvRow::Fault::control_byte:
        fail(
            fmt::format("holds a byte that is no text (0x{:02x}); expected a CSV file of "
                        "measurements",
                        static_cast<unsigned char>(row_.at_fault[0])));
      case CsvRow::Fault::long_line:
        fail(fmt::format("is longer than {} bytes; expected a row of measurements", kLongestLine));
    }
    return true;
  }

  void read_header() {
    if (!next_row()) {
      throw InputError(reader_.source(), "",
                       fmt::format("holds no table; expected {}", kExpectedHeader));
    }
    const std::vector<std::string>& fields = row_.cells;
    width_ = fields.size();
    std::vector<std::string> names;
    names.reserve(fields.size());
    for (const auto& field : fields) names.push_back(lower_case(field));
    const bool numbers = std::all_of(fields.begin(), fields.end(), [](std::string_view f) {
      return f.empty() || !parse_number(f).wrong;
    });
    if (numbers) {
      fail(fmt::format("holds numbers where names of columns should be; expected {}",
                       kExpectedHeader));
    }
    if (width_ == 1) {
      const char* separator = nullptr;
      if (names[0].find(';') != std::string::npos) separator = "semicolons";
      if (names[0].find('\t') != std::string::npos) separator = "tabs";
      if (separator) {
        fail(
            fmt::format("columns are separated by {}; expected commas between columns, and decimal "
                        "points in numbers",
                        separator));
      }
    }
    for (std::size_t i = 0; i < width_; ++i) {
      const auto same = std::find(names.begin(), names.begin() + static_cast<long>(i), names[i]);
      if (!names[i].empty() && same != names.begin() + static_cast<long>(i)) {
        fail(fmt::format("column {} and column {} are both named '{}'; expected each name once",
                         same - names.begin() + 1, i + 1, shown(fields[i])));
      }
      const auto known = std::find(kColumnNames.begin(), kColumnNames.end(), names[i]);
      if (known != kColumnNames.end()) {
        columns_[static_cast<std::size_t>(known - kColumnNames.begin())] = static_cast<int>(i);
      }
    }
    choose_kind(fields);
    for (std::size_t i = 0; i < width_; ++i) {
      const auto used = std::find_if(columns_.begin(), columns_.end(),
                                     [&](const auto& c) { return c && *c == static_cast<int>(i); });
      const auto index = used - columns_.begin();
      if (used != columns_.end() && is_used(static_cast<Column>(index))) continue;
      if (std::find(kOfForms.begin(), kOfForms.end(), names[i]) != kOfForms.end()) {
        is_form_ = is_form_ || names[i] == "name";
        continue;
      }
      warn(names[i].empty() ? fmt::format("column {} has no name and is not used", i + 1)
                            : fmt::format("column {} ('{}') is not used", i + 1, shown(fields[i])));
    }
  }

  bool is_used(Column column) const {
    if (column == kSigma || column == kExposure || column == kUv) return true;
    const bool of_dead_zones = column == kBlue || column == kDeadZone;
    return of_dead_zones == is_dead_zone_;
  }

  void choose_kind(const std::vector<std::string>& fields) {
    if (has(kHeight) && has(kDeadZone)) {
      fail("has cured_height_um and dead_zone_um; expected one kind of measurement in a file");
    }
    is_dead_zone_ = has(kDeadZone);
    std::string missing;
    const auto need = [&](Column column) {
      if (!has(column))
        missing += fmt::format("{}{}", missing.empty() ? "" : ", ", kColumnNames[column]);
    };
    if (is_dead_zone_) {
      for (const Column c : {kBlue, kUv, kExposure}) need(c);
    } else {
      need(kHeight);
      // Two of intensity, time and dose give the third; the dose alone is enough for Jacobs.
      if (!has(kDose)) {
        need(kIntensity);
        need(kExposure);
      }
    }
    if (missing.empty()) return;
    std::string present;
    for (const auto& field : fields) {
      if (present.size() > 200) break;
      present += fmt::format("{}{}", present.empty() ? "" : ", ", shown(field));
    }
    fail(fmt::format("column {} is missing among {}; expected {}", missing, present,
                     kExpectedHeader));
  }

  void check_count(const std::vector<std::string>& fields) const {
    if (fields.size() == width_) return;
    const bool more = fields.size() > width_;
    const bool rest_is_empty =
        more && std::all_of(fields.begin() + static_cast<long>(width_), fields.end(),
                            [](std::string_view f) { return f.empty(); });
    if (rest_is_empty) return;
    const bool semicolons =
        fields.size() < width_ && std::any_of(fields.begin(), fields.end(), [](const auto& f) {
          return f.find(';') != std::string::npos;
        });
    const char* hint = "";
    if (semicolons) hint = "; columns must be separated by commas, not semicolons";
    if (more) hint = "; a decimal comma looks like this: expected decimal points";
    fail(fmt::format("has {} fields where the header has {} columns{}", fields.size(), width_,
                     hint));
  }

  double number(const std::vector<std::string>& fields, Column column) const {
    const std::string_view field = fields[static_cast<std::size_t>(*columns_[column])];
    const Number n = parse_number(field);
    if (n.wrong) fail(column, fmt::format("'{}' {}", shown(field), n.wrong));
    return n.value;
  }
  double above_zero(const std::vector<std::string>& fields, Column column,
                    const char* hint = "") const {
    const double value = number(fields, column);
    if (!(value > 0)) {
      fail(column, fmt::format("is {:g}; expected a number above 0{}", value, hint));
    }
    return value;
  }
  double sigma(const std::vector<std::string>& fields) const {
    if (!has(kSigma) || fields[static_cast<std::size_t>(*columns_[kSigma])].empty()) return 0;
    return above_zero(fields, kSigma, ", or an empty field where the scatter is not known");
  }

  void add_cured(const std::vector<std::string>& fields) {
    CuredHeight c;
    c.origin = {source_, row_.line};
    if (has(kIntensity)) c.blue_mw_cm2 = above_zero(fields, kIntensity);
    if (has(kExposure)) c.exposure_s = above_zero(fields, kExposure);
    if (has(kDose)) c.dose_mj_cm2 = above_zero(fields, kDose);
    if (has(kIntensity) && has(kExposure)) {
      const double dose = c.blue_mw_cm2 * c.exposure_s;
      if (has(kDose) && !(std::abs(dose - c.dose_mj_cm2) <= 0.01 * dose)) {
        fail(kDose, fmt::format("is {:g}, but intensity times exposure is {:g} mJ/cm2; expected "
                                "the same within 1 %, or no column of doses",
                                c.dose_mj_cm2, dose));
      }
      c.dose_mj_cm2 = dose;
    } else if (has(kIntensity)) {
      c.exposure_s = c.dose_mj_cm2 / c.blue_mw_cm2;
    } else if (has(kExposure)) {
      c.blue_mw_cm2 = c.dose_mj_cm2 / c.exposure_s;
    }
    const bool alone = !has(kIntensity) && !has(kExposure);
    const auto usable = [](double v) { return std::isfinite(v) && v > 0; };
    if (!usable(c.dose_mj_cm2) || (!alone && !(usable(c.blue_mw_cm2) && usable(c.exposure_s)))) {
      fail("intensity, exposure and dose do not go together: a number overflows");
    }
    if (has(kUv) && number(fields, kUv) != 0) {
      fail(kUv,
           "is not 0; cured heights are measured without UV light (dead zones with it: "
           "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um)");
    }
    c.height_um = above_zero(fields, kHeight,
                             ": below gel there is nothing to measure; leave out rows of samples "
                             "that did not cure");
    c.sigma_um = sigma(fields);
    highest_ = std::max(highest_, c.height_um);
    if (has(kExposure)) longest_s_ = std::max(longest_s_, c.exposure_s);
    if (has(kIntensity)) brightest_mw_cm2_ = std::max(brightest_mw_cm2_, c.blue_mw_cm2);
    into_.cured.push_back(c);
  }

  void add_dead_zone(const std::vector<std::string>& fields) {
    DeadZone d;
    d.origin = {source_, row_.line};
    d.blue_mw_cm2 = above_zero(fields, kBlue);
    d.uv_mw_cm2 = above_zero(fields, kUv,
                             ": without UV light there is no dead zone (cured heights: "
                             "intensity_mw_cm2,exposure_s,cured_height_um)");
    d.exposure_s = above_zero(fields, kExposure);
    d.dead_zone_um = number(fields, kDeadZone);
    if (!(d.dead_zone_um >= 0)) {
      fail(kDeadZone,
           fmt::format("is {:g}; expected 0 (cured to the window) or more", d.dead_zone_um));
    }
    d.sigma_um = sigma(fields);
    longest_s_ = std::max(longest_s_, d.exposure_s);
    brightest_mw_cm2_ = std::max({brightest_mw_cm2_, d.blue_mw_cm2, d.uv_mw_cm2});
    into_.dead_zones.push_back(d);
  }

  CsvReader reader_;
  CsvRow row_;
  int source_;
  Measurements& into_;
  std::array<std::optional<int>, kColumns> columns_;
  std::size_t width_ = 0;
  bool is_dead_zone_ = false;
  bool is_form_ = false;  ///< rows have names: those without a height were not measured
  int not_measured_ = 0, first_not_measured_ = 0;
  double highest_ = 0, longest_s_ = 0, brightest_mw_cm2_ = 0;
};

}  // namespace

Measurements read_measurements(const std::vector<std::string>& paths,
                               const ExecutionContext& context) {
  if (paths.empty()) throw InputError("no file of measurements was given");
  Measurements data;
  check_given_once(paths);
  for (const std::string& path : paths) {
    const int source = static_cast<int>(data.sources.size());
    data.sources.push_back(path);
    std::error_code error;
    if (std::filesystem::is_directory(path, error)) {
      throw InputError(path, "", "is a folder; expected a CSV file of measurements");
    }
    expect_form_of(path, {"staircase", "wedge", "dead-zone"});
    Table(CsvReader::of_file(path, kRules), source, data).read(context);
  }
  return data;
}

Measurements parse_measurements(const std::string& text, const std::string& source) {
  Measurements data;
  data.sources.push_back(source);
  Table(CsvReader::of_text(text, source, kRules), 0, data).read({});
  return data;
}

std::string measurements_as_csv(const Measurements& measurements) {
  std::string out;
  const auto scatter = [](double sigma_um) {
    return sigma_um > 0 ? fmt::format("{}", sigma_um) : std::string();
  };
  if (!measurements.dead_zones.empty()) {
    out = "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um,sigma_um\n";
    for (const DeadZone& d : measurements.dead_zones) {
      out += fmt::format("{},{},{},{},{}\n", d.blue_mw_cm2, d.uv_mw_cm2, d.exposure_s,
                         d.dead_zone_um, scatter(d.sigma_um));
    }
    return out;
  }
  const bool doses = std::any_of(measurements.cured.begin(), measurements.cured.end(),
                                 [](const CuredHeight& c) { return c.blue_mw_cm2 == 0; });
  out = doses ? "dose_mj_cm2,cured_height_um,sigma_um\n"
              : "intensity_mw_cm2,exposure_s,cured_height_um,sigma_um\n";
  for (const CuredHeight& c : measurements.cured) {
    out += doses ? fmt::format("{}", c.dose_mj_cm2)
                 : fmt::format("{},{}", c.blue_mw_cm2, c.exposure_s);
    out += fmt::format(",{},{}\n", c.height_um, scatter(c.sigma_um));
  }
  return out;
}

}  // namespace slicecorr::resins
