// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo_look.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/widths.hpp"
#include "support/json/finite.hpp"
#include "tomo_views.hpp"

namespace slicecorr::cli {

namespace {

using detail::finite_or_null;

std::string in_words(const tomo::Look& look, double turns) {
  std::string text = fmt::format(
      "{} of {} voxels of the part have gelled, {} of void; by the plan {} voxels should, {} have "
      "(agreement {:.3f})\n"
      "{:.4g} of the planned dose has come ({:.4g} to {:.4g} by what is to be seen)\n",
      look.part_gelled, look.part, look.void_gelled, look.planned, look.gelled, look.agreement,
      look.share, look.least_share, look.most_share);
  text += look.stop_turn <= turns
              ? fmt::format("stop: all of the part had its dose at turn {:.2f}", look.stop_turn)
              : fmt::format("stop at turn {:.2f}, in {:.2f} turns from now", look.stop_turn,
                            look.stop_turn - turns);
  if (std::isfinite(look.void_turn)) {
    text += fmt::format("; void begins to gel at turn {:.2f}", look.void_turn);
  }
  return text + "\n";
}

std::string in_json(const tomo::Look& look) {
  nlohmann::ordered_json j;
  j["share_of_plan"] = finite_or_null(look.share);
  j["share_of_plan_range"] = {finite_or_null(look.least_share), finite_or_null(look.most_share)};
  j["agreement"] = look.agreement;
  j["gelled_voxels"] = look.gelled;
  j["planned_voxels"] = look.planned;
  j["part"] = {{"voxels", look.part}, {"gelled", look.part_gelled}};
  j["void_gelled"] = look.void_gelled;
  j["stop_turn"] = finite_or_null(look.stop_turn);
  j["void_turn"] = finite_or_null(look.void_turn);
  return j.dump(2);
}

int look(const TomoLookOptions& o, const ExecutionContext& context, Console& console) {
  const SectionsFile drawn = o.picture.empty() ? nullptr : sections_file(o.picture);
  for (const std::string& output : {o.seen, o.json, o.picture}) {
    check_output(output, {o.job, o.look.before, o.look.now});
  }
  const tomo::TomoJob job = tomo::read_job(o.job, context);
  const tomo::Box<float> dose = tomo::dose_of(job, context);
  const tomo::Look seen = tomo::look_at(job, dose, o.look, context);
  if (drawn != nullptr) {
    write_text_file(
        o.picture,
        drawn(tomo::sections_of(seen, job, dose, o.look.turns), tomo::ColouredBy::dose,
              fmt::format("{} after {:g} turns: the dose that has come, and what is seen "
                          "(its line: half of what gelled resin takes)",
                          std::filesystem::path(o.job).filename().string(), o.look.turns)));
  }
  if (!o.seen.empty()) tomo::write_npy(o.seen, seen.seen);
  const std::string words = in_words(seen, o.look.turns);
  if (o.json.empty()) {
    print_result(words);
  } else {
    print_or_write(o.json, in_json(seen));
    console.say(words);
  }
  return kDone;
}

int diffusion(const TomoLookOptions& o, const ExecutionContext& context, Console& console) {
  check_output(o.json, {o.job, o.widths});
  const auto widths = tomo::read_widths(o.widths);
  const tomo::DiffusionFit fit =
      tomo::fit_diffusion(tomo::read_job(o.job, context), widths, context);
  std::string words = fmt::format(
      "dose_diffusion_m2_s = {:.4g}\nwith it dose spreads by {:.4g} mm over the print; {} widths are off by "
      "{:.4g} mm (rms), without it by {:.4g} mm\n",
      fit.diffusion_m2_s, fit.spread_mm, widths.size(), fit.rms_mm, fit.without_rms_mm);
  if (fit.at_bound) {
    words +=
        "that is as much as was looked for: these widths are of something else than diffusion\n";
  }
  if (o.json.empty()) {
    print_result(words);
  } else {
    print_or_write(o.json, fit.to_json(widths));
    console.say(words);
  }
  return kDone;
}

}  // namespace

void add_tomo_look(Program& program, CLI::App* group, TomoLookOptions& o) {
  CLI::App* sub = program.add_to(
      group, "look",
      "Say what of a print has gelled, by images of a camera, and at which turn to stop",
      [&o](const ExecutionContext& context, Console& console) {
        return look(o, context, console);
      });
  sub->add_option("JOB", o.job, "File of the job that is being printed (.frames)")->required();
  sub->add_option("--before", o.look.before,
                  "Folder (or zip) of PNG images of the vial before any light, one for each angle "
                  "of a turn, in the order of their names")
      ->required()
      ->check(value_is(ValueKind::file));
  sub->add_option("--now", o.look.now, "The same now, at the same angles")
      ->required()
      ->check(value_is(ValueKind::file));
  sub->add_option("--turns", o.look.turns, "Turns that were shown until then")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--camera-deg", o.look.camera_deg,
                  "By how much the vial turns on from where the camera sees it to where the "
                  "projector does")
      ->check(number_in(-360, 360))
      ->capture_default_str();
  sub->add_option("--steps", o.look.steps, "Steps of the reconstruction")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  sub->add_option("--seen", o.seen, "Write what is seen, 1/mm, to FILE (.npy)");
  sub->add_option(
      "--picture", o.picture,
      "Draw the dose that has come beside what is seen, cut open, to FILE (.png or .svg)");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");

  sub = program.add_to(group, "diffusion",
                       "Say how far dose spreads in a resin, by widths measured on one print",
                       [&o](const ExecutionContext& context, Console& console) {
                         return diffusion(o, context, console);
                       });
  sub->add_option("JOB", o.job, "File of the job that was printed (.frames)")->required();
  sub->add_option(
         "WIDTHS", o.widths,
         "Table (.csv) with the columns x_mm, y_mm, z_mm, along (x, y or z), width_mm: of what is "
         "solid there")
      ->required();
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::cli
