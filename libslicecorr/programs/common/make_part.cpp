// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/make_part.hpp"

#include <unistd.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "programs/common/figures.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/report.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::cli {

FittedSlices fit_for_output(const SliceSource& slices, const StackFile& file,
                            const Printer& printer, const ExecutionContext& context) {
  static const Printer unturned;
  const std::string format = format_of(file);
  const bool ours = format == "uvj" || format == "folder";
  return FittedSlices::for_display(slices, ours ? unturned : printer, folder_of(file.path),
                                   context);
}

namespace {

std::string beside(const std::string& stack, const char* what) {
  const std::filesystem::path path(stack);
  return (path.parent_path() / (path.stem().string() + what)).string();
}

}  // namespace

std::string target_beside(const std::string& stack) { return beside(stack, kTargetEnding); }

std::string left_alone_beside(const std::string& stack) { return beside(stack, kLeftAloneEnding); }

void leave_beside(const SliceSource& slices, const LayerHeights& heights, const std::string& path,
                  const ExecutionContext& context) {
  const StackFile file(path);
  heights.alike() ? write_target(slices, file, context)
                  : write_target(slices, heights, file, context);
}

void leave_left_alone(const PartSlices& parts, const std::vector<std::string>& meshes,
                      const Printer& printer, const LayerHeights& heights, const std::string& path,
                      const ExecutionContext& context) {
  ExecutionContext told = context;  // what is told of these files was told when they were corrected
  told.notice = nullptr;
  const LeftAloneFiles on_plate(*parts, meshes, parts.place(), printer, folder_of(path), told);
  leave_beside(*(*on_plate).left_alone(), heights, path, context);
}

Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title,
                     const ExecutionContext& context, const std::function<void()>& corrected) {
  const std::string proof_path = base + ".json", page_path = base + ".html";
  std::optional<PendingFile> proof, page;
  const Correction* result = nullptr;
  CorrectionAsk ask;
  ask.before = true;
  ask.volume_cells = kReportCells;
  ask.before_writing = [&](const Correction& made) {
    result = &made;
    if (corrected) corrected();
  };
  // All three are whole before the first of them takes its name, and the old page goes before the
  // old stack: whenever this is killed, no page is of another stack.
  StackFile stack = file;
  stack.before_renaming = [&] {
    setup.process = *result->info.process;
    setup.printer = *result->info.printer;  // with as many levels as the file has
    // The proof: the prediction of the stack, with that of the uncorrected part beside it.
    auto figures = slicecorr::detail::own_json<nlohmann::ordered_json>(figures_json(result->after));
    const PrintTime time = print_time(result->info);
    figures["light_s"] = time.light_s;
    figures["print_time_s"] =
        time.all_s() ? nlohmann::ordered_json(*time.all_s()) : nlohmann::ordered_json();
    if (const Shrinkage& s = setup.resin.shrinkage; s.any()) {
      figures["made_for"] = slicecorr::detail::own_json<nlohmann::ordered_json>(s.to_json());
    }
    figures["uncorrected"] =
        slicecorr::detail::own_json<nlohmann::ordered_json>(result->before->to_json());
    proof.emplace(proof_path, figures.dump(2) + "\n");
    std::shared_ptr<const SliceSource> shown = result->slices;
    if (!shown) shown = std::make_shared<const CorrectedSlices>(target, setup, context);
    page.emplace(page_path,
                 make_report(gather_report(*shown, target, setup, result->info, result->after,
                                           result->before, title, context, result->volume),
                             context));
    context.check_cancelled();
    ::unlink(page_path.c_str());
    ::unlink(proof_path.c_str());
  };
  Correction done = correct_stack(target, setup, stack, ask, context);
  proof->publish();
  page->publish();
  return done;
}

}  // namespace slicecorr::cli
