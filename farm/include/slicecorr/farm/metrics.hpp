// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file metrics.hpp
/// The farm in the text format of Prometheus, version 0.0.4. Functions are thread-safe, but a
/// model belongs to one thread. Throws `DeviceError` as `ReadModel`.
#pragma once

#include <string>

#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/status.hpp"

namespace slicecorr::farm {

/// Base units (seconds, bytes), names begin with "slicefarm_". Counters fall only when rows leave
/// the record, which they never do.
std::string metrics_text(ReadModel& model, const FarmFolder& folder,
                         const FarmClock& clock = system_clock());

}  // namespace slicecorr::farm
