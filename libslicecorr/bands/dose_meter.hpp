// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Doses that print beside those that are wanted, by region.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Whether wanted doses go with a setup (`check_correction`), and can be reached. Throws `InputError`
/// in resin that ends, and `InfeasibleError` where one is wanted that full light never reaches.
void check_doses(const DoseTarget& doses, const SliceSource& target, const PlaceModels& models,
                 const Setup& setup);

/// What is wanted of columns of a band.
struct WantedBand {
  const DoseTarget* doses;
  const CodedBand* bytes;  ///< of the layers
  BandDoses of_columns() const {
    return {&doses->scale, [this](int n, std::uint8_t* out) { bytes->read(n, out); }};
  }
};

/// Follows columns from the last slice to the first.
class DoseMeter {
 public:
  /// Both must outlive this, and so must the coverage.
  DoseMeter(const WantedBand& wanted, const CureModel& model, const CodedBand& coverage);
  /// Null: black.
  void add_slice(int slice, const std::uint8_t* pixels);
  /// The same of light that spreads.
  void add_slice(int slice, std::span<const ImageShowing> showings);
  const std::vector<RegionDose>& regions() const { return regions_; }

 private:
  void measure(int slice);
  const WantedBand& wanted_;
  const CodedBand& coverage_;
  BandDose dose_;
  std::vector<std::uint8_t> black_, cover_, bytes_;
  std::vector<RegionDose> regions_;
};

/// Regions by name, nothing measured yet.
std::vector<RegionDose> regions_of(const DoseTarget& doses);
void merge_regions(std::vector<RegionDose>& into, const std::vector<RegionDose>& from);

/// The same of a whole stack. `target` must have doses; `slices`: what the stack shows.
std::vector<RegionDose> measure_doses(const SliceSource& stack, const SliceSource& target,
                                      const PlaceModels& models, const ShownSlices& slices,
                                      const ExecutionContext& context);

}  // namespace slicecorr::detail
