// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "bands/bands.hpp"
#include "bands/place_plans.hpp"
#include "base/coded_band.hpp"
#include "baseline/z_compensation.hpp"
#include "cure/shown_slices.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::coded_band_of;
using detail::CodedBand;
using detail::GroupedBand;
using detail::PlacePlans;

namespace {

bool has_greys(const CodedBand& band) {
  std::vector<detail::NonZero> lit;
  for (int n = 0; n < band.slices(); ++n) {
    if (n > 0 && band.same(n, n - 1)) continue;
    band.read_nonzero(n, lit);
    if (std::any_of(lit.begin(), lit.end(),
                    [](const detail::NonZero& p) { return p.value != 255; })) {
      return true;
    }
  }
  return false;
}

/// Mean height errors of the erase and of the Z compensation with each N up to the last that can be best.
struct BaselineErrors {
  std::vector<double> erase_um, z_compensation_um;
};
BaselineErrors baseline_errors(const SliceSource& target, const PlacePlans& plans,
                               const std::vector<PixelBox>& bands,
                               const ExecutionContext& context) {
  struct Sum {
    unsigned __int128 scaled = 0;
    std::uint64_t edges = 0;
    void add(const Sum& o) {
      scaled += o.scaled;
      edges += o.edges;
    }
    double mean() const {
      const double count = static_cast<double>(std::max<std::uint64_t>(edges, 1));
      return std::ldexp(static_cast<double>(scaled), -20) / count;
    }
  };
  const int most = std::min(cure_through_slices(plans.models().brightest()), plans.layers());
  std::vector<Sum> erased(static_cast<std::size_t>(most) + 1), compensated(erased.size());
  std::mutex adding;
  parallel_for(context, "erase", bands.size(), [&](std::size_t i) {
    // Only columns that are lit somewhere have edges.
    const GroupedBand grouped(plans.models().map(), bands[i],
                              {detail::reader_of(target, bands[i])});
    for (const GroupedBand::Group& group : grouped.groups) {
      const CodedBand& coded = group.sources[0];
      const std::size_t columns = coded.columns();
      std::vector<std::uint8_t> rows(columns);
      BandErase erase(columns);
      for (int n = 0; n < plans.layers(); ++n) {
        coded.read(n, rows.data());
        erase.add_layer(rows.data());
      }
      const auto predicted = [&](const auto& shown) {
        context.check_cancelled();
        BandPredictor predictor(plans.models().model(group.value),
                                plans.models().curve(group.value), plans.layers(), columns);
        for (int n = plans.layers(); n-- > 0;) {
          coded.read(n, rows.data());
          predictor.add_slice(n, shown(n), rows.data());
        }
        const Prediction p = predictor.finish(0, 0, static_cast<int>(columns));
        return Sum{p.height_error_um.scaled_sum(), p.height_error_um.count()};
      };
      // One N after the other, so that the state of its prediction stays in the cache.
      const bool greys = has_greys(coded);
      CodedBand common = coded;
      std::vector<std::uint8_t> kept(columns);
      for (std::size_t k = 0; k < erased.size(); ++k) {
        BandErase::Walk walk(erase, static_cast<int>(k));
        const Sum of_erase = predicted([&](int) { return walk.next(rows.data()); });
        // Without greys both are the same.
        Sum of_z = of_erase;
        if (greys && k > 0) {
          common = detail::compensated_by_one(common);
          of_z = predicted([&](int n) {
            common.read(n, kept.data());
            return kept.data();
          });
        }
        const std::lock_guard lock(adding);
        erased[k].add(of_erase);
        compensated[k].add(of_z);
      }
    }
  });
  BaselineErrors errors;
  for (const Sum& sum : erased) errors.erase_um.push_back(sum.mean());
  for (const Sum& sum : compensated) errors.z_compensation_um.push_back(sum.mean());
  return errors;
}

/// The first of the least.
int best_of(const std::vector<double>& errors) {
  return static_cast<int>(std::min_element(errors.begin(), errors.end()) - errors.begin());
}

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

Comparison compare_methods(const SliceSource& target, const Setup& setup,
                           const ExecutionContext& context) {
  const Setup own = setup_to_correct(target, setup, context);
  const SlicesAlone alone(target);
  const SliceSource& judged = own.process.surface == Surface::mesh ? target : alone;
  const PlacePlans plans(judged, own, context);
  const auto bands = bands_of(judged.grid(), judged.bounds());

  Comparison result;
  BaselineErrors errors = baseline_errors(judged, plans, bands, context);
  result.erase_mean_um = std::move(errors.erase_um);
  result.z_compensation_mean_um = std::move(errors.z_compensation_um);
  result.best_n = best_of(result.erase_mean_um);
  result.best_z = best_of(result.z_compensation_mean_um);

  const AsSliced shown(judged);
  const auto verified = [&](const SliceSource& slices) {
    return verify_stack(slices, judged, own, context);
  };
  result.uncorrected = verified(shown);
  if (result.uncorrected.target_voxels == 0) detail::refuse_vanished(judged);
  result.erase = verified(Filtered(shown, [&](const CodedBand& band) -> Filtered::Filter {
    auto erasing = std::make_shared<Erasing>(band);
    erasing->walk = std::make_unique<BandErase::Walk>(erasing->erase, result.best_n);
    return [erasing](const std::uint8_t* rows) { return erasing->walk->next(rows); };
  }));
  result.z_compensation = verified(Filtered(shown, [&](const CodedBand& band) -> Filtered::Filter {
    auto common = std::make_shared<const CodedBand>(detail::compensated(band, result.best_z));
    auto kept = std::make_shared<std::vector<std::uint8_t>>(band.columns());
    int n = common->slices();
    return [common, kept, n](const std::uint8_t*) mutable {
      common->read(--n, kept->data());
      return kept->data();
    };
  }));
  result.table = verified(Filtered(shown, [](const CodedBand& band) -> Filtered::Filter {
    auto table = std::make_shared<BandGreyTable>(band.columns());
    return [table](const std::uint8_t* rows) { return table->next(rows); };
  }));
  result.ours = verified(CorrectedSlices(judged, own, context));
  if (judged.edge_heights()) {
    Setup to_slices = own;
    to_slices.process.surface = Surface::slices;
    result.to_slices = verified(CorrectedSlices(judged, to_slices, context));
  }
  return result;
}

}  // namespace slicecorr
