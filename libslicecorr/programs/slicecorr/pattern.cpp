// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pattern.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "programs/common/setup_options.hpp"
#include "slicecorr/chemistry_cell.hpp"
#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/chemistry_pictures.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/picture.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

namespace {

using Json = nlohmann::ordered_json;

bool svg(const std::string& path) { return path.ends_with(".svg"); }

std::string bytes_text(const std::vector<std::uint8_t>& bytes) {
  return {bytes.begin(), bytes.end()};
}

GreyImage read_image(const PatternOptions& o, const ExecutionContext& context) {
  if (o.slice < 0) return read_flat_field_png(o.image);
  const StackReader stack(o.image, folder_of(o.image), context, {1, 1, 1});
  if (o.slice >= stack.grid().layers) {
    throw InputError(o.image, "",
                     fmt::format("has {} slices; expected --slice below that, not {}",
                                 stack.grid().layers, o.slice));
  }
  GreyImage image;
  image.width_px = stack.grid().width_px;
  image.height_px = stack.grid().height_px;
  image.pixels.resize(static_cast<std::size_t>(image.width_px) *
                      static_cast<std::size_t>(image.height_px));
  stack.read_slice(o.slice, image.pixels.data());
  return image;
}

/// Before anything is reckoned: what it takes, and whether it is there.
void check_memory(int width, int height, const Chemistry& c, Console& console) {
  const std::size_t bytes = pattern_bytes(width, height, c);
  const double there =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  console.say(fmt::format("{} x {} cells take {:.1f} MiB.", width, height,
                          static_cast<double>(bytes) / (1U << 20)));
  if (there > 0 && static_cast<double>(bytes) > there) {
    throw InputError(
        fmt::format("{} x {} cells take {:.1f} GiB and the computer has {:.1f}; expected "
                    "fewer pixels, or a smaller --refine",
                    width, height, static_cast<double>(bytes) / (1U << 30), there / (1U << 30)));
  }
}

/// What light can't gel however it is shaped, before anything is reckoned.
void check_feasible(const Chemistry& c, const PatternSetup& s, bool corrects) {
  const double mean = mean_light_share(c, s.film_um), i = s.intensity_mw_cm2 * mean;
  const std::string never = never_gels(c, i, s.supply_per_s);
  if (!never.empty()) throw InfeasibleError(never);
  if (corrects) return;  // the correction looks at it more closely
  const GelTime g = gel_time_of(c);
  // The closed form is good to half a percent.
  constexpr double sure = 0.98;
  if (gel_time_s(g, i) * sure > s.light_s + s.dark_s) {
    throw InfeasibleError(fmt::format(
        "nothing gels within {:g} s under {:g} mW/cm²: even light takes {:.4g} s, or {:.4g} mW/cm² "
        "for that time",
        s.light_s, s.intensity_mw_cm2, gel_time_s(g, i),
        gel_intensity_mw_cm2(g, s.light_s) / mean));
  }
}

Json overlap_json(const Overlap& o) { return {{"best", o.jaccard}, {"time_s", o.time_s}}; }

std::string csv_of(const PatternRun& run, const LightPattern& target) {
  std::string out = "x_cell,y_cell,share,intensity_mw_cm2,time_to_gel_s,used_up,oxygen_left\n";
  for (int y = 0; y < run.height; ++y) {
    for (int x = 0; x < run.width; ++x) {
      const std::size_t k = static_cast<std::size_t>(y) * static_cast<std::size_t>(run.width) +
                            static_cast<std::size_t>(x);
      const double t = run.gel_time_s[k];
      out += fmt::format("{},{},{:.4g},{:.6g},{},{:.6g},{:.6g}\n", x, y, target.share[k],
                         run.intensity_mw_cm2[k],
                         std::isfinite(t) ? fmt::format("{:.6g}", t) : std::string(),
                         run.used_up[k], run.oxygen_left[k]);
    }
  }
  out.pop_back();  // who writes it ends the last line
  return out;
}

std::string text_of(const PatternFigures& f, const PatternRun& run, const LightPattern& target) {
  const Overlap best = best_overlap(run, target);
  std::string out =
      fmt::format("{} of {} lit cells gelled, the first at {:.4g} s, the last at {:.4g} s\n",
                  f.lit_gelled, f.lit, f.first_s, f.last_lit_s);
  out += fmt::format("{} dark cells had gelled by then, {} at the end\n", f.dark_gelled,
                     f.dark_gelled_at_end);
  out += fmt::format("most like the image at {:.4g} s: Jaccard index {:.4f}\n", best.time_s,
                     best.jaccard);
  return out;
}

Json figures_json(const PatternFigures& f, const PatternRun& run, const LightPattern& target) {
  Json j;
  j["lit_cells"] = f.lit;
  j["lit_gelled_cells"] = f.lit_gelled;
  j["gelled_cells"] = f.gelled;
  j["dark_gelled_cells"] = f.dark_gelled;
  j["dark_gelled_cells_at_end"] = f.dark_gelled_at_end;
  j["time_to_gel_s"] = {{"first", f.first_s}, {"last", f.last_lit_s}};
  j["jaccard"] = overlap_json(best_overlap(run, target));
  j["step_s"] = run.step_s;
  j["steps"] = run.steps;
  j["balance_error"] = run.balance_error;
  j["oxygen_balance_error"] = run.oxygen_balance_error;
  return j;
}

void check_outputs(const PatternOptions& o) {
  std::vector<std::string> taken{o.image};
  for (const std::string& output : {o.correct, o.json, o.csv, o.output, o.curve}) {
    check_output(output, taken);
    if (!output.empty() && output != "-") taken.push_back(output);
  }
  const auto ends = [](const std::string& path, const char* with, const char* or_with = nullptr) {
    const auto end = std::filesystem::path(path).extension();
    if (path.empty() || end == with || (or_with && end == or_with)) return;
    throw InputError(path, "",
                     fmt::format("expected a picture that ends in {}{}", with,
                                 or_with ? fmt::format(" or {}", or_with) : std::string()));
  };
  ends(o.correct, ".png");
  ends(o.output, ".png", ".svg");
  ends(o.curve, ".svg");
}

int pattern_command(const PatternOptions& o, const ExecutionContext& context, Console& console) {
  check_outputs(o);
  const Resin resin = load_resin(o.resin);
  tell_unread(resin.unread, context);
  refuse_relative(resin, "--intensity-mw-cm2");
  if (!resin.chemistry) {
    throw InputError(o.resin, "chemistry", "missing; expected a resin whose file has [chemistry]");
  }
  const Chemistry& c = *resin.chemistry;
  PatternSetup s;
  s.cell_um = o.pixel_um / o.refine;
  s.intensity_mw_cm2 = o.intensity_mw_cm2;
  s.light_s = o.time_s;
  s.dark_s = o.dark_s;
  s.sides = o.sides == "walls" ? Sides::walls : Sides::periodic;
  s.spread_um = o.spread_um;
  s.film_um = o.film_um;
  s.bleaches = o.bleaching;
  s.supply_per_s = o.supply_per_s;
  s.step_s = o.step_ms / 1000;
  const GreyImage image = read_image(o, context);
  check_memory(image.width_px * o.refine, image.height_px * o.refine, c, console);
  const LightPattern target =
      pattern_of_grey(image.width_px, image.height_px, image.pixels, o.refine);
  constexpr int fine = 4;
  if (const int cells = thinnest_cells(target, s.sides); cells > 0 && cells < fine) {
    console.say(
        fmt::format("Warning: the thinnest lit part is {} cells across; below {} times to gel "
                    "are coarse. --refine makes cells smaller.",
                    cells, fine));
  }
  if (s.bleaches && !(s.film_um > 0)) {
    throw InputError(
        "--bleaching: nothing bleaches in a film without thickness; expected --film-um");
  }
  if (const double takes = absorbed_share(c, s.film_um); takes > 0.1) {
    console.say(
        fmt::format("Warning: the film takes up {:.0f} % of the light, and is reckoned with its "
                    "mean.",
                    100 * takes));
  }
  check_feasible(c, s, !o.correct.empty());

  std::optional<CorrectedPattern> corrected;
  if (!o.correct.empty()) {
    PatternCorrection k;
    k.used_up_by_s = o.used_up_by_s;
    k.margin = o.margin;
    k.steps = o.steps;
    corrected = correct_pattern(c, target, s, k, context);
    // Curing goes on after oxygen has gone; both images are followed until the best is past.
    constexpr double past = 2.5;
    s.light_s = std::max(s.light_s, past * corrected->used_up_by_s);
  }
  const PatternRun even = run_pattern(c, target, s, context);
  const PatternRun run = corrected ? run_pattern(c, corrected->light, s, context) : even;
  const PatternFigures f = figures_of(run, target);

  Json json = figures_json(f, run, target);
  json["cells"] = {run.width, run.height};
  json["cell_um"] = s.cell_um;
  if (corrected) {
    json["corrected"] = {{"oxygen_used_up_by_s", corrected->used_up_by_s},
                         {"least_inside", corrected->least_inside},
                         {"most_outside", corrected->most_outside}};
    json["jaccard_even"] = overlap_json(best_overlap(even, target));
    GreyImage out;
    out.width_px = image.width_px;
    out.height_px = image.height_px;
    out.pixels = grey_of_pattern(corrected->light, o.refine);
    write_text_file(o.correct, bytes_text(encode_png(out)));
    console.say(
        fmt::format("{}: written; show it at {:g} mW/cm² for 255", o.correct, s.intensity_mw_cm2));
  }
  if (!o.csv.empty()) print_or_write(o.csv, csv_of(run, target));
  if (!o.output.empty()) {
    write_text_file(o.output, gel_time_sheet(run, target, s.cell_um, resin.name, svg(o.output)));
    console.say(fmt::format("{}: written", o.output));
  }
  if (!o.curve.empty()) {
    write_text_file(o.curve, overlap_svg(even, corrected ? &run : nullptr, target,
                                         s.light_s + s.dark_s, resin.name));
    console.say(fmt::format("{}: written", o.curve));
  }
  if (!o.json.empty()) print_or_write(o.json, json.dump(2));
  if (o.json != "-" && o.csv != "-") print_result(text_of(f, run, target));
  if (f.gelled == 0) {
    throw InfeasibleError(fmt::format(
        "nothing gels within {:g} s: oxygen comes from the dark around as fast as it is used up; "
        "expected more time, more than {:g} mW/cm², or larger features",
        s.light_s + s.dark_s, s.intensity_mw_cm2));
  }
  return kDone;
}

}  // namespace

void add_pattern(Program& program, PatternOptions& o) {
  CLI::App* sub = program.add("pattern",
                              "What an image of light makes of a film of resin, by its chemistry: "
                              "when each pixel gels, and the image with which all gel together",
                              [&o](const ExecutionContext& context, Console& console) {
                                return pattern_command(o, context, console);
                              });
  sub->add_option("IMAGE", o.image, "Image of light (.png), or with --slice a stack")->required();
  sub->add_option("--slice", o.slice, "IMAGE is a stack: the slice to take, from 0")
      ->check(CLI::NonNegativeNumber);
  sub->add_option("--pixel-um", o.pixel_um, "Side of a pixel")
      ->required()
      ->check(number_in(1e-3, 1e5));
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  sub->add_option("--intensity-mw-cm2", o.intensity_mw_cm2, "Light of a white pixel")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--time-s", o.time_s, "How long the image is shown")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--dark-s", o.dark_s, "How long resin is watched after that [0]")
      ->check(number_in(0, 1e9));
  sub->add_option("--spread-um", o.spread_um, "Light spreads like a Gaussian of this sigma [0]")
      ->check(number_in(0, 1e6));
  sub->add_option("--film-um", o.film_um, "Thickness of the film, whose mean light counts [0]")
      ->check(number_in(0, 1e7));
  sub->add_flag("--bleaching", o.bleaching,
                "Initiator that has broken lets light pass: the film's light grows");
  sub->add_option("--sides", o.sides, "What is beside the image: itself again, or walls")
      ->check(CLI::IsMember({"periodic", "walls"}))
      ->capture_default_str();
  sub->add_option("--oxygen-supply-per-s", o.supply_per_s,
                  "Oxygen comes from outside at this rate times what is missing [0]")
      ->check(number_in(0, 1e9));
  sub->add_option("--refine", o.refine, "Cells along a side of a pixel")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  sub->add_option("--step-ms", o.step_ms, "Step in time [as diffusion and times to gel ask for]")
      ->check(number_above_zero());
  sub->add_option("--correct", o.correct,
                  "Find the image with which all that is lit gels together and nothing else, and "
                  "write it here (.png)");
  sub->add_option(
         "--oxygen-used-up-by-s", o.used_up_by_s,
         "When the image of --correct has used up the oxygen of all lit places [a quarter later than "
         "full light would, and by --time-s]")
      ->check(number_above_zero());
  sub->add_option("--margin", o.margin,
                  "With --correct: share of their oxygen that dark places keep until then")
      ->check(number_in(0.001, 0.999))
      ->capture_default_str();
  sub->add_option("--search-steps", o.steps, "With --correct: steps of the search")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  sub->add_option("-o,--output", o.output, "Draw when each pixel gels (.png or .svg)");
  sub->add_option("--curve", o.curve,
                  "Draw over time how well what has gelled matches the image (.svg)");
  sub->add_option("--csv", o.csv, "Write a row for each cell here (- for stdout)");
  sub->add_option("--json", o.json, "Write figures as JSON here (- for stdout)");
}

}  // namespace slicecorr::cli
