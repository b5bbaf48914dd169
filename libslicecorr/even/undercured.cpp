// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "even/undercured.hpp"

#include <mutex>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"

namespace slicecorr::detail {

std::uint64_t undercured_voxels(const SliceSource& target, const Setup& setup,
                                const ExecutionContext& context) {
  const PlacePlans plans(target, setup, context);
  const auto bands = bands_of(target.grid(), target.bounds());
  std::mutex adding;
  std::uint64_t undercured = 0;
  parallel_for(context, "try the light", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    DesignBand(target, plans.models().map(), band)
        .each(
            plans.all_layers(),
            [&](const DesignGroup& group, const PutRows& put_rows) {
              BandPredictor after(plans.plan(group.value).model, plans.models().curve(group.value),
                                  plans.all_layers(), group.columns);
              GroupListeners to{.put = put_rows, .after = &after};
              correct_group(plans, group, to, context);
              const std::uint64_t here = after.finish(group.place).undercure_voxels;
              const std::lock_guard lock(adding);
              undercured += here;
            },
            [](int, const std::uint8_t*) {});
  });
  return undercured;
}

}  // namespace slicecorr::detail
