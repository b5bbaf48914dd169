// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/setup_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/machine_light.hpp"
#include "slicecorr/machine_motion.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

namespace {

/// What CLI11 checks of a setting that is no list, in the words of the table.
CLI::Validator check_of(const Setting& s) {
  if (!s.words.empty()) {
    return CLI::IsMember(std::vector<std::string>(s.words.begin(), s.words.end()));
  }
  const auto check = [&s](const std::string& said) -> std::string {
    const auto value = number_of(said);
    if (s.or_inf ? takes_text(s, said) : value && takes_number(s, *value)) return {};
    return fmt::format("is {}, expected {}", said.empty() ? "''" : said, setting_takes(s));
  };
  return CLI::Validator(check, "");
}

}  // namespace

CLI::Option* SetupOptions::add(CLI::App& app, const Setting& s) {
  const std::string name = setting_name(ChoiceNames::options, s.name);
  std::string text = setting_text(ChoiceNames::options, s);
  return std::visit(
      [&](auto member) -> CLI::Option* {
        auto& value = static_cast<SetupChoices&>(*this).*member;
        using Value = std::decay_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, std::vector<double>>) {
          text += fmt::format(
              ". A table with the columns slice,{}: each row holds from its slice on", s.column);
          return app.add_option(name, tables_[s.name], text)->check(CLI::ExistingFile);
        } else {
          if constexpr (std::is_same_v<Value, std::string>) {
            // Of two words the one that is not meant anyway: nothing behind the option is its value.
            if (s.words.size() == 2 && !s.bare.empty()) {
              return app.add_flag(name, value, text)
                  ->transform([word = std::string(s.bare)](const std::string& said) {
                    return said == "true" ? word : said;
                  })
                  ->check(check_of(s));
            }
          }
          CLI::Option* const option = app.add_option(name, value, text);
          if constexpr (std::is_same_v<Value, std::string>) {
            if (s.or_inf) option->check(value_is(ValueKind::text));
            if (!value.empty()) option->capture_default_str();
            if (s.words.empty() && !s.or_inf) return option;
            if (!s.bare.empty()) option->expected(0, 1)->default_str(std::string(s.bare));
          }
          return option->check(check_of(s));
        }
      },
      s.chosen);
}

void SetupOptions::add_to(CLI::App& app, bool required, bool correcting,
                          const std::vector<std::string>& more_modes) {
  for (const std::string_view heading : kSettingGroups) {
    std::string shown(heading);
    // What a stack of ours says needs not be said again.
    if (heading == kHowItPrints && !required) shown += ", where the stack does not say them";
    const OptionGroup group(app, shown);
    for (const Setting& s : settings()) {
      if (s.group != heading || s.said_by != SaidBy::all || (s.corrects && !correcting)) continue;
      if (s.name == "mode") {
        std::vector<std::string> modes(s.words.begin(), s.words.end());
        modes.insert(modes.end(), more_modes.begin(), more_modes.end());
        app.add_option("--mode", mode, setting_text(ChoiceNames::options, s))
            ->check(CLI::IsMember(modes));
        continue;
      }
      CLI::Option* const option = add(app, s);
      if (required && (s.name == "printer" || s.name == "resin")) option->required();
    }
  }
}

void SetupOptions::add_surface_to(CLI::App& app) { add(app, *find_setting("surface")); }

bool SetupOptions::by_slice() const {
  return std::any_of(tables_.begin(), tables_.end(), [](auto& t) { return !t.second.empty(); });
}

SetupChoices SetupOptions::choices(double slice_s) const {
  SetupChoices choices = *this;
  const auto take = [&](const Setting& s, const std::string& path) {
    const bool lamp = s.name == "lamp_log" || s.name == "uv_lamp_log";
    choices.*std::get<std::vector<double> SetupChoices::*>(s.chosen) =
        lamp && is_lamp_curve(path) ? read_lamp_curve(path, slice_s, std::string(s.column))
                                    : read_by_slice(path, std::string(s.column));
  };
  for (const auto& [name, path] : tables_) {
    if (!path.empty()) take(*find_setting(name), path);
  }
  // One log of both lamps, unless the UV lamp's is another.
  const auto log = tables_.find("lamp_log"), uv_log = tables_.find("uv_lamp_log");
  const bool own = uv_log != tables_.end() && !uv_log->second.empty();
  if (!own && log != tables_.end() && !log->second.empty() && has_both_lamps(log->second)) {
    take(*find_setting("uv_lamp_log"), log->second);
  }
  return choices;
}

double SetupOptions::slice_s(const StackInfo* info, const StackInfo* times) const {
  const Process* const made = info && info->process ? &*info->process : nullptr;
  const bool layerwise =
      mode.empty() ? made && made->mode == ExposureMode::layerwise : mode == "layerwise";
  const auto own_speeds = tables_.find("slice_speed_mm_h");
  const bool own = (own_speeds != tables_.end() && !own_speeds->second.empty()) ||
                   (made && !made->slice_speed_mm_h.empty());
  const double speed = speed_mm_h > 0 ? speed_mm_h : made ? made->speed_mm_h : 0;
  const double um = times ? times->grid.layer_um : info ? info->grid.layer_um : layer_um;
  return layerwise || own || !(speed > 0) || !(um > 0) ? 0 : units::slice_time_s(um, speed);
}

Setup SetupOptions::resolve(const StackInfo* info, const StackInfo* times) const {
  return resolve_setup(choices(slice_s(info, times)), info, times, ChoiceNames::options);
}

namespace {

constexpr const char* kLamps[] = {"lamp_share", "uv_lamp_share"};

/// The head of a log of lamps; without cells where it is none.
CsvRow head_of(const std::string& path) {
  CsvReader reader = CsvReader::of_file(path, {.longest_line_bytes = 1000});
  CsvRow row;
  if (!reader.next(row) || row.fault != CsvRow::Fault::none) row.cells.clear();
  return row;
}

/// Where `column` stands in the head of a table of it alone, or of both lamps; 0: in neither.
std::size_t place_of(const std::string& column, const CsvRow& head) {
  if (head.cells.size() == 2 && head.cells[1] == column) return 1;
  if (head.cells.size() != 3 || head.cells[1] != kLamps[0] || head.cells[2] != kLamps[1]) return 0;
  return column == kLamps[0] ? 1 : column == kLamps[1] ? 2 : 0;
}

}  // namespace

bool is_lamp_curve(const std::string& path) {
  const CsvRow head = head_of(path);
  return head.cells.size() >= 2 && head.cells[0] == "seconds";
}

bool has_both_lamps(const std::string& path) { return place_of(kLamps[1], head_of(path)) == 2; }

std::vector<double> read_lamp_curve(const std::string& path, double slice_s,
                                    const std::string& column) {
  constexpr double most_slices = 1000000;
  CsvReader reader = CsvReader::of_file(path, {.longest_line_bytes = 1000});
  const auto wrong = [&](const std::string& what) { throw InputError(path, reader.place(), what); };
  CsvRow row;
  std::vector<double> seconds, shares;
  reader.next(row);
  const std::size_t place = place_of(column, row), width = row.cells.size();
  if (place == 0) wrong("expected the head seconds," + column);
  if (!(slice_s > 0)) {
    wrong(
        "has seconds, which are known of continuous exposure at one speed only; expected a table "
        "slice," +
        column);
  }
  while (reader.next(row)) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() != width) {
      wrong(fmt::format("expected {} columns, as in the head", width));
    }
    const auto at = number_of(row.cells[0]), share = number_of(row.cells[place]);
    if (!at || !share || !(*share > 0)) {
      wrong("expected seconds since the first slice, and a share above 0");
    }
    if (seconds.empty() ? *at < 0 : *at <= seconds.back()) {
      wrong(fmt::format("{} s; expected seconds that rise from 0 on", row.cells[0]));
    }
    seconds.push_back(*at);
    shares.push_back(*share);
    if (*at / slice_s > most_slices) wrong(fmt::format("is beyond {:g} slices", most_slices));
  }
  if (seconds.empty()) throw InputError(path, "", "has no rows; expected seconds," + column);
  // In the middle of each slice, straight lines between rows, flat before and after them.
  std::vector<double> of_slices;
  std::size_t next = 0;
  for (std::size_t n = 0; n == 0 || of_slices.size() * slice_s < seconds.back() + slice_s; ++n) {
    const double middle = (static_cast<double>(n) + 0.5) * slice_s;
    while (next < seconds.size() && seconds[next] < middle) ++next;
    if (next == 0 || next == seconds.size()) {
      of_slices.push_back(next == 0 ? shares.front() : shares.back());
      continue;
    }
    const double part = (middle - seconds[next - 1]) / (seconds[next] - seconds[next - 1]);
    of_slices.push_back(shares[next - 1] + part * (shares[next] - shares[next - 1]));
  }
  return of_slices;
}

std::vector<double> read_by_slice(const std::string& path, const std::string& column) {
  constexpr int most_slices = 1000000;
  CsvReader reader = CsvReader::of_file(path, {.longest_line_bytes = 1000});
  const auto wrong = [&](const std::string& what) { throw InputError(path, reader.place(), what); };
  const auto number = [&](const std::string& cell) {
    double value = 0;
    const char* const end = cell.data() + cell.size();
    const auto [stop, error] = std::from_chars(cell.data(), end, value);
    if (error != std::errc{} || stop != end || !std::isfinite(value)) {
      wrong(fmt::format("'{}' is no number", text::printable(cell)));
    }
    return value;
  };
  CsvRow row;
  std::vector<double> values;
  std::size_t place = 0, width = 2;
  while (reader.next(row)) {
    const bool head = place == 0;
    if (head && row.cells.size() == std::size(kLamps) + 1) width = row.cells.size();
    if (row.fault != CsvRow::Fault::none || row.cells.size() != width) {
      wrong(width == 2 ? "expected two columns, slice," + column
                       : "expected three columns, as in the head");
    }
    if (head) {
      place = row.cells[0] == "slice" ? place_of(column, row) : 0;
      if (place == 0) wrong("expected the head slice," + column);
      continue;
    }
    const double slice = number(row.cells[0]), value = number(row.cells[place]);
    const auto last = static_cast<double>(values.size()) - 1;
    const bool rises = values.empty() ? slice == 0 : slice > last;
    if (!rises || slice != std::floor(slice) || slice >= most_slices) {
      wrong(fmt::format(
          "slice {}; expected {}", row.cells[0],
          values.empty() ? "the first row to be of slice 0"
                         : fmt::format("a whole number above {:g}, below {}", last, most_slices)));
    }
    if (!(value > 0)) {
      wrong(fmt::format("{} {}; expected one above 0", column, row.cells[place]));
    }
    if (!values.empty()) values.resize(static_cast<std::size_t>(slice), values.back());
    values.push_back(value);
  }
  if (values.empty()) throw InputError(path, "", "has no rows; expected rows slice," + column);
  return values;
}

const std::string& design(const std::string& path) {
  try {
    check_design(StackReader::read_info(path), path);
  } catch (const InputError& e) {
    if (!is_mesh_name(path) || std::string(e.what()).find("is a mesh") == std::string::npos) throw;
    throw InputError(
        path, "",
        "is a mesh; expected a slice archive: `slicecorr slice` makes it of the mesh, and "
        "`slicecorr run` slices and corrects in one go");
  }
  return path;
}

CLI::Option* LightOptions::add_to(CLI::App& app) {
  return add(app, *find_setting("other_wavelength"));
}

std::vector<std::string> LightOptions::checked(const Printer& printer, const Resin& resin,
                                               bool uv) const {
  check_chosen_light(printer, resin, uv, *this, ChoiceNames::options);
  return definition_notices(printer, resin, uv);
}

std::string dose_words(const Setup& setup) {
  if (setup.process.mode != ExposureMode::layerwise || setup.resin.dose_factor <= 1) return "";
  return fmt::format(
      " (the critical dose is {:g} times the gel dose of resin '{}': its dose factor; --dose-factor "
      "sets another one, 1 aims at the gel dose itself)",
      setup.resin.dose_factor, setup.resin.name);
}

void tell_unread(const UnreadWords& unread, const ExecutionContext& context) {
  for (const std::string& text : unread.sentences) context.tell(text);
}

void tell_notices(const Setup& setup, const StackInfo* times, const ExecutionContext& context) {
  for (const std::string& text : setup_notices(setup, times, ChoiceNames::options))
    context.tell(text);
}

void tell_heights_left_out(const Setup& setup, Surface wanted, const ExecutionContext& context) {
  Process process = setup.process;
  const char* const why = leave_out_heights(setup.printer, setup.resin, process);
  if (why && wanted == Surface::mesh) context.tell(why);
}

void tell_doubted_grey(const std::string& printer, const Setup& setup,
                       const ExecutionContext& context) {
  if (setup.process.assumed == AssumedLight::none) return;
  if (const std::string text = doubted_grey_in_words(printer); !text.empty()) context.tell(text);
}

std::string refused_by_machine(const Setup& setup, const std::string& printer, const Grid& grid,
                               ChoiceNames names) {
  const auto machine =
      printer.empty() ? std::optional<MachineMotion>() : load_machine_motion(printer);
  if (!machine) return {};
  const double m = make_kinetics(setup.resin, setup.process.uv.kind != UvKind::off, true).m;
  try {
    print_motion(
        {setup.process, m, setup.resin.absorbance_height10_um, grid.layer_um, grid.layers, names},
        *machine);
    check_lamps({setup.printer, setup.resin, setup.process, grid.layer_um, grid.layers}, *machine);
  } catch (const InfeasibleError& e) {
    return e.what();
  }
  return {};
}

void tell_machine(const Setup& setup, const std::string& printer, const Grid& grid,
                  const ExecutionContext& context) {
  const std::string why = refused_by_machine(setup, printer, grid);
  if (!why.empty()) context.tell("printbridge will refuse this print: " + why);
}

}  // namespace slicecorr::cli
