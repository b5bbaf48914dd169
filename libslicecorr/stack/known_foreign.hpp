#pragma once

#include <memory>
#include <string>

#include "stack/container.hpp"
#include "stack/container_output.hpp"

namespace slicecorr::detail {
void refuse_known_foreign(const Container& archive);
void refuse_known_file(const std::string& path);
}  // namespace slicecorr::detail
