// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file resolved.hpp
/// What becomes of a request on its way to a job: what it comes to by its words, and by its inputs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/memory_need.hpp"
#include "slicecorr/setup.hpp"
#include "submit/tomographic.hpp"

namespace slicecorr::farm::detail {

/// What is found out of inputs that are worked on in the same way.
struct Checked {
  std::string error;
  Reason reason = Reason::none;  ///< of the error
  int layers = 0;
  MemoryFacts memory;
  TomoNeeds tomo;  ///< of tomographic prints, in place of `memory`
};

/// What a request comes to, before inputs are read.
struct Resolved {
  bool mesh = false;
  Setup setup;
  std::string setup_json, setup_hash;
  WorkSpec spec;  ///< without inputs; angles as they were asked for
  std::int64_t ready_by_ms = kNoDeadline;
  std::size_t checked = 0;  ///< index
};

/// Parts, then what is left alone beside them and meshes inside, or of tomographic jobs inserts.
std::vector<std::string> inputs_of(const JobRequest& request);

/// Reads the inputs as a worker will. `scratch_folder`: for archives.
Checked check_inputs(const JobRequest& request, const Resolved& resolved,
                     const std::string& scratch_folder, const ExecutionContext& context);

/// The name of the outputs of a copy, 1 the first.
std::string name_of_copy(const JobRequest& request, int copy);

/// Adds outputs that two requests write, that are inputs, that jobs of the queue will write, or that can't be
/// written, to `errors`. `resolved`: one for each request, as far as it got.
void check_outputs(const std::vector<JobRequest>& requests, const std::vector<Resolved>& resolved,
                   Queue& queue, std::vector<SubmitError>& errors);

}  // namespace slicecorr::farm::detail
