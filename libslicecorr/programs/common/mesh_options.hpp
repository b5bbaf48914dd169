// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What every program that slices can be told of its meshes.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "slicecorr/left_alone.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/plate.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::cli {

/// A file of a plate, and how its mesh is scaled and turned.
struct PlacedFile {
  std::string path;
  Placement placement;
};

struct MeshOptions {
  std::vector<std::string> parts;
  double layer_um = 0;
  double raised_um = 0;  ///< `SliceOptions::raised_um`
  std::string antialias = "on";
  std::vector<double> center_mm;
  std::string units = "auto";
  double scale = 1.0;
  double fit_mm = 0;  ///< longest side of all parts together; 0: as `scale` says
  std::vector<double> rotate_deg;
  PlateChoices plate;
  int plates = 1;         ///< at most so many plates
  int of_plate = 0;       ///< the parts of which of them are sliced
  Shrinkage shrinkage{};  ///< of the resin, where parts are made for one
  void add_to(CLI::App& app);
  void add_antialias_to(CLI::App& app);
  /// Only how meshes are turned, scaled and placed; `add_to` has these, too.
  void add_placement_to(CLI::App& app);
  /// The same but for the place.
  void add_turns_to(CLI::App& app);
  /// What parts do on one plate, of commands that slice. `copies`: a part may be given as PART*N.
  void add_plate_to(CLI::App& app, bool copies = true);
  /// The files of all parts: "part.stl*3" is thrice "part.stl", where no file has that name.
  std::vector<std::string> files() const;
  /// Whether parts lie side by side: copies do, where nobody says where each lies.
  bool arranges() const;
  /// Whether parts lie elsewhere than in their files.
  bool places() const { return arranges() || !plate.places_mm.empty(); }
  /// Where `fit_mm` is set, the first call reads the parts for their size; copies made after that
  /// scale other meshes alike. Throws as `read_mesh`.
  Placement placement() const;
  /// The files of all parts as `files()`, each with its own size and turn, where it has one. Throws as
  /// `read_mesh`, and where what parts have of their own does not fit their number.
  std::vector<PlacedFile> placed_files() const;
  /// `surface`: mesh gives targets edge heights.
  SliceOptions slice_options(Surface surface) const;

 private:
  bool own_size(std::size_t part) const;
  Point3 turn_of(std::size_t part) const;
  void check_own() const;
  /// The factor of `fit_mm` on the parts that have no size of their own.
  double fit_of_others() const;
  mutable double fit_factor_ = 0;  ///< 0: not known yet
};

/// What parts have of their own, said once for each of `MeshOptions::files`.
PlateChoices for_copies(const PlateChoices& plate, const std::vector<std::string>& parts);

struct PlateParts {
  TriangleMesh mesh;
  EdgeDefects edge_defects;
  std::vector<std::string>
      defects;  ///< a line for each file whose print may not be what was meant: "part.stl: 3 open edges"
};

/// What is known of parts besides their slices.
struct PartFacts {
  std::size_t triangles = 0;
  std::vector<std::string> defects;  ///< as `PlateParts` has them
};

/// Reads all parts as their files place them; tells their figures and defects through `context`.
PlateParts read_parts(const MeshOptions& options, const ExecutionContext& context);

/// A part of a plate.
struct PlacedPart {
  std::string path;
  TriangleMesh
      on_plate;  ///< mm, from the plate's corner at the least x and y, and above the platform
  int quarter_turns = 0;           ///< 0..3
  MeshReport report;               ///< of its file
  std::vector<std::string> notes;  ///< what of the file is no part, and what else reading it told
};
/// The parts of one plate where they are printed. Refuses what does not fit, as slicing does.
std::vector<PlacedPart> placed_parts(const MeshOptions& options, const Printer& printer,
                                     const ExecutionContext& context);

/// The plates that the parts take on this printer's display; 1 where they are not arranged.
int plates_needed(const MeshOptions& options, const Printer& printer,
                  const ExecutionContext& context);

/// Reads all parts to be sliced for this printer, arranges them where that is asked for, and refuses parts
/// that overlap.
MeshSlices slice_parts(const MeshOptions& options, const Printer& printer, Surface surface,
                       const ExecutionContext& context);

/// The same with what is left alone beside them. Meshes among these files share the plate with the
/// parts as placed: the centre and the least height are those of all. `place`: how they lie then;
/// `facts`: of the parts, where not null.
MeshSlices slice_parts(const MeshOptions& options, const Printer& printer, Surface surface,
                       const std::vector<std::string>& left_alone, MeshesLeftAlone& place,
                       const ExecutionContext& context, PartFacts* facts = nullptr);

/// The option --leave-alone of programs that correct, or measure what is corrected.
void add_leave_alone_to(CLI::App& app, std::vector<std::string>& files);
/// The option of programs to which an archive is given: --part, where no positional PART is meant.
void add_part_inside_to(CLI::App& app, std::vector<std::string>& files,
                        const std::string& name = "--part");
/// Parts in an archive, as `options` turn and scale their meshes.
PartsInside parts_inside(const std::vector<std::string>& files, const MeshOptions& options);

}  // namespace slicecorr::cli
