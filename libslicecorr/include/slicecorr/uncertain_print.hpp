// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uncertain_print.hpp
/// How sure a prediction is, when its inputs are off by an `Uncertainty`.
///
/// The variance of a dose follows from its derivatives (dose_derivatives.hpp), to first order:
/// sd = sd(ln Omega). An edge of the print lies above z exactly if Omega(z) >= 1, so that quantiles of
/// the dose are those of the edge: an edge is with 95 % between the *weak* print, which gels where ln
/// Omega - 1.96 sd >= 0, and the *strong* print, which gels where ln Omega + 1.96 sd >= 0. Both are
/// solved inside layers, and measured as a prediction measures (predict.hpp): bends of the dose, and
/// what lies beside an edge, are in them. A feature is lost with the probability Phi(-g), g the
/// greatest ln Omega / sd in it; a gap is filled with the probability Phi(g), g the least in it.
///
/// First order holds for sd of a few percent: for figure 2.2's ladder the bands cover 95 % at 1 % and
/// at 10 % alike, for columns of features and gaps of 2 to 14 slices 94.9 % at 1 % and 92 % at 5 %
/// (docs/uncertainty.md).
///
/// Plain values. All sums are of integers, so that no figure depends on the order of the work.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/dose_derivatives.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/surface_maps.hpp"
#include "slicecorr/uncertainty.hpp"

namespace slicecorr {

/// Quantile of the normal distribution beyond which 2.5 % lie.
inline constexpr double kSdsOf95 = 1.959963984540054;

/// Where errors come from that are drawn together.
enum class ErrorSource {
  resin,  ///< ha, dc, m, aim: one draw a print
  lamp,   ///< light, stray: one draw a print
  speed,  ///< or exposure times: one draw a print
  lifts,  ///< exchange: one draw a print
  flat,   ///< one draw a column
  noise,  ///< one draw a pixel and slice
};
inline constexpr std::size_t kErrorSources = 6;
const char* word_of(ErrorSource source);

/// How an error of the curing light acts: as one of the dose, by the exponent; by itself
/// (`DoseGradient::light`); by itself, and one of speed or times as it does: what bleaches a resin is light
/// times time.
enum class LightActs { by_exponent, by_itself, as_time };
/// Of a model whose derivatives are those of `nearby`; null: by recursion.
LightActs light_acts(const CureModel& model, const NearbyModels* nearby);

/// The variance of doses under an uncertainty: a quadratic form in a dose and its derivatives.
class DoseVariance {
 public:
  /// `exponent`: of the model (`CureModel::m`).
  DoseVariance(const Uncertainty& uncertainty, double exponent,
               LightActs light = LightActs::by_exponent);
  /// Of Omega.
  double of(const DoseGradient& g) const;
  double of(const DoseGradient& g, ErrorSource source) const;
  /// sd(ln Omega); infinite where there is no dose.
  double sd_ln(const DoseGradient& g) const;
  /// Which derivatives count.
  BandDerivatives::Wanted wanted() const { return wanted_; }
  /// Coefficients of `of` in dose, ln_ha, stray, m, light and exchange, and of the variance by noise.
  static constexpr std::size_t kTerms = 6;
  using Form = std::array<std::array<double, kTerms>, kTerms>;
  const Form& form() const { return all_; }
  double noise() const { return noise_; }

 private:
  BandDerivatives::Wanted wanted_;
  std::array<Form, kErrorSources> by_source_{};
  Form all_{};
  double noise_ = 0;  ///< variance of a slice's phi, relative
};

/// Counts that are not whole: sums of probabilities.
class ExpectedCount {
 public:
  void add(double probability);
  void merge(const ExpectedCount& other) { sum_ += other.sum_; }
  double value() const;

 private:
  unsigned __int128 sum_ = 0;  ///< in units of 2^-60
};

/// Sum of numbers of either sign.
class SignedSum {
 public:
  void add(double value);
  void merge(const SignedSum& other) { sum_ += other.sum_; }
  double value() const;

 private:
  __int128 sum_ = 0;  ///< in units of 2^-32
};

/// Bands of edges of a kind.
struct EdgeBands {
  std::uint64_t edges = 0;
  Histogram half_width_um;       ///< half of what lies between the weak and the strong print
  SignedSum weak_um, strong_um;  ///< height errors of both
  SignedSum weak_abs_um, strong_abs_um;
  SignedSum expected_abs_um;  ///< expected size of the height error, edge by edge
  std::array<SignedSum, kErrorSources> by_source_um;  ///< half widths from each source alone
  void merge(const EdgeBands& other);
  double mean(const SignedSum& sum) const {
    return edges ? sum.value() / static_cast<double>(edges) : 0.0;
  }
};

/// A feature that may be lost or a gap that may be filled.
struct DoubtfulPlace {
  double probability = 0;
  bool gap = false;
  FeatureExample where;
};

/// "the gap in slices 3 to 5".
std::string place_in_words(const DoubtfulPlace& place);

/// The most doubtful places, whatever the order of adding.
class DoubtfulPlaces {
 public:
  static constexpr std::size_t kMost = 50;
  void add(const DoubtfulPlace& place);
  void merge(const DoubtfulPlaces& other);
  /// Most probable first; of equal ones in reading order.
  std::vector<DoubtfulPlace> sorted() const;

 private:
  std::vector<DoubtfulPlace> heap_;  ///< the least doubtful at the front
};

/// What a robust correction did (`Uncertainty::robust`).
struct RobustFigures {
  /// Features lost and gaps filled somewhere in the range of the inputs by the plain correction, and
  /// those of which that is still so.
  std::uint64_t features = 0, gaps = 0, lost = 0, filled = 0;
  std::uint64_t moved_edges = 0;  ///< that aim at another dose for it
  /// Mean height error with the inputs as they are said: what the plain correction has, and this one.
  double plain_mean_abs_um = 0, mean_abs_um = 0;
  void merge(const RobustFigures& other);  ///< of the counts
};

/// The figures of an uncertain prediction.
struct UncertainPrint {
  Uncertainty inputs;
  EdgeBands upper, lower;  ///< edges towards the platform, and away from it
  std::uint64_t runs = 0, gaps = 0;
  ExpectedCount lost, filled;    ///< expected numbers of features lost and gaps filled
  std::uint64_t may_vanish = 0;  ///< features that are lost with 2.5 % or more
  std::uint64_t may_join = 0;    ///< gaps that are filled with 2.5 % or more
  std::uint64_t surely_lost = 0, surely_filled = 0;  ///< with 97.5 % or more
  DoubtfulPlaces places;
  std::optional<RobustFigures> robust;  ///< not merged, set for whole stacks
  /// Half widths of the widest bands of a column, of its upper edges (`below_um`) and its lower ones
  /// (`above_um`), um; null until the whole stack is known.
  std::shared_ptr<const SurfaceMaps> maps;

  /// Expected mean size of the height error over all edges; 0 without any.
  double expected_mean_abs_um() const;
  /// The greater of the mean sizes of the weak and of the strong print: about one print of 20 is
  /// off by more, where errors are shared.
  double bad_mean_abs_um() const;
  void merge(const UncertainPrint& other);
  /// A round number of um that the half widths of 95 % of the edges of each kind stay below: for maps.
  double map_scale_um() const;
  /// The figures of "uncertainty" in the JSON of a prediction.
  std::string to_json() const;
};

/// A few lines for people.
std::string uncertainty_in_words(const UncertainPrint& print);

/// The same of one band of columns, slices from the last to the first. For one thread at a time.
class UncertainBand {
 public:
  /// `model` must outlive this; `all_layers`: as for `BandPredictor`. Throws as `check_derivatives`,
  /// and `InputError` where stray light is off and the exponent below 1 meets levels without light.
  /// `nearby`: as for `BandDerivatives`.
  UncertainBand(const CureModel& model, const Uncertainty& uncertainty, int all_layers,
                std::size_t columns, const NearbyModels* nearby = nullptr);
  ~UncertainBand();
  UncertainBand(UncertainBand&&) noexcept;

  /// As for `BandPredictor`. What is left alone comes as grey coverage.
  void add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage,
                 const std::uint8_t* heights = nullptr);
  /// The same of light that spreads.
  void add_slice(int slice, std::span<const ImageShowing> showings, const std::uint8_t* coverage,
                 const std::uint8_t* heights = nullptr);
  /// Figures are added to these while slices come, and not by `finish`: several bands that are walked
  /// by one thread share their histograms. Before the first slice.
  void add_to(UncertainPrint& figures);
  /// Height errors are measured from edge heights. Before the first slice.
  void aim_at_heights();

  /// An edge's height errors in slices, as weak, nominal and strong print have them.
  struct EdgeBand {
    std::size_t column = 0;
    int node = 0;
    bool upper = false;
    double weak = 0, nominal = 0, strong = 0;
  };
  using EdgeSink = std::function<void(const EdgeBand&)>;
  void tell_edges(EdgeSink sink);
  /// Told each run and each gap of a column: its slices [first, last], and with which probability it
  /// is lost or filled.
  using DoubtSink =
      std::function<void(std::size_t column, bool gap, int first, int last, double p)>;
  void tell_doubts(DoubtSink sink);

  /// After slice 0: adds the figures to `into`, which are those of `add_to` where that was called.
  void finish(const BandPredictor::PixelOfColumn& place, UncertainPrint& into);
  /// Of `finish`: half widths per column, um; NaN without such an edge.
  const EdgeSides& sides() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace slicecorr
