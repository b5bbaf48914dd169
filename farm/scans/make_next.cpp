// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The next print of a job: tuned by its scans, queued again.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "programs/common/part_slices.hpp"
#include "programs/common/program.hpp"
#include "scans/beside.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/scans.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/turned.hpp"
#include "support/toml/toml_table.hpp"
#include "work/make_result.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;

namespace {

/// A job that is to be printed again.
struct Again {
  Job job;
  WorkSpec spec;
  Setup setup;
  std::vector<std::string> inputs;  ///< paths in the store
  std::vector<KeptScan> scans;
};

Again again_of(const FarmFolder& folder, ReadModel& model, const NextAsk& ask) {
  const auto job = model.job(ask.job);
  if (!job) throw InputError(fmt::format("{}: no such job", ask.job));
  const auto [spec_json, setup_json] = model.work_of(job->id);
  Again a{*job, parse_spec(spec_json), {}, {}, {}};
  if (a.spec.tomo) {
    throw InputError(
        fmt::format("job {} prints tomographically, and is not tuned by scans", job->id));
  }
  if (a.spec.left_alone > 0 || a.spec.inside > 0) {
    throw InputError(
        fmt::format("job {} leaves supports alone, and the farm queues no such job anew; expected "
                    "slicecorr tune --scan, and a job with what it writes",
                    job->id));
  }
  a.setup = parse_setup_json(setup_json, "the job's setup");
  for (KeptScan& s : model.scans(job->id)) {
    const bool wanted = ask.scans.empty() ||
                        std::find(ask.scans.begin(), ask.scans.end(), s.number) != ask.scans.end();
    if (wanted) a.scans.push_back(std::move(s));
  }
  for (const int number : ask.scans) static_cast<void>(scan_of(model, job->id, number));
  if (a.scans.empty()) {
    throw InputError(fmt::format("job {} has no scan; expected one of its print", job->id));
  }
  for (const WorkSpec::Input& input : a.spec.inputs) {
    if (!check_input(folder, input.file, input.sha256, false)) {
      throw InputError(fs::path(input.name).filename().string(), "",
                       "the farm's copy was collected (gc); expected the part to be submitted "
                       "again, with the resin that slicecorr tune --scan writes");
    }
    a.inputs.push_back(folder.input(input.file));
  }
  return a;
}

/// Units and sides of voxels are said of all scans at once.
std::vector<std::string> reading_of(const std::vector<KeptScan>& scans) {
  std::vector<std::string> options;
  const bool alike = std::all_of(scans.begin(), scans.end(), [&](const KeptScan& s) {
    return s.unit == scans.front().unit && s.voxel_um == scans.front().voxel_um;
  });
  if (!alike) {
    throw InputError(
        "the scans are in several units, or volumes of several voxels; expected alike ones, by "
        "their numbers");
  }
  if (scans.front().voxel_um > 0) {
    options.push_back(fmt::format("--voxel-um={}", scans.front().voxel_um));
  } else {
    options.push_back("--scan-unit=" + scans.front().unit);
  }
  return options;
}

/// What is known of how far edges of the first print are off, with what was found.
void judge_first(const Again& a, const NextMade& made, const ExecutionContext& context,
                 NextPrint& next) {
  const std::string stack_path = stack_of(a.job), folder = cli::folder_of(made.resin);
  const StackReader stack(stack_path, folder, context);
  std::optional<cli::PartSlices> mesh;
  std::optional<StackReader> archive;
  if (a.spec.kind == "run") {
    cli::MeshOptions options = detail::mesh_options(a.spec, a.inputs);
    options.shrinkage = a.setup.resin.shrinkage;  // of what the resin was known to do then
    cli::LayersWanted layers;
    layers.heights = LayerHeights(a.setup.process.layer_heights_um);
    layers.surface = a.setup.process.surface;
    mesh.emplace(options, a.setup.printer, layers, context);
  } else {
    MissingFacts facts;
    facts.layer_um = stack.grid().layer_um;
    facts.pixel_x_um = stack.grid().pixel_x_um;
    facts.pixel_y_um = stack.grid().pixel_y_um;
    archive.emplace(a.inputs.at(0), folder, context, facts);
  }
  const SliceSource& design = mesh ? **mesh : static_cast<const SliceSource&>(*archive);
  SetupChoices choices;
  choices.printer = made.printer;
  choices.resin = made.resin;
  const Setup now = resolve_setup(choices, &stack.info(), &stack.info(), ChoiceNames::options);
  const FittedSlices like = FittedSlices::like(stack, design, folder, context);
  const std::unique_ptr<const SliceSource> exposures = stack.exposures(now.resin.m);
  const Prediction first = verify_stack(exposures ? *exposures : stack, *like, now, context);
  if (first.height_error_um.count() == 0) return;
  next.before_mean_um = first.height_error_um.mean();
  next.before_p95_um = first.height_error_um.quantile(0.95);
}

/// The job as somebody would ask for it again, with what was found.
JobRequest request_of(const Again& a, const NextMade& made, const FarmFolder& folder,
                      const std::string& user) {
  JobRequest r;
  r.as_options = true;
  r.where = fmt::format("the next print of job {}", a.job.id);
  r.parts = a.inputs;
  place_as(r, detail::mesh_options(a.spec, a.inputs));
  r.setup.printer = made.printer;
  r.setup.resin = made.resin;
  r.setup.layer_heights_um = a.setup.process.layer_heights_um;
  if (r.setup.layer_heights_um.empty()) r.layer_um = a.spec.layer_um;
  r.uncertain = a.spec.uncertain;
  r.robust = a.spec.robust;
  r.like = std::make_shared<const StackInfo>(StackReader::read_info(stack_of(a.job)));
  r.name = a.job.name + "-next";
  r.format = a.spec.format;
  if (a.job.output_folder != folder.results(a.job.id)) r.out = a.job.output_folder;
  r.labels = a.job.labels;
  r.labels.push_back(fmt::format("after job {}", a.job.id));
  r.priority = a.job.priority;
  r.user = user;
  return r;
}

/// People know parts by the names under which they were submitted.
void give_names(const Again& a, Submission& submission) {
  for (NewJob& j : submission.jobs) {
    j.parts = a.job.parts;
    WorkSpec spec = parse_spec(j.work.spec_json);
    for (std::size_t i = 0; i < spec.inputs.size(); ++i) {
      spec.inputs[i].name = a.spec.inputs.at(i).name;
    }
    j.work.spec_json = spec_json(spec);
  }
}

}  // namespace

std::string tuned_name(const std::string& name, JobId job) {
  return fmt::format("{}-job-{}", name, job);
}

NextMade make_next(const FarmFolder& folder, const NextAsk& ask, const ExecutionContext& context) {
  Queue queue(folder.database());
  ReadModel model(folder.database());
  const Again a = again_of(folder, model, ask);
  const std::string stack = stack_of(a.job);
  NextMade made;
  const std::string at = fs::absolute(ask.folder).lexically_normal().string();
  made.resin = (fs::path(at) / (tuned_name(a.job.resin, a.job.id) + ".toml")).string();
  made.printer = (fs::path(at) / (tuned_name(a.job.printer, a.job.id) + ".toml")).string();
  if (made.resin == made.printer) {
    throw InputError("printer and resin have one name; expected two, to write both");
  }
  const std::string printer = ask.printer.empty() ? a.job.printer : ask.printer,
                    resin = ask.resin.empty() ? a.job.resin : ask.resin;
  // What the database says now is tuned; the job may have been made with what it said then.
  if (definitions_json(load_printer(printer), load_resin(resin)) !=
      definitions_json(a.setup.printer, a.setup.resin)) {
    made.notes.push_back(fmt::format(
        "{} or {} was changed since job {} was made: what is tuned is what the files say now",
        printer, resin, a.job.id));
  }
  std::vector<std::string> arguments = {"slicecorr", "tune", "--scan"};
  for (const KeptScan& s : a.scans) {
    arguments.push_back(folder.scan(s.folder) + "/file/" + s.file);
  }
  for (const std::string& more :
       {std::string("--stack"), stack, "--printer=" + find_definition(printer, "printer"),
        "--resin=" + find_definition(resin, "resin"), std::string("-o"), made.resin,
        "--printer-out=" + made.printer}) {
    arguments.push_back(more);
  }
  for (std::string& option : reading_of(a.scans)) arguments.push_back(std::move(option));
  context.report("tuning by scans", 0);
  made.print.words = detail::run_beside(arguments, at).out;
  made.print.of = a.job.id;
  ExecutionContext untold = context;
  untold.notice = nullptr;  // of the part, which was told when the job was made
  judge_first(a, made, untold, made.print);
  Submission submission =
      prepare({request_of(a, made, folder, ask.user)}, folder, queue, ask.user, true, context);
  give_names(a, submission);
  made.print.job = submit(submission, folder, queue, ask.user, "scans").ids.at(0);
  queue.record_next(made.print);
  return made;
}

}  // namespace slicecorr::farm
