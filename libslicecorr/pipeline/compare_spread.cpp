// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/compare_spread.hpp"

#include <functional>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/left_alone.hpp"

namespace slicecorr::detail {

namespace {

/// The slices of a target after a filter that follows them from the last to the first.
class Filtered final : public SliceSource {
 public:
  /// Makes the filter of a band, whose slices are given.
  using Filter = std::function<const std::uint8_t*(const std::uint8_t* rows)>;
  using FilterOf = std::function<Filter(const CodedBand& band)>;
  Filtered(const SliceSource& target, FilterOf filter)
      : target_(target), filter_(std::move(filter)) {}
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    const CodedBand coded = coded_band_of(target_, band);
    const Filter filter = filter_(coded);
    CodedBand upwards(coded.columns());
    std::vector<std::uint8_t> rows(coded.columns());
    for (int n = coded.slices(); n-- > 0;) {
      coded.read(n, rows.data());
      upwards.append(filter(rows.data()));
    }
    for (int n = 0; n < coded.slices(); ++n) {
      const int at = coded.slices() - 1 - n;
      upwards.read(at, rows.data());
      sink(n, upwards.black(at) ? nullptr : rows.data());
    }
  }

 private:
  const SliceSource& target_;
  FilterOf filter_;
};

/// An erase of a band, and where it stands.
struct Erasing {
  explicit Erasing(const CodedBand& band) : erase(band.columns()) {
    std::vector<std::uint8_t> rows(band.columns());
    for (int n = 0; n < band.slices(); ++n) {
      band.read(n, rows.data());
      erase.add_layer(rows.data());
    }
  }
  BandErase erase;
  std::unique_ptr<BandErase::Walk> walk;
};

}  // namespace

void compare_spread_methods(const SliceSource& target, const Setup& setup, Comparison& comparison,
                            const ExecutionContext& context) {
  const AsSliced shown(target);
  const auto verified = [&](const SliceSource& slices) {
    return verify_stack(slices, target, setup, context);
  };
  comparison.uncorrected = verified(shown);
  if (comparison.uncorrected.target_voxels == 0) refuse_vanished(target);
  comparison.erase = verified(Filtered(shown, [&](const CodedBand& band) -> Filtered::Filter {
    auto erasing = std::make_shared<Erasing>(band);
    erasing->walk = std::make_unique<BandErase::Walk>(erasing->erase, comparison.best_n);
    return [erasing](const std::uint8_t* rows) { return erasing->walk->next(rows); };
  }));
  comparison.table = verified(Filtered(shown, [](const CodedBand& band) -> Filtered::Filter {
    auto table = std::make_shared<BandGreyTable>(band.columns());
    return [table](const std::uint8_t* rows) { return table->next(rows); };
  }));
  comparison.ours = verified(CorrectedSlices(target, setup, context));
  if (target.edge_heights()) {
    Setup to_slices = setup;
    to_slices.process.surface = Surface::slices;
    comparison.to_slices = verified(CorrectedSlices(target, to_slices, context));
  }
}

}  // namespace slicecorr::detail
