// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/part_slices.hpp"

#include <algorithm>
#include <iterator>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

MeshOptions cut_for(const LayerHeights& heights, const MeshOptions& mesh) {
  MeshOptions cut = mesh;
  if (heights.alike()) return cut;
  cut.layer_um = thin_slice_um(heights);
  cut.raised_um = 0.5 * cut.layer_um;
  return cut;
}

LayerHeights adaptive_heights_of(const MeshOptions& mesh,
                                 const std::vector<std::string>& left_alone,
                                 const std::vector<double>& least_and_most_um) {
  MeshOptions all = mesh;
  std::copy_if(left_alone.begin(), left_alone.end(), std::back_inserter(all.parts), is_mesh_name);
  return adaptive_heights(read_parts(all, {}).mesh, least_and_most_um.at(0),
                          least_and_most_um.at(1));
}

void add_heights_to(CLI::App& app, std::string& table, std::vector<double>& adaptive_um) {
  CLI::Option* const layer_um = app.get_option("--layer-um");
  CLI::Option* const layers =
      app.add_option(
             "--layers", table,
             "Heights of layers that differ, in place of --layer-um. A table with the columns "
             "slice,layer_um: each row holds from its slice on")
          ->check(CLI::ExistingFile)
          ->excludes(layer_um);
  app.add_option(
         "--adaptive-um", adaptive_um,
         "LOW,HIGH: layers as high as slopes allow, in multiples of LOW up to HIGH, in place of "
         "--layer-um: no slope lies further from its steps than LOW")
      ->delimiter(',')
      ->expected(2)
      ->check(number_in(2, 1000))
      ->excludes(layer_um)
      ->excludes(layers);
}

PartSlices::PartSlices(const MeshOptions& options, const Printer& printer,
                       const LayersWanted& wanted, const ExecutionContext& context,
                       PartFacts* facts)
    : cuts_(slice_parts(cut_for(wanted.heights, options), printer, wanted.surface,
                        wanted.left_alone, place_, context, facts)) {
  if (!wanted.heights.alike()) uneven_.emplace(cuts_, wanted.heights);
}

const SliceSource& PartSlices::operator*() const {
  return uneven_ ? static_cast<const SliceSource&>(*uneven_) : cuts_;
}

}  // namespace slicecorr::cli
