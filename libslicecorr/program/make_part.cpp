#include "program/make_part.hpp"

#include <nlohmann/json.hpp>

#include "program/program.hpp"
#include "slicecorr/report.hpp"

namespace slicecorr::cli {

Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title, const Job& job,
                     const std::function<void()>& corrected) {
  Correction result = correct_stack(target, setup, file, true, job);
  if (corrected) corrected();
  setup.process = *result.info.process;
  auto proof = nlohmann::ordered_json::parse(result.after.to_json());
  proof["uncorrected"] = nlohmann::ordered_json::parse(result.before->to_json());
  write_text_file(base + ".json", proof.dump(2) + "\n");
  const CorrectedSlices shown(target, setup);
  write_text_file(base + ".html",
                  make_report(gather_report(shown, target, setup, result.info, result.after,
                                            result.before, title, job)));
  return result;
}

}  // namespace slicecorr::cli
