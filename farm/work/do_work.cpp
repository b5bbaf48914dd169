// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The worker: one order from the beginning to the end.

#include <fmt/format.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <new>
#include <system_error>

#include "programs/common/make_part.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/part_slices.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_greys.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/verdict.hpp"
#include "slicecorr/version.hpp"
#include "store/title.hpp"
#include "support/process/memory_limit.hpp"
#include "work/files.hpp"
#include "work/make_result.hpp"
#include "work/reporter.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using SteadyTime = std::chrono::steady_clock;
using detail::InputGone;
using detail::OutputInvalid;
using detail::Reporter;

namespace {

/// Shares of the whole time, measured on parts of the demo; they only shape the progress shown.
std::vector<detail::Phase> stack_phases() {
  return {{"read", 0, 0.05}, {"correct", 0.05, 0.75}, {"report", 0.75, 0.88}, {"check", 0.88, 1}};
}

/// Full disks, by what the library's messages say of them.
bool says_full(const std::string& text) {
  for (const int error : {ENOSPC, EDQUOT, EFBIG}) {
    if (text.find(std::generic_category().message(error)) != text.npos) return true;
  }
  return false;
}

bool says_no_memory(const std::string& text) {
  return text.find(std::generic_category().message(ENOMEM)) != text.npos ||
         text.find("Malloc failure") != text.npos;
}

/// What the archive that was written says when it is read again: a result is what can be read back.
void check_stack(const std::string& path, const std::string& scratch, const StackInfo& written,
                 const Prediction& prediction, const ExecutionContext& context) {
  const auto refuse = [&](const std::string& what) {
    throw InputError(path, "", "read back after writing: " + what);
  };
  MissingFacts facts;
  facts.layer_um = written.grid.layer_um;
  facts.pixel_x_um = written.grid.pixel_x_um;
  facts.pixel_y_um = written.grid.pixel_y_um;
  const StackReader stack(path, scratch, context, facts);
  const Grid& g = stack.grid();
  if (g.layers != written.grid.layers) {
    refuse(fmt::format("{} slices, expected {}", g.layers, written.grid.layers));
  }
  if (g.width_px != written.grid.width_px || g.height_px != written.grid.height_px) {
    refuse(fmt::format("images of {} x {} pixels, expected {} x {}", g.width_px, g.height_px,
                       written.grid.width_px, written.grid.height_px));
  }
  if (stack.pixel_sum() == 0) refuse("all images are black");
  if (prediction.target_voxels > 0 && prediction.printed_voxels == 0) refuse("nothing would print");
}

void fill_figures(ResultFigures& f, const Prediction& p) {
  f.layers = p.layers;
  if (p.height_error_um.count() > 0) {
    f.height_mean_um = p.height_error_um.mean();
    f.height_p95_um = p.height_error_um.quantile(0.95);
    f.height_max_um = p.height_error_um.greatest();
  }
  f.lost_features = static_cast<std::int64_t>(p.lost_features);
  f.merged_features = static_cast<std::int64_t>(p.merged_features);
  f.cure_through_voxels = static_cast<std::int64_t>(p.cure_through_voxels);
  f.undercure_voxels = static_cast<std::int64_t>(p.undercure_voxels);
  f.target_voxels = static_cast<std::int64_t>(p.target_voxels);
  const PrintVerdict verdict = verdict_of(p);
  f.verdict = {name_of(verdict.outcome), verdict.words};
}

/// The farm's copies of the inputs, checked.
std::vector<std::string> checked_inputs(const WorkOrder& order) {
  FarmFolder farm;
  farm.store = order.store;
  std::vector<std::string> paths;
  for (const WorkSpec::Input& input : order.spec.inputs) {
    if (!check_input(farm, input.file, input.sha256, true)) {
      throw InputGone(
          input.name, "",
          "the farm's copy, inputs/" + input.file + ", is gone, or not what was submitted");
    }
    paths.push_back(farm.input(input.file));
  }
  return paths;
}

/// A corrected stack; gives the endings of what was written.
std::vector<std::string> make_stack(const WorkOrder& order, const std::vector<std::string>& paths,
                                    const std::string& folder, const std::string& base,
                                    Reporter& reporter, const ExecutionContext& context,
                                    WorkOutcome& outcome) {
  const WorkSpec& spec = order.spec;
  Setup setup = parse_setup_json(order.setup_json, "the job's setup");
  if (const WorkSpec& s = order.spec; !s.uncertain.empty()) {
    SetupChoices resin;
    resin.resin_toml = s.uncertain_resin_toml;
    setup.uncertainty = chosen_uncertainty(s.uncertain, setup, resin, ChoiceNames::options);
    setup.uncertainty->robust = s.robust;
  }
  StackFile file(base + "." + spec.ending);
  file.format = spec.format;
  const std::string title = detail::title_stand_in(order.key);

  std::optional<cli::PartSlices> mesh;
  std::optional<StackReader> archive;
  std::optional<StackInfo> times;
  const std::ptrdiff_t inside_at = std::ssize(paths) - spec.inside,
                       parts = inside_at - spec.left_alone;
  const std::vector<std::string> left_alone(paths.begin() + parts, paths.begin() + inside_at),
      inside(paths.begin() + inside_at, paths.end());
  cli::PartFacts facts;
  if (spec.kind == "run") {
    cli::MeshOptions options = detail::mesh_options(spec, {paths.begin(), paths.begin() + parts});
    options.shrinkage = setup.resin.shrinkage;
    mesh.emplace(options, setup.printer,
                 cli::LayersWanted{LayerHeights(setup.process.layer_heights_um),
                                   setup.process.surface, left_alone},
                 context, &facts);
    Process process = setup.process;
    if (const char* const why = leave_out_heights(setup.printer, setup.resin, process)) {
      context.tell(why);
    }
    for (const std::string& text : facts.defects) {
      outcome.message += (outcome.message.empty() ? "" : "; ") + text;
    }
  } else {
    const StackInfo& info = times.emplace(StackReader::read_info(paths.at(0)));
    check_design(info, spec.inputs.at(0).name);
    // What a slicer wrote besides the slices stays, as with `slicecorr correct`.
    if (info.format == spec.format && keeps_settings(paths[0], info)) file.keep_from = paths[0];
    // What the archive says of lifts counts before the printer's; a job's setup has only that.
    if (info.lift_times) setup.lift_times = info.lift_times;
    if (!(setup.printer.travel_mm > 0)) file.machine_height_mm = info.machine_height_mm;
    MissingFacts facts;
    facts.layer_um = spec.layer_um;
    facts.pixel_x_um = setup.printer.pixel_x_um;
    facts.pixel_y_um = setup.printer.pixel_y_um;
    archive.emplace(paths[0], folder, context, facts);
  }
  for (const std::string& text :
       setup_notices(setup, times ? &*times : nullptr, ChoiceNames::options)) {
    context.tell(text);
  }
  for (const std::string& text : spec.warnings) context.tell(text);
  const SliceSource& slices = mesh ? **mesh : static_cast<const SliceSource&>(*archive);
  const bool foreign = archive && archive->info().kind == StackKind::foreign;
  const std::string corrected_before =
      foreign ? even_greys(slices, context).in_words() : std::string();
  const FittedSlices fitted = cli::fit_for_output(slices, file, setup.printer, context);
  const LeftAloneFiles leaving(*fitted, left_alone, mesh ? mesh->place() : MeshesLeftAlone{},
                               setup.printer, folder, context,
                               cli::parts_inside(inside, detail::mesh_options(spec, {})));
  const SliceSource& target = *leaving;
  const Grid& g = target.grid();
  reporter.set_layers(g.layers);
  outcome.voxels =
      static_cast<std::int64_t>(g.layers) * target.bounds().width() * target.bounds().height();

  reporter.begin(1);
  const Correction result =
      cli::make_part(target, setup, file, base, title, context, [&] { reporter.begin(2); });
  fill_figures(outcome.figures, result.after);
  // It ends well, but with warnings: of what nobody measured, of light that is not this printer's, of what was
  // corrected already or lifts, and of bodies.
  std::vector<std::string> warnings = spec.warnings;
  for (const std::string& text :
       {corrected_before, holds_without_lifts(spec.format, setup.process),
        other_wavelength_in_words(setup.printer, setup.resin, setup.process.uv.kind != UvKind::off),
        other_display_in_words(setup.printer, setup.resin),
        assumption_in_words(setup.printer, setup.resin, setup.process)}) {
    if (!text.empty()) warnings.push_back(text);
  }
  if (result.after.bodies) {
    const std::vector<std::string> of_bodies = warnings_of(*result.after.bodies);
    warnings.insert(warnings.end(), of_bodies.begin(), of_bodies.end());
  }
  for (const std::string& text : warnings) {
    outcome.message += (outcome.message.empty() ? "" : "; ") + text;
  }
  const PrintTime time = print_time(result.info);
  outcome.figures.time = StackTime{time.light_s, time.all_s()};
  std::vector<std::string> endings{spec.ending, "html", "json"};
  if (mesh) {
    const LayerHeights heights(setup.process.layer_heights_um);
    cli::leave_beside(**mesh, heights, base + cli::kTargetEnding, context);
    endings.emplace_back(cli::kTargetEnding);
    if (!left_alone.empty()) {
      cli::leave_left_alone(*mesh, left_alone, setup.printer, heights, base + cli::kLeftAloneEnding,
                            context);
      endings.emplace_back(cli::kLeftAloneEnding);
    }
  }
  mesh.reset();
  archive.reset();

  reporter.begin(3);
  try {
    check_stack(file.path, folder, result.info, result.after, context);
  } catch (const InputError& e) {
    throw OutputInvalid(e.what());
  }
  // Formats of one binary file have their record beside them.
  if (fs::exists(record_beside(file.path))) endings.push_back(spec.ending + ".slicecorr");
  return endings;
}

/// The work itself; fills in what is known of the result.
void make_result(const WorkOrder& order, const std::string& folder, Reporter& reporter,
                 const ExecutionContext& context, WorkOutcome& outcome) {
  reporter.begin(0);
  const std::vector<std::string> paths = checked_inputs(order);
  const std::string out = folder + "/out";
  // Not the folder around it: when that is gone, so is the attempt.
  fs::create_directory(out);
  const std::string base = out + "/" + order.name;
  const std::vector<std::string> endings =
      order.spec.tomo ? detail::make_tomographic(order, paths, base, reporter, context, outcome)
                      : make_stack(order, paths, folder, base, reporter, context, outcome);
  for (const std::string& ending : endings) {
    ResultFile written = sha256_of_file(result_name(base, ending));
    written.ending = ending;
    outcome.files.push_back(std::move(written));
  }
}

/// People know files by the names that they submitted, not by those of the farm's copies.
std::string in_names_of_user(std::string text, const WorkOrder& order) {
  FarmFolder farm;
  farm.store = order.store;
  for (const WorkSpec::Input& input : order.spec.inputs) {
    const std::string copy = farm.input(input.file);
    for (std::size_t at = 0; (at = text.find(copy, at)) != std::string::npos;) {
      text.replace(at, copy.size(), input.name);
      at += input.name.size();
    }
  }
  return text;
}

/// The worker's own limit, whatever the engine: data, which is what a job's memory grows by.
/// Programs and libraries that are mapped from files don't count.
void limit_memory(std::int64_t memory_mb, int threads) {
  if (!kLimitsMemory || memory_mb <= 0) return;
  rlimit stack{};
  ::getrlimit(RLIMIT_STACK, &stack);
  const rlim_t stack_bytes = stack.rlim_cur == RLIM_INFINITY
                                 ? rlim_t{8} << 20
                                 : std::min(stack.rlim_cur, rlim_t{64} << 20);
  // Stacks of threads are reserved whole and hardly used.
  const rlim_t bytes =
      (static_cast<rlim_t>(memory_mb) << 20) + static_cast<rlim_t>(threads + 1) * stack_bytes;
  const rlimit limit{bytes, bytes};
  ::setrlimit(RLIMIT_DATA, &limit);
}

/// What the record calls a failure.
Reason reason_of(const Failure& failure) {
  switch (failure.kind) {
    case Failure::Kind::cancelled:
      return Reason::stopped;
    case Failure::Kind::input:
      return Reason::bad_input;
    case Failure::Kind::infeasible:
      return Reason::infeasible;
    case Failure::Kind::memory:
    case Failure::Kind::system:  // threads that can't be made, mostly
      return Reason::out_of_memory;
    case Failure::Kind::device:
    case Failure::Kind::disk:
      return says_full(failure.text)        ? Reason::disk_full
             : says_no_memory(failure.text) ? Reason::out_of_memory
                                            : Reason::device_failed;
    default:
      return Reason::worker_crashed;
  }
}

}  // namespace

cli::MeshOptions detail::mesh_options(const WorkSpec& spec, const std::vector<std::string>& paths) {
  cli::MeshOptions o;
  o.parts = paths;
  o.layer_um = spec.layer_um;
  o.antialias = spec.antialias;
  o.center_mm = spec.center_mm;
  o.units = spec.units;
  o.scale = spec.scale;
  o.rotate_deg = spec.rotate_deg;
  o.plate = spec.plate;
  return o;
}

int do_work(const std::string& folder, const std::atomic<bool>* cancel,
            const std::function<void(const std::string&)>& say) {
  const auto begin = SteadyTime::now();
  const WorkOrder order = read_order(folder);
  ::signal(SIGXFSZ, SIG_IGN);
  WorkOutcome outcome;
  outcome.token = order.token;
  outcome.key = order.key;
  outcome.node = detail::host_name();
  outcome.program = std::string("slicecorr ") + version;
  const auto end = [&](int code, Reason reason, const std::string& text) {
    const std::string message = in_names_of_user(text, order);
    outcome.exit_code = code;
    outcome.reason = reason;
    outcome.message = message;
    if (!message.empty()) say(message);
  };
  for (const WorkSpec::Input& input : order.spec.inputs) {
    say(fmt::format("{}: read from inputs/{}", input.name, input.file));
  }
  limit_memory(order.memory_mb, order.threads);
  detail::tell_work_stage("start", order);
  Reporter reporter(folder, order, order.spec.tomo ? detail::tomo_phases() : stack_phases());
  ExecutionContext context;
  context.threads = order.threads;
  context.cancel = cancel;
  context.notice = [&](const std::string& text) { say(in_names_of_user(text, order)); };
  context.progress = [&](std::string_view, double done) { reporter.progress(done); };
  try {
    make_result(order, folder, reporter, context, outcome);
    // Not why it failed, but what was wrong with its inputs.
    outcome.message = in_names_of_user(outcome.message, order);
  } catch (const InputGone& e) {
    end(cli::kInput, Reason::input_gone, e.what());
  } catch (const OutputInvalid& e) {
    end(cli::kDevice, Reason::output_invalid, e.what());
  } catch (...) {
    const Failure failure = failure_at_hand();
    const bool memory = failure.kind == Failure::Kind::memory;
    end(cli::exit_code(failure.kind), reason_of(failure),
        failure.kind == Failure::Kind::cancelled ? "asked to stop"
        : memory ? fmt::format("out of memory; the limit is {} MB", order.memory_mb)
                 : failure.text);
  }
  detail::tell_work_stage("end", order);
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  outcome.cpu_s = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                  static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec) * 1e-6;
  outcome.peak_mb = used.ru_maxrss / 1024;
  outcome.wall_s = std::chrono::duration<double>(SteadyTime::now() - begin).count();
  detail::write_outcome(folder, outcome);
  return outcome.exit_code;
}

}  // namespace slicecorr::farm
