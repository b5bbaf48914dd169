// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file recording_entry.hpp
/// The table of a recorded stack: which image was lit in which slice, and how much.
#pragma once

#include <string>
#include <string_view>

#include "slicecorr/recording.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

inline constexpr const char* kRecordingEntry = "slicecorr/recording.csv";

/// Most slices and showings of a recording.
inline constexpr int kMaxRecordedSlices = 1'000'000;
inline constexpr int kMaxRecordedShowings = 5'000'000;

/// One row per showing; numbers read back as the same numbers.
std::string recording_csv(const Recording& recording);
std::uint32_t recording_crc32(std::string_view csv);
/// Throws `InputError` naming the line.
Recording parse_recording(std::string_view csv, int slices, const std::string& file);

/// Adds the entry when the stack is a recorded one.
void add_recording(const StackInfo& info, ContainerOutput& output);
/// Reads the table that our block speaks of. Throws `InputError` when it is missing, or not the one
/// of the block, or says what can't be.
void read_recording(const Container& archive, ArchiveContents& contents);

}  // namespace slicecorr::detail
