// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tuning by scans, which slicecorr-tuning.so does.

#include <new>
#include <nlohmann/json.hpp>

#include "c_api/handles.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tuning_call.hpp"
#include "support/files/shared_object.hpp"

namespace slicecorr::c_api {

namespace {

using Json = nlohmann::ordered_json;

/// What a call tells, and its answer.
struct Told {
  const ExecutionContext& context;
  std::string answer;
};

[[noreturn]] void fail(TuningEnd end, const std::string& text) {
  switch (end) {
    case TuningEnd::cancelled:
      throw Cancelled();
    case TuningEnd::input:
      throw InputError(text);
    case TuningEnd::infeasible:
      throw InfeasibleError(text);
    case TuningEnd::device:
      throw DeviceError(text);
    case TuningEnd::memory:
      throw std::bad_alloc();
    default:
      throw std::runtime_error(text);
  }
}

std::string request_of(const std::vector<std::string>& scans, const slicecorr_stack& stack,
                       const Choices& c, const slicecorr_job* job) {
  if (stack.path.empty()) {
    throw InputError("the stack in memory: expected one of an archive, which was printed");
  }
  Json request = {{"scans", scans},
                  {"stack", stack.path},
                  {"voxel_um", c.voxel_um},
                  {"scratch", scratch_folder(job)},
                  {"threads", job ? job->threads : 0}};
  for (const auto& [key, value] :
       {std::pair{"printer", &c.printer}, std::pair{"printer_toml", &c.printer_toml},
        std::pair{"resin", &c.resin}, std::pair{"resin_toml", &c.resin_toml},
        std::pair{"unit", &c.scan_unit}}) {
    if (!value->empty()) request[key] = *value;
  }
  return request.dump();
}

std::string tune_by(const std::vector<std::string>& scans, const slicecorr_stack& stack,
                    const Choices& choices, slicecorr_job* job) {
  const std::string request = request_of(scans, stack, choices, job);
  const auto function = reinterpret_cast<TuningFunction>(
      slicecorr::detail::module_entry(kTuningModule, kTuningFunction, "tunes by scans"));
  const ExecutionContext context = job_of(job);
  Told told{context, {}};
  TuningCall call;
  call.request = request.c_str();
  call.cancel = context.cancel;
  call.user = &told;
  call.progress = [](void* user, const char* stage, double fraction) {
    static_cast<Told*>(user)->context.report(stage, fraction);
  };
  call.notice = [](void* user, const char* text) { static_cast<Told*>(user)->context.tell(text); };
  call.answer = [](void* user, const char* text) { static_cast<Told*>(user)->answer = text; };
  const auto end = static_cast<TuningEnd>(function(&call));
  if (end != TuningEnd::done) fail(end, told.answer);
  return told.answer;
}

}  // namespace

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_status slicecorr_tune_scans(const char* const* scans, size_t count,
                                      const slicecorr_stack* stack, const slicecorr_setup* setup,
                                      slicecorr_job* job, slicecorr_figures** figures) {
  return guarded(error_of(job), [&] {
    Output output(figures, "figures");
    need(scans, "scans");
    if (count == 0) throw BadCall("count is 0; expected one scan or more");
    std::vector<std::string> paths;
    for (size_t i = 0; i < count; ++i) paths.emplace_back(&need(scans[i], "scans"));
    output.give(
        figures_of(tune_by(paths, need(stack, "stack"), need(setup, "setup").choices, job)));
  });
}
