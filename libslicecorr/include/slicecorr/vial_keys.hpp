// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file vial_keys.hpp
/// What resin files say that counts in vials alone, said where something else prints.
///
/// A pure function, thread-safe; it does not throw.
#pragma once

#include <string>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// What the resin's file says of inhibitors (`inhibition_dose_mj_cm3`, `inhibition_resupply_mj_cm3_s`) that
/// prints without a vial do not count, as a sentence without its full stop; empty where there is nothing
/// such.
std::string vial_keys_in_words(const Resin& resin);

}  // namespace slicecorr
