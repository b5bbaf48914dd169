// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How evenly a display shines, from readings at a few places.
#pragma once

#include <string>
#include <vector>

#include "exchange/import.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::resins {

/// What a meter read at one place, in the frame that the readings are in: mm from its left and from
/// its lower edge.
struct LightReading {
  double x_mm = 0, y_mm = 0, light = 0;  ///< light > 0, in any unit
  int line = 0;
};

/// Whether the header of a table names places and light.
bool is_light_readings(const std::string& text, const std::string& path);

/// A smooth map through readings: from nine on that curve both ways the surface of second order that fits them
/// best; and with what they differ from it, or from nothing, at each place the plane that fits those around best, each
/// the less the further away it is (a Gaussian as wide as readings lie apart).
struct LightMapOfReadings {
  GreyImage image;       ///< row 0 at the largest y; white is the brightest place
  double brightest = 0;  ///< light that white stands for
  double off_mean = 0;   ///< mean distance of readings from the map, over the brightest
  std::vector<double>
      ninths;  ///< shares of the brightest in the middles of 3 x 3 parts, from the top left on
  double value_at(double x_mm, double y_mm) const;  ///< 0 to 255, not rounded
  double width_mm = 0, height_mm = 0;
  /// A reading that the others contradict, as a sentence; empty: none.
  std::string contradicted;
};

/// Throws `InputError` where there are fewer than three readings, one lies beside the display, all lie on a line, or
/// they cover less than half of a side.
LightMapOfReadings map_of_readings(const ImportSource& source, double width_mm, double height_mm);

}  // namespace slicecorr::resins
