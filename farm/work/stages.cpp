// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "work/stages.hpp"

namespace slicecorr::farm::detail {

void (*work_stage_listener)(const std::string& stage, const WorkOrder& order) = nullptr;
void (*service_stage_listener)(const char* stage) = nullptr;

}  // namespace slicecorr::farm::detail
