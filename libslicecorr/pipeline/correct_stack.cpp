// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/coded_band.hpp"
#include "pipeline/bands.hpp"
#include "pipeline/columns_alone.hpp"
#include "pipeline/correct_columns.hpp"
#include "pipeline/correct_spread.hpp"
#include "pipeline/corrected_info.hpp"
#include "pipeline/design_band.hpp"
#include "pipeline/dose_meter.hpp"
#include "pipeline/even_cells.hpp"
#include "pipeline/kept_images.hpp"
#include "pipeline/place_plans.hpp"
#include "pipeline/robust_design.hpp"
#include "pipeline/shortcomings.hpp"
#include "pipeline/surface_collector.hpp"
#include "pipeline/target_scan.hpp"
#include "pipeline/uncertain_walk.hpp"
#include "pipeline/uv_images.hpp"
#include "pipeline/volume_reducer.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr {

using detail::BandReader;
using detail::bands_of;
using detail::CodedBand;
using detail::columns_of;
using detail::correct_columns;
using detail::DesignReader;
using detail::GroupedBand;
using detail::Joiner;
using detail::LightCounts;
using detail::pixels_of_columns;
using detail::PlacePlans;
using detail::PlaceWindows;
using detail::TargetScan;
using detail::VolumeReducer;
using detail::whole_image;

namespace {

Grid with_layers(Grid grid, int layers) {
  grid.layers = layers;
  return grid;
}

/// The setup with the UV light over z that it asks for.
Setup with_scheduled_uv(const SliceSource& target, Setup setup, const ExecutionContext& context) {
  refuse_recording(target);
  setup.process = schedule_uv(target, setup, context);
  return setup;
}

/// One run of correct_stack: what the bands share, and what they add up to.
class StackCorrection {
 public:
  StackCorrection(const SliceSource& target, const Setup& asked, const StackFile& file,
                  const CorrectionAsk& ask, const ExecutionContext& context);

  /// Corrects, predicts and encodes every band.
  void correct_bands();
  /// Once, after all bands: the figures, and what the stack says of itself.
  Correction result();
  void tell_shortcomings(const Prediction& p) const {
    if (plans_.robust()) tell_robust(p);
    detail::tell_shortcomings(p, model(), setup_.process, plans_.levels(), context_);
  }
  void write(const StackInfo& info) { writer_.finish(info, scan_.picture()); }

 private:
  class Band;

  void tell_robust(const Prediction& p) const {
    const RobustFigures& r = *p.uncertain->robust;
    context_.tell(fmt::format(
        "robust against {}: {} features lost and {} gaps filled somewhere in its range, {} and {} "
        "without; nominally the mean height error is {:.3f} um, {:.3f} um without",
        plans_.robust()->text, r.lost, r.filled, r.features, r.gaps, r.mean_abs_um,
        r.plain_mean_abs_um));
  }
  const CureModel& model() const { return plans_.models().brightest(); }
  Prediction of_whole_image(const Prediction& in_bands, int slices) const {
    return plans_.even() ? whole_image(in_bands, model(), grid_, slices, bands_)
                         : whole_image(in_bands, plans_.models(), grid_, slices, grouped_columns_);
  }

  const SliceSource& target_;
  const StackFile& file_;
  const ExecutionContext& context_;
  const bool with_before_;
  const Setup setup_;
  const PlacePlans plans_;
  Grid grid_;  ///< of the corrected stack
  StackWriter writer_;
  TargetScan scan_;
  const std::vector<PixelBox> bands_;
  std::optional<PlaceWindows> window_;      ///< where UV light keeps a dead zone
  std::optional<VolumeReducer> volume_;     ///< where the reduced volume is asked for
  std::optional<detail::KeptImages> kept_;  ///< where light is even over the flow

  detail::SurfaceCollector surface_after_, surface_before_;
  std::optional<detail::UncertainTotal> uncertain_;  ///< where it is asked how sure it is
  // Merging does not depend on the order of bands, and a band's histograms are large.
  std::mutex merging_;
  Prediction after_, before_, plain_;
  LightCounts grouped_columns_{};    ///< where the display's light is uneven
  std::vector<RegionDose> regions_;  ///< where doses are wanted
  RobustFigures robust_;             ///< where the correction is robust
};

/// A band on its way through the correction.
class StackCorrection::Band {
 public:
  Band(StackCorrection& whole, std::size_t index)
      : whole_(whole),
        index_(index),
        box_(whole.bands_[index]),
        columns_(columns_of(box_)),
        design_(columns_),
        upwards_(columns_),
        encoder_(whole.writer_, box_.y0, box_.y1) {
    if (whole.volume_) reduced_.emplace(*whole.volume_, box_);
  }

  /// All columns get the same light.
  void correct_even() {
    const auto heights = detail::edge_heights_of(whole_.target_, box_);
    const auto left_alone = detail::left_alone_of(whole_.target_, box_);
    std::optional<CodedBand> doses;
    if (whole_.target_.doses()) {
      doses = detail::coded_band_of(*whole_.target_.doses()->images, box_);
    }
    correct(
        whole_.plans_.models().map().reference(), nullptr,
        [this](const SliceSource::Sink& sink) { read(sink); }, heights ? &*heights : nullptr,
        left_alone ? &*left_alone : nullptr, doses ? &*doses : nullptr, pixels_of_columns(box_),
        [this](int n, const std::uint8_t* pixels) { put(n, pixels); });
  }
  /// Columns of equal light are corrected together, then joined.
  void correct_by_light();
  /// Adds the band's figures to those of the whole.
  void finish();

 private:
  using PutPixels = std::function<void(int slice, const std::uint8_t* pixels)>;

  void read(const SliceSource::Sink& sink) {
    if (!reduced_) return whole_.scan_.read(box_, sink);
    const auto left_alone = detail::left_alone_of(whole_.target_, box_);
    detail::LeftAloneRows left_rows(left_alone ? &*left_alone : nullptr);
    std::vector<std::uint8_t> room(columns_);
    whole_.scan_.read(box_, [&](int n, const std::uint8_t* rows) {
      design_.append(detail::marked(rows, left_rows.at(n), room));
      sink(n, rows);
    });
  }
  void put(int n, const std::uint8_t* pixels) {
    encoder_.put(n, box_.x0, box_.x1, pixels);
    if (whole_.kept_) whole_.kept_->put(index_, n, pixels);
    if (reduced_) upwards_.append(pixels);
  }
  /// Columns of one value of light, null for all of the band. Their figures go on from those
  /// before them. `heights`, `left_alone`: null without.
  void correct(std::uint8_t value, const std::vector<std::uint32_t>* of_band,
               const BandReader& reader, const CodedBand* heights, const CodedBand* left_alone,
               const CodedBand* doses, const BandPredictor::PixelOfColumn& place,
               const PutPixels& put_pixels);

  /// The same where features and gaps are to hold although inputs are off. `design` is filled by
  /// `read`.
  /// Gives what the plain correction shows, first slice first.
  CodedBand correct_robust(const CorrectionPlan& plan, const Uncertainty& robust,
                           const DesignReader& read, detail::CodedDesign& design,
                           const PutPixels& put_pixels);

  StackCorrection& whole_;
  const std::size_t index_;
  const PixelBox& box_;
  const std::size_t columns_;
  std::optional<VolumeReducer::Band> reduced_;
  CodedBand design_, upwards_;  ///< for the reduced volume; `upwards_` has the last slice first
  StackWriter::BandEncoder encoder_;
  Prediction after_, before_;
  Prediction plain_;  ///< of what is corrected robustly: the plain correction
  LightCounts counts_{};
  std::vector<RegionDose> regions_;
};

StackCorrection::StackCorrection(const SliceSource& target, const Setup& asked,
                                 const StackFile& file, const CorrectionAsk& ask,
                                 const ExecutionContext& context)
    : target_(target),
      file_(file),
      context_(context),
      with_before_(ask.before || ask.volume_cells > 0),
      setup_(with_scheduled_uv(target, asked, context)),
      plans_(target, setup_, context),
      grid_(with_layers(target.grid(), plans_.all_layers())),
      writer_(file, grid_, context),
      scan_(target),
      bands_(bands_of(grid_, target.bounds())),
      surface_after_(target.bounds()),
      surface_before_(target.bounds()) {
  if (target.doses()) detail::check_doses(*target.doses(), target, plans_.models(), setup_);
  if (setup_.uncertainty) uncertain_.emplace(setup_, target.grid().layer_um, target.bounds());
  detail::set_uv_images(writer_, model(), setup_, grid_);
  if (model().inhibited()) window_.emplace(plans_.models(), plans_.all_layers());
  if (setup_.process.even_light) {
    kept_.emplace(target, detail::judged_slices(*setup_.process.even_light), bands_);
  }
  if (ask.volume_cells > 0) {
    volume_.emplace(plans_.models(), target.bounds(), plans_.layers(), plans_.all_layers(),
                    plans_.levels(), ask.volume_cells);
  }
}

void StackCorrection::Band::correct(std::uint8_t value, const std::vector<std::uint32_t>* of_band,
                                    const BandReader& reader, const CodedBand* heights,
                                    const CodedBand* left_alone, const CodedBand* doses,
                                    const BandPredictor::PixelOfColumn& place,
                                    const PutPixels& put_pixels) {
  const int slices = whole_.plans_.all_layers();
  const std::size_t count = of_band ? of_band->size() : columns_;
  if (left_alone) whole_.scan_.add(*left_alone);
  const CorrectionPlan& plan = whole_.plans_.plan(value);
  const PixelCurve& curve = whole_.plans_.models().curve(value);
  // The node after the last layer may have edge heights: they come with a slice more.
  const int predicted = heights ? std::max(slices, plan.layers + 1) : slices;
  BandPredictor predict_after(plan.model, curve, predicted, count);
  BandPredictor predict_before(plan.model, curve, predicted, count);
  if (heights) {
    predict_after.aim_at_heights();
    predict_before.aim_at_heights();
  }
  predict_after.keep_sides();
  if (whole_.with_before_) predict_before.keep_sides();
  predict_after.go_on_from(std::move(after_));
  predict_before.go_on_from(std::move(before_));
  if (reduced_) {
    reduced_->listen_after(predict_after, of_band);
    reduced_->listen_before(predict_before, of_band);
  }
  std::optional<WindowWatch> watch;
  if (whole_.window_) watch.emplace(plan.model, slices, count);
  // Slices that are shown as they are have the greys of gentle slopes, which a design with edge
  // heights has not: they are kept, and predicted apart.
  const Uncertainty* const robust = whole_.plans_.robust();
  const bool apart = (heights || robust) && whole_.with_before_;
  CodedBand as_shown(count), as_read(apart || doses ? count : 0);
  std::vector<std::uint8_t> sliced(count);
  detail::LeftAloneRows left_rows(left_alone);
  const BandReader kept = [&](const SliceSource::Sink& sink) {
    reader([&](int n, const std::uint8_t* rows) {
      if (apart) as_shown.append(detail::as_sliced(rows, left_rows.at(n), sliced));
      if (apart || doses) as_read.append(rows);
      sink(n, rows);
    });
  };
  // Where it is asked how sure the print is, design and slices are kept to be walked once more.
  const bool uncertain = whole_.uncertain_.has_value();
  detail::CodedDesign looked_at(
      count, [](const SliceSource::Sink&) {}, nullptr, Surface::mesh, left_alone);
  if (uncertain && heights) looked_at.heights.emplace(count);
  CodedBand shown_upwards(uncertain ? count : 0);
  const DesignReader design = [&](const detail::DesignSink& sink) {
    detail::read_design(kept, heights, Surface::mesh,
                        [&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
                          if (uncertain) looked_at.coverage.append(rows);
                          if (uncertain && heights) looked_at.heights->append(its_heights);
                          sink(n, rows, its_heights);
                        });
  };
  const detail::WantedBand wanted{whole_.target_.doses(), doses};
  const BandDoses wanted_doses = doses ? wanted.of_columns() : BandDoses{};
  std::optional<detail::DoseMeter> meter;
  PutPixels put_and_measure = put_pixels;
  if (doses || uncertain) {
    put_and_measure = [&](int n, const std::uint8_t* pixels) {
      if (doses && !meter) meter.emplace(wanted, plan.model, as_read);
      if (meter) meter->add_slice(n, pixels);
      if (uncertain) shown_upwards.append(pixels);
      put_pixels(n, pixels);
    };
  }
  if (robust) {
    const CodedBand plain = correct_robust(plan, *robust, design, looked_at, put_and_measure);
    // What prints is measured against the design itself, not against what was aimed at.
    CodedBand shown(count);
    for (int n = 0; n < slices; ++n) shown.append_of(shown_upwards, slices - 1 - n);
    detail::predict_shown(predict_after, true, shown, slices, looked_at, predicted, nullptr,
                          whole_.context_);
    BandPredictor predict_plain(plan.model, curve, predicted, count);
    if (heights) predict_plain.aim_at_heights();
    predict_plain.go_on_from(std::move(plain_));
    detail::predict_shown(predict_plain, true, plain, slices, looked_at, predicted, nullptr,
                          whole_.context_);
    plain_ = predict_plain.finish(place);
  } else {
    correct_columns(
        plan, count, design, left_alone, doses ? &wanted_doses : nullptr,
        whole_.plans_.even_levels(value, place),
        {put_and_measure, predict_after, whole_.with_before_ && !apart ? &predict_before : nullptr,
         watch ? &*watch : nullptr},
        whole_.context_);
  }
  if (apart) {
    const detail::CodedDesign sharp(count, detail::reader_of(as_read), heights, Surface::mesh,
                                    left_alone);
    detail::predict_shown(predict_before, plan.model.is_plain(), as_shown, plan.layers, sharp,
                          predicted, nullptr, whole_.context_);
  }
  if (meter) detail::merge_regions(regions_, meter->regions());
  if (uncertain) {
    std::vector<std::uint8_t> pixels(count);
    const auto shown_at = [&](int n) -> const std::uint8_t* {
      if (n >= slices) return nullptr;
      shown_upwards.read(slices - 1 - n, pixels.data());
      return pixels.data();
    };
    whole_.uncertain_->add(plan.model, count, shown_at, looked_at, predicted, heights != nullptr,
                           place, whole_.context_);
  }
  after_ = predict_after.finish(place);
  before_ = predict_before.finish(place);
  whole_.surface_after_.add(predict_after.sides(), place);
  if (whole_.with_before_) whole_.surface_before_.add(predict_before.sides(), place);
  if (!watch) return;
  const std::lock_guard lock(whole_.merging_);
  whole_.window_->merge(value, *watch);
}

CodedBand StackCorrection::Band::correct_robust(const CorrectionPlan& plan,
                                                const Uncertainty& robust, const DesignReader& read,
                                                detail::CodedDesign& design,
                                                const PutPixels& put_pixels) {
  read([](int, const std::uint8_t*, const std::uint8_t*) {});
  const detail::RobustLevels made = detail::robust_levels(plan, robust, design, whole_.context_);
  const int slices = plan.all_layers;
  std::vector<std::uint8_t> pixels(made.levels.columns());
  const auto pixels_at = [&](const CodedBand& levels, int n) -> const std::uint8_t* {
    const int at = slices - 1 - n;
    if (levels.black(at)) return nullptr;
    levels.read(at, pixels.data());
    detail::to_pixels(pixels, plan.levels.size());
    return pixels.data();
  };
  CodedBand plain(pixels.size());
  for (int n = 0; n < slices; ++n) plain.append(pixels_at(made.plain, n));
  for (int n = slices; n-- > 0;) put_pixels(n, pixels_at(made.levels, n));
  const std::lock_guard lock(whole_.merging_);
  whole_.robust_.merge(made.figures);
  return plain;
}

void StackCorrection::Band::correct_by_light() {
  const BandReader reader = [this](const SliceSource::Sink& sink) { read(sink); };
  const DoseTarget* const doses = whole_.target_.doses();
  std::vector<BandReader> readers;
  if (doses) readers.push_back(detail::reader_of(*doses->images, box_));
  const std::size_t own = readers.size();
  readers.push_back(reader);
  const GroupedBand grouped(whole_.plans_.models().map(), box_,
                            detail::with_target(std::move(readers), whole_.target_, box_));
  std::vector<CodedBand> corrected;
  for (const GroupedBand::Group& g : grouped.groups) {
    counts_[g.value] = g.columns.size();
    CodedBand& coded = corrected.emplace_back(g.columns.size());
    correct(g.value, &g.columns, g.reader(own), g.heights(), g.left_alone(),
            doses ? g.sources.data() : nullptr, pixels_of_columns(box_, g.columns),
            [&](int, const std::uint8_t* pixels) { coded.append(pixels); });
  }
  Joiner joined(grouped, columns_, std::move(corrected));
  const int slices = whole_.plans_.all_layers();
  for (int n = slices; n-- > 0;) put(n, joined.at(slices - 1 - n));
}

void StackCorrection::Band::finish() {
  if (reduced_) {
    const int all = whole_.plans_.all_layers();
    reduced_->finish([&](int n, std::uint8_t* out) { upwards_.read(all - 1 - n, out); },
                     [&](int n, std::uint8_t* out) { design_.read(n, out); });
  }
  const std::lock_guard lock(whole_.merging_);
  whole_.after_.merge(after_);
  if (whole_.with_before_) whole_.before_.merge(before_);
  if (whole_.plans_.robust()) whole_.plain_.merge(plain_);
  if (!regions_.empty()) detail::merge_regions(whole_.regions_, regions_);
  for (std::size_t v = 0; v < counts_.size(); ++v) whole_.grouped_columns_[v] += counts_[v];
}

void StackCorrection::correct_bands() {
  parallel_for(context_, "correct", bands_.size(), [&](std::size_t i) {
    Band band(*this, i);
    plans_.even() ? band.correct_even() : band.correct_by_light();
    band.finish();
  });
}

Correction StackCorrection::result() {
  Correction result;
  if (volume_) result.volume = std::make_shared<ReducedVolume>(volume_->take());
  std::optional<DeadZones> dead_zones;
  if (window_) {
    dead_zones = window_->result();
    check_window(*dead_zones, setup_.process);
  }
  StackInfo& info = result.info;
  detail::fill_corrected(info, grid_, target_, setup_, file_);
  scan_.fill(info);

  result.after = of_whole_image(after_, plans_.all_layers());
  result.after.dead_zones = std::move(dead_zones);
  if (setup_.process.even_light) {
    result.after.flow = flow_doses(target_, &*kept_, setup_, context_);
  }
  result.after.regions = regions_;
  if (uncertain_) {
    std::optional<RobustFigures> robust;
    if (plans_.robust()) {
      robust = robust_;
      robust->mean_abs_um = result.after.height_error_um.mean();
      robust->plain_mean_abs_um = plain_.height_error_um.mean();
    }
    result.after.uncertain = uncertain_->result(robust);
  }
  result.after.maps = std::make_shared<const SurfaceMaps>(surface_after_.maps());
  if (!with_before_) return result;
  result.before = of_whole_image(before_, plans_.layers());
  result.before->maps = std::make_shared<const SurfaceMaps>(surface_before_.maps());
  return result;
}

}  // namespace

void check_correction(const Setup& setup, const DesignHas& design) {
  check_corrected(setup.printer, setup.resin, setup.process);
  std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
  if (design.doses) {
    // Of these it depends on the height of slices whether they count: `check_doses`.
    std::erase(features, Feature::vat_depth);
    std::erase(features, Feature::reflectance);
    features.push_back(Feature::wanted_doses);
  }
  if (design.left_alone) features.push_back(Feature::left_alone);
  if (setup.uncertainty) detail::check_uncertain(setup);
  const bool robust = setup.uncertainty && setup.uncertainty->robust;
  if (robust) features.push_back(Feature::robust);
  check_supported(features, setup.printer.name, setup.resin.name);
  if (robust && !setup.uncertainty->from_fit && setup.uncertainty->sd(UncertainInput::m) > 0) {
    throw InputError(
        "a correction can't be robust against an exponent that is off by itself, since doses rise "
        "with it here and fall there; expected its errors from a fit, or no error of m");
  }
}

Setup setup_to_correct(const SliceSource& target, Setup setup, const ExecutionContext& context) {
  check_correction(setup, {target.left_alone() != nullptr, target.doses() != nullptr});
  const char* const heights = leave_out_heights(setup.printer, setup.resin, setup.process);
  if (heights && target.edge_heights()) context.tell(heights);
  const char* const cap = leave_out_cap(setup.printer, setup.resin, setup.process);
  if (cap) context.tell(cap);
  return setup;
}

CorrectionPlan plan_correction(const SliceSource& target, const Setup& setup,
                               const ExecutionContext& context) {
  const PlacePlans plans(target, setup, context);
  return {plans.models().brightest(), setup.process, plans.layers(), plans.all_layers()};
}

Correction correct_stack(const SliceSource& target, const Setup& setup, const StackFile& file,
                         const CorrectionAsk& ask, const ExecutionContext& context) {
  Setup for_file = setup;
  for_file.printer = printer_for_file(setup.printer, file, target.grid(), context);
  for_file = setup_to_correct(target, std::move(for_file), context);
  StackInfo planned;
  planned.kind = StackKind::corrected;
  planned.grid = target.grid();
  planned.process = for_file.process;
  check_file_times(file, planned);
  const SlicesAlone alone(target);
  const SliceSource& wanted = for_file.process.surface == Surface::mesh ? target : alone;
  if (judges_suction(for_file)) {
    plan_correction(wanted, for_file, context);  // what does not fit is refused first
    judge_suction(target, for_file, context);
  }
  if (detail::spreads(for_file))
    return detail::correct_spread_stack(wanted, for_file, file, ask, context);
  StackCorrection correction(wanted, for_file, file, ask, context);
  correction.correct_bands();
  Correction result = correction.result();
  correction.tell_shortcomings(result.after);
  if (ask.before_writing) ask.before_writing(result);
  correction.write(result.info);
  return result;
}

CorrectedSlices::CorrectedSlices(const SliceSource& target, const Setup& setup,
                                 const ExecutionContext& context, const std::string& scratch_folder)
    : alone_(target),
      target_(setup.process.surface == Surface::mesh ? target : alone_),
      plans_(std::make_unique<const PlacePlans>(target_, setup, context)),
      grid_(target.grid()) {
  grid_.layers = plans_->all_layers();
  check_correction(setup, {target.left_alone() != nullptr, target.doses() != nullptr});
  if (target.doses()) detail::check_doses(*target.doses(), target, plans_->models(), setup);
  if (!detail::spreads(setup)) return;
  const CureModel& model = plans_->models().brightest();
  std::vector<Feature> features = features_of(model);
  features.push_back(Feature::spread);
  const Unsupported* const pair = find_unsupported(features, Verdict::alone);
  const char* const alone = pair                 ? pair->words
                            : !model.inhibited() ? nullptr
                            : !plans_->even()    ? "the display's light is uneven under UV light"
                            : !detail::can_couple_under_uv(model) ? "UV light is patterned"
                                                                  : nullptr;
  if (alone == nullptr) {
    together_ = std::make_unique<const detail::TogetherCorrected>(
        target_, *plans_, setup.process.spread_rounds, scratch_folder, context);
  } else if (setup.process.spread_rounds > 0) {
    context.tell(fmt::format("light spreads, and {}: each column is corrected alone", alone));
  }
}

CorrectedSlices::~CorrectedSlices() = default;

void CorrectedSlices::read_band(const PixelBox& band, const Sink& sink) const {
  if (together_) return together_->read_band(band, sink);
  const CodedBand upwards = detail::levels_alone(target_, *plans_, band);
  std::vector<std::uint8_t> pixels(columns_of(band));
  const int all = plans_->all_layers();
  for (int n = 0; n < all; ++n) {
    const int at = all - 1 - n;
    if (upwards.black(at)) {
      sink(n, nullptr);
      continue;
    }
    upwards.read(at, pixels.data());
    detail::to_pixels(pixels, plans_->levels());
    sink(n, pixels.data());
  }
}

}  // namespace slicecorr
