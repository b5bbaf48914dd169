/// @file uv_images.hpp
/// Images of a patterned UV lamp, which follow from the slices.
#pragma once

#include "slicecorr/cure.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// Lets the writer make an image in UV light of every slice, where the model's lamp is patterned.
/// `levels`: grey levels of the printer.
void set_uv_images(StackWriter& writer, const CureModel& model, int levels);

}  // namespace slicecorr::detail
