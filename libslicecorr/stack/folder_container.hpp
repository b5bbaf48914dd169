#pragma once

#include <memory>
#include <string>

#include "stack/container.hpp"
#include "stack/container_output.hpp"

namespace slicecorr::detail {
std::unique_ptr<Container> open_folder(const std::string& path);
std::unique_ptr<ContainerOutput> make_folder_output(const std::string& path,
                                                    const std::string& keep_from);
}  // namespace slicecorr::detail
