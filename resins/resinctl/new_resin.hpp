// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resin files that are made new.
#pragma once

#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::resinctl {

/// Writes the text of a resin to `path`, NAME.toml, where no file is yet, and says so. Throws
/// `InputError`.
void write_new_resin(const std::string& path, const std::string& text, cli::Console& console);

}  // namespace slicecorr::resinctl
