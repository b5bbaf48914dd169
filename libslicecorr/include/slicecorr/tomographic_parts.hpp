// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomographic_parts.hpp
/// What a tomographic printer has besides others (`Printer` in process.hpp): vial, optics, bath and rotation, as
/// its file says them. Plain values.
#pragma once

#include <vector>

namespace slicecorr {

/// The vial of a tomographic printer across its axis.
enum class VialShape { round, square, outline };

/// A place across the axis of rotation, in the frame of the part, mm.
struct FlatPoint {
  double x_mm = 0, y_mm = 0;
  bool operator==(const FlatPoint&) const = default;
};

/// A cylinder that stands in the resin along the axis and turns with it, from below all light to above.
struct Rod {
  double x_mm = 0, y_mm = 0, diameter_mm = 0;
  double n = 0;         ///< refractive index, 1..3; 0: it lets no light through
  double reflects = 0;  ///< share of light that one without index sends on as a mirror, 0..1
  bool operator==(const Rod&) const = default;
};

/// The vial of a tomographic printer: a tube of resin about its axis of rotation, the z axis.
struct Vial {
  double outer_mm = 0;   ///< outer radius, > `inner_mm`
  double inner_mm = 0;   ///< inner radius: the resin ends here; > 0
  double n_outside = 1;  ///< refractive index around the vial, 1..3: 1 is air, the resin's a bath
  double n_wall = 1.48;  ///< that of the wall, 1..3; borosilicate glass in violet light
  /// A second wall around the first, of a double-walled vial: its radii, jacket_outer_mm > jacket_inner_mm
  /// >= outer_mm; 0: none.
  double jacket_outer_mm = 0, jacket_inner_mm = 0;
  double n_between = 1;    ///< between the walls, 1..3
  double n_jacket = 1.48;  ///< of the second wall, 1..3
  /// round: walls are cylinders about the axis. square, outline: flat or curved ones that turn with the
  /// vial (vial_outline.hpp); `outer_mm` and `inner_mm` are how far the farthest of both faces is from the
  /// axis then.
  VialShape shape = VialShape::round;
  double side_mm = 0;    ///< square: from outer face to outer face
  double wall_mm = 0;    ///< square, outline: thickness of the wall
  double corner_mm = 0;  ///< square: radius of its outer corners, 0: sharp
  std::vector<FlatPoint>
      outline{};            ///< outline: corners of the outer face, convex, around the axis
  std::vector<Rod> rods{};  ///< that stand in the resin
  /// Whether light is traced through it face by face: closed forms know round ones without rods.
  bool traced() const { return shape != VialShape::round || !rods.empty(); }
  /// Where the vial ends.
  double outside_mm() const { return jacket_outer_mm > 0 ? jacket_outer_mm : outer_mm; }
  bool operator==(const Vial&) const = default;
};

/// telecentric: the light of all pixels is parallel. pinhole: it comes from one point.
enum class OpticsKind { telecentric, pinhole };

/// How a tomographic printer's light comes to the vial. The image is sharp on the plane through the
/// axis of rotation that faces the projector; `Printer::pixel_x_um` is its pitch there, without the
/// vial.
struct Optics {
  OpticsKind kind = OpticsKind::telecentric;
  double distance_mm = 0;     ///< pinhole: from the point to the axis, > the vial's outer radius
  double half_angle_deg = 0;  ///< of the cone that a pixel's light fills outside the vial, 0..45
  int rays_per_pixel = 1;     ///< rays that stand for that cone, 1..1000
  /// Where the image, as seen from the projector, shows the axis of rotation, from its middle to
  /// the right, and the optical axis, where z is 0, from its middle upwards.
  double axis_right_px = 0, axis_up_px = 0;
  /// By how much the image shows the axis of rotation leaning to the right, about that place, -45..45.
  double tilt_deg = 0;
  bool operator==(const Optics&) const = default;
};

/// A bath around the vial of a tomographic printer, with a flat window that faces the projector,
/// square to the optical axis. The liquid's index is `Vial::n_outside`, too.
struct Bath {
  double window_mm = 0;  ///< from the window's outer face, in air, to the axis of rotation
  double n = 1;          ///< refractive index of the liquid, 1..3
  double wall_mm = 0;    ///< thickness of the window, >= 0
  double n_wall = 1.52;  ///< refractive index of the window, 1..3; float glass in violet light
  bool operator==(const Bath&) const = default;
};

/// How the vial turns, seen from above.
enum class TurnDirection { clockwise, counterclockwise };

/// Where the image shows the axis of rotation at one angle, from where `Optics` says.
struct AxisWobble {
  double angle_deg = 0;            ///< that the stage has turned since the first frame, 0..360
  double right_px = 0, up_px = 0;  ///< as seen from the projector, each -1e4..1e4
  bool operator==(const AxisWobble&) const = default;
};

/// How a tomographic printer's vial turns.
struct Rotation {
  double deg_s = 0;  ///< > 0
  TurnDirection direction = TurnDirection::clockwise;
  double max_fps = 0;  ///< images that the projector shows in a second at most; 0 when not given
  /// Angles rise; linear between them and from the last to the first; empty: none.
  std::vector<AxisWobble> wobble = {};
  double turn_s() const { return 360 / deg_s; }
  bool operator==(const Rotation&) const = default;
};

}  // namespace slicecorr
