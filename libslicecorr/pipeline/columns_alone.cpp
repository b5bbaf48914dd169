// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/columns_alone.hpp"

#include <optional>
#include <utility>

#include "pipeline/design_band.hpp"
#include "pipeline/dose_meter.hpp"
#include "pipeline/robust_design.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose_target.hpp"

namespace slicecorr::detail {

namespace {

/// The solve gives the last slice first. Null pointers: none.
CodedBand levels_of(const CorrectionPlan& plan, const Uncertainty* robust, std::size_t columns,
                    const BandReader& reader, const CodedBand* heights, const CodedBand* left_alone,
                    const DoseTarget* doses, const CodedBand* dose_bytes,
                    BandCorrector::ColumnLevels most) {
  if (robust) {
    const CodedDesign design(columns, reader, heights, Surface::mesh, left_alone);
    return robust_levels(plan, *robust, design, {}).levels;
  }
  const WantedBand wanted{doses, dose_bytes};
  BandCorrector corrector = dose_bytes ? BandCorrector(plan, columns, wanted.of_columns())
                                       : BandCorrector(plan, columns, left_alone != nullptr);
  if (most) corrector.keep_light(std::move(most));
  LeftAloneRows left_rows(left_alone);
  read_design(reader, heights, Surface::mesh,
              [&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
                corrector.add_layer(rows, its_heights, left_rows.at(n));
              });
  CodedBand upwards(columns);
  corrector.solve([&](int, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
    upwards.append(dark ? nullptr : levels);
  });
  return upwards;
}

}  // namespace

CodedBand levels_alone(const SliceSource& target, const PlacePlans& plans, const PixelBox& band) {
  const std::size_t columns = columns_of(band);
  const BandReader read = reader_of(target, band);
  const DoseTarget* const doses = target.doses();
  if (plans.even()) {
    const auto heights = edge_heights_of(target, band);
    const auto left_alone = left_alone_of(target, band);
    std::optional<CodedBand> bytes;
    if (doses) bytes = coded_band_of(*doses->images, band);
    return levels_of(plans.plan(), plans.robust(), columns, read, heights ? &*heights : nullptr,
                     left_alone ? &*left_alone : nullptr, doses, bytes ? &*bytes : nullptr,
                     plans.even_levels(plans.models().map().reference(), pixels_of_columns(band)));
  }
  std::vector<BandReader> readers;
  if (doses) readers.push_back(reader_of(*doses->images, band));
  const std::size_t own = readers.size();
  readers.push_back(read);
  const GroupedBand grouped(plans.models().map(), band,
                            with_target(std::move(readers), target, band));
  std::vector<CodedBand> coded_bands;
  for (const GroupedBand::Group& g : grouped.groups) {
    coded_bands.push_back(
        levels_of(plans.plan(g.value), plans.robust(), g.columns.size(), g.reader(own), g.heights(),
                  g.left_alone(), doses, doses ? g.sources.data() : nullptr,
                  plans.even_levels(g.value, pixels_of_columns(band, g.columns))));
  }
  Joiner joined(grouped, columns, std::move(coded_bands));
  CodedBand upwards(columns);
  for (int k = 0; k < plans.all_layers(); ++k) upwards.append(joined.at(k));
  return upwards;
}

void to_pixels(std::vector<std::uint8_t>& levels, int count) {
  if (count == 256) return;
  for (std::uint8_t& level : levels)
    level = static_cast<std::uint8_t>(pixel_of_level(level, count));
}

}  // namespace slicecorr::detail
