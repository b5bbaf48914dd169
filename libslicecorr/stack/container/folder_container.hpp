// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file folder_container.hpp
/// A plain folder of files, as an archive.
#pragma once

#include <memory>
#include <string>

#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"

namespace slicecorr::detail {

/// Lists the files of the folder and of the folders in it ("uv/00000000.png"), no deeper. Links,
/// devices and pipes are not listed and never followed.
std::unique_ptr<Container> open_folder(const std::string& path);

/// Makes the folder beside `path` under a temporary name. A folder that is there is exchanged with
/// it in one step and removed after; only these are replaced: `keep_from` itself, an empty folder,
/// and one that this program wrote (it holds `kProvenanceEntry`) and that holds nothing else than
/// images and what `keep_from` has, too. All others, and whatever holds links or deeper folders,
/// are refused with `InputError`, and stay as they are whatever happens.
///
/// Kept files keep their mode and time. They are links to the same contents only where `keep_from`
/// itself is replaced: two folders must not change together. Changed files get the mode of the old.
std::unique_ptr<ContainerOutput> make_folder_output(const std::string& path,
                                                    const std::string& keep_from);

}  // namespace slicecorr::detail
