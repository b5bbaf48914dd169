// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a job prints, judged by its doses.
#pragma once

#include <cstdint>
#include <memory>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::tomo::detail {

/// What is printed and what shades it, and what light does there.
struct Scene {
  Target target;
  std::shared_ptr<const Projector> projector;
};
/// Coverage on the grid that is computed on.
Volume volume_of(const TomoGrid& grid, const Box<std::uint8_t>& part);
Target target_of(const Bench& bench, const Box<std::uint8_t>& part,
                 const Box<std::uint8_t>& insert);
Scene scene_of(const Bench& bench, const Box<std::uint8_t>& part, const Box<std::uint8_t>& insert);

/// mJ/cm³ that black light leaves in a turn, at most.
double floor_of_turn(const Bench& bench, const Projector& projector,
                     const ExecutionContext& context);

/// `dose` is that of the whole print.
PrintFigures judge(const TomoJob& job, const Bench& bench, const Target& target,
                   const Box<float>& dose, double floor_of_turn_mj_cm3);

}  // namespace slicecorr::tomo::detail
