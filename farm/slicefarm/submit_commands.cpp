// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "commands.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/part_slices.hpp"
#include "programs/common/setup_options.hpp"
#include "programs/common/tomo_options.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "submit/fields.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

namespace {

struct SubmitArguments {
  FarmOptions farm;
  std::vector<std::string> parts;
  cli::SetupOptions setup;
  cli::TomoPrintOptions tomo;  ///< with the options of meshes
  const CLI::App* app = nullptr;
  JobRequest request;
  std::string store, json, layers;
  bool dry_run = false, skip_bad = false;
};

/// The fields of jobs that options on the command line set.
std::map<std::string, SaidField> said_options(const CLI::App& app) {
  const std::vector<std::string> fields = detail::field_names();
  std::map<std::string, SaidField> said;
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() == 0) continue;
    for (std::string name : option->get_lnames()) {
      std::replace(name.begin(), name.end(), '-', '_');
      if (name == "layers") name = detail::kLayerHeights;
      if (std::find(fields.begin(), fields.end(), name) == fields.end()) continue;
      said[name] = {"command line", false};
    }
  }
  return said;
}

bool is_jobs_file(const std::string& path) {
  return path.ends_with(".toml") || path.ends_with(".csv");
}

std::vector<JobRequest> requests_of(const SubmitArguments& a) {
  JobRequest common = a.request;
  common.setup = a.setup.choices();
  const cli::MeshOptions& mesh = a.tomo.mesh;
  common.layer_um = mesh.layer_um;
  common.adaptive_um = a.request.adaptive_um;
  if (!a.layers.empty()) {
    common.setup.layer_heights_um = cli::read_by_slice(a.layers, "layer_um");
  }
  place_as(common, mesh);
  common.inserts = a.tomo.inserts;
  common.voxel_mm = a.tomo.voxel_mm;
  common.method = a.tomo.method;
  common.window = a.tomo.window;
  common.angles = a.tomo.angles;
  common.iterations = a.tomo.iterations;
  common.clip_sigma = a.tomo.clip_sigma;
  common.stop_error = a.tomo.stop_error;
  common.max_time_s = a.tomo.most_time_s;
  common.beyond_reach = a.tomo.beyond_reach;
  common.said = said_options(*a.app);
  std::vector<JobRequest> requests;
  std::vector<SubmitError> errors;
  for (const std::string& part : a.parts) {
    try {
      if (is_jobs_file(part)) {
        const auto more = read_jobs_to_check(part, common);
        requests.insert(requests.end(), more.begin(), more.end());
      } else {
        JobRequest r = common;
        r.parts = {part};
        r.where = part;
        r.as_options = true;
        for (auto& [key, said] : r.said) said.where = part;
        absolute_paths(r);
        requests.push_back(std::move(r));
      }
    } catch (const SubmitErrors& e) {
      errors.insert(errors.end(), e.errors().begin(), e.errors().end());
    }
  }
  if (!errors.empty()) throw SubmitErrors(std::move(errors));
  return requests;
}

std::string table_of(const Submission& s) {
  std::vector<std::vector<std::string>> rows;
  double seconds = 0, bytes = 0;
  for (const Estimate& e : s.estimates) {
    std::string note = e.cached ? "from the cache" : e.duplicate ? "with another job" : "";
    if (!e.planned.empty()) note = e.planned + (note.empty() ? "" : "; ") + note;
    rows.push_back({text::clipped(text::printable(e.name), 60), std::to_string(e.layers),
                    text::duration(e.seconds), text::bytes(static_cast<double>(e.disk_bytes)),
                    fmt::format("{} MB", e.memory_mb), note});
    if (!e.cached && !e.duplicate) seconds += e.seconds;
    bytes += static_cast<double>(e.disk_bytes);
  }
  std::string text = text::table({"job", ">layers", ">time", ">disk", ">memory", ""}, rows, 0);
  const bool measured = std::all_of(s.estimates.begin(), s.estimates.end(),
                                    [](const Estimate& e) { return e.measured; });
  text +=
      fmt::format("{} {}: {} on one core, {}; {}\n", s.jobs.size(),
                  s.jobs.size() == 1 ? "job" : "jobs", text::duration(seconds), text::bytes(bytes),
                  measured ? "by rates that this farm measured"
                           : "guessed, this farm has measured nothing of the kind yet");
  return text;
}

std::string json_of(const Submission& s, const std::vector<JobId>& ids) {
  nlohmann::ordered_json json;
  json["jobs"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < s.estimates.size(); ++i) {
    const Estimate& e = s.estimates[i];
    nlohmann::ordered_json job;
    job["id"] = ids.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(ids[i]);
    job["name"] = e.name;
    job["where"] = e.where;
    job["key"] = s.jobs[i].work.key;
    job["layers"] = e.layers;
    job["voxels"] = e.voxels;
    job["expected_s"] = e.seconds;
    job["expected_bytes"] = e.disk_bytes;
    job["memory_mb"] = e.memory_mb;
    job["measured"] = e.measured;
    job["planned"] =
        e.planned.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(e.planned);
    job["cached"] = e.cached;
    job["duplicate"] = e.duplicate;
    json["jobs"].push_back(std::move(job));
  }
  return json.dump(2);
}

/// Takes what can't be done out of `requests` and says so; false where nothing would be left, or an
/// error is of no job in particular.
bool skip(const SubmitErrors& e, std::vector<JobRequest>& requests, cli::Console& console) {
  std::set<std::ptrdiff_t> bad;
  for (const SubmitError& error : e.errors()) {
    if (error.request < 0) return false;
    bad.insert(error.request);
  }
  if (bad.size() >= requests.size()) return false;
  for (const SubmitError& error : e.errors()) {
    // Messages about a file begin with its whole path, which `where` has as it was given.
    const std::string path = std::filesystem::absolute(error.where).string() + ": ";
    const std::string& text = error.message;
    console.say(fmt::format("skipped: {}: {}", error.where,
                            text.starts_with(path) ? text.substr(path.size()) : text));
  }
  for (auto i = bad.rbegin(); i != bad.rend(); ++i) requests.erase(requests.begin() + *i);
  return true;
}

/// Each error on a line of its own; the last one is thrown. What physics alone forbids has an exit code of its
/// own.
[[noreturn]] void throw_line_by_line(const SubmitErrors& e, cli::Console& console) {
  console.clear();
  const auto line = [](const SubmitError& error) {
    return text::printable(fmt::format("{}: {}", error.where, error.message));
  };
  const std::vector<SubmitError>& errors = e.errors();
  for (std::size_t i = 0; i + 1 < errors.size(); ++i) {
    cli::write_stderr(fmt::format("slicefarm: {}\n", line(errors[i])));
  }
  if (e.all_infeasible()) throw InfeasibleError(line(errors.back()));
  throw InputError(line(errors.back()));
}

Submission checked(std::vector<JobRequest>& requests, const FarmFolder& folder, Queue& queue,
                   const std::string& user, const SubmitArguments& a,
                   const ExecutionContext& context, cli::Console& console) {
  for (;;) {
    try {
      return prepare(requests, folder, queue, user, !a.dry_run, context);
    } catch (const SubmitErrors& e) {
      // What is left is looked at again: what was wrong with one may have hidden another's fault.
      if (a.skip_bad && skip(e, requests, console)) continue;
      std::set<std::ptrdiff_t> bad;
      for (const SubmitError& error : e.errors()) bad.insert(error.request);
      if (!a.skip_bad && !bad.contains(-1) && bad.size() < requests.size()) {
        console.say(
            fmt::format("nothing is queued; --skip-bad queues the {} of {} jobs that can be "
                        "done",
                        requests.size() - bad.size(), requests.size()));
      }
      throw_line_by_line(e, console);
    }
  }
}

int submit_command(const SubmitArguments& a, const ExecutionContext& context,
                   cli::Console& console) {
  const FarmFolder folder = a.store.empty() ? a.farm.open() : a.farm.open(a.store);
  Queue queue(folder.database());
  const std::string user = user_name();
  std::vector<JobRequest> requests;
  try {
    requests = requests_of(a);
  } catch (const SubmitErrors& e) {
    throw_line_by_line(e, console);
  }
  const Submission submission = checked(requests, folder, queue, user, a, context, console);
  if (a.dry_run) {
    if (a.json.empty()) {
      cli::print_result(table_of(submission));
    } else {
      cli::print_or_write(a.json, json_of(submission, {}));
    }
    return cli::kDone;
  }
  std::string source;
  for (const std::string& part : a.parts) {
    if (is_jobs_file(part)) source = part;
  }
  const Submitted done =
      submit(submission, folder, queue, user, source.empty() ? "command line" : source);
  if (!a.json.empty()) cli::print_or_write(a.json, json_of(submission, done.ids));
  const std::string ids = done.ids.size() == 1
                              ? fmt::format("job {}", done.ids[0])
                              : fmt::format("jobs {} to {}", done.ids.front(), done.ids.back());
  const auto first = ReadModel(folder.database()).job(done.ids.front());
  const std::string where =
      first ? fmt::format("; results{} come into {}",
                          done.ids.size() == 1 ? "" : fmt::format(" of job {}", first->id),
                          first->output_folder)
            : std::string();
  console.say(fmt::format("{} queued{}{}", ids,
                          done.done_from_cache > 0 ? fmt::format(", {} of them done from the cache",
                                                                 done.done_from_cache)
                                                   : "",
                          where));
  return cli::kDone;
}

}  // namespace

void add_submit_commands(cli::Program& program) {
  const auto a = std::make_shared<SubmitArguments>();
  CLI::App* sub =
      program.add("submit", "Queue parts, or the jobs of a file; checks everything first",
                  [a](const ExecutionContext& context, cli::Console& console) {
                    return submit_command(*a, context, console);
                  });
  a->app = sub;
  sub->add_option(
         "PART", a->parts,
         "Meshes (stl, obj, ply, off, 3mf; also .gz), archives of slices and volumes (.npy), each "
         "a job of its own, and jobs files (.toml, .csv)")
      ->required();
  a->farm.add_to(*sub);
  sub->add_option("--store", a->store,
                  "Folder of inputs and results, where the farm is made: may be shared with nodes")
      ->check(cli::value_is(cli::ValueKind::folder));
  cli::MeshOptions& mesh = a->tomo.mesh;
  sub->add_option("--layer-um", mesh.layer_um, "Slice height, 1 to 1000")
      ->check(cli::number_in(1, 1000));
  cli::add_heights_to(*sub, a->layers, a->request.adaptive_um);
  sub->add_option("--antialias", mesh.antialias,
                  "Area coverage in 256 levels, or the pixel-centre rule")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  mesh.add_placement_to(*sub);
  mesh.add_plate_to(*sub, false);
  a->setup.add_to(*sub, false, true, {"tomography"});
  a->tomo.add_to(*sub);
  cli::add_leave_alone_to(*sub, a->request.leave_alone);
  cli::add_part_inside_to(*sub, a->request.part_inside, "--part-inside");
  sub->add_option(
         "--uncertain", a->request.uncertain,
         "By how much inputs may be off, as for slicecorr: ha=5%,dc=5%, or fit; the figures of "
         "each job then say how sure they are")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_flag("--robust", a->request.robust,
                "Keep features and gaps for all that --uncertain names, where that is possible");
  sub->add_flag("--plan", a->request.plan,
                "Find the fastest speed (layer by layer: the least exposure) for each part, as "
                "slicecorr plan does");
  sub->add_option("--tolerance-um", a->request.tolerance_um,
                  "With --plan: how far edges may lie from the design [25]")
      ->check(cli::number_above_zero());
  sub->add_option("--gap-contrast", a->request.gap_contrast,
                  "With --plan: 1 less the least dose that every gap is to have [0.05]")
      ->check(cli::number_in(0, 1, true));
  sub->add_option("--out", a->request.out, "Folder of the outputs [results/ID in the farm]")
      ->check(cli::value_is(cli::ValueKind::folder));
  sub->add_option("--format,--out-format", a->request.format,
                  "Format of the archives, or its ending [uvj; archives keep theirs]")
      ->check(cli::value_is(cli::ValueKind::format));
  sub->add_option("--for", a->request.machine,
                  "Machine of machines.toml that is to print it: says printer and format")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--name", a->request.name, "Name of the outputs, without ending [the part's]")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--copies", a->request.copies, "NAME, NAME-2 and so on: the work is done once")
      ->check(CLI::Range(1, 10000));
  sub->add_option("--priority", a->request.priority, "Larger comes first [0]");
  sub->add_option("--ready-by", a->request.ready_by,
                  "HH:MM or YYYY-MM-DD HH:MM: among equal priorities the earlier comes first")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--label", a->request.labels, "Words for filters and clusters; may be repeated")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--user", a->request.user, "Whose jobs they are [who calls]")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_flag("--skip-bad", a->skip_bad,
                "Queue the jobs that can be done, and name those that can't, in place of queueing "
                "none");
  sub->add_flag("--dry-run", a->dry_run, "Check, and say what the jobs will take; queue nothing");
  sub->add_option("--json", a->json, "Write the jobs as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::farm
