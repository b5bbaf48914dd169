// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "even/planned_images.hpp"

#include <algorithm>
#include <map>
#include <vector>

#include "bands/bands.hpp"
#include "bands/design_band.hpp"
#include "base/coded_band.hpp"
#include "correct/even_column.hpp"

namespace slicecorr::detail {

namespace {

/// A column has this value from this slice on.
struct Change {
  std::uint32_t column;
  std::int32_t at;
  std::uint8_t value;
};

/// The coverage of a band as changes along its columns, column by column.
std::vector<Change> coverage_of(const SliceSource& target, const PixelBox& band) {
  std::vector<Change> changes;
  std::vector<std::uint8_t> before(columns_of(band), 0);
  target.read_band(band, [&](int n, const std::uint8_t* rows) {
    for (std::size_t i = 0; i < before.size(); ++i) {
      const std::uint8_t value = rows ? rows[i] : std::uint8_t{0};
      if (value == before[i]) continue;
      changes.push_back({static_cast<std::uint32_t>(i), n, value});
      before[i] = value;
    }
  });
  std::stable_sort(changes.begin(), changes.end(),
                   [](const Change& a, const Change& b) { return a.column < b.column; });
  return changes;
}

/// The light of columns of one value of light.
struct Place {
  Place(const PlacePlans& plans, std::uint8_t value, const PixelBox& band)
      : even(plans.even_levels(value, pixels_of_columns(band))),
        column(*plans.plan(value).inhibited),
        most(static_cast<std::size_t>(plans.all_layers())) {}
  BandCorrector::ColumnLevels even;
  EvenColumn column;
  std::vector<Level> most;
};

}  // namespace

void PlannedImages::read_band(const PixelBox& band, const Sink& sink) const {
  const std::vector<Change> coverage = coverage_of(target_, band);
  const LightMap& map = plans_.models().map();
  const auto pixel_of = pixels_of_columns(band);
  const int layers = target_.grid().layers;
  std::map<std::uint8_t, Place> places;
  std::vector<Change> shown;
  std::vector<CoverageRun> runs;
  for (std::size_t i = 0; i < coverage.size();) {
    const std::uint32_t column = coverage[i].column;
    runs.clear();
    for (; i < coverage.size() && coverage[i].column == column; ++i) {
      const bool more = i + 1 < coverage.size() && coverage[i + 1].column == column;
      if (coverage[i].value == 0) continue;
      runs.push_back({coverage[i].at, more ? coverage[i + 1].at : layers, coverage[i].value});
    }
    const Pixel pixel = pixel_of(column);
    const std::uint8_t value = map.value(pixel.x, pixel.y);
    auto found = places.find(value);
    if (found == places.end()) {
      found = places.try_emplace(value, plans_, value, band).first;
    }
    Place& place = found->second;
    place.even(column, place.most.data());
    const std::vector<Level>& levels = place.column.levels(runs, place.most);
    std::uint8_t before = 0;
    for (int n = 0; n < layers; ++n) {
      const Level level = levels[static_cast<std::size_t>(n)];
      if (level == before) continue;
      shown.push_back(
          {column, n, static_cast<std::uint8_t>(pixel_of_level(level, plans_.levels()))});
      before = level;
    }
  }
  std::stable_sort(shown.begin(), shown.end(),
                   [](const Change& a, const Change& b) { return a.at < b.at; });
  const auto left_alone = left_alone_of(target_, band);
  LeftAloneRows left_rows(left_alone ? &*left_alone : nullptr);
  std::vector<std::uint8_t> now(columns_of(band), 0), both(now.size());
  std::size_t next = 0, lit = 0;
  for (int n = 0; n < layers; ++n) {
    for (; next < shown.size() && shown[next].at == n; ++next) {
      std::uint8_t& pixel = now[shown[next].column];
      lit -= static_cast<std::size_t>(pixel != 0);
      pixel = shown[next].value;
      lit += static_cast<std::size_t>(pixel != 0);
    }
    const std::uint8_t* const left = left_rows.at(n);
    if (!left) {
      sink(n, lit > 0 ? now.data() : nullptr);
      continue;
    }
    std::transform(now.begin(), now.end(), left, both.begin(),
                   [](std::uint8_t a, std::uint8_t b) { return std::max(a, b); });
    sink(n, both.data());
  }
}

void LitPart::read_band(const PixelBox& band, const Sink& sink) const {
  const std::size_t columns = columns_of(band);
  CodedBand covered(columns);
  target_.read_band(band, [&](int, const std::uint8_t* rows) { covered.append(rows); });
  std::vector<std::uint8_t> rows(columns);
  images_.read_band(band, [&](int n, const std::uint8_t* pixels) {
    if (n >= covered.slices()) return;
    if (!pixels) return sink(n, nullptr);
    covered.read(n, rows.data());
    for (std::size_t i = 0; i < columns; ++i) rows[i] = lit(pixels[i], rows[i]);
    sink(n, rows.data());
  });
}

}  // namespace slicecorr::detail
