// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Checks requests and makes jobs of them.

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <map>
#include <set>
#include <tuple>

#include "programs/common/database_band.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/part_slices.hpp"
#include "programs/common/setup_options.hpp"
#include "service/commit.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/memory_need.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/same_light.hpp"
#include "submit/fields.hpp"
#include "submit/for_machine.hpp"
#include "submit/heights.hpp"
#include "submit/pass_over.hpp"
#include "submit/planned.hpp"
#include "submit/resolved.hpp"
#include "submit/tomographic.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using detail::Checked;
using detail::Resolved;

namespace {

/// Before the farm has measured any: cautious for parts of 10 to 100 million voxels.
constexpr double kGuessedVoxelsPerS = 60e6;
/// Where columns are corrected together, in twenty rounds.
constexpr double kTimesOfTogether = 15;
constexpr double kGuessedBytesPerVoxel = 0.02;
/// Of the design that lies beside a stack of meshes.
constexpr double kGuessedBytesOfDesign = 0.03;
constexpr double kReportBytes = 2e6;

/// All that decides what is found out, as one text.
std::string signature(const JobRequest& r) {
  std::string text = detail::work_text(r);
  // What planning adds.
  for (const double v : r.setup.slice_speed_mm_h) text += fmt::format("v{}\n", v);
  // A default may be passed over where the same is refused that the job says itself.
  for (const auto& [key, said] : r.said) {
    if (said.default_) text += "default " + key + "\n";
  }
  return text + r.setup.slice_lamps;
}

ChoiceNames names_of(const JobRequest& r) {
  return r.as_options ? ChoiceNames::options : ChoiceNames::fields;
}

/// The archive's format and ending, from what was asked for and, for archives, what they are.
void choose_format(const JobRequest& r, const std::string& input_format, WorkSpec& spec) {
  std::string wanted = r.format;
  if (wanted.starts_with(".")) wanted.erase(0, 1);
  if (spec.tomo) {
    const auto said = r.said.find("format");
    const bool meant = said == r.said.end() || !said->second.default_;
    if (meant && !wanted.empty() && wanted != "frames") {
      throw InputError(
          fmt::format("format is '{}'; a tomographic print is written as frames", r.format));
    }
    spec.format = spec.ending = "frames";
    return;
  }
  if (wanted.empty() && spec.kind == "correct") {
    // A slicer's file stays one of the same kind.
    spec.format = input_format;
    spec.ending =
        fs::path(r.parts[0]).filename().string().substr(detail::stem_of(r.parts[0]).size());
    if (!spec.ending.empty()) spec.ending.erase(0, 1);
    if (spec.ending.empty()) spec.ending = spec.format;
    StackFile file("out." + spec.ending);
    file.format = spec.format;
    format_of(file);
    return;
  }
  if (wanted.empty()) wanted = "uvj";
  for (const FormatInfo& f : archive_formats()) {
    if (f.name != wanted) continue;
    spec.format = f.name;
    spec.ending = f.endings.empty() ? f.name : f.endings.front();
    if (spec.ending.starts_with(".")) spec.ending.erase(0, 1);
    if (f.name == "folder") throw InputError("format folder: expected an archive, one file");
    return;
  }
  spec.ending = wanted;
  spec.format = format_of(StackFile("out." + wanted));
}

/// What can't be written, or moved as its file is printed, is refused before the night.
void check_format(const JobRequest& r, const Resolved& w, const std::string& input_format) {
  if (w.spec.tomo) return;
  StackFile made("out." + w.spec.ending);
  made.format = w.spec.format;
  check_lifts(made, w.setup.process, r.setup.mode == "continuous", names_of(r));
  if (w.spec.kind == "correct" && w.spec.format == input_format) return;
  check_can_be_made(made, !w.setup.process.layer_heights_um.empty());
}

std::int64_t parse_ready_by(const std::string& text, std::int64_t now_ms) {
  if (text.empty()) return kNoDeadline;
  if (const int minute = parse_minute(text); minute >= 0) return next_local_minute(now_ms, minute);
  std::tm t{};
  const char* end = strptime(text.c_str(), "%Y-%m-%d %H:%M", &t);
  if (end && *end == 0) {
    t.tm_isdst = -1;
    const std::time_t s = std::mktime(&t);
    if (s != -1) {
      const std::int64_t ms = std::int64_t{s} * 1000;
      if (ms <= now_ms) throw InputError("ready_by is '" + text + "', which is over");
      return ms;
    }
  }
  throw InputError("ready_by is '" + text + "', expected HH:MM or YYYY-MM-DD HH:MM");
}

std::string rate_class_of(const Resolved& w, int slices) {
  if (w.spec.tomo) return detail::tomo_rate_class(*w.spec.tomo, slices);
  const Process& p = w.setup.process;
  return fmt::format(
      "{} {}{}{}", w.spec.kind, p.mode == ExposureMode::layerwise ? "layerwise" : "continuous",
      p.uv.kind == UvKind::off ? "" : " uv", corrects_together(w.setup) ? " together" : "");
}

/// When it throws, what was put into the store for it goes again: nothing needs it, and the disk
/// may be full.
template <typename Action>
auto unless_it_fails(const FarmFolder& folder, Queue& queue, InputLock& lock, Action action) {
  try {
    return action();
  } catch (...) {
    lock.release();
    try {
      // Another submission at the same time keeps everything; gc removes it then.
      if (const auto alone = InputLock::alone(folder)) {
        for (const std::string& path : detail::stray_inputs(folder, queue)) {
          std::error_code error;
          fs::remove(path, error);
        }
      }
    } catch (const Error&) {
      // What counts is why it failed; gc comes later.
    }
    throw;
  }
}

/// With `fit_mm` made a scale, and PART*N so many parts.
void scale_all(std::vector<JobRequest>& requests, std::vector<SubmitError>& errors) {
  detail::for_each_sound(requests, errors, [](JobRequest& r) {
    detail::expand_copies(r);
    const std::vector<std::string>& meshes = r.part_inside.empty() ? r.parts : r.part_inside;
    if (r.fit_mm <= 0 || !std::all_of(meshes.begin(), meshes.end(), is_mesh_name)) return;
    if (r.scale != 1) {
      throw InputError(r.as_options ? "--fit-mm and --scale exclude each other"
                                    : "fit_mm and scale exclude each other");
    }
    cli::MeshOptions o;
    o.parts = meshes;
    o.units = r.units;
    o.rotate_deg = r.rotate_deg;
    o.fit_mm = r.fit_mm;
    if (r.part_inside.empty()) o.plate = r.plate;
    r.scale = o.placement().scale;
  });
}

class Preparation {
 public:
  Preparation(std::vector<JobRequest> requests, const FarmFolder& folder, Queue& queue,
              const std::string& user, const ExecutionContext& context)
      : requests_(std::move(requests)),
        folder_(folder),
        queue_(queue),
        user_(user),
        context_(context) {}

  Submission run(bool store) {
    for (JobRequest& r : requests_) {
      for (const SubmitError& e : r.wrong) refuse_at(r, e);
    }
    detail::fit_to_machines(requests_, folder_, errors_);
    // Jobs are recorded with a scale, whatever was said.
    scale_all(requests_, errors_);
    detail::plan_all(requests_, folder_.store, context_, errors_);
    resolve_all();
    detail::check_defaults(requests_, errors_);
    check_all();
    detail::check_outputs(requests_, resolved_, queue_, errors_);
    if (!errors_.empty()) {
      // In the order of the requests, whatever was found out first.
      std::stable_sort(errors_.begin(), errors_.end(),
                       [](const auto& a, const auto& b) { return a.request < b.request; });
      throw SubmitErrors(std::move(errors_));
    }
    tell_passed_over();
    if (!store) {
      for (const std::string& part : parts()) {
        context_.check_cancelled();
        const ResultFile f = sha256_of_file(part);
        stored_[part] = {f.sha256 + stored_ending(part), f.sha256, f.bytes};
      }
      return make_jobs();
    }
    const auto lock = std::make_shared<InputLock>(InputLock::shared(folder_));
    return unless_it_fails(folder_, queue_, *lock, [&] {
      for (const std::string& part : parts()) {
        context_.check_cancelled();
        stored_[part] = store_input(folder_, part);
      }
      Submission submission = make_jobs();
      for (const auto& [part, in] : stored_) submission.inputs.push_back({in.file, in.bytes});
      submission.lock = lock;
      return submission;
    });
  }

 private:
  void refuse(const JobRequest& r, const std::string& message, Reason reason = Reason::bad_input) {
    refuse_at(r, {r.where, message, reason});
  }
  void refuse_at(const JobRequest& r, SubmitError error) {
    error.request = &r - requests_.data();
    errors_.push_back(std::move(error));
  }

  void resolve_all() {
    std::map<std::string, std::size_t> known;  // signature to the first request that has it
    resolved_.resize(requests_.size());
    const std::int64_t now = system_clock().wall_ms();
    detail::for_each_sound(requests_, errors_, [&](JobRequest& r) {
      context_.check_cancelled();
      const auto i = static_cast<std::size_t>(&r - requests_.data());
      Resolved& w = resolved_[i];
      if (r.parts.empty()) {
        throw InputError("no part; expected a mesh, an archive of slices or a volume");
      }
      if (!check_fields(r)) return;
      const auto [found, first] = known.emplace(signature(r), i);
      // What was refused may have been so for what these two do not share; else it is told of both.
      const bool fresh = first || resolved_[found->second].setup_json.empty();
      if (fresh) {
        found->second = i;
      } else {
        w = resolved_[found->second];
        for (const auto& [key, why] : requests_[found->second].passed_over) {
          detail::pass_over(r, key, why.message);
        }
      }
      try {
        if (fresh) {
          resolve(r, w);
          if (!w.spec.tomo) w.spec.warnings = cli::unmeasured_in_words(r.setup, w.setup);
          tell_definitions(w);
        }
        w.ready_by_ms = parse_ready_by(r.ready_by, now);
        choose_format(r, input_format_[r.parts[0]], w.spec);
        check_format(r, w, input_format_[r.parts[0]]);
      } catch (const Error&) {
        w.setup_json.clear();
        throw;
      }
      if (fresh) {
        w.checked = distinct_.size();
        distinct_.push_back(i);
      }
    });
  }

  /// Words of their files that nothing reads, that a resin is of another wavelength, or its seconds of
  /// another display's light: once for each pair of resin and printer.
  void tell_definitions(const Resolved& w) {
    const Setup& setup = w.setup;
    std::vector<std::string> told = setup.printer.unread.sentences;
    const auto& of_resin = setup.resin.unread.sentences;
    told.insert(told.end(), of_resin.begin(), of_resin.end());
    told.push_back(other_wavelength_in_words(setup.printer, setup.resin,
                                             setup.process.uv.kind != UvKind::off));
    told.push_back(other_display_in_words(setup.printer, setup.resin));
    told.push_back(assumption_in_words(setup.printer, setup.resin, setup.process));
    told.insert(told.end(), w.spec.warnings.begin(), w.spec.warnings.end());
    for (const std::string& words : told) {
      if (!words.empty() && told_.insert(words).second) context_.tell(words);
    }
  }

  /// Refuses what was said for another kind of job, where it stands.
  bool check_fields(const JobRequest& r) {
    const detail::JobKind kind = detail::kind_of(r);
    std::vector<SubmitError> wrong;
    for (const auto& [key, said] : r.said) {
      if (said.default_) continue;
      std::string name = key;
      if (r.as_options) {
        if (key == detail::kLayerHeights) name = "layers";
        std::replace(name.begin(), name.end(), '_', '-');
        name.insert(0, "--");
      }
      const std::string error = detail::misfit(key, name, kind);
      if (!error.empty()) wrong.push_back({said.where, error});
    }
    // In the order of their lines.
    std::sort(wrong.begin(), wrong.end(), [](const SubmitError& a, const SubmitError& b) {
      return std::pair(a.where.size(), a.where) < std::pair(b.where.size(), b.where);
    });
    for (const SubmitError& error : wrong) refuse_at(r, error);
    return wrong.empty();
  }

  /// Once for each default, however many jobs it was left out of.
  void tell_passed_over() {
    std::map<std::string, int> told;
    for (const JobRequest& r : requests_) {
      for (const auto& [key, left_out] : r.passed_over) {
        ++told[fmt::format("{}: the default {} is passed over where it has no place ({})",
                           left_out.where, key, left_out.message)];
      }
    }
    for (const auto& [words, jobs] : told) {
      context_.tell(fmt::format("{}: {} of {} jobs", words, jobs, requests_.size()));
    }
  }

  void resolve(JobRequest& r, Resolved& w) {
    const auto meshes =
        static_cast<std::size_t>(std::count_if(r.parts.begin(), r.parts.end(), is_mesh_name));
    w.mesh = meshes == r.parts.size();
    const detail::JobKind kind = detail::kind_of(r);
    if (!detail::is_tomographic(kind)) {
      if (!w.mesh && r.parts.size() > 1) {
        throw InputError(meshes > 0 ? "meshes and archives can't share a plate"
                                    : "one archive of slices makes a job of its own");
      }
      if (!w.mesh && detail::is_volume(r.parts[0])) {
        throw InputError(
            r.parts[0], "",
            fmt::format("is a volume; expected mode {} with it", detail::kTomographyMode));
      }
    } else if (kind == detail::JobKind::tomographic_volume ? r.parts.size() > 1 : !w.mesh) {
      throw InputError("expected meshes, or one volume (.npy), to print tomographically");
    }
    for (const std::string& part : detail::inputs_of(r)) {
      std::error_code error;
      if (!fs::exists(part, error)) throw InputError(part, "", "is not there");
      if (fs::is_directory(part, error)) {
        throw InputError(part, "", "is a folder; expected a file (zip the images)");
      }
    }
    if (detail::is_tomographic(kind)) {
      std::tie(w.setup.printer, w.setup.resin) = detail::resolve_tomographic(r, w.spec);
      w.setup_json = definitions_json(w.setup.printer, w.setup.resin);
      w.setup_hash = sha256_of_text(w.setup_json);
      return;
    }
    w.spec.kind = w.mesh ? "run" : "correct";
    w.spec.left_alone = static_cast<int>(r.leave_alone.size());
    w.spec.inside = static_cast<int>(r.part_inside.size());
    if (w.mesh && w.spec.inside > 0) {
      throw InputError(fmt::format("{} is for archives; expected one of slices with it",
                                   r.as_options ? "--part-inside" : "part_inside"));
    }
    for (const std::string& part : r.part_inside) {
      if (!is_mesh_name(part)) throw InputError(part, "", "is no mesh; expected one");
    }
    w.spec.layer_um = r.layer_um;
    const detail::HeightsBy heights = detail::check_heights(r, w.mesh);
    if (w.mesh) {
      w.spec.antialias = r.antialias;
      w.spec.units = r.units;
      w.spec.scale = r.scale;
      w.spec.center_mm = r.center_mm;
      w.spec.rotate_deg = r.rotate_deg;
      w.spec.plate = r.plate;
      SetupChoices chosen = r.setup;
      chosen.layer_um = r.layer_um;
      if (heights != detail::HeightsBy::each) chosen.layer_heights_um.clear();
      if (heights == detail::HeightsBy::slopes) {
        cli::MeshOptions mesh = detail::mesh_options_of(r);
        if (!chosen.resin_toml.empty()) {
          mesh.shrinkage = parse_resin(chosen.resin_toml, "resin_toml").shrinkage;
        } else if (!chosen.resin.empty()) {
          mesh.shrinkage = load_resin(chosen.resin).shrinkage;
        }
        chosen.layer_heights_um = cli::adaptive_heights_of(mesh, r.leave_alone, r.adaptive_um).um();
      }
      const std::vector<double> heights_um = chosen.layer_heights_um;
      w.setup = detail::resolve_passing_over(r, [&](const JobRequest& one) {
        chosen = one.setup;
        chosen.layer_um = one.layer_um;
        chosen.layer_heights_um = heights_um;
        return resolve_setup(chosen, one.like.get(), one.like.get(), names_of(one));
      });
    } else {
      const StackInfo info = StackReader::read_info(r.parts[0]);
      check_design(info, r.parts[0]);
      input_format_[r.parts[0]] = info.format;
      if (w.spec.inside > 0) {
        w.spec.units = r.units;
        w.spec.scale = r.scale;
        w.spec.rotate_deg = r.rotate_deg;
      }
      w.setup = detail::resolve_passing_over(r, [&](const JobRequest& one) {
        SetupChoices chosen = one.setup;
        chosen.layer_heights_um.clear();  // a default for meshes
        return resolve_setup(chosen, one.like.get(), one.like ? one.like.get() : &info,
                             names_of(one));
      });
    }
    if (r.robust && r.uncertain.empty()) {
      throw InputError(fmt::format(
          "{} needs to know by how much inputs may be off; expected {}, as "
          "in ha=5%,dc=5%",
          r.as_options ? "--robust" : "robust", r.as_options ? "--uncertain" : "uncertain"));
    }
    if (r.uncertain.empty() && w.setup.uncertainty) w.spec.uncertain = kAssumedUncertainty;
    if (!r.uncertain.empty()) {
      w.setup.uncertainty = chosen_uncertainty(r.uncertain, w.setup, r.setup, names_of(r));
      w.setup.uncertainty->robust = w.spec.robust = r.robust;
      w.spec.uncertain = r.uncertain;
      if (w.setup.uncertainty->from_fit) {
        w.spec.uncertain_resin_toml = read_text_file(find_definition(r.setup.resin, "resin"));
      }
    }
    w.setup_json = setup_json(w.setup);
    w.setup_hash = sha256_of_text(w.setup_json);
  }

  void check_all() {
    checked_.resize(distinct_.size());
    // Parts are read side by side; each alone would leave most cores idle.
    ExecutionContext one;
    one.threads = 1;
    one.cancel = context_.cancel;
    parallel_for(context_, "checking parts", distinct_.size(), [&](std::size_t n) {
      const std::size_t i = distinct_[n];
      checked_[n] = detail::check_inputs(requests_[i], resolved_[i], folder_.store, one);
    });
    for (std::size_t i = 0; i < requests_.size(); ++i) {
      if (resolved_[i].setup_json.empty()) continue;
      const Checked& c = checked_[resolved_[i].checked];
      if (!c.error.empty()) refuse(requests_[i], c.error, c.reason);
    }
  }

  /// Each once, in order.
  std::vector<std::string> parts() const {
    std::vector<std::string> list;
    std::set<std::string> seen;
    for (const JobRequest& r : requests_) {
      for (const std::string& part : detail::inputs_of(r)) {
        if (seen.insert(part).second) list.push_back(part);
      }
    }
    return list;
  }

  Submission make_jobs() {
    Submission submission;
    std::map<std::string, Rates> rates;
    std::set<std::string> keys;
    for (std::size_t i = 0; i < requests_.size(); ++i) {
      const JobRequest& r = requests_[i];
      const Resolved& w = resolved_[i];
      const Checked& c = checked_[w.checked];
      NewJob j;
      WorkSpec spec = w.spec;
      for (const std::string& part : detail::inputs_of(r)) {
        const StoredInput& in = stored_.at(part);
        spec.inputs.push_back({in.file, in.sha256, part});
        j.work.input_files.push_back(in.file);
      }
      j.work.setup_json = w.setup_json;
      j.work.setup_hash = w.setup_hash;
      j.work.kind = spec.kind;
      j.work.printer = w.setup.printer.name;
      j.work.resin = w.setup.resin.name;
      j.work.format = spec.ending;
      j.work.rate_class = rate_class_of(w, c.layers);
      j.work.layers = c.layers;
      j.work.voxels = w.spec.tomo ? c.tomo.voxels : c.memory.voxels;
      if (spec.tomo) {
        spec.tomo->angles = c.tomo.angles;
        j.work.voxel_angle_steps = c.tomo.voxel_angle_steps;
      }
      const MemoryNeeds memory = spec.tomo ? c.tomo.memory : memory_needs(c.memory);
      j.work.base_memory_mb = memory.base_mb;
      j.work.thread_memory_mb = memory.thread_mb;
      const auto [rate, fresh] = rates.emplace(j.work.rate_class, Rates{});
      if (fresh) rate->second = queue_.rates(j.work.rate_class);
      const bool measured = rate->second.units_per_s > 0;
      const auto units = static_cast<double>(spec.tomo ? c.tomo.voxel_angle_steps : j.work.voxels);
      const double guessed = spec.tomo           ? detail::guessed_units_per_s(c.layers)
                             : c.memory.together ? kGuessedVoxelsPerS / kTimesOfTogether
                                                 : kGuessedVoxelsPerS;
      j.expected_s = kFixedJobS + units / (measured ? rate->second.units_per_s : guessed);
      const double guessed_bytes = kGuessedBytesPerVoxel + (w.mesh ? kGuessedBytesOfDesign : 0);
      const double bytes = spec.tomo  ? static_cast<double>(c.tomo.bytes)
                           : measured ? units * rate->second.bytes_per_unit
                                      : units * guessed_bytes + kReportBytes;
      // The cache's copy and the delivered one.
      j.expected_bytes = static_cast<std::int64_t>(2 * bytes);
      j.user = r.user.empty() ? user_ : r.user;
      j.output_folder = r.out;
      j.results_folder = folder_.root + "/results/";
      j.parts = r.parts;
      j.labels = r.labels;
      j.priority = r.priority;
      j.ready_by_ms = w.ready_by_ms;
      for (int copy = 1; copy <= r.copies; ++copy) {
        j.name = detail::name_of_copy(r, copy);
        // Some formats write the file's name into the archive.
        spec.name = spec.format == "uvj" || spec.tomo ? "" : j.name;
        if (copy == 1 || !spec.name.empty()) {
          j.work.key = work_key(spec, w.setup_json);
          j.work.spec_json = spec_json(spec);
        }
        Estimate e;
        e.name = j.name;
        e.where = r.where;
        e.layers = c.layers;
        e.voxels = j.work.voxels;
        e.seconds = j.expected_s;
        e.planned = r.planned;
        e.disk_bytes = j.expected_bytes;
        e.memory_mb = j.work.base_memory_mb;
        e.measured = measured;
        e.duplicate = !keys.insert(j.work.key).second;
        e.cached = queue_.cached(j.work.key).has_value();
        submission.estimates.push_back(std::move(e));
        submission.jobs.push_back(j);
      }
    }
    return submission;
  }

  std::vector<JobRequest> requests_;
  const FarmFolder& folder_;
  Queue& queue_;
  const std::string& user_;
  const ExecutionContext& context_;
  std::vector<SubmitError> errors_;
  std::vector<Resolved> resolved_;
  std::vector<std::size_t> distinct_;  ///< requests whose inputs are looked at
  std::vector<Checked> checked_;       ///< of these
  std::set<std::string> told_;
  std::map<std::string, std::string> input_format_;
  std::map<std::string, StoredInput> stored_;
};

}  // namespace

Submission prepare(const std::vector<JobRequest>& requests, const FarmFolder& folder, Queue& queue,
                   const std::string& user, bool store, const ExecutionContext& context) {
  return Preparation(requests, folder, queue, user, context).run(store);
}

Submitted submit(const Submission& submission, const FarmFolder& folder, Queue& queue,
                 const std::string& user, const std::string& source) {
  Submitted result;
  const auto queue_all = [&] {
    return queue.submit(submission.jobs, user, source, submission.inputs);
  };
  result.ids =
      submission.lock ? unless_it_fails(folder, queue, *submission.lock, queue_all) : queue_all();
  std::set<std::string> cached;
  for (std::size_t i = 0; i < submission.jobs.size(); ++i) {
    if (submission.estimates[i].cached) cached.insert(submission.jobs[i].work.key);
  }
  for (const std::string& key : cached) {
    result.done_from_cache += serve_from_cache(folder, queue, "submit", key);
  }
  return result;
}

}  // namespace slicecorr::farm
