// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file scan.hpp
/// A printed part that was scanned, beside the surface that it should have.
///
/// A scan has any pose, may show a part of the surface only, and may hold what is not the part: stubs of supports,
/// dust. `register_scan` finds how it lies to a surface (a design on the plate, or the mesh of `solid_mesh`, both in the
/// frame of solid.hpp: mm, z from the platform towards the window), `deviation_from` measures it there. Distances are
/// above 0 where the scan lies outside: too much was printed.
///
/// Coarse registration does not depend on how the scan lies: axes of inertia in all 24 ways, and pairs of points with
/// their normals that are found again in the surface (point pair features, Drost et al. 2010). Then distances to the surface
/// are made least by Gauss-Newton steps, with the weights of Cauchy so that stubs and what was printed wrong do not pull.
///
/// All functions are thread-safe; results do not depend on the number of threads. What does not fit throws `InputError`, a
/// cancelled `context` `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/solid.hpp"

namespace slicecorr {

/// Places all over a surface, each for the same share of its area.
struct SurfaceSamples {
  std::vector<Point3> points;   ///< mm
  std::vector<Point3> normals;  ///< outwards, of length 1
  double area_mm2 = 0;          ///< of the whole surface
};
/// The same samples whenever the mesh is the same. Throws where the mesh has no area.
SurfaceSamples sample_surface(const TriangleMesh& mesh, std::size_t count);

struct Scan {
  std::string source;
  std::vector<Point3> points;   ///< mm; of a mesh places all over it
  std::vector<Point3> normals;  ///< of a mesh, outwards, of length 1; else empty
  std::size_t triangles = 0;    ///< of a mesh; 0: points
  std::string unit;             ///< in which the file's numbers were taken, "mm"
  std::vector<std::string> notes;
};

struct ScanReading {
  /// "auto", "um", "mm", "cm", "inch" or "m". "auto": the one in which the scan's size is nearest to that of the surface.
  std::string unit = "auto";
  double voxel_um = 0;  ///< side of a voxel, of volumes; else 0
  std::size_t most_points =
      400'000;  ///< >= 1000; of larger clouds every Nth point is taken, which is noted
};

/// Reads a mesh (STL, PLY, OBJ, OFF, 3MF), points (PLY or OBJ without faces), or a volume of grey values, bright where the
/// part is: an array of NumPy (.npy, axes z, y, x), or a folder of TIFF slices in the order of their names. Of a volume
/// the points are those between voxels where it passes the value half way between part and empty, which is noted.
/// `surface`: what it should look like,
/// which gives the unit. Throws where the file can't be read, has less than 100 points, or is in no unit as large as the
/// surface (less than a quarter of its diagonal, or more than four of them).
Scan read_scan(const std::string& path, const TriangleMesh& surface,
               const ScanReading& reading = {}, const ExecutionContext& context = {});

/// A turn, then a shift.
struct Pose {
  std::array<Point3, 3> turn{Point3{1, 0, 0}, Point3{0, 1, 0},
                             Point3{0, 0, 1}};  ///< rows of a rotation
  Point3 shift{};                               ///< mm
  Point3 turned(const Point3& v) const {
    Point3 out{};
    for (std::size_t i = 0; i < 3; ++i) {
      out[i] = turn[i][0] * v[0] + turn[i][1] * v[1] + turn[i][2] * v[2];
    }
    return out;
  }
  Point3 of(const Point3& p) const {
    const Point3 t = turned(p);
    return {t[0] + shift[0], t[1] + shift[1], t[2] + shift[2]};
  }
};

struct Registration {
  Pose pose;                ///< from the scan to the surface
  double median_um = 0;     ///< of absolute distances after it
  double within_share = 0;  ///< of points that lie within `reach_um` of the surface, 0..1
  double reach_um = 0;      ///< a twentieth of the surface's diagonal
  double mirrored_um = 0;   ///< median of the mirror image of the scan where it fits best
  int rounds = 0;           ///< of the last, close search
  bool sided = false;       ///< the scan's normals were heeded: they face as the surface does
};

/// How a scan lies to a surface. Throws, with the distances that are left, where the mirror image fits much better, where
/// half of the points stay farther away than a hundredth of the diagonal and 0.05 mm, or where less than half of the points
/// come near at all: then it is another part.
Registration register_scan(const Scan& scan, const TriangleMesh& surface,
                           const MeshDistance& distance, const ExecutionContext& context = {});

/// How far a share of the points is off, um; above 0: too much was printed.
struct DeviationFigures {
  std::string name;
  std::size_t points = 0;
  double mean_um = 0, mean_abs_um = 0, p95_um = 0,
         largest_um = 0;  ///< the last two of absolute distances
};

struct WorstPlace {
  Point3 place{};  ///< on the surface, mm
  double deviation_um = 0;
};
struct UnseenPlace {
  Point3 place{};  ///< middle of it, mm
  double area_mm2 = 0;
};

struct Deviation {
  std::string against;  ///< "design" or "predicted"
  DeviationFigures all;
  double rms_um = 0;
  std::size_t beside =
      0;  ///< points farther from the surface than `reach_um`: counted nowhere else
  double reach_um = 0;
  /// Sideways, facing the platform, facing the window, on the platform.
  std::vector<DeviationFigures> facing;
  std::vector<DeviationFigures> heights;  ///< ten slabs from the platform on
  /// Of faces towards the platform, by how deep the resin between them and what is next towards the platform is.
  std::vector<DeviationFigures> gaps;
  std::vector<WorstPlace> worst;  ///< at most ten, each a twentieth of the diagonal from the others
  double unseen_share = 0;        ///< of the surface, no point of the scan near it
  std::vector<UnseenPlace> unseen;  ///< the ten largest
  /// Where each point that counts lies, how far off it is, and which way the surface faces there.
  std::vector<Point3> places;
  std::vector<float> off_um;
  std::vector<std::array<float, 3>> normals;
};

/// `reach_mm`: > 0, points farther away are no part of the print.
Deviation deviation_from(const Scan& scan, const Pose& pose, const TriangleMesh& surface,
                         const MeshDistance& distance, std::string_view against, double reach_mm,
                         const ExecutionContext& context = {});

/// A scan beside all that it was measured against.
struct ScanComparison {
  std::string scan;  ///< file
  std::string unit;
  std::size_t points = 0, triangles = 0;
  std::vector<std::string> notes;
  std::string posed_by;  ///< "predicted" or "design": what the pose was found with
  Registration registration;
  std::vector<Deviation> deviations;
  /// An object with a final newline.
  std::string to_json() const;
  /// Some lines of plain text.
  std::string to_text() const;
};

/// What a scan is measured against: "design" or "predicted".
struct ScanSurface {
  std::string against;
  TriangleMesh mesh;
};
struct ScanAsk {
  ScanReading reading;
  double reach_um = 0;  ///< 0: a twentieth of the surface's diagonal
};
struct ComparedScan {
  Scan scan;
  ScanComparison comparison;
};
/// Reads a scan, lays it onto the last of these surfaces and measures it against all. Throws as `read_scan` and
/// `register_scan`, and where there is no surface.
ComparedScan compare_scan(const std::string& path, const std::vector<ScanSurface>& surfaces,
                          const ScanAsk& ask = {}, const ExecutionContext& context = {});
/// Of what is predicted in one piece: half a gigabyte with the distances to it.
inline constexpr double kMostPredictedTriangles = 1e7;
/// What a stack is predicted to print, with about `most_triangles` at most: where it would have more, every second pixel
/// (third, ...) is taken, which is told.
TriangleMesh predicted_surface(const SliceSource& shown, const PlaceModels& models,
                               double most_triangles, const ExecutionContext& context = {});

/// What the comparison of one print says of a laboratory.
struct DriftPrint {
  std::string source, name;  ///< the file with the figures, the scan's name
  std::string against;
  double mean_um = 0, mean_abs_um = 0, p95_um = 0;
};
/// Reads what `ScanComparison::to_json` wrote. Throws, naming `source` and the key.
DriftPrint read_comparison(std::string_view json, const std::string& source);

/// One figure over the prints, and its band: three standard deviations about the mean of the prints that were settled,
/// where the standard deviation is that of prints that follow each other (a chart of individuals and moving ranges,
/// Shewhart), at least 0.1 um.
struct DriftBand {
  std::string name;
  std::vector<double> values_um;
  double middle_um = 0, low_um = 0, high_um = 0;
  std::vector<std::size_t> beyond;  ///< which prints lie outside
  std::vector<std::size_t> runs;    ///< which is the eighth in a row on one side of the middle
};
struct ScanDrift {
  std::vector<DriftPrint> prints;
  std::size_t settled = 0;  ///< the first so many say the bands
  std::vector<DriftBand> bands;
  /// Whether the last print lies outside of a band.
  bool last_is_beyond() const;
  /// An object with a final newline; lines of plain text; a page that needs no other file.
  std::string to_json() const;
  std::string to_text() const;
  std::string to_page() const;
  /// The chart of the page alone.
  std::string to_svg() const;
};
/// `prints` in their order, three or more; `settled`: 0: all. Throws where these are fewer, or not all measured against
/// the same.
ScanDrift scan_drift(const std::vector<DriftPrint>& prints, std::size_t settled = 0);

/// A page that needs no other file: the part in the round in the colours of its deviations, sections with the outlines of
/// `surfaces` (as `comparison.deviations`) and the scan's points, histograms, tables.
std::string scan_page(const ScanComparison& comparison, const Scan& scan,
                      const std::vector<const TriangleMesh*>& surfaces);

}  // namespace slicecorr
