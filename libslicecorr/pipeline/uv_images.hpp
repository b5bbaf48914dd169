// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uv_images.hpp
/// Images of a patterned UV lamp, which follow from the slices.
#pragma once

#include <array>
#include <cstdint>

#include "slicecorr/cure.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// UV pixel value of each pixel value, where the model's lamp is patterned.
std::array<std::uint8_t, 256> uv_of_pixels(const CureModel& model, int levels);

/// Lets the writer make an image in UV light of every slice, where the lamp shows patterns: by the
/// curing light of each pixel, or by place for an even dead zone. `models` must outlive the writer's work.
struct ImagesLie {
  Grid grid;
  ImageFrame frame;
};
void set_uv_images(StackWriter& writer, const PlaceModels& models, const Setup& setup,
                   const ImagesLie& images);

}  // namespace slicecorr::detail
