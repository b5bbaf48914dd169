// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/band_state.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {

BandPredictor::BandPredictor(const CureModel& model, const PixelCurve& curve, int all_layers,
                             std::size_t columns, bool in_showings)
    : state_(std::make_unique<State>(model, curve, all_layers, columns, in_showings)) {}
BandPredictor::~BandPredictor() = default;

void BandPredictor::tell_edges(EdgeSink sink) { state_->edge_sink_ = std::move(sink); }
void BandPredictor::tell_runs(RunSink sink) { state_->run_sink_ = std::move(sink); }
void BandPredictor::tell_gaps(GapSink sink) { state_->gap_sink_ = std::move(sink); }
void BandPredictor::tell_states(StateSink sink) {
  if (!state_->state_sink_) {
    state_->state_sink_ = std::move(sink);
    return;
  }
  state_->state_sink_ = [first = std::move(state_->state_sink_), then = std::move(sink)](
                            std::size_t column, int slice, std::uint8_t coverage, bool prints,
                            bool prints_above) {
    first(column, slice, coverage, prints, prints_above);
    then(column, slice, coverage, prints, prints_above);
  };
}
bool BandPredictor::tell_delays(DelaySink sink, int longest) {
  return state_->tell_delays(std::move(sink), longest);
}
void BandPredictor::aim_at_heights() { state_->prediction_.at_heights = true; }
void BandPredictor::keep_sides() { state_->keep_sides(); }
const EdgeSides& BandPredictor::sides() const { return state_->sides_; }
void BandPredictor::keep_no_histograms() { state_->histograms_ = false; }

void BandPredictor::add_slice(int slice, const std::uint8_t* pixels, const DesignRow& design) {
  state_->add_slice(slice, pixels, design);
}
void BandPredictor::add_slice(int slice, std::span<const ImageShowing> showings,
                              const DesignRow& design) {
  state_->add_slice(slice, showings, design);
}
void BandPredictor::add_tile(const TilePlace& place, const std::uint8_t* pixels,
                             const DesignRow& design) {
  state_->add_tile(place, pixels, design);
}
bool BandPredictor::takes_tiles() const { return !state_->dose_; }
int BandPredictor::all_layers() const { return state_->all_layers_; }
const double* BandPredictor::middle() const { return state_->dose_->middle(); }
void BandPredictor::go_on_from(Prediction so_far) { state_->go_on_from(std::move(so_far)); }

Prediction BandPredictor::finish(int x0, int y0, int width) {
  const auto w = static_cast<std::size_t>(width);
  return finish([&](std::size_t column) {
    return Pixel{x0 + static_cast<int>(column % w), y0 + static_cast<int>(column / w)};
  });
}
Prediction BandPredictor::finish(const PixelOfColumn& place) { return state_->finish(place); }

}  // namespace slicecorr
