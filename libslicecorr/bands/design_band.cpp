// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/design_band.hpp"

#include <algorithm>
#include <cstring>
#include <vector>

#include "correct/coverage.hpp"

namespace slicecorr::detail {

namespace {

constexpr std::uint8_t kMostGrey = kFull - 1;

}  // namespace

BandReader reader_of(const CodedBand& coded) {
  return [&coded](const SliceSource::Sink& sink) {
    std::vector<std::uint8_t> rows(coded.columns());
    for (int n = 0; n < coded.slices(); ++n) {
      if (coded.black(n)) {
        sink(n, nullptr);
        continue;
      }
      coded.read(n, rows.data());
      sink(n, rows.data());
    }
  };
}

const std::uint8_t* as_sliced(const std::uint8_t* coverage, const std::uint8_t* left_alone,
                              std::vector<std::uint8_t>& room) {
  if (!left_alone) return coverage;
  if (!coverage) return left_alone;
  for (std::size_t i = 0; i < room.size(); ++i) room[i] = std::max(coverage[i], left_alone[i]);
  return room.data();
}

void read_as_sliced(const SliceSource& target, const PixelBox& band,
                    const SliceSource::Sink& sink) {
  const auto left_alone = left_alone_of(target, band);
  LeftAloneRows rows_left(left_alone ? &*left_alone : nullptr);
  std::vector<std::uint8_t> room(columns_of(band));
  target.read_band(band, [&](int n, const std::uint8_t* rows) {
    sink(n, as_sliced(rows, rows_left.at(n), room));
  });
}

const std::uint8_t* marked(const std::uint8_t* coverage, const std::uint8_t* left_alone,
                           std::vector<std::uint8_t>& room) {
  if (!left_alone) return coverage;
  for (std::size_t i = 0; i < room.size(); ++i) {
    // A grey, whatever it shows: neither a feature nor a gap.
    room[i] = left_alone[i] ? std::min(left_alone[i], kMostGrey)
              : coverage    ? coverage[i]
                            : std::uint8_t{0};
  }
  return room.data();
}

CodedBand marked_band_of(const SliceSource& target, const PixelBox& band) {
  if (!target.left_alone()) return coded_band_of(target, band);
  const auto left_alone = left_alone_of(target, band);
  LeftAloneRows left_rows(left_alone ? &*left_alone : nullptr);
  CodedBand coded(columns_of(band));
  std::vector<std::uint8_t> room(columns_of(band));
  target.read_band(band, [&](int n, const std::uint8_t* rows) {
    coded.append(marked(rows, left_rows.at(n), room));
  });
  return coded;
}

namespace {

void predict_tiles(BandPredictor& predictor, const ShownSlicesOf& shown, const CodedDesign& design,
                   const ExecutionContext& context) {
  constexpr std::size_t lanes = BandPredictor::kTileColumns;
  constexpr int most = 64;
  const std::size_t columns = shown.band.columns();
  std::vector<std::uint8_t> pixels(columns * most), coverage(columns * most), heights;
  std::vector<std::uint8_t> lit(lanes * most, 0), cover(lanes * most, 0), edges;
  if (design.heights) {
    heights.resize(columns * most);
    edges.resize(lanes * most, 0);
  }
  for (int end = predictor.all_layers(); end > 0;) {
    context.check_cancelled();
    const bool dark = end > shown.layers;
    const int begin = std::max({0, end - most, dark ? shown.layers : 0});
    const auto count = static_cast<std::size_t>(end - begin);
    bool any_heights = false;
    for (std::size_t k = 0; k < count; ++k) {
      const int n = begin + static_cast<int>(k);
      shown.band.read(n, &pixels[k * columns]);
      design.coverage.read(n, &coverage[k * columns]);
      if (!design.heights) continue;
      design.heights->read(n, &heights[k * columns]);
      any_heights = any_heights || (n < design.heights->slices() && !design.heights->black(n));
    }
    for (std::size_t b = 0; b < columns; b += lanes) {
      const std::size_t width = std::min(lanes, columns - b);
      for (std::size_t k = 0; k < count; ++k) {
        std::copy_n(&pixels[k * columns + b], width, &lit[k * lanes]);
        std::copy_n(&coverage[k * columns + b], width, &cover[k * lanes]);
        if (any_heights) std::copy_n(&heights[k * columns + b], width, &edges[k * lanes]);
      }
      predictor.add_tile({b, width, begin, end - begin}, dark ? nullptr : lit.data(),
                         {cover.data(), any_heights ? edges.data() : nullptr});
    }
    end = begin;
  }
}

}  // namespace

void predict_shown(BandPredictor& predictor, const ShownSlicesOf& shown, const CodedDesign& design,
                   const ExecutionContext& context) {
  if (predictor.takes_tiles() && !design.left_alone) {
    predict_tiles(predictor, shown, design, context);
    return;
  }
  const std::size_t columns = shown.band.columns();
  std::vector<std::uint8_t> pixels(columns), coverage(columns), height_rows(columns);
  LeftAloneRows left_alone(design.left_alone);
  for (int n = predictor.all_layers(); n-- > 0;) {
    if ((n & 63) == 0) context.check_cancelled();
    shown.band.read(n, pixels.data());
    design.coverage.read(n, coverage.data());
    predictor.add_slice(
        n, n < shown.layers ? pixels.data() : nullptr,
        {coverage.data(), design.heights_at(n, height_rows.data()), left_alone.at(n)});
    if (shown.watch && n < shown.layers) shown.watch->add_slice(n, pixels.data());
  }
}

}  // namespace slicecorr::detail
