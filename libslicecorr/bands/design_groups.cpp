// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/design_groups.hpp"

#include <utility>

#include "bands/bands.hpp"

namespace slicecorr::detail {

GroupedBand::GroupedBand(const LightMap& map, const PixelBox& band,
                         const std::vector<BandReader>& readers) {
  const std::size_t columns = columns_of(band);
  std::vector<std::uint8_t> lit(columns, 0), rows(columns), gathered(columns);
  std::vector<CodedBand> whole;
  for (const BandReader& read : readers) {
    CodedBand coded(columns);
    read([&](int, const std::uint8_t* layer) {
      coded.append(layer);
      for (std::size_t k = 0; layer && k < columns; ++k) lit[k] |= layer[k];
    });
    whole.push_back(std::move(coded));
  }
  for (LightGroup& g : light_groups(map, band, lit.data())) {
    groups.push_back({g.value, std::move(g.columns), {}});
  }
  for (const CodedBand& coded : whole) {
    for (Group& g : groups) g.sources.emplace_back(g.columns.size());
    for (int n = 0; n < coded.slices(); ++n) {
      const bool black = coded.black(n);
      if (!black) coded.read(n, rows.data());
      for (Group& g : groups) {
        if (!black) {
          for (std::size_t k = 0; k < g.columns.size(); ++k) gathered[k] = rows[g.columns[k]];
        }
        g.sources.back().append(black ? nullptr : gathered.data());
      }
    }
  }
}

/// What groups point to: of even light the rows that are kept, else all of them.
struct DesignBand::Kept {
  std::size_t columns = 0;
  std::optional<CodedBand> heights, left_alone, doses, beside;
  std::optional<GroupedBand> grouped;
};

DesignBand::DesignBand(const SliceSource& target, const LightMap& map, const PixelBox& box,
                       DesignAsk ask)
    : kept_(std::make_unique<Kept>()) {
  Kept& k = *kept_;
  k.columns = columns_of(box);
  if (!ask.coverage) ask.coverage = reader_of(target, box);
  const DoseTarget* const doses = ask.doses ? target.doses() : nullptr;
  if (map.even()) {
    k.heights = edge_heights_of(target, box);
    k.left_alone = left_alone_of(target, box);
    if (doses) k.doses = coded_band_of(*doses->images, box);
    DesignGroup g;
    g.value = map.reference();
    g.columns = k.columns;
    g.place = pixels_of_columns(box);
    g.coverage = std::move(ask.coverage);
    if (k.heights) g.heights = &*k.heights;
    if (k.left_alone) g.left_alone = &*k.left_alone;
    if (k.doses) g.doses = WantedBand{doses, &*k.doses};
    if (ask.beside) g.beside = &k.beside.emplace(coded_band_of(*ask.beside, box));
    groups_.push_back(std::move(g));
    return;
  }
  // The coverage, and of what else is there its place among the readers.
  std::vector<BandReader> readers{std::move(ask.coverage)};
  const auto add = [&](const SliceSource* source) {
    if (source) readers.push_back(reader_of(*source, box));
    return source ? readers.size() - 1 : 0;
  };
  const std::size_t heights = add(target.edge_heights()), left_alone = add(target.left_alone()),
                    wanted = add(doses ? doses->images : nullptr), beside = add(ask.beside);
  k.grouped.emplace(map, box, readers);
  for (const GroupedBand::Group& of : k.grouped->groups) {
    DesignGroup g;
    g.value = of.value;
    g.columns = of.columns.size();
    g.of_band = &of.columns;
    const auto width = static_cast<std::uint32_t>(box.width());
    g.place = [&of, box, width](std::size_t column) {
      return Pixel{box.x0 + static_cast<int>(of.columns[column] % width),
                   box.y0 + static_cast<int>(of.columns[column] / width)};
    };
    g.coverage = reader_of(of.sources[0]);
    if (heights > 0) g.heights = &of.sources[heights];
    if (left_alone > 0) g.left_alone = &of.sources[left_alone];
    if (wanted > 0) g.doses = WantedBand{doses, &of.sources[wanted]};
    if (beside > 0) g.beside = &of.sources[beside];
    groups_.push_back(std::move(g));
  }
}

DesignBand::~DesignBand() = default;

void DesignBand::count(LightCounts& counts) const {
  for (const DesignGroup& g : groups_) counts[g.value] += g.columns;
}

void DesignBand::each(int slices,
                      const std::function<void(const DesignGroup&, const PutRows&)>& make,
                      const PutRows& put) const {
  if (!kept_->grouped) return make(groups_.front(), put);
  std::vector<CodedBand> made;
  for (const DesignGroup& g : groups_) {
    CodedBand& coded = made.emplace_back(g.columns);
    make(g, [&](int, const std::uint8_t* rows) { coded.append(rows); });
  }
  std::vector<std::uint8_t> joined(kept_->columns, 0), part(kept_->columns);
  for (int n = slices; n-- > 0;) {
    const int at = slices - 1 - n;
    bool black = true;
    for (std::size_t g = 0; g < made.size(); ++g) {
      black = black && made[g].black(at);
      made[g].read(at, part.data());
      const std::vector<std::uint32_t>& columns = *groups_[g].of_band;
      for (std::size_t k = 0; k < columns.size(); ++k) joined[columns[k]] = part[k];
    }
    put(n, black ? nullptr : joined.data());
  }
}

}  // namespace slicecorr::detail
