// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// resinctl plot

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <memory>
#include <sstream>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/plots.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

struct PlotArguments {
  std::vector<std::string> inputs;
  std::string output, kind, model, resin;
  double blue_mw_cm2 = 0, uv_mw_cm2 = -1, time_s = 0;
};

bool has_ending(const std::string& path, const std::string& ending) {
  return lower_case(path).ends_with(ending);
}

bool is_dead_zone(FitModel model) { return !kind_of(model).heights; }

/// A picture and a sentence on what it shows.
struct Drawn {
  std::string svg, words;
};

std::string words_of(const FitResult& fit) {
  return fmt::format("{} fit of {} measurements, R² {:.4f}, RMSE {:.4g} um", name_of(fit.model),
                     fit.n, fit.r2, fit.rmse_um);
}

Drawn draw_fronts(const Resin& resin, const std::string& name, const PlotArguments& a) {
  refuse_relative(resin, "a picture of curing fronts");
  const bool asked_uv = a.uv_mw_cm2 >= 0;
  const bool inhibited = asked_uv ? a.uv_mw_cm2 > 0 : resin.inhibition.has_value();
  const Kinetics k = make_kinetics(resin, inhibited, false);
  const double blue = a.blue_mw_cm2 > 0 ? a.blue_mw_cm2 : 100;
  // Twice what keeps the window free in the long run, where nothing was said.
  const double uv = asked_uv ? a.uv_mw_cm2 : inhibited ? 2 * blue / k.beta : 0;
  std::string words =
      fmt::format("curing fronts at the gel dose, blue {:.4g}, UV {:.4g} mW/cm²", blue, uv);
  if (a.blue_mw_cm2 <= 0 || (inhibited && !asked_uv)) {
    words += " (--blue-mw-cm2 and --uv-mw-cm2 choose others)";
  }
  return {fronts_svg(k, blue, uv, a.time_s, name), words};
}

/// What measurements are of; both may be unknown.
struct Subject {
  const Resin* resin = nullptr;
  std::string name;
  double aim_over_gel() const {
    return resin && resin->dose_factor > 1 ? resin->dose_factor : kDefaultDoseFactor;
  }
};

/// The picture of `kind` (empty: what the data are of) from measurements.
Drawn draw_measurements(const Measurements& data, const PlotArguments& a, const Subject& subject,
                        FitModel cure_model, FitModel zone_model, const ExecutionContext& context) {
  const bool zones = a.kind == "dead-zone" || (a.kind.empty() && data.cured.empty());
  if (a.kind == "collapse") {
    if (!has_intensities(data)) {
      throw InputError(
          "a collapse needs cured heights at two intensities or more; expected columns "
          "intensity_mw_cm2,exposure_s,cured_height_um");
    }
    const FitResult jacobs = fit(data, FitModel::jacobs, {}, context);
    const FitResult kinetic = fit(data, FitModel::kinetic, {}, context);
    return {collapse_svg(jacobs, kinetic, subject.name), words_of(kinetic)};
  }
  FitModel model = zones ? zone_model : cure_model;
  if (!a.model.empty()) {
    model = fit_model_named(a.model);
    if (is_dead_zone(model) && a.kind == "working-curve") {
      throw InputError(fmt::format(
          "--model {} has no working curve; expected jacobs, kinetic or joint", a.model));
    }
  }
  const bool draw_zones = zones || (a.kind.empty() && is_dead_zone(model));
  if (draw_zones ? data.dead_zones.empty() : data.cured.empty()) {
    throw InputError(fmt::format("{}: {}", data.sources.front(),
                                 draw_zones
                                     ? "no dead zones; expected columns "
                                       "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um"
                                     : "no cured heights; expected a column cured_height_um"));
  }
  if (draw_zones && !kind_of(model).dead_zones) {
    throw InputError(fmt::format(
        "--model {} says nothing of dead zones; expected deadzone-steady, deadzone-transient or "
        "joint",
        name_of(model)));
  }
  if (is_dead_zone(model) && !subject.resin) {
    throw InputError(
        "a fit of dead zones stands on a resin's blue parameters; expected --resin NAME");
  }
  const FitResult result =
      fit(data, model, is_dead_zone(model) ? on_resin(*subject.resin) : FitOptions{}, context);
  std::string words = words_of(result);
  if (a.kind.empty() && !data.cured.empty() && !data.dead_zones.empty()) {
    words +=
        draw_zones ? "; the heights: --kind working-curve" : "; the dead zones: --kind dead-zone";
  }
  return {draw_zones ? dead_zone_svg(result, subject.name)
                     : working_curve_svg(result, subject.aim_over_gel(), subject.name),
          words};
}

Drawn draw_data(const PlotArguments& a, const ExecutionContext& context, cli::Console& console) {
  if (a.kind == "fronts" || a.kind == "resin") {
    throw InputError(
        fmt::format("--kind {} is drawn from a resin; expected its name or .toml file", a.kind));
  }
  const Measurements data = read_measurements(a.inputs, context);
  for (const std::string& w : data.warnings) console.say("warning: " + w);
  std::optional<Resin> resin;
  if (!a.resin.empty()) resin = load_resin(a.resin);
  return draw_measurements(data, a, {resin ? &*resin : nullptr, resin ? resin->name : ""},
                           has_intensities(data) ? FitModel::kinetic : FitModel::jacobs,
                           FitModel::dead_zone_steady, context);
}

Drawn draw_record(const PlotArguments& a, const ExecutionContext& context, cli::Console& console) {
  if (a.inputs.size() != 1) {
    throw InputError(fmt::format(
        "{} inputs; expected one resin, or CSV files of measurements alone", a.inputs.size()));
  }
  if (!a.resin.empty()) {
    throw InputError("--resin goes with CSV files; here the resin is the input itself");
  }
  const ResinRecord record = load_record(a.inputs[0]);
  cli::check_output(a.output, {record.path});
  if (has_ending(a.output, ".html")) {
    const RecordFits fits = fits_of_record(record, context);
    for (const std::string& p : fits.problems) console.say("warning: " + p);
    return {resin_page(record, fits.fits), "the resin's page"};
  }
  if (a.kind == "fronts") return draw_fronts(record.resin, record.name, a);
  const bool kinetic = record.resin.model == CureModelKind::kinetic;
  const std::string from = "from the resin's parameters";
  if (a.kind == "resin" || (a.kind.empty() && a.model.empty() && record.measurements.empty())) {
    return {record_svg(record), from};
  }
  if (record.measurements.empty()) {
    throw InputError(record.path, "",
                     "keeps no measurements to fit; expected measurements in [provenance], or "
                     "--kind resin or fronts, which need none");
  }
  std::vector<std::string> paths;
  for (const std::string& name : record.measurements) {
    paths.push_back(cli::folder_of(record.path) + "/" + name);
  }
  cli::check_output(a.output, paths);
  const Measurements data = read_measurements(paths, context);
  for (const std::string& w : data.warnings) console.say("warning: " + w);
  return draw_measurements(data, a, {&record.resin, record.name},
                           record.resin.bleaches()       ? FitModel::bleaching
                           : !has_intensities(data)      ? FitModel::jacobs
                           : record.resin.has_gel_time() ? FitModel::gel_time
                           : kinetic                     ? FitModel::kinetic
                                                         : FitModel::jacobs,
                           dead_zone_model(record), context);
}

/// The format that a name asks for by its ending; "svg" also for devices and stdout's like.
std::string picture_format(const std::string& path) {
  for (const char* format : {"svg", "html", "png", "pdf"}) {
    if (has_ending(path, fmt::format(".{}", format))) return format;
  }
  if (path.starts_with("/dev/")) return "svg";
  throw InputError(path, "", "expected a name that ends in .svg, .png, .pdf or .html");
}

/// An SVG as another picture, by the program rsvg-convert: beside its place, then renamed.
void write_converted(const std::string& svg, const std::string& format, const std::string& path) {
  const std::string folder = cli::folder_of(path);
  const std::string made = folder + "/.resinctl-" + std::to_string(::getpid()) + "." + format;
  struct Removed {
    const std::string& path;
    ~Removed() { ::unlink(path.c_str()); }
  };
  const Removed removed{made};
  // The SVG goes in by a pipe, so that no name of a file is a matter of its own.
  std::array<int, 2> in{};
  if (::pipe2(in.data(), O_CLOEXEC) != 0) throw DeviceError(path + ": no pipe");
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, in[0], 0);
  std::vector<std::string> words{
      "rsvg-convert",       "--format", format,     "--zoom", format == "png" ? "2" : "1",
      "--background-color", "white",    "--output", made};
  std::vector<char*> arguments;
  arguments.reserve(words.size() + 1);
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t child = 0;
  const int failed =
      ::posix_spawnp(&child, "rsvg-convert", &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(in[0]);
  if (failed != 0) {
    ::close(in[1]);
    throw InputError(path, "",
                     fmt::format("a {} is made by the program rsvg-convert, which is not installed "
                                 "(Debian package librsvg2-bin); expected a name that ends in .svg",
                                 format));
  }
  // A reader that is gone is told by its exit code.
  ::signal(SIGPIPE, SIG_IGN);
  for (std::size_t at = 0; at < svg.size();) {
    const ::ssize_t n = ::write(in[1], svg.data() + at, svg.size() - at);
    if (n <= 0) break;
    at += static_cast<std::size_t>(n);
  }
  ::close(in[1]);
  int status = 0;
  ::waitpid(child, &status, 0);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw DeviceError(path + ": rsvg-convert failed");
  }
  std::ifstream picture(made, std::ios::binary);
  std::stringstream bytes;
  bytes << picture.rdbuf();
  cli::write_text_file(path, bytes.str());
}

int plot(const PlotArguments& a, const ExecutionContext& context, cli::Console& console) {
  const auto is_csv = [](const std::string& path) { return has_ending(path, ".csv"); };
  const bool data = std::all_of(a.inputs.begin(), a.inputs.end(), is_csv);
  cli::check_output(a.output, a.inputs);
  const std::string format = picture_format(a.output);
  const Drawn drawn = data ? draw_data(a, context, console) : draw_record(a, context, console);
  if (format == "png" || format == "pdf") {
    write_converted(drawn.svg, format, a.output);
  } else {
    cli::write_text_file(a.output, drawn.svg);
  }
  console.say(fmt::format("{}: written; {}", a.output, drawn.words));
  return cli::kDone;
}

}  // namespace

void add_plot(cli::Program& program) {
  const auto a = std::make_shared<PlotArguments>();
  CLI::App* app = program.add(
      "plot",
      "Draws a resin's working curve or what else is known of it, or a fit of measurements.",
      [a](const ExecutionContext& context, cli::Console& console) {
        return plot(*a, context, console);
      });
  app->add_option("INPUT", a->inputs,
                  "A resin (name or .toml file), or CSV files of measurements (see fit)")
      ->check(cli::value_is(cli::ValueKind::resin_or_file))
      ->required();
  app->add_option("-o,--output", a->output,
                  "Picture to write (.svg, .png or .pdf); for a resin also a page about it (.html)")
      ->required();
  app->add_option("--kind", a->kind,
                  "working-curve: heights over dose, with fit and residuals; collapse: over D and "
                  "over D', to see whether reciprocity holds; dead-zone: over the ratio of UV to "
                  "blue; fronts: over time; resin: from the parameters alone [what the "
                  "measurements are of, else resin]")
      ->check(CLI::IsMember({"working-curve", "collapse", "dead-zone", "fronts", "resin"}));
  app->add_option("--model", a->model,
                  "Model to fit [that of the resin; for CSV files kinetic when there are several "
                  "intensities, else jacobs; deadzone-steady]")
      ->check(CLI::IsMember(fit_model_names()));
  app->add_option("--resin", a->resin,
                  "CSV files of dead zones: the resin whose blue parameters they stand on");
  app->add_option("--blue-mw-cm2", a->blue_mw_cm2, "fronts: curing light at the window [100]")
      ->check(cli::number_above_zero());
  app->add_option("--uv-mw-cm2", a->uv_mw_cm2,
                  "fronts: inhibiting light at the window [such that beta Iuv is twice Ib]")
      ->check(cli::number_in(0, 1e6));
  app->add_option("--time-s", a->time_s, "fronts: until when [eight times that of the first gel]")
      ->check(cli::number_above_zero());
}

}  // namespace slicecorr::resinctl
