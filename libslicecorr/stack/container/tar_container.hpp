// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tar_container.hpp
/// A tar packed by gzip.
#pragma once

#include <memory>
#include <string>

#include "slicecorr/parallel.hpp"
#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"

namespace slicecorr::detail {

/// Unpacks the archive once, as its entries can't be found in it: to memory, and beyond 64 MiB to
/// an unnamed scratch file in `scratch_folder`, as `context` is told. Refuses archives that unpack
/// to more than 500 times their size and 256 MiB.
std::unique_ptr<Container> open_tar_gz(const std::string& path, const std::string& scratch_folder,
                                       const ExecutionContext& context = {});

/// New entries have a fixed time and no owner, and nothing tells where or when the file was packed.
/// Kept ones keep their place, time, owner and mode, changed or not, and links can't be kept.
std::unique_ptr<ContainerOutput> make_tar_gz_output(const std::string& path,
                                                    const std::string& keep_from);

}  // namespace slicecorr::detail
