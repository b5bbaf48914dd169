// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic prints, as `slicecorr tomo solve` makes them.

#include <fmt/format.h>

#include <string_view>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/tomo/report.hpp"
#include "store/title.hpp"
#include "work/make_result.hpp"

namespace slicecorr::farm::detail {

namespace {

enum PhaseOfTomo : std::size_t { kRead, kSolve, kJudge, kCheck, kReport };

ResultFigures figures_of(const tomo::Print& print) {
  const tomo::PrintFigures& p = print.figures;
  ResultFigures f;
  f.layers = print.job.part.nz;
  f.target_voxels = static_cast<std::int64_t>(p.metrics.gel);
  f.tomo = TomoFigures{p.metrics.contrast, p.contrast_bound, p.metrics.ver, p.turns,
                       p.print_time_s,     p.feasible()};
  return f;
}

/// A result is what can be read back: reads the job, and compares it with what was written.
tomo::TomoJob read_back(const std::string& path, const tomo::TomoJob& written,
                        const ExecutionContext& context) {
  try {
    tomo::TomoJob job = tomo::read_job(path, context);
    if (job.turns != written.turns || job.levels != written.levels ||
        job.part.values != written.part.values || job.insert.values != written.insert.values) {
      throw InputError(path, "", "other frames, or another part, than were written");
    }
    return job;
  } catch (const InputError& e) {
    throw OutputInvalid(fmt::format("read back after writing: {}", e.what()));
  }
}

}  // namespace

cli::TomoPrintOptions tomo_options(const WorkSpec& spec, const std::vector<std::string>& paths) {
  const TomoWork& t = *spec.tomo;
  cli::TomoPrintOptions o;
  const std::size_t parts = paths.size() - static_cast<std::size_t>(t.inserts);
  const auto past = paths.begin() + static_cast<std::ptrdiff_t>(parts);
  if (t.volume) {
    o.volume = paths.at(0);
  } else {
    o.mesh = mesh_options(spec, {paths.begin(), past});
  }
  o.inserts.assign(past, paths.end());
  o.voxel_mm = t.voxel_mm;
  o.method = t.method;
  o.window = t.window;
  o.angles = t.angles;
  o.iterations = t.iterations;
  o.clip_sigma = t.clip_sigma;
  o.stop_error = t.stop_error;
  o.most_time_s = t.max_time_s;
  o.beyond_reach = t.beyond_reach;
  return o;
}

std::vector<Phase> tomo_phases() {
  return {{"read", 0, 0.03},
          {"solve", 0.03, 0.9},
          {"judge", 0.9, 0.95},
          {"check", 0.95, 0.96},
          {"report", 0.96, 1}};
}

std::vector<std::string> make_tomographic(const WorkOrder& order,
                                          const std::vector<std::string>& paths,
                                          const std::string& base, Reporter& reporter,
                                          const ExecutionContext& context, WorkOutcome& outcome) {
  const auto [printer, resin] = parse_definitions_json(order.setup_json, "the job's setup");
  const cli::TomoPrint wanted =
      cli::read_tomo_print(tomo_options(order.spec, paths), printer, context);
  reporter.set_layers(wanted.part.nz);
  outcome.voxels = static_cast<std::int64_t>(wanted.part.values.size());

  for (const std::string& text : light_notices(printer, resin, false)) context.tell(text);
  reporter.begin(kSolve);
  ExecutionContext told = context;
  bool judging = false;
  told.progress = [&](std::string_view stage, double done) {
    if (stage == "judging" && !judging) {
      judging = true;
      reporter.begin(kJudge);
    }
    reporter.progress(done);
  };
  const tomo::Print print =
      tomo::solve_print(wanted.part, wanted.voxel_mm, printer, resin, wanted.options, told);
  tomo::write_job(base + ".frames", print.job, context);
  cli::print_or_write(base + ".json", print.figures.to_json());
  outcome.figures = figures_of(print);
  // As `slicecorr tomo solve` ends: what was made misses, and is there.
  if (!print.figures.feasible()) outcome.exit_code = cli::kMissed;
  context.tell(in_words(outcome.figures));

  reporter.begin(kCheck);
  tomo::TomoJob job = read_back(base + ".frames", print.job, context);
  reporter.begin(kReport);
  cli::write_text_file(base + ".html",
                       tomo::report_page(tomo::printed(std::move(job), context),
                                         title_stand_in(order.key) + ".frames", context));
  return {"frames", "html", "json"};
}

}  // namespace slicecorr::farm::detail
