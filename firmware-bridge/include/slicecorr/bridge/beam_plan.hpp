// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file beam_plan.hpp
/// A print with beams: one exposure of still images on several displays. Plain functions,
/// thread-safe.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/beam_vat.hpp"
#include "slicecorr/bridge/plan.hpp"
#include "slicecorr/tomo/beams_job.hpp"

namespace slicecorr::bridge {

/// One slice as high as the vat, layer by layer: the stage stands at home, the images are shown, then
/// the lamp lights them for the time of the job. `vat`: of the machine's printer file. Throws
/// `InputError` when the job was made for another printer (name, displays, calibration, vat), and
/// `InfeasibleError` when its exposure is too short to be timed.
PrintPlan plan_beams(const tomo::BeamJob& job, const std::string& path, const Machine& machine,
                     const std::optional<BeamVat>& vat);

/// What the simulator and its records are told of it: an exposure of the job's time.
Process process_of(const tomo::BeamJob& job);

}  // namespace slicecorr::bridge
