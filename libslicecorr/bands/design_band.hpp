// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A band of a target as corrections and predictions see it: coverage, and where it has edge
/// heights, these, with gentle slopes made sharp (base/sharp_edges.hpp).
#pragma once

#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "bands/bands.hpp"
#include "base/coded_band.hpp"
#include "base/sharp_edges.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Gives the rows of a band's slices, first slice first, to a sink.
using BandReader = std::function<void(const SliceSource::Sink&)>;
/// The same with the edge heights of each slice's upper node, null without; of a target with edge
/// heights once more after the last slice, without coverage, for the node there.
using DesignSink = SharpEdges::Sink;
using DesignReader = std::function<void(const DesignSink&)>;

/// The edge heights of a band; nothing where the target has none.
inline std::optional<CodedBand> edge_heights_of(const SliceSource& target, const PixelBox& band) {
  if (!target.edge_heights()) return std::nullopt;
  return coded_band_of(*target.edge_heights(), band);
}

inline BandReader reader_of(const SliceSource& source, const PixelBox& band) {
  return [&source, band](const SliceSource::Sink& sink) { source.read_band(band, sink); };
}
BandReader reader_of(const CodedBand& coded);
/// What of a band is left alone; nothing where nothing is: columns are corrected faster then.
inline std::optional<CodedBand> left_alone_of(const SliceSource& target, const PixelBox& band) {
  if (!target.left_alone()) return std::nullopt;
  CodedBand coded = coded_band_of(*target.left_alone(), band);
  for (int n = 0; n < coded.slices(); ++n) {
    if (!coded.black(n)) return coded;
  }
  return std::nullopt;
}

/// Reads what is left alone slice by slice.
class LeftAloneRows {
 public:
  /// `left_alone`: null without.
  explicit LeftAloneRows(const CodedBand* left_alone)
      : left_alone_(left_alone), row_(left_alone ? left_alone->columns() : 0) {}
  /// Null: nothing is left alone in this slice. Valid until the next call.
  const std::uint8_t* at(int slice) {
    if (!left_alone_ || slice >= left_alone_->slices() || left_alone_->black(slice)) return nullptr;
    left_alone_->read(slice, row_.data());
    return row_.data();
  }

 private:
  const CodedBand* left_alone_;
  std::vector<std::uint8_t> row_;
};
/// What a slice shows that is not corrected: `coverage`, and what is left alone. Null: black.
const std::uint8_t* as_sliced(const std::uint8_t* coverage, const std::uint8_t* left_alone,
                              std::vector<std::uint8_t>& room);

/// A band of a target as it is shown where nothing is corrected: with what is left alone.
void read_as_sliced(const SliceSource& target, const PixelBox& band, const SliceSource::Sink& sink);

/// `coverage` with what is left alone as greys of what it shows, for pictures. Null: black.
const std::uint8_t* marked(const std::uint8_t* coverage, const std::uint8_t* left_alone,
                           std::vector<std::uint8_t>& room);
/// A band of a target so.
CodedBand marked_band_of(const SliceSource& target, const PixelBox& band);

/// `heights`: null without. `surface`: gentle slopes are made sharp for the mesh only.
inline void read_design(const BandReader& coverage, const CodedBand* heights, Surface surface,
                        const DesignSink& sink) {
  if (!heights) {
    coverage([&](int n, const std::uint8_t* rows) { sink(n, rows, nullptr); });
    return;
  }
  SharpEdges edges(*heights, sink, surface == Surface::mesh);
  coverage([&](int, const std::uint8_t* rows) { edges.add(rows); });
  edges.finish();
}

/// What is read of a band of a target.
struct DesignParts {
  BandReader coverage;
  const CodedBand* heights = nullptr;     ///< edge heights; null: none
  const CodedBand* left_alone = nullptr;  ///< null: nothing
};

/// A design kept to be read in any order.
struct CodedDesign {
  CodedBand coverage;
  std::optional<CodedBand> heights;       ///< one row more
  const CodedBand* left_alone = nullptr;  ///< null: nothing

  /// Nothing yet.
  CodedDesign(std::size_t columns, bool with_heights, const CodedBand* its_left_alone)
      : coverage(columns), left_alone(its_left_alone) {
    if (with_heights) heights.emplace(columns);
  }
  /// `parts`: of the target, which must outlive this.
  CodedDesign(std::size_t columns, const DesignParts& parts, Surface surface)
      : CodedDesign(columns, parts.heights != nullptr, parts.left_alone) {
    read_design(parts.coverage, parts.heights, surface,
                [this](int, const std::uint8_t* rows, const std::uint8_t* its_heights) {
                  append(rows, its_heights);
                });
  }
  /// The next slice, as a `DesignSink` gets it.
  void append(const std::uint8_t* rows, const std::uint8_t* its_heights) {
    coverage.append(rows);
    if (heights) heights->append(its_heights);
  }
  /// Null: none at this node. `out`: room for a row.
  const std::uint8_t* heights_at(int node, std::uint8_t* out) const {
    if (!heights || node >= heights->slices() || heights->black(node)) return nullptr;
    heights->read(node, out);
    return out;
  }
};

/// So many slices shown, then no light.
struct ShownSlicesOf {
  const CodedBand& band;
  int layers;
  WindowWatch* watch = nullptr;  ///< null, or takes the slices, too
};
/// Up to `BandPredictor::all_layers`.
void predict_shown(BandPredictor& predictor, const ShownSlicesOf& shown, const CodedDesign& design,
                   const ExecutionContext& context);

}  // namespace slicecorr::detail
