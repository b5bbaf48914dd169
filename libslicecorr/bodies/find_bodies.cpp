// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <vector>

#include "bodies/kept_voxels.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr {

Bodies find_bodies(const SliceSource& images, const ExecutionContext& context, const BodyAsk& ask) {
  const Grid& grid = images.grid();
  const PixelBox box = images.bounds();
  const int rows = band_rows(grid);
  std::vector<PixelBox> bands;
  for (int y = box.y0; !box.empty() && y < box.y1; y += rows - y % rows) {
    bands.push_back({box.x0, y, box.x1, std::min(y + rows - y % rows, box.y1)});
  }
  detail::KeptVoxels kept(bands, grid.layers, context);
  detail::KeptVoxels::Stream found(bands.size());
  parallel_for(context, "look for bodies", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    detail::VoxelChanges changes(static_cast<std::size_t>(band.width()) *
                                 static_cast<std::size_t>(band.height()));
    images.read_band(band, [&](int n, const std::uint8_t* pixels) {
      if ((n & 63) == 0) context.check_cancelled();
      changes.add_slice(n, pixels);
    });
    found[i] = kept.keep(changes.code(grid.layers));
  });
  return kept.follow({found}, grid, images.frame(), ask);
}

}  // namespace slicecorr
