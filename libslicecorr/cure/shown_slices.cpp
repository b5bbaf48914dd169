// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/shown_slices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// UV intensity of the setting that a showing needs. With a share s of usual blue light the rate
/// max(0, s I - beta Iuv)^m is s^m times that of usual blue light under Iuv / s: s^m is part of
/// `light`, Iuv / s is the setting. `usual`: what a recorded share of 1 is usual light's part of.
double setting_of(const Recording::Showing& p, double usual) {
  return p.blue_share > 0 ? p.uv_mw_cm2 * usual / p.blue_share : p.uv_mw_cm2;
}

bool lit_under_uv(const Recording& recording) {
  return std::any_of(recording.showings.begin(), recording.showings.end(),
                     [](const auto& p) { return p.light > 0 && p.uv_mw_cm2 > 0; });
}

/// From where to where in the slice a showing was lit, 0..1; all of it where the showing does not
/// say.
std::pair<double, double> place_of(const Recording::Showing& p, int slice, double layer_um) {
  const double begin = slice * layer_um;
  const double from = std::max(0.0, (std::min(p.from_um, p.to_um) - begin) / layer_um);
  const double to = std::min(1.0, (std::max(p.from_um, p.to_um) - begin) / layer_um);
  constexpr double least = 1e-9;
  if (!(to - from > least)) return {0.0, 1.0};
  return {from < least ? 0.0 : from, to > 1.0 - least ? 1.0 : to};
}

/// Ends of groups of neighbours in a rising list that differ by no more than a share.
std::vector<std::size_t> group_ends(const std::vector<double>& values, double share) {
  std::vector<std::size_t> ends;
  for (std::size_t first = 0; first < values.size();) {
    std::size_t end = first + 1;
    while (end < values.size() && values[end] <= values[first] * (1.0 + share)) ++end;
    ends.push_back(end);
    first = end;
  }
  return ends;
}

}  // namespace

void refuse_recording_under_uv(const SliceSource& source) {
  if (!source.recording()) return;
  throw InputError(
      "the surface of a recording under UV light can't be drawn; its figures, columns and sections "
      "are given by verify, probe and section");
}

namespace {

/// Most light of an image in a slice whose UV image was another.
double light_under_other_uv(const Recording& recording) {
  const std::vector<int>& others = recording.other_uv_images;
  if (others.empty()) return 0;
  double most = 0;
  for (int n = 0; n < recording.slices(); ++n) {
    double light = 0;
    for (const Recording::Showing& p : recording.of(n)) {
      if (std::binary_search(others.begin(), others.end(), p.image)) light += p.light;
    }
    most = std::max(most, light);
  }
  return most;
}

}  // namespace

ShownSlices::ShownSlices(const SliceSource& stack) : slices_(stack.grid().layers) {
  if (!stack.recording()) return;
  if (lit_under_uv(*stack.recording())) refuse_recording_under_uv(stack);
  take(*stack.recording(), {}, stack.grid().layer_um);
}

ShownSlices::ShownSlices(const SliceSource& stack, const Printer& printer, const Resin& resin,
                         const Process& process)
    : slices_(stack.grid().layers), printer_(printer), process_(process) {
  if (stack.recording()) take(*stack.recording(), resin, stack.grid().layer_um);
}

void ShownSlices::take(const Recording& recording, const Resin& resin, double layer_um) {
  recorded_ = true;
  slices_ = recording.slices();
  // A UV lamp that shone although it was not asked for counts, too, if UV light inhibits the resin.
  const bool stray =
      process_.uv.kind == UvKind::off && lit_under_uv(recording) && resin.inhibition && printer_.uv;
  const bool uv = process_.uv.kind != UvKind::off || stray;
  if (uv && (!process_.layer_heights_um.empty() || printer_.platform_reflectance > 0)) {
    throw InputError(
        "a recording under UV light can't be predicted in layers of different heights, or below a platform that sends "
        "light back: each of its images would need tables of its own in each slice; "
        "expected the corrected stack, layers of one height and a platform that takes light up, or no UV light");
  }
  if (uv) other_uv_light_ = light_under_other_uv(recording);
  if (other_uv_light_ > kMostOtherUv) {
    throw InputError(fmt::format(
        "{} UV images of the recording, first that of image {}, are not those that follow from "
        "their slices: what they print can't be predicted",
        recording.other_uv_images.size(), recording.other_uv_images.front()));
  }
  const Process lit = as_lamp_shines(process_);
  if (uv && process_.uv.kind == UvKind::patterned &&
      (light_differs(lit) || !process_.uv_lamp_share.empty())) {
    throw InputError(
        "a recording under patterned UV light, of whose lamps slices get different shares, can't be predicted: "
        "which UV images follow from its slices it does not say");
  }
  const double usual = usual_light_share(lit);
  // Settings are of showings, not of slices: what slices get of the light is in what showings have of it.
  const double m = light_exponent(resin, process_);
  const auto counts = [&](int n) {
    return uv && light_differs(lit) ? std::pow(light_share(lit, n) / usual, m) : 1.0;
  };
  // Of a lamp that has faded what is recorded is a share of what it still gives.
  const auto usual_of = [&](int n) {
    return usual * light_share(process_, n) / light_share(lit, n);
  };
  // Of images that go by place the mean of each slice stands for all of it, as it does in the stack.
  const bool by_place = uv && process_.even_light && process_.uv.kind == UvKind::patterned;
  const std::vector<double> means = by_place ? process_.uv.slice_mw_cm2 : std::vector<double>{};
  const double lamp = by_place ? printer_.uv->max_mw_cm2() : 1;
  const auto setting = [&](const Recording::Showing& p, int n) {
    const double own = setting_of(p, usual_of(n));
    return means.empty()
               ? own
               : own / lamp * means[std::min(static_cast<std::size_t>(n), means.size() - 1)];
  };
  std::vector<double> asked;
  for (int n = 0; uv && n < slices_; ++n) {
    for (const Recording::Showing& p : recording.of(n)) {
      if (p.light > 0) asked.push_back(setting(p, n));
    }
  }
  if (uv) {
    make_settings(asked);
    process_.lamp_share.clear();
    if (!lit.light_share.empty()) process_.light_share = {usual};
  }
  const std::vector<double>& settings = process_.uv.slice_mw_cm2;
  const auto nearest = [&](double value) {
    const auto above = std::lower_bound(settings.begin(), settings.end(), value);
    if (above == settings.begin()) return 0;
    const auto below = above - 1;
    const bool upper = above != settings.end() && *above - value < value - *below;
    return static_cast<int>((upper ? above : below) - settings.begin());
  };
  for (int n = 0; n < slices_; ++n) {
    const std::size_t first = showings_.size();
    const auto shown = recording.of(n);
    // Under UV light and layer by layer the place within the slice does not count.
    const bool placed =
        !uv && process_.mode == ExposureMode::continuous && shown.size() <= kMostPlaced;
    for (const Recording::Showing& p : shown) {
      if (!(p.light > 0)) continue;
      Showing showing{p.image, p.light * counts(n), uv ? nearest(setting(p, n)) : 0};
      if (placed) std::tie(showing.from, showing.to) = place_of(p, n, layer_um);
      add(showing, first);
    }
    if (showings_.size() - first > kMostShowings) {
      throw InputError(fmt::format("slice {} of the recording shows {} images; expected at most {}",
                                   n, showings_.size() - first, kMostShowings));
    }
    ends_.push_back(showings_.size());
  }
}

/// Adds a showing to the slice whose showings begin at `first`; one that differs from an earlier
/// one in nothing but its light is joined with that.
void ShownSlices::add(const Showing& showing, std::size_t first) {
  for (std::size_t k = first; k < showings_.size(); ++k) {
    Showing& p = showings_[k];
    if (p.image == showing.image && p.setting == showing.setting && p.from == showing.from &&
        p.to == showing.to) {
      p.light += showing.light;
      return;
    }
  }
  showings_.push_back(showing);
}

/// Makes settings for the UV intensities asked for: one for each as long as they are few, else
/// groups of similar intensities share one.
void ShownSlices::make_settings(const std::vector<double>& asked) {
  std::vector<double> values = asked;
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  if (values.empty()) values.push_back(0);
  double share = 0;
  std::vector<std::size_t> ends = group_ends(values, share);
  for (share = 1e-4; ends.size() > kMostSettings; share *= 2) ends = group_ends(values, share);
  std::vector<double> settings;
  std::size_t first = 0;
  for (const std::size_t end : ends) {
    const double low = values[first], high = values[end - 1];
    settings.push_back(end - first == 1 ? low : std::sqrt(low * high));
    if (low > 0) deviation_ = std::max(deviation_, std::sqrt(high / low) - 1.0);
    first = end;
  }
  // Measured intensities hold even where the lamp's calibration says that they can't be.
  if (process_.uv.kind != UvKind::patterned) {
    process_.uv.kind = UvKind::per_slice;
    printer_.uv->calibration = {{0, 0}, {1, std::max(1.0, settings.back())}};
  }
  process_.uv.slice_mw_cm2 = std::move(settings);
  // What was recorded is what came.
  process_.uv_lamp_share.clear();
}

std::span<const ShownSlices::Showing> ShownSlices::of(int slice) const {
  const auto n = static_cast<std::size_t>(slice);
  if (slice < 0 || n >= ends_.size()) return {};
  const std::size_t begin = n ? ends_[n - 1] : 0;
  return std::span(showings_).subspan(begin, ends_[n] - begin);
}

std::span<const ImageShowing> BlackColumn::operator()(int slice) {
  showings_.clear();
  for (const ShownSlices::Showing& p : slices_.of(slice)) {
    showings_.push_back({&black_, p.light, p.setting, p.from, p.to});
  }
  return showings_;
}

ShownBand::ShownBand(const ShownSlices& slices, const CodedBand& coded)
    : slices_(slices), coded_(coded) {}

const std::uint8_t* ShownBand::pixels_of(int image) {
  for (const auto& kept : kept_) {
    if (kept->image != image) continue;
    kept->used = true;
    return kept->pixels.data();
  }
  auto free = std::find_if(kept_.begin(), kept_.end(), [](const auto& k) { return !k->used; });
  if (free == kept_.end()) {
    kept_.push_back(std::make_unique<Kept>());
    kept_.back()->pixels.resize(coded_.columns());
    free = kept_.end() - 1;
  }
  Kept& kept = **free;
  kept.image = image;
  kept.used = true;
  coded_.read(image, kept.pixels.data());
  return kept.pixels.data();
}

std::span<const ImageShowing> ShownBand::of(int slice) {
  showings_.clear();
  if (slice < 0 || slice >= slices_.slices()) return {};
  const auto shown = slices_.of(slice);
  // Keep images of this slice that are decoded already; all others may be overwritten.
  for (const auto& kept : kept_) {
    kept->used = std::any_of(shown.begin(), shown.end(),
                             [&](const auto& p) { return p.image == kept->image; });
  }
  for (const ShownSlices::Showing& p : shown) {
    showings_.push_back({pixels_of(p.image), p.light, p.setting, p.from, p.to});
  }
  return showings_;
}

}  // namespace slicecorr::detail
