// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "simulate.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>

#include "programs/common/make_part.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/turned.hpp"

namespace slicecorr::cli {

namespace {

[[noreturn]] void wrong(const std::string& message) { throw InputError(message); }

/// The form of an output by its name's end.
std::string form_of(const std::string& path, const std::vector<std::string>& forms) {
  std::string end = std::filesystem::path(path).extension().string();
  if (std::find(forms.begin(), forms.end(), end) == forms.end()) {
    throw InputError(path, "",
                     fmt::format("expected an output that ends in {}", fmt::join(forms, " or ")));
  }
  return end;
}

std::string name_of(const std::string& path) { return std::filesystem::path(path).stem().string(); }

void check_simulated_outputs(const SimulateOptions& o) {
  const std::vector<const std::string*> outputs{&o.output, &o.csv, &o.dose_csv, &o.lifts_csv};
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    check_output(*outputs[i], {o.stack, o.target});
    for (std::size_t k = 0; k < i; ++k) {
      if (!outputs[i]->empty() && *outputs[i] != "-" && *outputs[i] == *outputs[k]) {
        wrong(fmt::format("{} is given as two outputs; expected a name of its own for each",
                          *outputs[i]));
      }
    }
  }
}

/// A table to FILE or -, text without a further line end.
void write_table(const std::string& where, const std::string& text) {
  if (where == "-") {
    print_result(text);
  } else {
    write_text_file(where, text);
  }
}

/// The stack, its design where there is one, and how it is printed.
struct Input {
  StackReader stack;
  std::optional<StackReader> given;
  Setup setup;
  std::optional<FittedSlices> fitted;
  std::optional<LeftAloneFiles> part;
  const SliceSource* target = nullptr;

  Input(const SimulateOptions& o, const SetupOptions& options, const ExecutionContext& context)
      : stack(o.stack, folder_of(o.output), context),
        setup(options.resolve(&stack.info(), &stack.info())) {
    if (!stack.info().exposures.empty()) {
      throw InputError(
          o.stack, "",
          "has layers that are exposed more than once, which are not followed in time; "
          "verify says what they print");
    }
    const std::string left = target_beside(o.stack);
    const bool beside = o.target.empty() && stack.info().kind == StackKind::corrected &&
                        std::filesystem::exists(left);
    if (const std::string path = beside ? left : o.target; !path.empty()) {
      given.emplace(design(path), folder_of(o.output), context);
      fitted.emplace(FittedSlices::like(stack, *given, folder_of(o.output), context));
      std::vector<std::string> left_alone;
      if (const std::string kept = left_alone_beside(o.stack);
          path == left && std::filesystem::exists(kept)) {
        left_alone.push_back(kept);
      }
      part.emplace(**fitted, left_alone, MeshesLeftAlone{}, setup.printer, folder_of(o.output),
                   context);
      target = &**part;
      check_target(stack, stack.info(), *target, path,
                   left_alone.empty() ? std::optional(given->pixel_sum()) : std::nullopt, context);
    } else if (stack.info().kind == StackKind::target) {
      target = &stack;  // a target shown as it is
    }
    // Intensities of each slice are known only after a correction, and stand in its stack.
    const UvSchedule& uv = setup.process.uv;
    if (uv.kind == UvKind::per_slice && uv.slice_mw_cm2.empty() && target) {
      setup.process = schedule_uv(*target, setup, context);
    }
    tell_notices(setup, &stack.info(), context);
  }
  Input(const Input&) = delete;
};

void write_lifts(const SimulateOptions& o, const ColumnHistory& history) {
  if (history.lifts.empty()) {
    wrong(
        "--lifts-csv: nothing is lifted in this print, or it is not looked at; expected layer by layer exposure with --lifts each");
  }
  std::string rows = "slice,z_um,window_dose,joint_dose,at_lift\n";
  for (std::size_t n = 0; n < history.lifts.size(); ++n) {
    const LayerAtLift& layer = history.lifts[n];
    fmt::format_to(std::back_inserter(rows), "{},{},{},{},{}\n", n,
                   static_cast<double>(n) * history.layer_um, layer.window_dose, layer.joint_dose,
                   name_of(layer.state));
  }
  write_table(o.lifts_csv, rows);
}

/// What the column's layers do when the platform lifts.
std::string lifts_in_words(const ColumnHistory& history) {
  std::array<int, 5> count{};
  double least = std::numeric_limits<double>::infinity();
  for (const LayerAtLift& layer : history.lifts) {
    ++count[static_cast<std::size_t>(layer.state)];
    if (layer.state == AtLift::holds || layer.state == AtLift::does_not_hold) {
      least = std::min(least, layer.joint_dose);
    }
  }
  std::string words = "at the lifts:";
  for (std::size_t i = 1; i < count.size(); ++i) {
    words += fmt::format("{} {} {}", i > 1 ? "," : "", count[i], name_of(static_cast<AtLift>(i)));
  }
  if (std::isfinite(least)) words += fmt::format("; least dose at a joint {:.4g}", least);
  return words;
}

int column(const SimulateOptions& o, const SetupOptions& options, const ExecutionContext& context,
           Console& console) {
  const std::string form = form_of(o.output, {".svg", ".csv"});
  const Input in(o, options, context);
  const PrintClock clock = print_clock(in.setup, in.stack.grid());
  ColumnOptions how;
  how.substeps = o.substeps;
  how.profile_times_s = o.times_s.empty() ? group_times_s(clock, 8) : o.times_s;
  const ColumnHistory history =
      simulate_column(in.stack, in.target, in.setup, o.x, o.y, how, context);

  const bool table = form == ".csv" || !o.csv.empty();
  std::string rows = "time_s,slice,z_window_um,front_um,back_um\n";
  if (table) {
    for (const HistoryStep& step : history.steps) {
      for (const GelledInterval& g : step.gelled) {
        fmt::format_to(std::back_inserter(rows), "{},{},{},{},{}\n", step.time_s, step.slice,
                       step.z_window_um, g.front_um, g.back_um);
      }
    }
  }
  if (form == ".csv") {
    write_text_file(o.output, rows);
  } else {
    write_text_file(o.output, column_history_svg(history, fmt::format("{}: column {}, {}",
                                                                      name_of(o.stack), o.x, o.y)));
  }
  if (!o.csv.empty()) write_table(o.csv, rows);
  if (!o.dose_csv.empty()) {
    std::string doses = "time_s,slice,z_um,dose\n";
    for (const DoseProfile& p : history.profiles) {
      for (std::size_t i = 0; i < p.z_um.size(); ++i) {
        fmt::format_to(std::back_inserter(doses), "{},{},{},{}\n", p.time_s, p.slice, p.z_um[i],
                       p.dose[i]);
      }
    }
    write_table(o.dose_csv, doses);
  }
  if (!o.lifts_csv.empty()) write_lifts(o, history);
  const auto& last = history.steps.back().gelled;
  console.say(fmt::format("{}: column {}, {} over {:.4g} s{}; {} gelled {} at the end", o.output,
                          o.x, o.y, history.total_s,
                          history.mode == ExposureMode::layerwise ? " of exposure" : "",
                          last.size(), last.size() == 1 ? "stretch" : "stretches"));
  if (!history.lifts.empty()) console.say(lifts_in_words(history));
  return kDone;
}

int section_of_row(const SimulateOptions& o, const SetupOptions& options,
                   const ExecutionContext& context, Console& console) {
  form_of(o.output, {".png"});
  const Input in(o, options, context);
  const PrintClock clock = print_clock(in.setup, in.stack.grid());
  std::vector<double> times = o.times_s.empty() ? group_times_s(clock, 6) : o.times_s;
  std::sort(times.begin(), times.end());
  if (times.back() > clock.total_s() * (1 + 1e-6)) {
    wrong(fmt::format("--times-s {:g}: the print ends after {:g} s; expected times up to that",
                      times.back(), clock.total_s()));
  }
  const SectionHistory history =
      simulate_section(in.stack, in.target, in.setup, o.row, times, context);
  std::vector<ColourImage> frames;
  for (std::size_t k = 0; k < history.frames.size(); ++k) {
    frames.push_back(progress_picture(history, k, 400));
  }
  const auto png = encode_png(tiled(frames, 3));
  write_text_file(o.output, {png.begin(), png.end()});
  std::string when;
  for (const auto& f : history.frames) {
    when += fmt::format("{}{:.4g}", when.empty() ? "" : ", ", f.time_s);
  }
  console.say(fmt::format(
      "{}: image row {} after {} s, left to right, then the next line; platform up, the black line "
      "is the window; {}",
      o.output, o.row, when,
      in.target ? "grey gelled, red gelled where nothing is designed; of the design pale blue not "
                  "gelled yet, pale grey still to come, blue never"
                : "grey gelled"));
  return kDone;
}

int stationary(const SimulateOptions& o, const SetupOptions& options,
               const ExecutionContext& context, Console& console) {
  const std::string form = form_of(o.output, {".svg", ".csv"});
  const Resin resin = load_resin(options.resin, resin_overrides(options));
  refuse_relative(resin, "--blue-mw-cm2");
  tell_unread(resin.unread, context);
  const bool inhibited = options.uv_mw_cm2 > 0 || o.uv_ratio > 0;
  if (inhibited && !resin.inhibition) {
    wrong(fmt::format("{}: resin '{}' has no [inhibition]; expected one that UV light inhibits",
                      o.uv_ratio > 0 ? "--uv-ratio" : "--uv-mw-cm2", resin.name));
  }
  const Kinetics kinetics = make_kinetics(resin, inhibited, false);
  std::vector<StationaryFronts> exposures;
  bool any = false;
  for (const double blue : o.blue_mw_cm2) {
    const double uv = o.uv_ratio > 0 ? o.uv_ratio * blue : options.uv_mw_cm2;
    exposures.push_back(simulate_stationary(kinetics, blue, uv, o.time_s));
    any = any || !exposures.back().points.empty();
  }
  std::string rows = "blue_mw_cm2,uv_mw_cm2,time_s,front_um,back_um\n";
  for (const StationaryFronts& e : exposures) {
    for (const auto& p : e.points) {
      fmt::format_to(std::back_inserter(rows), "{},{},{},{},{}\n", e.blue_mw_cm2, e.uv_mw_cm2,
                     p.time_s, p.front_um, p.back_um);
    }
  }
  if (form == ".csv") {
    write_text_file(o.output, rows);
  } else {
    write_text_file(
        o.output, stationary_svg(exposures, o.time_s, fmt::format("{}: curing fronts", resin.name),
                                 "Gelled where the gel dose is reached."));
  }
  if (!o.csv.empty()) write_table(o.csv, rows);
  for (const StationaryFronts& e : exposures) {
    std::string text = fmt::format("{:g} mW/cm²", e.blue_mw_cm2);
    if (inhibited) text += fmt::format(" over {:g} mW/cm² of UV", e.uv_mw_cm2);
    if (!std::isfinite(e.first.time_s)) {
      text += ": never gels";
    } else {
      text += fmt::format(": first gel after {:.5g} s at {:.5g} um", e.first.time_s, e.first.z_um);
      if (inhibited) {
        text += std::isfinite(e.window_s)
                    ? fmt::format("; cures to the window after {:.5g} s", e.window_s)
                : e.dead_zone_um > 0
                    ? fmt::format("; steady dead zone {:.5g} um", e.dead_zone_um)
                    : std::string("; beta Iuv is just Ib: the dead zone gets ever thinner");
      }
    }
    console.say(text);
  }
  if (!any) {
    double soonest = std::numeric_limits<double>::infinity();
    for (const StationaryFronts& e : exposures) soonest = std::min(soonest, e.first.time_s);
    console.say(std::isfinite(soonest)
                    ? fmt::format("nothing gels in {:g} s; expected --time-s above {:.5g} s",
                                  o.time_s, soonest)
                    : std::string("nothing gels, however long it is exposed"));
  }
  return kDone;
}

}  // namespace

void SimulateOptions::add_to(CLI::App& app) {
  const double most = std::numeric_limits<double>::max();
  app.add_option("STACK", stack, "Stack to print (not with --stationary)");
  app.add_option("--x", x, "Column of the image: with --y, one pixel column against time")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--y", y, "Row of the image")->check(CLI::NonNegativeNumber);
  app.add_option("--row", row,
                 "Row of the image: what has gelled along it at several times, in place of --x and "
                 "--y")
      ->check(CLI::NonNegativeNumber);
  app.add_option(
      "--target", target,
      "Stack of the design, to show what should gel [the one that run left beside STACK; STACK, when it is a design itself]");
  app.add_option("--times-s", times_s,
                 "T1,T2,...: times to show, since the light went on. With --x: up to 8 dose curves "
                 "[after eight runs of slices]; with --row: pictures [six]")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(0, most));
  app.add_option("--substeps", substeps,
                 "Times at which a slice is looked at while it is shown (with --x) [enough for "
                 "smooth curves]")
      ->check(CLI::Range(1, 10000));
  app.add_option("--csv", csv,
                 "Write the gelled stretches against time as CSV to FILE, or - for stdout");
  app.add_option("--dose-csv", dose_csv,
                 "Write the dose along the column at --times-s as CSV to FILE, or - for stdout");
  app.add_option(
      "--lifts-csv", lifts_csv,
      "Write what each layer of the column does at its lift as CSV to FILE, or - for stdout "
      "(layer by layer)");
  app.add_flag("--stationary", stationary,
               "Instead of a stack: the window stands still, under constant light");
  app.add_option("--blue-mw-cm2", blue_mw_cm2,
                 "I1,I2,...: intensities of the curing light (with --stationary)")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_above_zero());
  app.add_option("--uv-ratio", uv_ratio,
                 "Intensity of UV light over that of the curing light, in place of --uv-mw-cm2 "
                 "(with --stationary)")
      ->check(number_above_zero());
  app.add_option("--time-s", time_s, "How long the light is on (with --stationary)")
      ->check(number_above_zero());
  app.add_option("-o,--output", output,
                 "Picture or table to write: .svg or .csv for a column and with --stationary, .png "
                 "for a row")
      ->required();
}

int simulate(const SimulateOptions& o, const SetupOptions& setup, const ExecutionContext& context,
             Console& console) {
  check_simulated_outputs(o);
  if (o.stationary) {
    if (!o.stack.empty() || !o.target.empty()) {
      wrong("--stationary needs no stack; expected --resin, --blue-mw-cm2 and --time-s");
    }
    if (o.x >= 0 || o.y >= 0 || o.row >= 0 || !o.times_s.empty() || o.substeps > 0 ||
        !o.dose_csv.empty() || !o.lifts_csv.empty()) {
      wrong(
          "--x, --y, --row, --times-s, --substeps, --dose-csv and --lifts-csv look into a stack; expected none "
          "of them with --stationary");
    }
    // Nothing but the resin, its changes and a constant UV light counts.
    const auto counts = [](std::string_view name) {
      return name == "resin" || name == "dc_mj_cm3" || name == "dose_factor" || name == "ha_um" ||
             name == "uv_mw_cm2";
    };
    const auto all = settings();
    if (setup.by_slice() || std::any_of(all.begin(), all.end(), [&](const Setting& s) {
          return is_said(s, setup) && !counts(s.name);
        })) {
      wrong(
          "a stationary exposure has a resin, intensities and a time; expected no printer, speed, "
          "mode or schedule with --stationary");
    }
    if (setup.resin.empty()) wrong("--stationary: expected --resin");
    if (o.blue_mw_cm2.empty()) wrong("--stationary: expected --blue-mw-cm2");
    if (!(o.time_s > 0)) wrong("--stationary: expected --time-s");
    if (o.uv_ratio > 0 && setup.uv_mw_cm2 > 0) {
      wrong("--uv-ratio and --uv-mw-cm2 are two ways to set the UV light; expected one of them");
    }
    return stationary(o, setup, context, console);
  }
  if (!o.blue_mw_cm2.empty() || o.uv_ratio > 0 || o.time_s > 0) {
    wrong("--blue-mw-cm2, --uv-ratio and --time-s go with --stationary");
  }
  if (o.stack.empty()) wrong("expected a STACK, or --stationary");
  if (o.row >= 0) {
    if (o.x >= 0 || o.y >= 0) {
      wrong("--row shows a section, --x and --y a column; expected one of the two");
    }
    if (o.substeps > 0 || !o.csv.empty() || !o.dose_csv.empty() || !o.lifts_csv.empty()) {
      wrong(
          "--substeps, --csv, --dose-csv and --lifts-csv are for a column; expected --x and --y with them");
    }
    return section_of_row(o, setup, context, console);
  }
  if (o.x < 0 || o.y < 0) wrong("expected --x and --y for a column, or --row for a section");
  if (o.times_s.size() > 8 && form_of(o.output, {".svg", ".csv"}) == ".svg") {
    wrong("--times-s: a picture shows up to 8 dose curves");
  }
  return column(o, setup, context, console);
}

}  // namespace slicecorr::cli
