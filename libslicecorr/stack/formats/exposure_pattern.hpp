// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The times of an archive's layers as few numbers: bottom layers, a fade, normal layers.
#pragma once

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// How a layer of the stack is lit: by its process when corrected, else by the archive's times.
SliceLight light_of_layer(const StackInfo& info, int layer);
/// Share of full light that a layer gets.
double share_of_layer(const StackInfo& info, int layer);
/// Whether layers are of different heights.
bool has_own_heights(const StackInfo& info);
/// Whether layers of the two get other shares.
bool shares_differ(const StackInfo& a, const StackInfo& b);
/// Its time alone, s.
inline double light_on_of_layer(const StackInfo& info, int layer) {
  return light_of_layer(info, layer).time_s;
}
/// Whether two times are the same but for the rounding of archives: hundredths of seconds, and less
/// for short times, which are written with more digits.
bool same_time(double a_s, double b_s);
/// Light-on time of normal layers, of the first layers, and the number of these.
struct ExposureSummary {
  double normal_s = 0, bottom_s = 0;
  int bottom_layers = 0, fade_layers = 0;
  /// Whether layers differ in another way, which these numbers can't say.
  bool uneven = false;
};
ExposureSummary exposure_summary(const StackInfo& info);
/// The same for the head of a file, whether it lists layers, too, or not: where these numbers can't say all, the
/// first layers and those that fade from them as they are, so that a printer that doesn't heed a list prints
/// nearly the same. `uneven` stays.
ExposureSummary head_summary(const StackInfo& info);
/// Whether layers of the two are lit for different times.
bool exposures_differ(const StackInfo& a, const StackInfo& b);
/// Whether a part that is put into a binary file takes the place of the file's times: a part without
/// times gets those that are there.
inline bool replaces_exposures(const StackInfo& part, const StackInfo& file) {
  return exposures_differ(part, file) && exposure_summary(part).normal_s > 0;
}

}  // namespace slicecorr::detail
