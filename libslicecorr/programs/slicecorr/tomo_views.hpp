/// Subcommands of `tomo` that look at jobs and exchange them.
#pragma once

#include <optional>
#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

struct TomoViewOptions {
  std::string job, output, show = "dose";
  std::optional<double> x_mm, y_mm, z_mm;
};

/// Adds them to the group `tomo`; they keep what they are told in `options`.
void add_tomo_views(Program& program, CLI::App* group, TomoViewOptions& options);

}  // namespace slicecorr::cli
