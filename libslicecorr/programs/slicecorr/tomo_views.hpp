// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Subcommands of `tomo` that look at jobs and exchange them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/tomo/convert.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/section.hpp"
#include "slicecorr/tomo/video.hpp"

namespace slicecorr::cli {

struct TomoViewOptions {
  LightOptions light;
  std::string job, output, show = "dose", channel = "all";
  std::optional<double> x_mm, y_mm, z_mm;
  tomo::VideoOptions video;
  std::string printer, resin, part, direction;
  tomo::ImageSequence images;
  double voxel_mm = 0;
};

/// Writes a picture of where a part fails (.png or .svg), and says what it shows.
using SectionsFile = std::string (*)(const std::vector<tomo::PrintSection>&, tomo::ColouredBy,
                                     const std::string&);
/// What writes pictures with this name: .png or .svg.
SectionsFile sections_file(const std::string& output);

std::string picture_of(const tomo::Evidence& evidence, const std::string& part,
                       const std::string& path);
/// Throws `InputError` unless a picture can be written under this name.
void check_picture_name(const std::string& path);

/// Adds them to the group `tomo`; they keep what they are told in `options`.
void add_tomo_views(Program& program, CLI::App* group, TomoViewOptions& options);

}  // namespace slicecorr::cli
