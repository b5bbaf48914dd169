// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/read_wanted.hpp
/// Grey targets as files. Plain functions, thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/wanted.hpp"

namespace slicecorr::tomo {

/// A box of numbers: a file of NumPy, or a folder or zip of grey PNG images of 8 bits, the lowest slice first, an
/// image's lowest row first along y, in which white stands for `white` (> 0; 0: images are refused). Throws
/// `InputError` as `read_dose_npy`, and for no images and images of two sizes or of 16 bits.
Box<float> read_numbers(const std::string& path, double white,
                        const ExecutionContext& context = {});

/// A table with the columns dose_mj_cm3 and conversion. Throws `InputError`, naming the row.
std::vector<CurvePoint> read_conversion_curve(const std::string& path);

}  // namespace slicecorr::tomo
