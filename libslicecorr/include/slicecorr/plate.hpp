// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file plate.hpp
/// Several parts on one plate: whether what they print overlaps, and where each is to lie so that none does.
///
/// Meshes are in mm, as they are to be sliced. Plain values; functions are thread-safe. Errors are
/// `InputError`, a cancelled `context` `Cancelled`.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

/// How parts share a plate.
struct PlateChoices {
  std::string overlap = "refuse";  ///< parts that overlap: "refuse", or "join" for their union
  bool arrange = false;            ///< parts lie side by side, not as in their files
  double spacing_mm = 1;           ///< at least so far apart where they are arranged, 0 or more
  bool turn_about_z = false;       ///< arranged parts may be turned by quarters
  /// In place of all that: x and y on the plate of the middle of each part, mm, from its corner at the
  /// least of both, and how many quarters each is turned about z; each stands on the platform. Empty:
  /// not said, or not turned.
  std::vector<double> places_mm, quarter_turns;
  /// Of each part as it is given (PART*N once), in place of what holds for all: its longest side, mm, or
  /// the factor on its lengths, 0: as all; and its turns about x, y and z, degrees. Empty: all are alike.
  std::vector<double> own_fit_mm, own_scale, own_rotate_deg;
  /// Whether parts have sizes or turns of their own.
  bool has_own() const {
    return !own_fit_mm.empty() || !own_scale.empty() || !own_rotate_deg.empty();
  }
  bool operator==(const PlateChoices&) const = default;
};

/// Two parts, by their places in the list, both of which are solid at the middles of some voxels.
struct PartOverlap {
  std::size_t first = 0, second = 0;
  double volume_mm3 = 0;  ///< of these voxels
  /// The lowest of them: on the plate from its corner at the least x and y, and above the platform.
  double x_mm = 0, y_mm = 0, z_mm = 0;
};

/// The two parts that overlap most, when they lie together as `options` say (`options.center_mm`: the
/// middle of all); nothing where none do. Parts that only touch do not. Time and memory are those of
/// slicing the parts whose boxes meet.
std::optional<PartOverlap> find_overlap(const std::vector<TriangleMesh>& parts,
                                        const Printer& printer, const SliceOptions& options,
                                        const ExecutionContext& context = {});

struct ArrangeOptions {
  double width_mm = 0, height_mm = 0;  ///< of the display, above 0
  double spacing_mm = 1;               ///< at least so far apart, 0 or more
  bool turn = false;                   ///< also by quarter turns about z
};

/// Where a part lies: turned about the middle of its box, then moved.
struct ArrangedPart {
  int plate = 0;     ///< 0 for the first
  int quarters = 0;  ///< turns by 90 degrees about z, 0..3
  Point3 move_mm{};  ///< then added to all corners
};

/// Places the outlines of parts, the largest first, each where it fits first, from the display's corner at
/// the least x and y on, standing on the platform. What does not fit beside the others goes to another
/// plate. Outlines are found on cells of a thousandth of the display's longer side. `name`: of a part, for
/// messages. Throws where a part is larger than the display. The same input gives the same places.
std::vector<ArrangedPart> arrange(const std::vector<TriangleMesh>& parts,
                                  const ArrangeOptions& options,
                                  const std::function<std::string(std::size_t)>& name,
                                  const ExecutionContext& context = {});

/// A part as it lies at its place.
TriangleMesh at_place(const TriangleMesh& part, const ArrangedPart& place);

}  // namespace slicecorr
