// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A scan of a job's print: compared, then kept.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "scans/beside.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/scans.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/token.hpp"
#include "slicecorr/farm/work.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;

namespace {

using Node = slicecorr::detail::JsonNode<nlohmann::json>;

/// A folder that goes unless it is kept.
class NewFolder {
 public:
  explicit NewFolder(std::string path) : path_(std::move(path)) {
    slicecorr::detail::make_lasting_folder(path_ + "/file");
  }
  ~NewFolder() {
    std::error_code error;
    if (!kept_) fs::remove_all(path_, error);
  }
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;
  void keep() { kept_ = true; }

 private:
  std::string path_;
  bool kept_ = false;
};

std::string list_of(const std::vector<double>& numbers) {
  return fmt::format("{}", fmt::join(numbers, ","));
}

/// The job's meshes as they were sliced, as options of `slicecorr scan compare`; empty where there are
/// none, which is noted with the reason.
std::vector<std::string> design_options(const FarmFolder& folder, const WorkSpec& spec,
                                        std::vector<std::string>& notes) {
  const auto without = [&](const std::string& why) {
    notes.push_back("measured against what was predicted alone: " + why);
    return std::vector<std::string>();
  };
  if (spec.kind != "run") return without("the job's part is an archive of slices");
  if (spec.left_alone > 0) return without("supports that were left alone stand beside the part");
  if (!(spec.plate == PlateChoices{})) return without("the job placed its parts on the plate");
  std::vector<std::string> options;
  for (const WorkSpec::Input& input : spec.inputs) {
    if (!check_input(folder, input.file, input.sha256, false)) {
      return without("the farm's copy of the part was collected (gc)");
    }
    options.insert(options.end(), {"--design", folder.input(input.file)});
  }
  options.push_back("--units=" + spec.units);
  options.push_back(fmt::format("--scale={}", spec.scale));
  if (!spec.center_mm.empty()) options.push_back("--center-mm=" + list_of(spec.center_mm));
  if (!spec.rotate_deg.empty()) options.push_back("--rotate-deg=" + list_of(spec.rotate_deg));
  return options;
}

void check_room(const FarmFolder& folder, std::int64_t bytes, std::int64_t min_free_mb) {
  if (bytes > kMostScanBytes) {
    throw InputError(
        fmt::format("the scan has {} bytes; expected {} at most", bytes, kMostScanBytes));
  }
  const std::int64_t free = free_bytes(folder.root);
  if (free >= 0 && free - bytes < (min_free_mb << 20)) {
    throw DiskFull(folder.root + ": has no room for the scan (setting min-free-mb)");
  }
}

/// What the record keeps of a comparison.
void read_figures(const std::string& path, KeptScan& scan, std::vector<std::string>& notes) {
  const slicecorr::detail::JsonSource place{path, ""};
  const auto parsed = slicecorr::detail::read_json(read_text_file(path), place);
  const Node root(parsed, "", place);
  constexpr double most = 1e7;
  scan.unit = root["unit"].string();
  scan.points = root["points"].whole(1, std::int64_t{1} << 40);
  for (const Node& note : root["notes"].list(0, 1000)) notes.push_back(note.string());
  const auto deviations = root["deviations"].list(1, 2);
  scan.with_design = deviations.size() > 1;
  const Node& predicted = deviations.back();
  if (predicted["against"].string() != "predicted") predicted["against"].fail("\"predicted\"");
  scan.mean_um = predicted["mean_um"].number(-most, most);
  scan.mean_abs_um = predicted["mean_abs_um"].number(0, most);
  scan.p95_um = predicted["p95_abs_um"].number(0, most);
  scan.worst_um = predicted["max_abs_um"].number(0, most);
  scan.unseen_share = predicted["unseen_share"].number(0, 1);
}

/// The job whose print was scanned, where it may have one more.
Job printed_job(ReadModel& model, const NewScan& given) {
  const auto job = model.job(given.job);
  if (!job) throw InputError(fmt::format("{}: no such job", given.job));
  if (job->kind == "tomo") {
    throw InputError(
        fmt::format("job {} prints tomographically, of which no surface is predicted; "
                    "expected a job that prints layers",
                    job->id));
  }
  if (model.scans(job->id).size() >= static_cast<std::size_t>(kMostScansOfJob)) {
    throw InputError(fmt::format("job {} has {} scans, and may have no more; remove some", job->id,
                                 kMostScansOfJob));
  }
  std::error_code error;
  if (!fs::is_regular_file(given.path, error)) {
    throw InputError(given.path, "",
                     "is no file; expected a mesh, points or a volume (.npy) in one file");
  }
  if (fs::path(given.path).filename().string().starts_with('-')) {
    throw InputError(given.path, "", "begins with '-'; expected another name");
  }
  return *job;
}

}  // namespace

KeptScan scan_of(ReadModel& model, JobId job, int number) {
  for (KeptScan& s : model.scans(job)) {
    if (s.number == number) return std::move(s);
  }
  throw InputError(fmt::format("job {} has no scan {}", job, number));
}

TakenScan take_scan(const FarmFolder& folder, const NewScan& given) {
  Queue queue(folder.database());
  ReadModel model(folder.database());
  const Job job = printed_job(model, given);
  TakenScan taken;
  KeptScan& scan = taken.scan;
  const std::string stack = stack_of(job);
  std::error_code error;
  scan.job = job.id;
  scan.file = fs::path(given.path).filename().string();
  scan.bytes = static_cast<std::int64_t>(fs::file_size(given.path, error));
  scan.user = given.user;
  scan.voxel_um = given.voxel_um;
  check_room(folder, scan.bytes, model.settings().min_free_mb);

  scan.folder = random_token();
  const std::string at = folder.scan(scan.folder), copy = "file/" + scan.file;
  NewFolder made(at);
  fs::copy_file(given.path, at + "/" + copy, error);
  if (error) throw DeviceError(at + "/" + copy + ": can't be written: " + error.message());
  std::vector<std::string> arguments = {"slicecorr",
                                        "scan",
                                        "compare",
                                        scan.file,
                                        "--stack",
                                        stack,
                                        "--json",
                                        "../comparison.json",
                                        "--html",
                                        "../comparison.html",
                                        "--scan-unit=" + given.unit};
  if (given.voxel_um > 0) arguments.push_back(fmt::format("--voxel-um={}", given.voxel_um));
  const WorkSpec spec = parse_spec(model.work_of(job.id).first);
  for (std::string& option : design_options(folder, spec, taken.notes)) {
    arguments.push_back(std::move(option));
  }
  taken.words = detail::run_beside(arguments, at + "/file").out;
  read_figures(at + "/comparison.json", scan, taken.notes);
  for (const std::string& name :
       {copy, std::string("comparison.json"), std::string("comparison.html")}) {
    slicecorr::detail::sync_file(at + "/" + name);
  }
  for (const std::string& name : {at + "/file", at, folder.root + "/scans"}) {
    slicecorr::detail::sync_folder(name);
  }
  scan.number = queue.add_scan(scan);
  made.keep();
  scan = scan_of(model, scan.job, scan.number);
  for (const PrintsOverTime& prints : prints_over_time(model)) {
    if (prints.printer != scan.printer || prints.resin != scan.resin) continue;
    taken.drift = beyond_in_words(prints);
    if (!taken.drift.empty()) queue.add_event("scan_beyond", taken.drift, scan.job);
  }
  return taken;
}

bool remove_scan(const FarmFolder& folder, Queue& queue, const KeptScan& scan,
                 const std::string& by) {
  if (!queue.remove_scan(scan.job, scan.number, by)) return false;
  std::error_code error;
  fs::remove_all(folder.scan(scan.folder), error);
  return true;
}

}  // namespace slicecorr::farm
