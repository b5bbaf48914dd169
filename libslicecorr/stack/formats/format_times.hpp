// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file format_times.hpp
/// Sizes and exposure times that archives of G-code printers and the like say in similar ways.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

inline constexpr int kMaxLayers = 1'000'000;

/// Millimetres to micrometres, without the noise of a division by pixels.
double um_of_mm(double mm);
/// Micrometres to millimetres, rounded to 1e-9 mm: without the noise of the last digits.
double mm_of_um(double um);

/// Takes the whole number that `value`, if any, is. Throws `InputError` naming `key` otherwise.
std::optional<int> whole(std::optional<double> value, const std::string& file,
                         const std::string& entry, const std::string& key);

/// Size of the images from the first one, whether they are RGB-packed when the archive says how
/// wide they are, and a check of both. `says` names the place that says the size.
void take_image_size(const Container& archive, std::optional<int> width_px,
                     std::optional<int> height_px, const std::string& says, bool may_be_packed,
                     ArchiveContents& contents);

/// Size of a pixel on the plate from that of the display; leaves 0 where either is not known.
/// Throws `InputError` when it is not from 1 to 1000 um.
double pixel_um(double pixel_mm, const Container& archive, const std::string& says);
/// The same for the height of a layer.
double layer_um(double layer_mm, const Container& archive, const std::string& says);

/// Takes light-on times of all layers, s, unless the times of `info` say the same; fading layers
/// after the bottom ones are recognised.
void take_layer_times(std::vector<double> times_s, StackInfo& info);

/// Names of `layers` images: the kept ones and, after them, their numbers continued with at least
/// as many digits as the last one has. Throws `InputError` when there are more kept ones.
std::vector<std::string> continued_names(const ArchiveRequest& request, std::string_view suffix);

void warn(const ArchiveRequest& request, std::string text);
/// Tells of prints that move while they cure, which these formats have no word for, and of stacks
/// that say no exposure.
void warn_of_mode(const ArchiveRequest& request, std::string_view format);

/// Whether the platform is lifted between the layers of the stack.
bool lifts(const StackInfo& info);
/// Lifts that new files say, until somebody sets what the printer needs, mm and mm/min: slow enough for any, as
/// Chitubox proposes them.
inline constexpr double kLiftMm = 5, kLiftMmMin = 60, kDropMmMin = 150;

}  // namespace slicecorr::detail
