#include "program/make_part.hpp"

#include <nlohmann/json.hpp>

#include "program/program.hpp"
#include "slicecorr/report.hpp"

namespace slicecorr::cli {

FittedSlices fit_for_output(const SliceSource& slices, const StackFile& file,
                            const Printer& printer, const Job& job) {
  static const Printer unturned;
  const std::string format = format_of(file);
  const bool ours = format == "uvj" || format == "folder";
  return FittedSlices::for_display(slices, ours ? unturned : printer, folder_of(file.path), job);
}

Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title, const Job& job,
                     const std::function<void()>& corrected) {
  Correction result =
      correct_stack(target, setup, file, {.before = true, .volume_cells = kReportCells}, job);
  if (corrected) corrected();
  setup.process = *result.info.process;
  // The proof: the prediction of the stack, with that of the uncorrected part beside it.
  auto proof = nlohmann::ordered_json::parse(result.after.to_json());
  proof["uncorrected"] = nlohmann::ordered_json::parse(result.before->to_json());
  write_text_file(base + ".json", proof.dump(2) + "\n");
  const CorrectedSlices shown(target, setup, job);
  write_text_file(base + ".html",
                  make_report(gather_report(shown, target, setup, result.info, result.after,
                                            result.before, title, job, result.volume),
                              job));
  return result;
}

}  // namespace slicecorr::cli
