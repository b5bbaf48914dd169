// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "support/text/display_text.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::cli {

namespace {

using tomo::Box;
using tomo::PrintFigures;

std::string in_words(const PrintFigures& f) {
  const auto& m = f.metrics;
  std::string text = fmt::format(
      "contrast {:.4g}{}: void begins to gel after {:.4g} times the print's time\n"
      "part {} voxels, void {}, of which {} gel with the part\n"
      "dose in the part {:.4g} to {:.4g} mJ/cm³, in void up to {:.4g}; {:.4g} gels\n"
      "overlap {:.5f} at that dose, {:.5f} at the best\n"
      "{} turns, {}; light {:.2f} % of the brightest in the mean; alpha R {:.3g}",
      m.contrast,
      std::isfinite(f.contrast_bound)
          ? fmt::format(" (no light has more than {:.4g})", f.contrast_bound)
          : std::string(),
      m.contrast, m.gel, m.empty, m.void_gelled, m.min_gel, m.max_gel, m.max_void,
      f.gel_dose_mj_cm3, f.jaccard_at_dose, m.best_jaccard, f.turns, text::duration(f.print_time_s),
      100 * f.efficiency, f.alpha_r);
  if (!f.feasible()) text += fmt::format("\n{}", f.fault());
  if (f.gel_centres_below_dose) {
    text += fmt::format(
        "\nbelow the gel dose: {:.3g} % of the part's voxels by their means, {:.3g} % "
        "in their middles",
        100 * f.gel_below_dose, 100 * *f.gel_centres_below_dose);
  }
  if (f.surface.voxels > 0) {
    text += fmt::format("\nsurface: {} voxels, {:+.3g} um in the mean, {:.3g} um rms",
                        f.surface.voxels, f.surface.mean_um, f.surface.rms_um);
  }
  if (f.wanted) {
    const tomo::WantedFigures& w = *f.wanted;
    text += fmt::format("\nwanted doses: {} of {} voxels within, slack {:.4g}{}", w.within,
                        w.voxels, w.slack,
                        std::isfinite(w.slack_bound)
                            ? fmt::format(" (no light has more than {:.4g})", w.slack_bound)
                            : std::string());
    if (!w.all()) {
      text += fmt::format(
          "\n{:.4g} % within by weight; off by {:.3g} mJ/cm³ rms, {:+.3g} at worst, in voxel {}, {}, {}",
          100 * w.share_within, w.rms_off_mj_cm3, w.worst_off_mj_cm3, w.worst[0], w.worst[1],
          w.worst[2]);
    }
  }
  return text + "\n";
}

int tell(const PrintFigures& figures, const std::string& json, Console& console) {
  const std::string words = in_words(figures);
  if (json.empty()) {
    print_result(words);
  } else {
    print_or_write(json, figures.to_json());
    console.say(words);
  }
  return figures.feasible() ? kDone : kMissed;
}

/// What printbridge will say of a job of more turns than the stage counts (`[stage] travel_turns` of a
/// printer file that drives one).
void tell_too_many_turns(const TomoOptions& o, const PrintFigures& figures,
                         const ExecutionContext& context) {
  const std::string path = find_definition(o.printer, "printer");
  const toml::table file = parse_toml(read_text_file(path), path);
  const auto most = file["stage"]["travel_turns"].value<double>();
  const double turns = figures.turns;
  if (!most || turns <= *most) return;
  context.tell(fmt::format(
      "printbridge will refuse this job: it has {} turns, {}, and the stage of the printer counts {:g} "
      "(travel_turns); expected {:.3g} times as much light, or a gel dose as many times lower",
      figures.turns, text::duration(figures.print_time_s), *most, rounded_up(turns / *most, 3)));
}

int solve(const TomoOptions& o, const ExecutionContext& context, Console& console) {
  if (o.wanted.empty() && o.volume.empty() == o.mesh.parts.empty()) {
    throw InputError("expected meshes, or a volume (--volume), or wanted doses (--wanted)");
  }
  if (!o.mesh.center_mm.empty()) {
    throw InputError("--center-mm has no place here: parts are middled on the axis");
  }
  if (o.voxel_mm > 0 && o.mesh.layer_um > 0) {
    throw InputError("--voxel-mm and --layer-um both say a voxel's side; expected one of them");
  }
  std::vector<std::string> inputs = o.mesh.parts;
  inputs.insert(inputs.end(), o.inserts.begin(), o.inserts.end());
  for (const std::string& file : {o.volume, o.wanted, o.tolerance, o.weights, o.conversion_curve}) {
    if (!file.empty()) inputs.push_back(file);
  }
  check_output(o.output, inputs);
  check_output(o.json, inputs);
  if (!o.output.ends_with(".frames")) {
    context.tell(o.output +
                 ": is a job of frames, which other programs know by the ending .frames");
  }
  const std::string picture = o.picture.empty() ? o.output + ".infeasible.png" : o.picture;
  check_picture_name(picture);
  inputs.insert(inputs.end(), {o.output, o.json});
  check_output(picture, inputs);
  const Printer printer = load_printer(o.printer);
  const Resin resin = load_resin(o.resin);
  for (const std::string& text : o.light.checked(printer, resin)) context.tell(text);
  TomoPrint wanted = o.wanted.empty() ? read_tomo_print(o, printer, context)
                                      : read_wanted_print(o, printer, resin, context);
  tomo::PrintOptions& options = wanted.options;
  options.checkpoint = o.output + ".resume";
  options.checkpoint_s = o.checkpoint_s;
  options.resume = o.resume;
  std::string shown;
  options.evidence = [&](const tomo::Evidence& evidence) {
    const std::string part = !o.mesh.parts.empty() ? o.mesh.parts.front() : o.volume;
    shown = "; " + picture_of(evidence, std::filesystem::path(part).filename().string(), picture);
  };
  const auto forget = [&] {
    std::error_code error;
    std::filesystem::remove(options.checkpoint, error);
  };
  const tomo::Print print = [&] {
    try {
      return tomo::solve_print(wanted.part, wanted.voxel_mm, printer, resin, options, context);
    } catch (const Cancelled&) {
      if (std::filesystem::exists(options.checkpoint)) {
        console.say(
            fmt::format("{}: what was found so far; the same command with --resume goes on "
                        "from there",
                        options.checkpoint));
      }
      throw;
    } catch (const InfeasibleError& e) {
      forget();
      throw InfeasibleError(e.what() + shown);
    }
  }();
  tomo::write_job(o.output, print.job, context);
  forget();
  console.say(fmt::format("{}: {} frames of {} x {} pixels", o.output, print.job.sampling.angles,
                          printer.width_px, printer.height_px));
  tell_too_many_turns(o, print.figures, context);
  return tell(print.figures, o.json, console);
}

int verify(const TomoOptions& o, const ExecutionContext& context, Console& console) {
  for (const std::string& output : {o.dose, o.json})
    check_output(output, {o.job, o.volume, o.shown});
  const tomo::TomoJob job = tomo::read_job(o.job, context);
  for (const std::string& text : definition_notices(job.printer, job.resin, false))
    context.tell(text);
  if (const std::string doubt = tomo::doubt_of_turbidity(job.printer, job.resin); !doubt.empty()) {
    context.tell(doubt);
  }
  const Box<std::uint8_t> part =
      o.volume.empty()
          ? job.part
          : tomo::placed(tomo::read_part_npy(o.volume), job.printer, job.sampling.voxel_mm);
  if (part.nz != job.part.nz) {
    throw InputError(
        o.volume, "",
        fmt::format("has {} slices, the job {}; expected as many", part.nz, job.part.nz));
  }
  std::optional<tomo::Shown> shown_frames;
  const auto dose_at = [&](tomo::JudgedAt at) {
    return shown_frames ? tomo::dose_of(job, shown_frames->showings, context, at)
                        : tomo::dose_of(job, context, at);
  };
  if (!o.shown.empty()) {
    const tomo::Shown shown = tomo::read_shown(o.shown, job.sampling.angles);
    if (shown.without_end > 0) {
      console.say(
          fmt::format("{}: {} without an end {} left out", o.shown,
                      shown.without_end == 1 ? "a row" : fmt::format("{} rows", shown.without_end),
                      shown.without_end == 1 ? "is" : "are"));
    }
    const double planned_s = job.turns * job.printer.rotation->turn_s(), light_s = shown.light_s();
    console.say(fmt::format("{}: {:.4g} s of light, planned {:.4g} s ({} turns)", o.shown, light_s,
                            planned_s, job.turns));
    shown_frames = shown;
  }
  const Box<float> dose = dose_at(tomo::JudgedAt::means);
  if (!o.dose.empty()) tomo::write_npy(o.dose, dose);
  PrintFigures figures = tomo::figures_of(job, dose, part, context);
  figures.gel_centres_below_dose =
      tomo::share_below_gel(job, dose_at(tomo::JudgedAt::centres), part);
  return tell(figures, o.json, console);
}

}  // namespace

void add_tomo(Program& program, TomoOptions& o) {
  CLI::App* group = program.add_group(
      "tomo", "Print whole parts at once, in a vial that turns before a projector");
  using Command = int (*)(const TomoOptions&, const ExecutionContext&, Console&);
  const auto add = [&](const char* name, const char* text, Command command) {
    return program.add_to(group, name, text,
                          [&o, command](const ExecutionContext& context, Console& console) {
                            return command(o, context, console);
                          });
  };
  CLI::App* sub = add("solve", "Find the frames of a part, and write them as a job", solve);
  sub->add_option("PART", o.mesh.parts, "Meshes (stl, obj, ply, off, 3mf; also .gz)");
  sub->add_option(
      "--volume", o.volume,
      "A volume in place of meshes (.npy, axes z, y, x: 255 part, 0 empty, else neither)");
  sub->add_option("--layer-um", o.mesh.layer_um, "Side of a voxel in micrometres")
      ->check(number_in(1, 1000));
  o.mesh.add_placement_to(*sub);
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  o.light.add_to(*sub);
  sub->add_option("-o,--output", o.output, "File of the job to write (.frames)")->required();
  o.add_to(*sub);
  o.add_places_to(*sub);
  o.add_wanted_to(*sub);
  o.add_numbers_to(*sub);
  sub->add_flag("--resume", o.resume,
                "Go on from what a solve that was stopped left in OUTPUT.resume, if it is there");
  sub->add_option("--checkpoint-s", o.checkpoint_s,
                  "Seconds at least between what is left there; 0: after each rung or step")
      ->check(number_in(0, 1e9))
      ->capture_default_str();
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("--picture", o.picture,
                  "Where to draw the slice that fails, when no light prints the part (.png or "
                  ".svg) [the output's name and .infeasible.png]");

  sub = add("verify", "Say what a job's frames print, by a direct sum of their light", verify);
  sub->add_option("JOB", o.job, "File of the job (.frames)")->required();
  sub->add_option("--volume", o.volume, "Another part to judge by (.npy), with the job's voxels");
  sub->add_option("--shown", o.shown,
                  "Judge by what a machine really showed: frames.csv of printbridge, or the record "
                  "of printer-sim (.csv)");
  sub->add_option("--dose", o.dose, "Write the dose of the print, mJ/cm³, to FILE (.npy)");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");

  add_tomo_views(program, group, o.views);
  add_tomo_targets(program, group, o.targets);
  add_tomo_look(program, group, o.look);
  add_tomo_limits(program, group, o.limits);
}

}  // namespace slicecorr::cli
