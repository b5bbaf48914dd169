#pragma once

#include <memory>
#include <string>

#include "stack/container.hpp"
#include "stack/container_output.hpp"

namespace slicecorr::detail {
std::unique_ptr<Container> open_tar_gz(const std::string& path, const std::string& scratch_folder);
std::unique_ptr<ContainerOutput> make_tar_gz_output(const std::string& path,
                                                    const std::string& keep_from);
}  // namespace slicecorr::detail
