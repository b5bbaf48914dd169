// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <mutex>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"
#include "bands/correct_spread.hpp"
#include "bands/design_band.hpp"
#include "bands/dose_meter.hpp"
#include "bands/place_plans.hpp"
#include "bands/robust_design.hpp"
#include "bands/surface_collector.hpp"
#include "bands/uncertain_walk.hpp"
#include "base/coded_band.hpp"
#include "even/even_cells.hpp"
#include "even/kept_images.hpp"
#include "parallel/silent.hpp"
#include "pipeline/corrected_info.hpp"
#include "pipeline/printed_bodies.hpp"
#include "pipeline/shortcomings.hpp"
#include "pipeline/target_scan.hpp"
#include "pipeline/uv_images.hpp"
#include "pipeline/volume_reducer.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::CodedBand;
using detail::columns_of;
using detail::correct_group;
using detail::DesignGroup;
using detail::LightCounts;
using detail::PlacePlans;
using detail::PlaceWindows;
using detail::PutRows;
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

/// Where light spreads, all slices corrected; else null.
std::shared_ptr<const CorrectedSlices> corrected_together(const SliceSource& target,
                                                          const Setup& setup, const StackFile& file,
                                                          const ExecutionContext& context) {
  if (!detail::spreads(setup)) return nullptr;
  return std::make_shared<const CorrectedSlices>(
      target, setup, context, std::filesystem::path(file.path).parent_path().string());
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
  void describe(StackInfo& info) const;
  void judge_together(Correction& result) const;
  const CureModel& model() const { return plans_.models().brightest(); }
  Prediction of_whole_image(const Prediction& in_bands, int slices) const {
    return whole_image(in_bands, plans_.models(), grid_, slices, grouped_columns_);
  }

  const SliceSource& target_;
  const StackFile& file_;
  const ExecutionContext& context_;
  const bool with_before_;
  const Setup setup_;
  /// Where light spreads: what all columns show, corrected in rounds; null elsewhere. It is judged
  /// when it is whole, since each band prints by the light of those beside it.
  const std::shared_ptr<const CorrectedSlices> together_;
  const std::unique_ptr<const PlacePlans> own_plans_;  ///< null where `together_` has them
  const PlacePlans& plans_;
  Grid grid_;  ///< of the corrected stack
  StackWriter writer_;
  TargetScan scan_;
  const std::vector<PixelBox> bands_;
  std::optional<PlaceWindows> window_;   ///< where UV light keeps a dead zone
  std::optional<VolumeReducer> volume_;  ///< where the reduced volume is asked for
  std::optional<detail::PrintedBodies> bodies_;
  std::optional<detail::PrintedBodies> bodies_before_;
  std::optional<detail::KeptImages> kept_;  ///< where light is even over the flow
  const int volume_cells_;

  detail::SurfaceCollector surface_after_, surface_before_;
  std::optional<detail::UncertainTotal> uncertain_;  ///< where it is asked how sure it is
  // Merging does not depend on the order of bands, and a band's histograms are large.
  std::mutex merging_;
  Prediction after_, before_, plain_;
  LightCounts grouped_columns_{};    ///< by value of light
  std::vector<RegionDose> regions_;  ///< where doses are wanted
  LayerAreas areas_;
  RobustFigures robust_;  ///< where the correction is robust
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
        encoder_(whole.writer_, box_.y0, box_.y1),
        lit_(whole.areas_.lit_pixels.size()) {
    if (whole.volume_) reduced_.emplace(*whole.volume_, box_);
    if (whole.bodies_) hanging_.emplace(*whole.bodies_, index, box_);
    if (whole.bodies_before_) hanging_before_.emplace(*whole.bodies_before_, index, box_);
  }

  /// What is corrected already.
  void show(const CorrectedSlices& together) {
    read([](int, const std::uint8_t*) {});
    if (const auto left_alone = detail::left_alone_of(whole_.target_, box_)) {
      whole_.scan_.add(*left_alone);
    }
    together.read_band(box_, [this](int n, const std::uint8_t* pixels) {
      if ((n & 63) == 0) whole_.context_.check_cancelled();
      put(n, pixels);
    });
    const std::lock_guard lock(whole_.merging_);
    add_areas();
  }
  /// Columns of equal light together.
  void correct() {
    const detail::DesignBand design(
        whole_.target_, whole_.plans_.models().map(), box_,
        {.coverage = [this](const SliceSource::Sink& sink) { read(sink); }});
    design.count(counts_);
    design.each(
        whole_.plans_.all_layers(),
        [this](const DesignGroup& g, const PutRows& put_rows) { correct(g, put_rows); },
        [this](int n, const std::uint8_t* pixels) { put(n, pixels); });
  }
  /// Adds the band's figures to those of the whole.
  void finish();

 private:
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
  void add_areas() {
    for (std::size_t n = 0; n < lit_.size(); ++n) whole_.areas_.lit_pixels[n] += lit_[n];
  }
  void put(int n, const std::uint8_t* pixels) {
    lit_[static_cast<std::size_t>(n)] = count_lit(pixels, columns_);
    encoder_.put(n, box_.x0, box_.x1, pixels);
    if (whole_.kept_) whole_.kept_->put(index_, n, pixels);
    if (reduced_) upwards_.append(pixels);
  }
  /// The figures of a group go on from those of the groups before it.
  void correct(const DesignGroup& of, const PutRows& put_rows);

  StackCorrection& whole_;
  const std::size_t index_;
  const PixelBox& box_;
  const std::size_t columns_;
  std::optional<VolumeReducer::Band> reduced_;
  std::optional<detail::PrintedBodies::Band> hanging_, hanging_before_;
  CodedBand design_, upwards_;  ///< for the reduced volume; `upwards_` has the last slice first
  StackWriter::BandEncoder encoder_;
  std::vector<std::uint64_t> lit_;  ///< pixels of each slice
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
      together_(corrected_together(target, setup_, file, context)),
      own_plans_(together_ ? nullptr : std::make_unique<const PlacePlans>(target, setup_, context)),
      plans_(together_ ? together_->plans() : *own_plans_),
      grid_(with_layers(target.grid(), plans_.all_layers())),
      writer_(file, grid_, context),
      scan_(target, LayerHeights(setup_.process.layer_heights_um)),
      bands_(bands_of(grid_, target.bounds())),
      volume_cells_(ask.volume_cells),
      surface_after_(target.bounds()),
      surface_before_(target.bounds()),
      areas_(areas_of(grid_, &setup_.printer)) {
  areas_.heights = LayerHeights(setup_.process.layer_heights_um);
  detail::set_uv_images(writer_, plans_.models(), setup_, {grid_, target.frame()});
  if (together_) return;
  if (target.doses()) detail::check_doses(*target.doses(), target, plans_.models(), setup_);
  if (setup_.uncertainty) uncertain_.emplace(setup_, plans_.models(), target.bounds());
  bodies_.emplace(bands_, plans_.all_layers(), model(), context);
  // What uncorrected light joins in the end is told beside the correction, not when.
  if (with_before_) bodies_before_.emplace(bands_, plans_.layers(), model(), context, false);
  if (model().inhibited()) window_.emplace(plans_.models(), plans_.all_layers());
  if (setup_.process.even_light) {
    kept_.emplace(target, detail::judged_slices(*setup_.process.even_light), bands_);
  }
  if (ask.volume_cells > 0) {
    volume_.emplace(plans_.models(), target.bounds(), plans_.layers(), plans_.all_layers(),
                    plans_.levels(), ask.volume_cells);
  }
}

void StackCorrection::Band::correct(const DesignGroup& of, const PutRows& put_rows) {
  const int slices = whole_.plans_.all_layers();
  const std::size_t count = of.columns;
  if (of.left_alone) whole_.scan_.add(*of.left_alone);
  const CorrectionPlan& plan = whole_.plans_.plan(of.value);
  const PixelCurve& curve = whole_.plans_.models().curve(of.value);
  // The node after the last layer may have edge heights: they come with a slice more.
  const int predicted = of.heights ? std::max(slices, plan.layers + 1) : slices;
  BandPredictor after(plan.model, curve, predicted, count),
      before(plan.model, curve, predicted, count);
  const auto go_on = [&](BandPredictor& predictor, Prediction& so_far) {
    if (of.heights) predictor.aim_at_heights();
    predictor.go_on_from(std::move(so_far));
  };
  go_on(after, after_);
  go_on(before, before_);
  after.keep_sides();
  if (whole_.with_before_) before.keep_sides();
  if (reduced_) {
    reduced_->listen_after(after, of.of_band);
    reduced_->listen_before(before, of.of_band);
  }
  hanging_->listen(after, of.of_band);
  if (hanging_before_) hanging_before_->listen(before, of.of_band);
  std::optional<WindowWatch> watch;
  if (whole_.window_) watch.emplace(plan.model, slices, count);
  // Slices that are shown as they are have the greys of gentle slopes, which a design with edge
  // heights has not: they are kept, and predicted apart.
  const bool robust = whole_.plans_.robust() != nullptr;
  const bool apart = (of.heights || robust) && whole_.with_before_;
  DesignGroup group = of;
  CodedBand as_shown(count), as_read(apart || of.doses ? count : 0);
  std::vector<std::uint8_t> sliced(count);
  detail::LeftAloneRows left_rows(of.left_alone);
  group.coverage = [&](const SliceSource::Sink& sink) {
    of.coverage([&](int n, const std::uint8_t* rows) {
      if (apart) as_shown.append(detail::as_sliced(rows, left_rows.at(n), sliced));
      if (apart || of.doses) as_read.append(rows);
      sink(n, rows);
    });
  };
  std::optional<detail::DoseMeter> meter;
  // Where it is asked how sure the print is, design and slices are kept to be walked once more.
  const bool uncertain = whole_.uncertain_.has_value();
  detail::CodedDesign looked_at(count, uncertain && of.heights, of.left_alone);
  CodedBand shown_upwards(uncertain ? count : 0);
  detail::GroupListeners to{.put = put_rows, .after = &after};
  if (whole_.with_before_ && !apart) to.before = &before;
  if (watch) to.watch = &*watch;
  if (of.doses || uncertain) {
    to.put = [&](int n, const std::uint8_t* pixels) {
      if (of.doses && !meter) meter.emplace(*of.doses, plan.model, as_read);
      if (meter) meter->add_slice(n, pixels);
      if (uncertain) shown_upwards.append(pixels);
      put_rows(n, pixels);
    };
  }
  if (uncertain) {
    to.design = [&](int, const std::uint8_t* rows, const std::uint8_t* heights) {
      looked_at.append(rows, heights);
    };
  }
  RobustFigures figures;
  std::optional<BandPredictor> plain;
  if (robust) {
    to.robust = &figures;
    to.plain = &plain.emplace(plan.model, curve, predicted, count);
    go_on(*plain, plain_);
  }
  correct_group(whole_.plans_, group, to, whole_.context_);
  if (apart) {
    const detail::CodedDesign sharp(count, {detail::reader_of(as_read), of.heights, of.left_alone},
                                    Surface::mesh);
    detail::predict_shown(before, {as_shown, plan.layers}, sharp, whole_.context_);
  }
  if (meter) detail::merge_regions(regions_, meter->regions());
  if (uncertain) {
    std::vector<std::uint8_t> pixels(count);
    const auto shown_at = [&](int n) -> const std::uint8_t* {
      if (n >= slices) return nullptr;
      shown_upwards.read(slices - 1 - n, pixels.data());
      return pixels.data();
    };
    whole_.uncertain_->add(of, {shown_at, predicted, of.heights != nullptr}, looked_at,
                           whole_.context_);
  }
  after_ = after.finish(of.place);
  before_ = before.finish(of.place);
  if (plain) plain_ = plain->finish(of.place);
  whole_.surface_after_.add(after.sides(), of.place);
  if (whole_.with_before_) whole_.surface_before_.add(before.sides(), of.place);
  if (!watch && !robust) return;
  const std::lock_guard lock(whole_.merging_);
  if (watch) whole_.window_->merge(of.value, *watch);
  if (robust) whole_.robust_.merge(figures);
}

void StackCorrection::Band::finish() {
  hanging_->finish();
  if (hanging_before_) hanging_before_->finish();
  if (reduced_) {
    const int all = whole_.plans_.all_layers();
    reduced_->finish([&](int n, std::uint8_t* out) { upwards_.read(all - 1 - n, out); },
                     [&](int n, std::uint8_t* out) { design_.read(n, out); });
  }
  const std::lock_guard lock(whole_.merging_);
  add_areas();
  whole_.after_.merge(after_);
  if (whole_.with_before_) whole_.before_.merge(before_);
  if (whole_.plans_.robust()) whole_.plain_.merge(plain_);
  if (!regions_.empty()) detail::merge_regions(whole_.regions_, regions_);
  for (std::size_t v = 0; v < counts_.size(); ++v) whole_.grouped_columns_[v] += counts_[v];
}

void StackCorrection::correct_bands() {
  parallel_for(context_, "correct", bands_.size(), [&](std::size_t i) {
    Band band(*this, i);
    if (together_) return band.show(*together_);
    band.correct();
    band.finish();
  });
}

void StackCorrection::describe(StackInfo& info) const {
  detail::fill_corrected(info, grid_, target_, setup_, file_);
  scan_.fill(info);
}

void StackCorrection::judge_together(Correction& result) const {
  describe(result.info);
  result.slices = together_;
  result.after = verify_stack(*together_, target_, setup_, context_);
  if (result.after.dead_zones) check_window(*result.after.dead_zones, setup_.process);
  if (plans_.held() && result.after.uncertain) {
    // What it costs: the same without.
    Setup plain = setup_;
    plain.uncertainty.reset();
    const ExecutionContext quiet = detail::silent(context_);
    const CorrectedSlices without(target_, plain, quiet,
                                  std::filesystem::path(file_.path).parent_path().string());
    UncertainPrint print = *result.after.uncertain;
    print.robust = *plans_.held();
    print.robust->mean_abs_um = result.after.height_error_um.mean();
    print.robust->plain_mean_abs_um =
        verify_stack(without, target_, plain, quiet).height_error_um.mean();
    result.after.uncertain = std::make_shared<const UncertainPrint>(std::move(print));
  }
  if (with_before_) {
    result.before = verify_stack(AsSliced(target_), target_, setup_, context_);
  }
  if (volume_cells_ > 0) {
    result.volume = std::make_shared<ReducedVolume>(
        reduce_volume(*together_, target_, setup_, volume_cells_, context_));
  }
}

Correction StackCorrection::result() {
  Correction result;
  if (together_) {
    judge_together(result);
    result.after.areas = std::make_shared<const LayerAreas>(areas_);
    return result;
  }
  if (volume_) result.volume = std::make_shared<ReducedVolume>(volume_->take());
  std::optional<DeadZones> dead_zones;
  if (window_) {
    dead_zones = window_->result();
    check_window(*dead_zones, setup_.process);
  }
  describe(result.info);
  result.after = of_whole_image(after_, plans_.all_layers());
  result.after.other_wavelength = other_wavelength(setup_.printer, setup_.resin);
  result.after.other_display = other_display(setup_.printer, setup_.resin);
  result.after.assumed = setup_.process.assumed;
  result.after.slits_merged = setup_.process.one_slice_gaps == OneSliceGaps::merge;
  result.after.dead_zones = std::move(dead_zones);
  if (setup_.process.even_light) {
    result.after.flow = flow_doses(target_, &*kept_, setup_, context_);
  }
  result.after.regions = regions_;
  result.after.areas = std::make_shared<const LayerAreas>(areas_);
  if (uncertain_) {
    std::optional<RobustFigures> robust;
    if (plans_.robust()) {
      robust = robust_;
      robust->mean_abs_um = result.after.height_error_um.mean();
      robust->plain_mean_abs_um = plain_.height_error_um.mean();
    }
    result.after.uncertain = uncertain_->result(robust);
  }
  if (with_before_) result.before = of_whole_image(before_, plans_.layers());
  // Side by side: each follows slice by slice.
  parallel_for(detail::silent(context_), "", with_before_ ? 2 : 1, [&](std::size_t i) {
    std::optional<detail::PrintedBodies>& bodies = i == 0 ? bodies_ : bodies_before_;
    const Grid& grid = i == 0 ? grid_ : target_.grid();
    (i == 0 ? result.after : *result.before).bodies =
        bodies->judge(grid, target_.frame(), model().heights, setup_.least_neck_mm2);
    // A report is made while this stays: what was kept of voxels makes room for it.
    bodies.reset();
  });
  result.after.maps = std::make_shared<const SurfaceMaps>(surface_after_.maps());
  if (!with_before_) return result;
  result.before->maps = std::make_shared<const SurfaceMaps>(surface_before_.maps());
  return result;
}

}  // namespace

CorrectionPlan plan_correction(const SliceSource& target, const Setup& setup,
                               const ExecutionContext& context) {
  const PlacePlans plans(target, setup, context);
  CorrectionPlan plan(plans.models().brightest(), setup.process, plans.layers(),
                      plans.all_layers());
  if (plan.model.lifts) plan.most_exchange = plans.most_exchange();
  return plan;
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
  std::optional<PrintSuction> suction;
  if (judges_suction(for_file)) {
    plan_correction(wanted, for_file, context);  // what does not fit is refused first
    suction = judge_suction(target, for_file, context);
  }
  StackCorrection correction(wanted, for_file, file, ask, context);
  correction.correct_bands();
  Correction result = correction.result();
  result.after.suction = std::move(suction);
  correction.tell_shortcomings(result.after);
  if (result.after.bodies) detail::judge_bodies(*result.after.bodies, for_file, context);
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
  if (model.inhibited() && model.inhibited()->ends()) features.push_back(Feature::vat_depth);
  if (model.inhibited() && model.inhibited()->gap_um() > 0) {
    features.push_back(Feature::even_dead_zone);
  } else if (model.inhibited() && !model.inhibited()->uv_levels().empty()) {
    features.push_back(Feature::uv_patterned);
  }
  const Unsupported* const pair = find_unsupported(features, Verdict::alone);
  const bool uv = model.inhibited() != nullptr;
  const char* const alone = pair                        ? pair->words
                            : uv && target.left_alone() ? "something is left alone under UV light"
                            : uv && model.inhibited()->ends() ? "the resin ends under UV light"
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
  CodedBand upwards(columns_of(band));
  detail::correct_band(target_, *plans_, band,
                       [&](int, const std::uint8_t* rows) { upwards.append(rows); });
  std::vector<std::uint8_t> pixels(columns_of(band));
  const int all = plans_->all_layers();
  for (int n = 0; n < all; ++n) {
    const int at = all - 1 - n;
    const bool black = upwards.black(at);
    if (!black) upwards.read(at, pixels.data());
    sink(n, black ? nullptr : pixels.data());
  }
}

}  // namespace slicecorr
