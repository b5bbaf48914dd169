// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file make_result.hpp
/// The work itself, by its kind: what a worker does between its order and its outcome.
#pragma once

#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/tomo_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/work.hpp"
#include "work/reporter.hpp"

namespace slicecorr::farm::detail {

/// Raised where inputs are not what was submitted.
class InputGone : public InputError {
 public:
  using InputError::InputError;
};
/// Raised where what was written is not what was meant.
class OutputInvalid : public InputError {
 public:
  using InputError::InputError;
};

/// How the meshes of a spec are placed; `paths` are those of the farm's copies.
cli::MeshOptions mesh_options(const WorkSpec& spec, const std::vector<std::string>& paths);

/// What `slicecorr tomo solve` would be told of a tomographic print with these inputs.
cli::TomoPrintOptions tomo_options(const WorkSpec& spec, const std::vector<std::string>& paths);

/// Of a tomographic print: reading, solving, judging, reading back, its page.
std::vector<Phase> tomo_phases();
/// Solves a tomographic print of the inputs at `paths` into BASE.frames, BASE.json and BASE.html, reads it back,
/// and fills in what is known of the result. Gives the endings of what was written.
std::vector<std::string> make_tomographic(const WorkOrder& order,
                                          const std::vector<std::string>& paths,
                                          const std::string& base, Reporter& reporter,
                                          const ExecutionContext& context, WorkOutcome& outcome);

}  // namespace slicecorr::farm::detail
