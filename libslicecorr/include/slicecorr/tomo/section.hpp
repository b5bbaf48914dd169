// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/section.hpp
/// What a job prints, cut open: dose against target in planes of voxels, as pictures.
///
/// Lengths from the axis (x, y) and from the optical axis (z, upwards), mm. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::tomo {

/// A job, the doses that its frames leave, and its figures.
struct Printed {
  TomoJob job;
  Box<float> dose;
  PrintFigures figures;
};
/// As `dose_of` and `figures_of`, which it calls; the bound of contrast is the job's.
Printed printed(TomoJob job, const ExecutionContext& context = {});

/// Which coordinate a plane keeps.
enum class Axis { x, y, z };

/// Where to cut.
struct Plane {
  Axis axis = Axis::z;
  double at_mm = 0;
};

/// The three planes through the middle of the part's box.
std::vector<Plane> middle_planes(const Printed& print);

/// What stands in a voxel.
enum class Matter : std::uint8_t { nothing, resin, insert };

/// A plane of voxels: x to the right, or y in planes of x; z upwards, or y in planes of z. Numbers
/// row by row, the lowest row first.
struct PrintSection {
  Axis axis = Axis::z;
  double at_mm = 0;  ///< of the voxels' middles
  int width = 0, height = 0;
  double voxel_mm = 0;
  double gel_dose = 0;               ///< > 0
  std::string unit = "mJ/cm³";       ///< of doses
  std::vector<float> dose;           ///< 0 where there is no resin
  std::vector<std::uint8_t> target;  ///< coverage: 255 part, 0 empty, between: neither
  std::vector<Matter> matter;
  std::size_t missing() const;  ///< part below the gel dose
  std::size_t gelled() const;   ///< void at the gel dose or above it
};

/// The planes of voxels nearest to where they are asked for, cut down alike to the part, what gels
/// and inserts, with a margin. Throws `InputError` for planes outside of the resin.
std::vector<PrintSection> sections_of(const Printed& print, const std::vector<Plane>& planes);
/// The same of any doses on the grid of voxels: `matter` and `part` are those of all voxels.
std::vector<PrintSection> sections_of(const Box<float>& dose, const Box<std::uint8_t>& part,
                                      const Box<std::uint8_t>& insert, double voxel_mm,
                                      double gel_dose, const std::vector<Plane>& planes,
                                      double middle_z_mm = 0);

/// The slice where a part fails that no light prints.
PrintSection section_of(const Evidence& evidence);

/// What the voxels of a picture are coloured by.
enum class ColouredBy {
  dose,    ///< blue below the gel dose, yellow to red above it
  print,   ///< grey where it gels
  target,  ///< grey where it should
};

/// The sections side by side at one scale, with the line where the dose reaches the gel dose, the
/// outline of the target, hatched wrong voxels, a scale bar and a legend. A wrong voxel is never
/// left out, however small the picture.
std::string sections_svg(const std::vector<PrintSection>& sections, ColouredBy by,
                         const std::string& title);
/// The same as PNG.
std::string sections_png(const std::vector<PrintSection>& sections, ColouredBy by,
                         const std::string& title);

}  // namespace slicecorr::tomo
