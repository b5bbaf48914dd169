// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/correct_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "post/beside.hpp"
#include "post/files.hpp"
#include "programs/common/database_band.hpp"
#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/even_greys.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/report.hpp"
#include "support/files/sha256.hpp"
#include "support/files/temporary.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

/// Symbolic links stay: what they lead to is changed, but for those that a watcher finds.
std::string real_path(const std::string& path, const PostRequest& request) {
  std::error_code ec;
  const fs::path real = fs::canonical(path, ec);
  if (!ec && request.watched && real != fs::path(path)) {
    throw InputError(
        path, "",
        "is a link; what lies in a watched folder itself is corrected, not what links lead to");
  }
  if (ec || !fs::is_regular_file(real, ec)) {
    throw InputError(path, "",
                     fs::is_directory(path, ec)
                         ? "is a folder; expected an archive of slices, or --watch"
                         : "is not a file that can be read");
  }
  return real.string();
}

/// The name that the file has for the user: that of the export, where a slicer hands us a copy.
std::string name_for_user(const std::string& real, const PostRequest& request) {
  return request.slicer.output_name.empty() ? real : request.slicer.output_name;
}

std::string backup_of(const std::string& real, const PostRequest& request) {
  return name_for_user(real, request) + ".orig";
}

/// What the library says of a setup does not tell of which file.
template <typename Body>
auto naming(const std::string& path, const Body& body) {
  const auto named = [&](const std::string& what) {
    const std::string text = WorkFolder::without(what);
    return text.find(path) != std::string::npos ? text : path + ": " + text;
  };
  try {
    return body();
  } catch (const AlreadyCorrected&) {
    throw;
  } catch (const NotReadable&) {
    throw;
  } catch (const InUse&) {
    throw;
  } catch (const InputError& e) {
    throw InputError(named(e.what()));
  } catch (const InfeasibleError& e) {
    throw InfeasibleError(named(e.what()));
  } catch (const DeviceError& e) {
    // Work folders have names of their own, which nobody knows.
    const std::string text = e.what();
    throw DeviceError(WorkFolder::is_named_in(text) ? path + text.substr(text.find(": ")) : text);
  }
}

Lock lock_of(const std::string& path) {
  auto lock = Lock::try_take(path);
  if (!lock) throw InUse(path, "", "is being corrected by another slicecorr-post");
  return std::move(*lock);
}

/// Whether `backup` is what `corrected` was made from.
void check_belongs(const StackInfo& corrected, const std::string& path, const std::string& backup,
                   const ExecutionContext& context) {
  const auto fail = [&](const std::string& why) {
    throw InputError(backup, "", fmt::format("is not what {} was made from: {}", path, why));
  };
  std::error_code ec;
  if (!fs::is_regular_file(backup, ec)) {
    throw InputError(backup, "", fmt::format("is not there; no backup of {} was kept", path));
  }
  const StackInfo info = StackReader::read_info(backup);
  if (info.kind == StackKind::corrected) fail("it is corrected itself");
  const Grid &g = info.grid, &c = corrected.grid;
  if (info.format != corrected.format || g.width_px != c.width_px || g.height_px != c.height_px ||
      g.layers != corrected.target_layers) {
    fail(fmt::format("it is {} with {} slices of {} x {} pixels; expected {} with {} of {} x {}",
                     info.format, g.layers, g.width_px, g.height_px, corrected.format,
                     corrected.target_layers, c.width_px, c.height_px));
  }
  if (!corrected.original_sha256.empty()) {
    const std::string sha256 = cli::sha256_of_contents(backup);
    if (sha256 != corrected.original_sha256) {
      fail(fmt::format("its SHA-256 is {}; expected {}", sha256, corrected.original_sha256));
    }
    return;
  }
  // Corrected by a program that noted none: format, sizes and the sum of all pixels must do.
  MissingFacts facts{c.pixel_x_um, c.pixel_y_um, c.layer_um};
  if (corrected.printer && !(facts.pixel_x_um > 0)) {
    facts.pixel_x_um = corrected.printer->pixel_x_um;
    facts.pixel_y_um = corrected.printer->pixel_y_um;
  }
  const StackReader images(backup, cli::folder_of(backup), context, facts);
  const Grid& grid = images.grid();
  const double volume_mm3 = static_cast<double>(images.pixel_sum()) / 255.0 * grid.pixel_x_um *
                            grid.pixel_y_um * grid.layer_um * 1e-9;
  // A product of the same numbers: it differs by rounding only, while one grey level of one pixel
  // is 1e-12 of even a trillion.
  if (std::abs(volume_mm3 - corrected.part_volume_mm3) > 1e-14 * corrected.part_volume_mm3) {
    fail(fmt::format("its slices hold {:.9g} mm³; expected {:.9g}", volume_mm3,
                     corrected.part_volume_mm3));
  }
}

/// Refuses before the work what would be refused after it.
void check_backup(const std::string& real, const std::string& backup, const std::string& how) {
  std::error_code ec;
  if (!fs::exists(fs::symlink_status(backup, ec)) || how == "replace") return;
  if (same_contents(real, backup)) return;
  throw InputError(backup, "",
                   fmt::format("is there already and is another file than {}; expected it to be "
                               "moved away, or --backup=replace",
                               real));
}

void keep_backup(const std::string& real, const std::string& backup, const std::string& how,
                 const std::string& scratch) {
  std::error_code ec;
  if (fs::exists(fs::symlink_status(backup, ec)) && same_contents(real, backup)) return;
  // A folder of the slicer's export may be another than that of the copy we are given.
  std::optional<WorkFolder> beside;
  const std::string folder = detail::path_parts(backup).folder;
  if (!fs::equivalent(folder, detail::path_parts(real).folder, ec)) beside.emplace(folder);
  keep_copy(real, backup, how == "replace", beside ? beside->path() : scratch);
}

/// Also for the program that is killed: what was in work is found again.
void note_work(const WorkFolder& work, const std::string& real) {
  std::ofstream(fs::path(work.path()) / detail::kInWork, std::ios::binary)
      << fs::path(real).filename().string() << '\0';
}

/// Reports are made in the work folder, and put in place before the archive: that is the last step.
class Reports {
 public:
  Reports(const WorkFolder& work, std::string name, std::string kinds)
      : work_(work), name_(std::move(name)), kinds_(std::move(kinds)) {}

  void make(const SliceSource& target, const PostOutcome& outcome,
            const ExecutionContext& context) const {
    if (wants("html")) {
      const Correction& c = outcome.correction;
      Setup setup = outcome.setup;
      setup.process = *c.info.process;
      setup.printer = *c.info.printer;  // with as many levels as the file has
      std::shared_ptr<const SliceSource> corrected = c.slices;
      if (!corrected) corrected = std::make_shared<const CorrectedSlices>(target, setup);
      cli::write_text_file(
          work_.path() + "/html",
          make_report(gather_report(*corrected, target, setup, c.info, c.after, c.before,
                                    fs::path(name_).stem().string(), context, c.volume),
                      context));
    }
    if (wants("json")) cli::write_text_file(work_.path() + "/json", figures_json(outcome));
  }
  void publish(std::vector<std::string>& written) const {
    for (const char* kind : {"html", "json"}) {
      if (!wants(kind)) continue;
      const std::string path = fmt::format("{}.{}", name_, kind);
      rename_file(work_.path() + "/" + kind, path);
      written.push_back(path);
    }
  }
  bool wants(const std::string& kind) const { return kinds_ == kind || kinds_ == "both"; }

 private:
  const WorkFolder& work_;
  std::string name_, kinds_;
};

/// The archive that is to be corrected: the file, or its backup with --again.
std::string source_of(const std::string& real, const PostRequest& request,
                      const ExecutionContext& context) {
  if (!request.again) return real;
  const StackInfo info = read_archive(real);
  if (info.kind != StackKind::corrected) return real;
  std::string backup = backup_of(real, request);
  check_belongs(info, real, backup, context);
  return backup;
}

}  // namespace

std::string figures_json(const PostOutcome& outcome) {
  auto figures =
      slicecorr::detail::own_json<nlohmann::ordered_json>(outcome.correction.after.to_json());
  if (outcome.correction.before) {
    figures["uncorrected"] =
        slicecorr::detail::own_json<nlohmann::ordered_json>(outcome.correction.before->to_json());
  }
  return figures.dump(2) + "\n";
}

Decision preview(const std::string& path, const PostRequest& request) {
  const std::string real = real_path(path, request);
  return naming(path, [&] {
    return decide(source_of(real, request, {}), name_for_user(real, request), request);
  });
}

PostOutcome correct_file(const std::string& path, const PostRequest& request,
                         const ExecutionContext& given) {
  // The archive is made in a work folder; who reads of it knows the file.
  ExecutionContext context = given;
  if (given.notice) {
    context.notice = [&given](const std::string& text) { given.notice(WorkFolder::without(text)); };
  }
  const std::string real = real_path(path, request);
  // Not where scratch may lie instead: what can't be put in place is not begun.
  const std::string folder = detail::path_parts(real).folder;
  return naming(path, [&] {
    const Lock lock = lock_of(real);
    const auto seen = identity_of(real);
    WorkFolder::remove_stale(folder, detail::path_parts(real).file);
    const std::string source = source_of(real, request, context);
    const Decision decision = decide(source, name_for_user(real, request), request);
    PostOutcome outcome;
    outcome.rule = decision.rule;
    if (decision.settings.leave_alone) {
      outcome.left_alone = true;
      return outcome;
    }
    // What is to be replaced at the end must be open to it.
    detail::check_may_replace(real);
    const std::string name = name_for_user(real, request);
    for (const char* kind : {"html", "json"}) {
      if (decision.settings.report == kind || decision.settings.report == "both") {
        detail::check_may_replace(fmt::format("{}.{}", name, kind));
      }
    }
    const bool keep = !decision.settings.backup.empty() && source == real;
    const std::string backup = backup_of(real, request);
    if (keep) check_backup(real, backup, decision.settings.backup);
    cli::tell_notices(decision.setup, &decision.info, context);
    for (const std::string& words :
         cli::unmeasured_in_words(decision.settings.setup, decision.setup)) {
      context.tell(words);
    }

    const WorkFolder work(folder);
    note_work(work, real);
    const std::string made = work.path() + "/" + fs::path(real).filename().string();
    const StackReader slices(source, work.path(), context, decision.missing);
    tell_even_greys(slices, decision.info.kind, context);
    const LeftAloneFiles supported(slices, {}, {}, decision.setup.printer, work.path(), context,
                                   request.parts);
    const SliceSource& target = *supported;
    StackFile file(made);
    file.format = outcome.format = decision.info.format;
    file.keep_from = source;
    file.original_sha256 = cli::sha256_of_contents(source);
    outcome.setup = decision.setup;
    const Reports reports(work, name_for_user(real, request), decision.settings.report);
    outcome.correction = cli::with_dose_words(decision.setup, [&] {
      return correct_stack(
          target, decision.setup, file,
          {.before = true, .volume_cells = reports.wants("html") ? kReportCells : 0}, context);
    });
    reports.make(target, outcome, context);
    detail::copy_mode(real, made);

    context.check_cancelled();
    if (identity_of(real) != seen) {
      throw InUse(path, "", "was changed while it was being corrected; it is left as it is");
    }
    if (keep) {
      keep_backup(real, backup, decision.settings.backup, work.path());
      outcome.written.push_back(backup);
    }
    reports.publish(outcome.written);
    outcome.identity = identity_of(made).value();
    rename_with_record(made, real);
    outcome.removed = remove_beside(name, outcome.written);
    detail::sync_folder(folder);
    return outcome;
  });
}

std::vector<std::string> undo(const std::string& path, const PostRequest& request,
                              const ExecutionContext& context) {
  const std::string real = real_path(path, request);
  return naming(path, [&] {
    const Lock lock = lock_of(real);
    const StackInfo info = read_archive(real);
    if (info.kind != StackKind::corrected) {
      throw InputError(path, "", "is not corrected: there is nothing to undo");
    }
    const std::string backup = backup_of(real, request);
    check_belongs(info, real, backup, context);
    rename_with_record(backup, real);
    std::vector<std::string> removed = remove_beside(name_for_user(real, request), {});
    detail::sync_folder(detail::path_parts(real).folder);
    return removed;
  });
}

}  // namespace slicecorr::post
