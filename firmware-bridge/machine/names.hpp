// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Words of printer files for what machine.hpp names.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge::detail {

struct SignalName {
  Signal signal;
  std::string_view name;
  bool written;
};
/// All signals, those written first.
std::span<const SignalName> signal_names();

inline constexpr std::array<std::string_view, 4> kCommandNames{"off", "run", "stop", "reset"};
inline constexpr std::array<std::string_view, 4> kStateNames{"idle", "running", "stopped", "fault"};

/// Least and greatest raw value.
double least_raw(const Register& reg);
double greatest_raw(const Register& reg);

}  // namespace slicecorr::bridge::detail
