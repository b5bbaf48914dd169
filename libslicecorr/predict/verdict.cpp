// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/verdict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "slicecorr/bodies.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr {
namespace {

std::string counted(std::uint64_t n) { return text::count(static_cast<std::int64_t>(n)); }

std::string with_noun(std::uint64_t n, const char* one, const char* more) {
  return counted(n) + " " + (n == 1 ? one : more);
}

double share(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

/// The width of a bin of a `Histogram`: what lies that near a bound counts as within it.
constexpr double kBin = 1.001;

/// Samples above `um`.
std::uint64_t beyond(const Histogram& h, double um) {
  if (h.count() == 0 || !(um > 0) || h.greatest() <= um * kBin) return 0;
  return h.coarse({0, um * kBin, std::numeric_limits<double>::infinity()})[1];
}

/// Height of the highest layer, um.
double layer_um(const Prediction& p) {
  const std::vector<double>& um = p.heights.um();
  return um.empty() ? p.layer_um : *std::max_element(um.begin(), um.end());
}

/// Gaps of one slice that are closed because that was asked for.
std::uint64_t slits_closed(const Prediction& p) {
  return p.slits_merged ? p.merged_features - std::min(p.merged_thick_gaps, p.merged_features) : 0;
}

std::uint64_t gaps_closed(const Prediction& p) { return p.merged_features - slits_closed(p); }

std::uint64_t gelled_in_gaps(const Prediction& p) {
  return p.cure_through_voxels - std::min(slits_closed(p), p.cure_through_voxels);
}

std::uint64_t edges_off(const Prediction& p) { return beyond(p.design_error_um(), layer_um(p)); }

std::uint64_t outlines_off(const Prediction& p) {
  return beyond(p.plane_error_um, std::max(p.pixel_x_um, p.pixel_y_um));
}

/// To so many digits, and never as a power of ten of something large.
std::string to_digits(double value, int digits) {
  const std::string text = fmt::format("{:.{}g}", value, digits);
  return value < 1 || text.find('e') == std::string::npos ? text : fmt::format("{:.0f}", value);
}

/// What nothing lies beyond: never rounded to less.
std::string up_to(double value, int digits) { return to_digits(rounded_up(value, digits), digits); }

/// What 95 % are no greater than; a quantile is known to half a bin.
double most_of(const Histogram& all) {
  return std::min(all.greatest(), 1.0005 * all.quantile(0.95));
}

/// Of a whole; shares that round to nothing or to all are still not that.
std::string percent(double of_one) {
  if (of_one > 0.99 && of_one < 1) return "over 99 %";
  return to_digits(100 * of_one, 2) + " %";
}

/// Where to look first; empty where nothing is off by a micrometre.
std::string place(const Prediction& p) {
  // The place is that of the greatest height error, which is the distance to the mesh where edges were
  // aimed at it.
  const bool placed = p.at_heights || p.surface_error_um.count() == 0;
  const double um = placed ? p.height_error_um.greatest() : p.surface_error_um.greatest();
  if (p.worst_x < 0 || um < 1) return {};
  std::string words = fmt::format(" The worst edge is {} um off", to_digits(um, 3));
  if (placed) words += fmt::format(", in pixel {}, {}", p.worst_x, p.worst_y);
  return words + ".";
}

std::string slits(const Prediction& p) {
  const std::uint64_t closed = slits_closed(p);
  return closed == 0
             ? std::string()
             : fmt::format(" {} closed, as was asked.",
                           with_noun(closed, "gap of one slice is", "gaps of one slice are"));
}

std::string edges(const Prediction& p) {
  const Histogram& error_um = p.design_error_um();
  if (error_um.count() == 0) return {};
  // Layer by layer the other edges are where the window stands.
  if (p.layerwise && !(error_um.greatest() > 0)) {
    return " No edge lies over a gap, and light moves no other.";
  }
  // No print and no measurement tells a tenth of a micrometre.
  return fmt::format(" 95 % of edges lie within {} um.",
                     up_to(std::max(0.1, most_of(error_um)), 2));
}

/// Outlines in the plane, where light spreads: of them 95 % within, and to which side they err.
std::string outlines(const Prediction& p) {
  if (p.plane_error_um.count() == 0) return {};
  const double um = p.plane_signed_um();
  std::string words = fmt::format(" 95 % of outlines lie within {} um",
                                  up_to(std::max(0.1, most_of(p.plane_error_um)), 2));
  if (std::abs(um) >= 1 && std::abs(um) >= 0.5 * p.plane_error_um.mean()) {
    words += fmt::format(", on average {} um {}: walls are {} um {}", to_digits(std::abs(um), 2),
                         um < 0 ? "inwards" : "outwards", to_digits(2 * std::abs(um), 2),
                         um < 0 ? "thinner" : "thicker");
  }
  return words + ".";
}

/// A share that lifts exchange is measured, and never to the last digit; or nobody said one.
std::string with_other_exchange(const Prediction& p) {
  if (!p.joints || p.uncertain) return {};
  const double all_um = p.joints->exchanged_max_um, none_um = p.joints->staying_max_um;
  if (std::max(all_um, none_um) < std::max(1.0, 2 * p.design_error_um().greatest())) return {};
  if (!p.joints->exchange) {
    return fmt::format(
        " That is where lifts exchange no resin, which nobody said: where they exchange all of it "
        "edges over gaps are up to {} um off.",
        up_to(all_um, 3));
  }
  return fmt::format(
      " That is where lifts exchange a share of {:g} of the resin: where they exchange all of it "
      "edges over gaps are up to {} um off, where none {} um.",
      *p.joints->exchange, up_to(all_um, 3), up_to(none_um, 3));
}

/// By how much the errors that were said of inputs move edges.
std::string as_sure_as_inputs(const Prediction& p) {
  if (!p.uncertain) return {};
  double um = 0;
  for (const EdgeBands* edges : {&p.uncertain->upper, &p.uncertain->lower}) {
    if (edges->half_width_um.count() > 0) um = std::max(um, most_of(edges->half_width_um));
  }
  if (um < 0.1) return {};
  return fmt::format(" The errors of inputs that were said move edges by up to {} um (95 %).",
                     up_to(um, 2));
}

/// Why it does not hold on the platform, or holds on the window.
std::string falls_or_sticks(const Prediction& p) {
  if (p.bodies && p.bodies->printed.loose_bodies > 0) {
    const Bodies& b = p.bodies->printed;
    std::string words = fmt::format("Will not hold: {} on nothing",
                                    with_noun(b.loose_bodies, "body hangs", "bodies hang"));
    const auto loose = std::find_if(b.islands.begin(), b.islands.end(),
                                    [](const Island& i) { return i.until < 0; });
    if (loose != b.islands.end()) {
      words += fmt::format(", {}from {:.0f} um on", b.loose_bodies == 1 ? "" : "the largest ",
                           b.slice_um(loose->first));
    }
    return words + ".";
  }
  if (p.dead_zones && p.dead_zones->cured_pixels > 0) {
    return fmt::format("Will stick: resin gels down to the window over {}.",
                       with_noun(p.dead_zones->cured_pixels, "pixel", "pixels"));
  }
  if (share(p.liquid_at_platform, p.runs_on_platform) >= kAnotherPart) {
    return fmt::format("Will not hold: {} of what stands on the platform is liquid at it.",
                       percent(share(p.liquid_at_platform, p.runs_on_platform)));
  }
  if (p.joints && share(p.joints->not_holding_voxels, p.target_voxels) >= kAnotherPart) {
    return fmt::format("Will not hold: {} of the voxels come loose when the platform lifts.",
                       percent(share(p.joints->not_holding_voxels, p.target_voxels)));
  }
  return {};
}

/// What makes it another part: the greatest share first.
std::string another_part(const Prediction& p) {
  struct Found {
    double share;
    const char* words;
  };
  std::vector<Found> all{
      {share(gaps_closed(p), p.gaps), "{} of the gaps by column close"},
      {share(p.lost_features, p.runs), "{} of the features by column are lost"},
      {share(p.split_features, p.runs), "{} of the features by column come apart"},
      {share(gelled_in_gaps(p), p.target_voxels), "what gels in gaps is {} of the part"},
      {share(p.undercure_voxels, p.target_voxels), "{} of its voxels stay liquid"},
      {share(edges_off(p), p.design_error_um().count()),
       "{} of the edges are off by more than a layer"},
      {share(outlines_off(p), p.plane_error_um.count()),
       "{} of the outlines are off by more than a pixel"}};
  std::stable_sort(all.begin(), all.end(),
                   [](const Found& a, const Found& b) { return a.share > b.share; });
  const bool black = p.black_alone_dose >= 1.0;
  if (all.front().share < kAnotherPart && !black) return {};
  std::string words = "Does not print as designed: ";
  if (black) {
    words += "black light alone gels resin over the whole display";
    if (p.joints && !p.joints->exchange) words += " where lifts exchange none of it";
    if (all.front().share >= kAnotherPart) words += ", ";
  }
  for (std::size_t i = 0; i < 2 && all[i].share >= kAnotherPart; ++i) {
    words += (i > 0 ? ", " : "") + fmt::format(fmt::runtime(all[i].words), percent(all[i].share));
  }
  return words + ".";
}

/// How a print begins that is no other part: edges that are off by more than half a layer have a wrong
/// voxel each, which no rounding of slices explains.
std::string edges_by_voxels(const Prediction& p) {
  const double half_um = layer_um(p) / 2;
  const std::uint64_t all = beyond(p.height_error_um, half_um);
  const double off = share(all - std::min(2 * slits_closed(p), all), p.height_error_um.count());
  if (off < kAnotherPart) return {};
  return fmt::format("Prints with edges that are off: {} of them by more than half a layer ({} um)",
                     percent(off), to_digits(half_um, 3));
}

/// Single places that are otherwise than designed.
std::vector<std::string> to_look_at(const Prediction& p) {
  std::vector<std::string> found;
  const auto add = [&](std::uint64_t n, const std::string& words) {
    if (n > 0) found.push_back(words);
  };
  add(p.undercure_voxels, fmt::format("{} of {} voxels stay liquid", counted(p.undercure_voxels),
                                      counted(p.target_voxels)));
  add(gelled_in_gaps(p),
      fmt::format("{} in gaps", with_noun(gelled_in_gaps(p), "voxel gels", "voxels gel")));
  add(gaps_closed(p),
      fmt::format("{} of {} gaps by column close", counted(gaps_closed(p)), counted(p.gaps)));
  add(p.lost_features, fmt::format("{} of {} features by column are lost", counted(p.lost_features),
                                   counted(p.runs)));
  add(p.split_features, fmt::format("{} of {} features by column come apart",
                                    counted(p.split_features), counted(p.runs)));
  add(p.liquid_at_platform,
      fmt::format("{} of {} columns on the platform are liquid at it",
                  counted(p.liquid_at_platform), counted(p.runs_on_platform)));
  if (p.dead_zones && p.dead_zones->least() < kThinDeadZoneUm) {
    found.push_back(fmt::format(
        "the dead zone gets as thin as {} um, where a little more blue light gels resin to the window",
        to_digits(rounded_down(p.dead_zones->least(), 2), 2)));
  }
  const std::uint64_t narrow = narrow_gaps(p);
  if (share(narrow, p.gaps) >= kAnotherPart) {
    add(narrow, fmt::format("{} of {} gaps by column are hardly darker than what gels (a contrast "
                            "below {:g})",
                            counted(narrow), counted(p.gaps), kLeastGapContrast));
  }
  if (p.joints) {
    add(p.joints->not_holding_voxels,
        fmt::format("{} loose when the platform lifts",
                    with_noun(p.joints->not_holding_voxels, "voxel comes", "voxels come")));
  }
  if (p.bodies) {
    const Bodies& b = p.bodies->printed;
    const double largest_mm3 = b.islands.empty() ? 0 : b.voxels_mm3(b.islands.front().voxels);
    add(b.islands_in_all,
        fmt::format("{} while it prints, until the rest reaches {}{}",
                    with_noun(b.islands_in_all, "body hangs on nothing", "bodies hang on nothing"),
                    b.islands_in_all == 1 ? "it" : "them",
                    largest_mm3 > 0
                        ? fmt::format(" ({}{} mm³)", b.islands_in_all == 1 ? "" : "the largest ",
                                      to_digits(largest_mm3, 2))
                        : ""));
    add(b.necks_in_all,
        fmt::format("{} by less than {:.3g} mm²",
                    with_noun(b.necks_in_all, "body hangs", "bodies hang"), b.least_neck_mm2));
    add(b.none_so_wide() ? 1 : 0,
        fmt::format("no body is as wide as the {:.3g} mm² by which each is to hang",
                    b.least_neck_mm2));
    add(b.sealed_in_all,
        fmt::format("{} resin", with_noun(b.sealed_in_all, "cavity traps", "cavities trap")));
  }
  if (p.uncertain) {
    const UncertainPrint& u = *p.uncertain;
    add(u.may_vanish,
        fmt::format("with the errors of inputs that were said {} of {} features may be lost",
                    counted(u.may_vanish), counted(u.runs)));
    add(u.may_join, fmt::format("with the errors of inputs that were said {} of {} gaps may close",
                                counted(u.may_join), counted(u.gaps)));
  }
  const std::uint64_t edges = edges_off(p), outlines = outlines_off(p);
  add(edges, fmt::format("{} off by more than a layer", with_noun(edges, "edge is", "edges are")));
  add(outlines, fmt::format("{} off by more than a pixel",
                            with_noun(outlines, "outline is", "outlines are")));
  return found;
}

}  // namespace

std::uint64_t narrow_gaps(const Prediction& p) {
  if (p.gap_contrast.count() == 0) return 0;
  const std::uint64_t below = p.gap_contrast.coarse({0, kLeastGapContrast / kBin, 2})[0];
  return below - std::min(below, p.merged_features);
}

std::string worse_than_none(const Prediction& after, const Prediction& before) {
  const Histogram &with = after.design_error_um(), &without = before.design_error_um();
  if (with.count() == 0 || without.count() == 0 || with.mean() - without.mean() < 1 ||
      after.cure_through_voxels + after.undercure_voxels <
          before.cure_through_voxels + before.undercure_voxels) {
    return {};
  }
  return fmt::format(
      "The correction makes this part worse: on average edges are {} um off, and {} um without it.",
      to_digits(with.mean(), 3), to_digits(without.mean(), 3));
}

const char* name_of(Outcome outcome) {
  switch (outcome) {
    case Outcome::look:
      return "look";
    case Outcome::fails:
      return "fails";
    default:
      return "as-designed";
  }
}

PrintVerdict verdict_of(const Prediction& p) {
  if (p.target_voxels == 0)
    return {Outcome::look, "Nothing is designed: no voxel is covered whole."};
  if (p.printed_voxels == 0) {
    return {Outcome::fails, "Nothing prints: no voxel reaches the dose that gels."};
  }
  const std::string falls = falls_or_sticks(p), another = another_part(p);
  if (!falls.empty() || !another.empty()) {
    return {
        Outcome::fails,
        (falls.empty() || another.empty() ? falls + another : falls + " " + another) + place(p)};
  }
  const std::vector<std::string> found = to_look_at(p);
  const std::string off = edges_by_voxels(p);
  if (found.empty() && off.empty()) {
    // Light for an even dead zone is that of a print that has gone on for a while.
    const char* const flows =
        p.flow ? " Whether it sticks before its flow is steady is not judged here: "
                 "follow the print in time."
               : "";
    return {Outcome::as_designed, "Prints as designed." + slits(p) + edges(p) + outlines(p) +
                                      as_sure_as_inputs(p) + with_other_exchange(p) + flows};
  }
  std::string words = off.empty() ? "Prints as designed but for what to look at: "
                                  : off + (found.empty() ? "" : "; ");
  // The gravest come first; the figures have all.
  constexpr std::size_t kMost = 3;
  for (std::size_t i = 0; i < std::min(found.size(), kMost); ++i) {
    words += (i > 0 ? "; " : "") + found[i];
  }
  return {Outcome::look, words + "." + place(p) + as_sure_as_inputs(p) + with_other_exchange(p)};
}

}  // namespace slicecorr
