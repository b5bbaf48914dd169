// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/vanished.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bands/bands.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

void refuse_vanished(const SliceSource& target, const std::string& name) {
  const Grid& g = target.grid();
  const PixelBox box = target.bounds();
  int brightest = 0;
  for (const PixelBox& band : bands_of(g, box)) {
    const std::size_t columns = columns_of(band);
    target.read_band(band, [&](int, const std::uint8_t* rows) {
      if (rows) brightest = std::max(brightest, int{*std::max_element(rows, rows + columns)});
    });
  }
  const std::string found =
      brightest == 0 ? std::string("all slices are empty")
                     : fmt::format(
                           "no pixel is covered fully, the fullest by {:.3g} % (grey value {} of "
                           "255)",
                           brightest / 2.55, brightest);
  const std::string size =
      box.empty()
          ? std::string()
          : fmt::format(
                " It lies within {} x {} pixels of {:g} x {:g} um and {} layers of {:g} um.",
                box.width(), box.height(), g.pixel_x_um, g.pixel_y_um, g.layers, g.layer_um);
  const std::string message =
      "nothing in the part is solid, so nothing would print: " + found + "." + size +
      " Expected a part with walls of a pixel and more: are its units and scale right (metres or "
      "inches read as millimetres)?";
  if (name.empty()) throw InputError(message);
  throw InputError(name, "", message);
}

void tell_nothing_prints(const Prediction& p, const ExecutionContext& context) {
  if (p.target_voxels == 0 || p.undercure_voxels < p.target_voxels) return;
  context.tell(fmt::format(
      "nothing of the part prints: all of its {} voxels stay liquid (overlap 0)", p.target_voxels));
}

}  // namespace slicecorr::detail
