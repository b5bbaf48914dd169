// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// slicecorr-tuning.so (tuning_call.hpp).

#include <array>
#include <memory>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tuning_call.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"
#include "support/process/failure.hpp"

namespace slicecorr::resins {

namespace {

using Json = nlohmann::ordered_json;

ExecutionContext context_of(const TuningCall& call, const Json& request) {
  ExecutionContext context;
  context.threads = request.value("threads", 0);
  context.cancel = call.cancel;
  context.progress = [&call](std::string_view stage, double fraction) {
    if (call.progress) call.progress(call.user, std::string(stage).c_str(), fraction);
  };
  context.notice = [&call](const std::string& text) {
    if (call.notice) call.notice(call.user, text.c_str());
  };
  return context;
}

/// A definition that is tuned: its text, and where that stands.
struct Definition {
  std::string text, source;
};
Definition definition_of(const Json& request, const std::string& kind) {
  if (const std::string text = request.value(kind + "_toml", ""); !text.empty()) {
    return {text, kind + "_toml"};
  }
  const std::string name = request.value(kind, "");
  if (name.empty()) throw InputError(kind + " is missing; expected the one that was believed");
  const std::string path = find_definition(name, kind);
  return {read_text_file(path), path};
}

Json findings_json(const std::vector<ScanFinding>& findings) {
  // In the order of `ScanInput`.
  constexpr auto names = std::to_array<const char*>(
      {"absorbance_height_ln", "light_over_dose_ln", "stray_light_mw_cm2", "lift_exchange",
       "shrinkage_plane", "shrinkage_z", "walls_mm", "first_layers_mm", "spread_um",
       "scatter_um2_per_um", "uv_beta_ln"});
  static_assert(names.size() == kScanInputs);
  Json json = Json::object();
  for (std::size_t i = 0; i < findings.size() && i < kScanInputs; ++i) {
    const ScanFinding& f = findings[i];
    json[names[i]] = {
        {"change", f.value}, {"sd", f.sd}, {"sd_before", f.sd_before}, {"told", f.told()}};
  }
  return json;
}

Json unexplained_json(const std::vector<Unexplained>& places) {
  Json json = Json::array();
  for (const Unexplained& u : places) {
    json.push_back({{"place_mm", u.place}, {"mean_um", u.mean_um}, {"points", u.points}});
  }
  return json;
}

std::string answer_to(const TuningCall& call) {
  const auto request = slicecorr::detail::own_json<Json>(call.request);
  const ExecutionContext context = context_of(call, request);
  const Definition resin_file = definition_of(request, "resin"),
                   printer_file = definition_of(request, "printer");
  const bool text_alone = request.contains("printer_toml");
  Printer printer = text_alone ? parse_printer(printer_file.text, printer_file.source)
                               : load_printer(printer_file.source);
  refuse_relative(printer, "what is known of stray light before tuning");
  const Resin resin = parse_resin(resin_file.text, resin_file.source);
  const std::string path = request.at("stack");
  const StackReader stack(path, request.value("scratch", "."), context);
  if (stack.info().kind != StackKind::corrected || !stack.info().process) {
    throw InputError(path, "", "is no corrected stack; expected the one that was printed");
  }
  Setup setup = resolve_setup(SetupChoices{}, &stack.info(), &stack.info(), ChoiceNames::fields);
  setup.printer = printer;
  setup.resin = resin;
  const std::unique_ptr<const SliceSource> exposures = stack.exposures(resin.m);
  const SliceSource& shown = exposures ? *exposures : static_cast<const SliceSource&>(stack);
  ExecutionContext untold = context;
  untold.notice = nullptr;  // of how finely it is taken: it gives a unit alone
  constexpr double triangles = 2e5;
  const TriangleMesh surface = predicted_surface(
      shown, {printer, resin, setup.process, stack.grid(), stack.frame()}, triangles, untold);
  const ScanReading reading{request.value("unit", "auto"), request.value("voxel_um", 0.0)};
  std::vector<Scan> scans;
  for (const std::string& scan : request.at("scans").get<std::vector<std::string>>()) {
    scans.push_back(read_scan(scan, surface, reading, context));
  }
  const std::vector<std::string> counted =
      marks_to_count(scans, resin_file.text, resin_file.source);
  std::vector<PrintScan> prints;
  prints.reserve(scans.size());
  for (const Scan& scan : scans) prints.push_back({&scan, &shown, &setup.process});
  const TunePrior prior = prior_of(resin_file.text, resin_file.source, printer);
  ScanTuneResult found = tune_by_scans(prints, setup, prior, {}, context);
  found.tuned.counted = counted;
  Json json = {{"inputs", findings_json(found.findings)},
               {"not_told_apart", found.not_apart},
               {"points", found.points},
               {"left_out", found.left_out},
               {"noise_um", found.noise_um},
               {"rms_before_um", found.before_um},
               {"rms_after_um", found.after_um},
               {"unexplained", unexplained_json(found.unexplained)},
               {"text", found.to_text(printer, resin, prior)}};
  // Both belong together, and have names of their own.
  Printer renamed = printer;
  renamed.name += "-tuned";
  json["resin_toml"] = resin_with_tuning(resin_file.text, resin_file.source, resin.name + "-tuned",
                                         renamed, found.tuned);
  json["printer_toml"] =
      printer_with_tuning(printer_file.text, printer_file.source, renamed, found.tuned);
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

TuningEnd end_of(Failure::Kind kind) {
  switch (kind) {
    case Failure::Kind::cancelled:
      return TuningEnd::cancelled;
    case Failure::Kind::input:
      return TuningEnd::input;
    case Failure::Kind::infeasible:
      return TuningEnd::infeasible;
    case Failure::Kind::device:
    case Failure::Kind::disk:
    case Failure::Kind::system:
      return TuningEnd::device;
    case Failure::Kind::memory:
      return TuningEnd::memory;
    case Failure::Kind::defect:
      break;
  }
  return TuningEnd::defect;
}

}  // namespace

}  // namespace slicecorr::resins

extern "C" __attribute__((visibility("default"))) int slicecorr_tuning(
    const slicecorr::TuningCall* call) {
  using slicecorr::TuningEnd;
  try {
    const std::string text = slicecorr::resins::answer_to(*call);
    call->answer(call->user, text.c_str());
    return static_cast<int>(TuningEnd::done);
  } catch (...) {
    const slicecorr::Failure failure = slicecorr::failure_at_hand();
    call->answer(call->user, failure.text.c_str());
    return static_cast<int>(slicecorr::resins::end_of(failure.kind));
  }
}
