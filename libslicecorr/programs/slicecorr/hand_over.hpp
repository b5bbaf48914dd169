// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Commands of `slicecorr` that another program of the project does.
#pragma once

#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

/// Becomes the program that lies beside this one, with the same arguments. Does not return; throws
/// `InputError` where that program is not there.
[[noreturn]] void become(const std::string& program, char** argv);

/// Adds `tune`, which is `resinctl tune`: fits need Ceres, which `slicecorr` does without.
void add_tune(Program& program, char** argv);
/// How many of the arguments `slicecorr` reads itself: behind `tune` all, --help too, are for
/// `resinctl`.
int own_arguments(int argc, char** argv);

}  // namespace slicecorr::cli
