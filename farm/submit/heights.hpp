// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How the meshes of a job are placed, and how high their layers are.
#pragma once

#include "programs/common/mesh_options.hpp"
#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// The options of `run` that a request says.
cli::MeshOptions mesh_options_of(const JobRequest& r);

/// By what heights of layers are said: one for all, each by itself, or as slopes ask for.
enum class HeightsBy { alike, each, slopes };

/// Heights of layers are said once, of meshes: what a job says comes before defaults. An archive says
/// its own. Throws `InputError` where they are said twice, of meshes not at all, or of
/// an archive.
HeightsBy check_heights(const JobRequest& r, bool mesh);

}  // namespace slicecorr::farm::detail
