// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/even_dead_zone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>

#include "bands/bands.hpp"
#include "even/even_finder.hpp"
#include "even/kept_images.hpp"
#include "even/lit_setup.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/first_slices.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {

using detail::Undercured;

namespace {

void check_setup(const Setup& setup) {
  const Resin& resin = setup.resin;
  if (setup.process.mode != ExposureMode::continuous) {
    throw InputError(
        "an even dead zone is for continuous exposure: layer by layer resin comes to rest");
  }
  if (!resin.inhibition) {
    throw InputError(resin.name, "inhibition",
                     "is missing; an even dead zone needs a resin that UV light inhibits");
  }
  if (!setup.printer.uv) {
    throw InputError(setup.printer.name, "uv", "is missing; an even dead zone needs a UV lamp");
  }
  const bool by_place = setup.process.even_dead_zone == EvenDeadZone::uv ||
                        setup.process.even_dead_zone == EvenDeadZone::both;
  if (by_place && !setup.printer.uv->patterned) {
    throw InputError(setup.printer.name, "uv.kind",
                     fmt::format("is a flood; an even dead zone by \"{}\" needs \"patterned\"",
                                 name_of(setup.process.even_dead_zone)));
  }
  if (setup.printer.uv_flat_field && !by_place) {
    throw InputError(
        setup.printer.name, "uv.flat_field",
        "the dead zone is as uneven as UV light whose images do not go by place; expected even_dead_zone uv or both "
        "with a UV lamp that shows patterns, or a printer without uv.flat_field");
  }
  const double m = flow_resin(resin).kinetics.m;
  if (m != 1) {
    throw InputError(
        resin.name, "inhibition.m",
        fmt::format("is {:g}; an even dead zone needs light that acts in proportion, 1", m));
  }
}

std::shared_ptr<const EvenLight> with_blue_as_uv(EvenLight light) {
  light.uv = light.blue;
  return std::make_shared<const EvenLight>(std::move(light));
}

/// One search for light.
class Try {
 public:
  Try(const SliceSource& target, Setup with, const ExecutionContext& context, int every,
      double hold_off)
      : target_(target),
        context_(context),
        asked_(std::move(with)),
        finder_(target, asked_, context, every, hold_off),
        process_(finder_.guess()) {}
  double gap_um() const { return process_.even_light->gap_um; }
  const Process& process() const { return process_; }
  void tell() const { finder_.tell(process_); }
  void find() { process_ = finder_.find(std::move(process_)); }
  /// What columns can't print with the light as far as it was found, of one in so many across and down.
  Undercured undercured(int every) const {
    if (every == 1 && finder_.undercured()) return *finder_.undercured();
    const Setup with{asked_.printer, asked_.resin, process_, gap_um()};
    return detail::undercured_by(target_, with, every, context_);
  }

 private:
  const SliceSource& target_;
  const ExecutionContext& context_;
  Setup asked_;
  detail::EvenFinder finder_;
  Process process_;
};

/// Light in a dead zone that columns can print with. The one with which the largest section comes out
/// best may be so thick that resin has too little light left on its way: where nobody said it, it is made
/// thinner until hardly anything is undercured, or no less is. What is lacking then is mostly lacking all over the
/// part, so some columns tell it first, with light for guessed images, which takes no rounds: only in the gap that this
/// leaves light is sought, all columns are asked, and it goes on from there.
std::unique_ptr<const Try> best_gap(const SliceSource& target, const Setup& setup,
                                    const ExecutionContext& context, int every, double hold_off) {
  constexpr double kThinner = 0.87;
  constexpr int kMostTries = 8;
  // Shares of the voxels that no other gap would mend: a few lack levels, more so with guessed light.
  constexpr double kFew = 1e-5, kFewOfSome = 1e-4;
  // Columns across and down of which one is asked at first.
  constexpr int kSome = 4;
  Setup asked = setup;
  int tries = 0;
  const auto next = [&](const Try* before) {
    if (before) asked.gap_um = before->gap_um() * kThinner;
    ++tries;
    return std::make_unique<Try>(target, asked, context, every, hold_off);
  };
  std::unique_ptr<Try> best = next(nullptr);
  if (setup.gap_um > 0) {
    best->find();
    return best;
  }
  const double first_um = best->gap_um();
  // Whether a thinner one did no better.
  bool thinnest = false;
  const auto thin_out = [&](double few, const auto& look) {
    Undercured left = look(*best);
    while (left.more_than(few) && !thinnest && tries < kMostTries &&
           best->gap_um() * kThinner >= SectionGoal{}.min_gap_um) {
      auto now = next(best.get());
      const Undercured thinner = look(*now);
      thinnest = thinner.voxels >= left.voxels;
      if (thinnest) break;
      left = thinner;
      best = std::move(now);
    }
    return left;
  };
  thin_out(kFewOfSome, [](const Try& now) { return now.undercured(kSome); });
  const Undercured left = thin_out(kFew, [](Try& now) {
    now.find();
    return now.undercured(1);
  });
  if (best->gap_um() < first_um) {
    context.tell(fmt::format(
        "a dead zone of {:.4g} um comes out best where resin gels, but leaves features undercured; "
        "{:.4g} um is taken, which leaves {}",
        first_um, best->gap_um(),
        left.voxels == 0 ? std::string("none")
                         : fmt::format("{} of {} voxels", left.voxels, left.of)));
  }
  return best;
}

/// Throws where UV light does not keep what is left alone, which shines as it is, off the window.
void check_left_alone(const SliceSource& target, const Setup& setup, const Process& process,
                      const ExecutionContext& context) {
  if (!target.left_alone()) return;
  const std::vector<double> blue = level_intensities(setup.printer);
  const double most_uv = setup.printer.uv->max_mw_cm2() * detail::least_uv_factor(setup.printer);
  const double beta = flow_resin(setup.resin).kinetics.beta;
  const bool patterned = process.even_light->uv != nullptr;
  const detail::EvenBack back(setup.printer, setup.resin, process, target.grid().layer_um);
  for (const PixelBox& band : detail::bands_of(target.grid(), target.bounds())) {
    target.left_alone()->read_band(band, [&](int n, const std::uint8_t* rows) {
      context.check_cancelled();
      if (!rows) return;
      const std::uint8_t most = *std::max_element(rows, rows + detail::columns_of(band));
      const auto level = level_of_pixel(most, static_cast<int>(blue.size()));
      const double light = blue[static_cast<std::size_t>(level)];
      const auto& of_slice = process.uv.slice_mw_cm2;
      const detail::LampShares lamps{setup.process};
      const double shone = light * lamps.blue(n) * back.times(n);
      const double uv =
          lamps.uv(n) *
          (patterned ? most_uv
                     : of_slice[std::min(static_cast<std::size_t>(n), of_slice.size() - 1)]);
      if (most == 0 || shone <= beta * uv * (1 + 1e-9)) return;
      throw InfeasibleError(fmt::format(
          "what is left alone would stick to the window in slice {}: it shines with {:.4g} mW/cm², of which UV light of "
          "{:.4g} mW/cm² holds {:.4g} off; expected {}, or the part by itself",
          n, shone, uv, beta * uv,
          patterned ? "a UV lamp that gives more" : "a UV lamp that shows patterns (uv.kind)"));
    });
  }
}

/// The light, such that the first slices print. Patterns count on what flowing resin brings along: inhibitor in
/// store from where UV light is strong, and a front that is level up to the outline. At first there is neither, and
/// resin sticks where curing light comes near to what UV light holds off the window. So every place's curing light is
/// kept below a share of that.
Process light_that_prints(const SliceSource& target, const Setup& setup,
                          const ExecutionContext& context, int every) {
  constexpr std::array kHeldOff{0.9, 0.75};
  const bool patterned = setup.process.even_dead_zone != EvenDeadZone::constant;
  std::unique_ptr<const Try> best;
  FirstSlices first;
  Setup asked = setup;
  for (const double share : kHeldOff) {
    best = best_gap(target, asked, context, every, share);
    // What another share changes is the light, not the gap.
    asked.gap_um = best->gap_um();
    const Setup with{setup.printer, setup.resin, best->process(), best->gap_um()};
    first = follow_first_slices(target, FlowPixels::coverage, with, context);
    if (!first.sticks || !patterned) break;
  }
  if (first.sticks) {
    throw InfeasibleError(fmt::format(
        "even dead zone of {:.4g} um: {}{}; expected another gap, less speed, or a UV lamp that gives more",
        best->gap_um(), first.in_words(),
        patterned
            ? fmt::format(
                  ", although curing light is kept to {:g} % of what UV light holds off there",
                  100 * kHeldOff.back())
            : std::string()));
  }
  check_left_alone(target, setup, best->process(), context);
  best->tell();
  context.tell(first.in_words());
  return best->process();
}

}  // namespace

Process find_even_light(const SliceSource& target, const Setup& setup,
                        const ExecutionContext& context, int every) {
  if (setup.process.even_dead_zone == EvenDeadZone::off || setup.process.even_light) {
    return setup.process;
  }
  check_setup(setup);
  const Setup lit = detail::lit_setup(setup);
  Process process = light_that_prints(target, lit, context, every);
  process.light_share = setup.process.light_share;
  process.lamp_share = setup.process.lamp_share;
  judge_suction(target, {setup.printer, setup.resin, process, setup.gap_um}, context);
  return process;
}

EvenUvImages::EvenUvImages(const Setup& setup, const Grid& images, const ImageFrame& frame)
    : map_(setup.printer, images, frame),
      uv_map_(uv_light_map(setup.printer, images, frame)),
      blue_light_(with_blue_as_uv(*setup.process.even_light)),
      pixels_(*setup.process.even_light, images),
      blue_(*blue_light_, images) {
  const Printer& printer = setup.printer;
  const LevelTable lamp(uv_level_intensities(printer));
  const int levels = printer.levels();
  const std::vector<double> blue = level_intensities(as_lit(printer, setup.process));
  const auto pixel = [&](double mw_cm2) {
    return static_cast<std::uint8_t>(pixel_of_level(lamp.at_least(mw_cm2 * (1 - 1e-12)), levels));
  };
  const double most = printer.uv->max_mw_cm2();
  const Setup lit = detail::lit_setup(setup);
  const detail::LampShares lamps{lit.process};
  const detail::EvenBack back(printer, setup.resin, setup.process, images.layer_um);
  // One more: what comes back ends with the slices that it is told of.
  const std::size_t own =
      std::max({lit.process.light_share.size(), lit.process.uv_lamp_share.size(),
                back.slices() > 0 ? back.slices() + 1 : 0});
  std::map<double, std::uint16_t> known;
  for (std::size_t n = 0; n < std::max<std::size_t>(1, own); ++n) {
    const double comes = lamps.uv(static_cast<int>(n));
    const auto [at, fresh] = known.try_emplace(comes, static_cast<std::uint16_t>(known.size()));
    const auto slice = static_cast<int>(n);
    lamps_.push_back({lamps.blue(slice) * back.times(slice), at->second});
    if (!fresh) continue;
    std::vector<std::uint8_t>& of_share = of_share_.emplace_back();
    for (int s = 0; s <= 255 * kSteps; ++s) {
      of_share.push_back(pixel(std::min(1.0, s / (255.0 * kSteps) / comes) * most));
    }
  }
  for (int p = 0; p < 256; ++p) {
    const int level = level_of_pixel(static_cast<std::uint8_t>(p), levels);
    share_of_[static_cast<std::size_t>(p)] =
        255 * blue[static_cast<std::size_t>(level)] / blue.back();
  }
  for (std::size_t l = 1; l < blue.size(); ++l) {
    step_ = std::max(step_, 255 * (blue[l] - blue[l - 1]) / blue.back());
  }
  const double beta = flow_resin(setup.resin).kinetics.beta;
  uv_of_blue_ = blue.back() / (beta * most);
  // Twice what holds black's own light off the window.
  const double black = blue.front();
  const double least = lamps.least_uv() * detail::least_uv_factor(printer);
  of_black_ = black > 0 ? pixel(std::min(most, 2 * black / (beta * least))) : pixel(0);
}

void EvenUvImages::make_row(int slice, int y, std::span<std::uint8_t> pixels) const {
  const auto lit =
      std::find_if(pixels.begin(), pixels.end(), [](std::uint8_t p) { return p != 0; });
  const auto first = lit - pixels.begin();
  std::fill(pixels.begin(), lit, of_black_);
  if (lit == pixels.end()) return;
  std::vector<double> shares(static_cast<std::size_t>(pixels.end() - lit)), even(shares.size());
  const Lamps& lamps = lamps_[std::min(static_cast<std::size_t>(slice), lamps_.size() - 1)];
  const std::vector<std::uint8_t>& of_share = of_share_[lamps.table];
  pixels_.uv_of_row(slice, static_cast<int>(first), y, shares);
  blue_.uv_of_row(slice, static_cast<int>(first), y, even);
  for (std::size_t i = 0; i < shares.size(); ++i) {
    std::uint8_t& p = pixels[static_cast<std::size_t>(first) + i];
    if (p == 0) {
      p = of_black_;
      continue;
    }
    // What its place on an uneven display, and its slice, make of it.
    const int x = static_cast<int>(first + static_cast<std::ptrdiff_t>(i));
    const double share = share_of_[p] * lamps.blue * map_.factor(map_.value(x, y));
    // Dimmer pixels, as beside edges, get less of both lights alike: else inhibitor would be left over
    // and flow to where the part is to gel. But where much of the light is curing light, as on outlines,
    // whose resin has just come in, they get what keeps their own off the window.
    double uv = shares[i];
    if (share < even[i]) uv = std::min(uv, std::max(uv * share / even[i], share * uv_of_blue_));
    // What is left alone shines brighter, and is kept off the window as well.
    if (share > even[i] + 1 + step_) uv = std::min(255.0, std::max(uv, share * uv_of_blue_));
    uv = std::min(255.0, uv / uv_map_.factor(uv_map_.value(x, y)));
    p = of_share[static_cast<std::size_t>(std::ceil(uv * kSteps - 1e-9))];
  }
}

}  // namespace slicecorr
