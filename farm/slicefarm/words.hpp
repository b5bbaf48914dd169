/// Figures for people.
#pragma once

#include <cstdint>
#include <string>

namespace slicecorr::farm {

/// "3.2 s", "4 min 05 s", "2 h 07 min".
std::string duration_text(double seconds);
/// "812 kB", "1.4 GB".
std::string bytes_text(std::int64_t bytes);

}  // namespace slicecorr::farm
