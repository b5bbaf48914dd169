// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the subcommands of `slicecorr` do that work on a part and its stack; others have files of their
/// own.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "options.hpp"
#include "oxygen.hpp"
#include "programs/common/dose_options.hpp"
#include "programs/common/uncertain_options.hpp"
#include "simulate.hpp"
#include "slicecorr/load_display.hpp"

namespace slicecorr::cli {

/// Options of all subcommands; only those of the one called are filled.
/// Throws `InputError` where an archive says another height of layers than `layer_um`, which is for those that say none;
/// 0: nobody said one.
void check_layer_height(const std::string& path, double layer_um);

struct Arguments {
  MeshOptions mesh;
  SetupOptions setup;
  UncertainOptions uncertain;
  DoseOptions doses;
  OxygenOptions oxygen;
  SimulateOptions simulate;
  std::string input, output, format, target, json, kept;
  std::vector<std::string> leave_alone, inside;  ///< inside: meshes that the archive holds
  double layer_um = 0;
  std::string layers;               ///< of slice and run: a table of heights
  std::vector<double> adaptive_um;  ///< of slice and run: least and greatest height
  int x = -1, y = -1, reduce = 0;
  double max_height_error_um = -1, max_surface_error_um = -1;
  int max_loose_bodies = -1;  ///< -1: any number
  bool archive = false;

  StackFile file() const {
    StackFile f(output);
    f.format = format;
    f.archive = archive;
    return f;
  }
  /// What archives that do not say it are told.
  MissingFacts missing() const {
    MissingFacts facts;
    facts.layer_um = layer_um;
    if (!setup.printer.empty()) {
      const Printer p = load_display(setup.printer);
      facts.pixel_x_um = p.pixel_x_um;
      facts.pixel_y_um = p.pixel_y_um;
    }
    return facts;
  }
  /// `paths`, and the files of what is left alone.
  std::vector<std::string> with_left_alone(std::vector<std::string> paths) const {
    paths.insert(paths.end(), leave_alone.begin(), leave_alone.end());
    paths.insert(paths.end(), inside.begin(), inside.end());
    return paths;
  }
  StackReader open(const std::string& path, const std::string& scratch,
                   const ExecutionContext& context) const {
    check_layer_height(path, layer_um);
    return {path, scratch, context, missing()};
  }
};

/// Of commands that read a stack: throws `InputError` where options say how meshes lie, and none is named that they
/// are of.
void check_placement(const Arguments& a, bool meshes);
/// Whether meshes are named beside a stack: of the part in it, or of wanted doses.
inline bool names_meshes(const Arguments& a) {
  return !a.inside.empty() || !a.doses.regions.empty();
}

/// Of a page or a picture: the name of its file without folder and ending.
inline std::string title_of(const std::string& path) {
  return std::filesystem::path(path).stem().string();
}

namespace commands {

// stack_commands.cpp: what makes stacks, and what a stack says.
int slice(const Arguments& given, const ExecutionContext& context, Console& console);
int correct(const Arguments& a, const ExecutionContext& context, Console& console);
int run(const Arguments& given, const ExecutionContext& context, Console& console);
int convert(const Arguments& a, const ExecutionContext& context, Console& console);
int info(const Arguments& a, const ExecutionContext& context, Console& console);
/// What `info` says of a mesh.
int mesh_info(const Arguments& a, const ExecutionContext& context);

// view_commands.cpp: what stacks print, as figures, pages, pictures and meshes.
int verify(const Arguments& asked, const ExecutionContext& context, Console& console);
int probe(const Arguments& asked, const ExecutionContext& context, Console& console);
int report(const Arguments& asked, const ExecutionContext& context, Console& console);
int section(const Arguments& asked, const ExecutionContext& context, Console& console);
int solid(const Arguments& a, const ExecutionContext& context, Console& console);
int compare(const Arguments& a, const ExecutionContext& context, Console& console);

}  // namespace commands

}  // namespace slicecorr::cli
