// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The main job as programs do it: a corrected stack with the proof of what it prints beside it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "programs/common/part_slices.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/turned.hpp"

namespace slicecorr::cli {

/// Slices as they go into the output: archives that printers read have the images of a display,
/// our own those of the plate. `slices` must outlive the result.
FittedSlices fit_for_output(const SliceSource& slices, const StackFile& file,
                            const Printer& printer, const ExecutionContext& context);

/// Behind the stem of a stack, what is left beside it: its design, and what was left alone.
inline constexpr const char *kTargetEnding = "-target.uvj", *kLeftAloneEnding = "-left-alone.uvj";

/// Where `run` leaves the target of a stack: BASE-target.uvj beside BASE.uvj.
std::string target_beside(const std::string& stack);

/// Where `run` leaves what it left alone, as slices: BASE-left-alone.uvj beside BASE.uvj.
std::string left_alone_beside(const std::string& stack);

/// Corrects `target` into `file`, and writes the figures (BASE.json: the prediction, with that of
/// the uncorrected part under "uncorrected", and the time of the print) and the report (BASE.html), which gets this title.
/// `corrected` is called, when given, when all is computed but the report. Of the three files each
/// appears whole, the stack first; an old page and old figures go before the old stack does.
Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title,
                     const ExecutionContext& context, const std::function<void()>& corrected = {});

/// Leaves slices of the plate at `path`, beside a stack, for the programs that measure it: verify, section,
/// report, scan compare.
void leave_beside(const SliceSource& slices, const LayerHeights& heights, const std::string& path,
                  const ExecutionContext& context);
/// The same of what lies on the plate beside parts that were sliced: `meshes` as they were left alone.
void leave_left_alone(const PartSlices& parts, const std::vector<std::string>& meshes,
                      const Printer& printer, const LayerHeights& heights, const std::string& path,
                      const ExecutionContext& context);

}  // namespace slicecorr::cli
