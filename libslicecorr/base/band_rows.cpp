#include <algorithm>

#include "slicecorr/target.hpp"

namespace slicecorr {

int band_rows(const Grid& grid) {
  // A band through all slices should hold about 64 million voxels; fewer rows than 8 would make
  // pieces too short to compress, more than 32 would leave too few bands for the threads.
  const double voxels_per_row = static_cast<double>(grid.width_px) * grid.layers;
  return static_cast<int>(std::clamp(64e6 / std::max(voxels_per_row, 1.0), 8.0, 32.0));
}

}  // namespace slicecorr
