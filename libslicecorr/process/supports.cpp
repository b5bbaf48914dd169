// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/supports.hpp"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <iterator>
#include <string_view>

#include "slicecorr/error.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/light_unit.hpp"

namespace slicecorr {

namespace {

using enum Feature;
using enum Verdict;

constexpr std::array<const char*, kFeatures> kNames = {
    "layer by layer (mode)",
    "constant UV light (uv_mw_cm2)",
    "UV light per slice (dead_zone_um)",
    "patterned UV light (uv_schedule)",
    "an even dead zone (even_dead_zone)",
    "a time to gel (model = \"gel-time\")",
    "a resin that bleaches ([bleaching])",
    "light that spreads ([blue] or [uv] spread, scatter)",
    "uneven light ([blue] flat_field)",
    "resin that ends ([vat] depth_um)",
    "a platform that sends light back ([vat] platform_reflectance)",
    "layers that hold at each lift (lifts)",
    "resin that lifts exchange (lift_exchange)",
    "more light for slower slices (slice_lamps)",
    "light below full (light_share)",
    "layers that get different shares of the light (light_share)",
    "layers of different heights (layer_um)",
    "slices of different heights in continuous exposure (layer_um)",
    "edges of the mesh (surface)",
    "what is left alone (leave_alone, part)",
    "wanted doses (doses)",
    "a capped dose (omega_max)",
    "a robust correction (robust)",
    "how sure figures are (uncertain)",
    "grey by pulses ([blue] grey)",
    "uneven UV light ([uv] flat_field)",
    "a UV lamp that fades (uv_lamp_log)",
};

// A pair for each of the kinds of UV light.
#define UNDER_UV(feature, verdict, words)                                          \
  {feature, uv_constant, verdict, words}, {feature, uv_per_slice, verdict, words}, \
      {feature, uv_patterned, verdict, words}, {                                   \
    feature, even_dead_zone, verdict, words                                        \
  }

// The same for heights, which have a feature in each mode.
#define IN_HEIGHTS(feature, verdict, words) \
  {own_heights, feature, verdict, words}, { moved_heights, feature, verdict, words }

constexpr const char* kGelTimeUv =
    "{resin}: cure.model: a time to gel is two numbers of light alone, which do not say how much of the rate "
    "UV light takes away; expected no UV light, or a resin of another model (resinctl derive)";
constexpr const char* kBleachingUv =
    "{resin}: bleaching: is not counted under UV light, since what UV light bleaches, and how much further it "
    "then inhibits, a resin file does not say; expected no UV light, or a resin without [bleaching]";
constexpr const char* kStayUv =
    "slices that get more light where they go slower can't have an even dead zone: resin flows faster where slices go "
    "faster, and light that is even for one flow is not for another; expected lamps that follow the speed, or "
    "even_dead_zone off";
constexpr const char* kEdgesInHeights =
    "edges lie at slices: the mesh's own heights are not counted in layers of different heights";
constexpr const char* kSureUv =
    "how sure a print is can't be said beside an even dead zone: inputs that are off move the front, and with it "
    "the flow that brings its dose; expected even_dead_zone off";
constexpr const char* kCapUv =
    "the dose inside features is not capped: under UV light they get the least that gels them";
constexpr const char* kExchangeUv =
    "the share of resin that lifts exchange is not counted under UV light, where what slices give is summed by their "
    "distance: of what stays liquid a lift would take a share of all that came before it, so that the order of slices "
    "counts; each layer is made to hold by its own exposure, whatever the share";
constexpr const char* kRobustUv =
    "a correction can't be robust beside an even dead zone: inputs that are off move the front, and with it the "
    "flow that brings its dose; expected even_dead_zone off";

constexpr const char* kPulsesUv =
    "{printer}: blue.grey: pulses are full light while they last, so that the dead zone is that of full light at every "
    "grey, and no grey makes it even; expected even_dead_zone off, or grey = \"steady\"";

constexpr Unsupported kTable[] = {
    {pulsed_grey, even_dead_zone, refused, kPulsesUv},
    {pulsed_grey, spread, refused,
     "{printer}: blue.grey: grey by pulses is not counted where light spreads, since pulses of pixels "
     "beside each other overlap or not; expected no spread, a resin with m = 1, or grey = \"steady\""},
    UNDER_UV(gel_time, refused, kGelTimeUv),
    UNDER_UV(bleaching, refused, kBleachingUv),
    {bleaching, gel_time, refused,
     "{resin}: bleaching: does not go with model = \"gel-time\"; expected a resin of model \"jacobs\""},
    {bleaching, vat_depth, refused,
     "{printer}: vat.depth_um: is not counted for a resin that bleaches: once resin runs off, how far light has "
     "bleached its way depends on the order in which slices are shown; expected a printer without it, or a "
     "resin without [bleaching]"},
    {bleaching, reflectance, refused,
     "{printer}: vat.platform_reflectance: is not counted for a resin that bleaches: light that comes back "
     "passes what it has bleached on its way, and bleaches it once more; expected a printer without it, or a "
     "resin without [bleaching]"},
    {lamps_stay, even_dead_zone, refused, kStayUv},
    {lamps_stay, layerwise, refused,
     "more light for slower slices is for continuous exposure: layer by layer the stage stands still; "
     "expected continuous exposure"},
    IN_HEIGHTS(
        vat_depth, refused,
        "layers of different heights are not counted in resin that ends above the window: its end "
        "would lie inside layers, which then get a part of a slice's light; expected layers of one "
        "height, or no depth"),
    {uv_patterned, spread, alone,
     "UV light is patterned, by grey levels and not by the light that columns get"},
    // What is wanted of a correction.
    {wanted_doses, exchange, refused,
     "doses can't be graded where lifts exchange resin: what of a dose is left depends on when its place gels, which "
     "layers still to come decide; expected no lift_exchange, or 0"},
    {wanted_doses, even_dead_zone, refused,
     "doses can't be graded beside an even dead zone: the light that gels resin just at the gap is the dose inside as "
     "well, and leaves none to choose; expected even_dead_zone off"},
    {derivatives, even_dead_zone, refused, kSureUv},
    {robust, even_dead_zone, refused, kRobustUv},
    {even_dead_zone, layerwise, refused,
     "an even dead zone is for continuous exposure: layer by layer resin comes to rest"},
    {even_dead_zone, spread, alone,
     "an even dead zone is found for light that stays in its pixel, and images keep it"},
    // What is left out.
    {edge_heights, reflectance, without,
     "edges lie at slices: the mesh's own heights are not counted below a platform that sends light "
     "back"},
    {edge_heights, own_heights, without, kEdgesInHeights},
    {edge_heights, moved_heights, without, kEdgesInHeights},
    {edge_heights, gel_time, without,
     "edges lie at slices: the mesh's own heights are not counted with a resin of model \"gel-time\""},
    {capped_dose, layerwise, without,
     "the dose inside features is not capped: layer by layer each layer gets the least that gels it"},
    UNDER_UV(capped_dose, without, kCapUv),
    {capped_dose, gel_time, without,
     "the dose inside features is not capped: with a time to gel they get the least that gels them"},
    {capped_dose, bleaching, without,
     "the dose inside features is not capped: of a resin that bleaches they get the least that gels "
     "them"},
    UNDER_UV(exchange, without, kExchangeUv),
    {exchange, gel_time, without,
     "the share of resin that lifts exchange is not counted with a resin of model \"gel-time\", whose inhibitor "
     "is exchanged as well: each layer is made to hold by its own exposure, whatever the share"},
    {exchange, bleaching, without,
     "the share of resin that lifts exchange is not counted with a resin that bleaches, since fresh resin is "
     "not bleached: each layer is made to hold by its own exposure, whatever the share"},
};

#undef UNDER_UV
#undef IN_HEIGHTS

/// With what light that scatters in the resin does not go, beside what light that spreads does not. `in_bath`: in resin
/// that ends.
struct NotScattered {
  Feature feature;
  const char* words;
  bool in_bath = false;
};

constexpr const char* kScatterUv =
    "UV light is on; expected one of both: the front where both lights cancel lies elsewhere for the light of each "
    "distance, which has spread by another width";
constexpr const char* kScatterHeights =
    "layers differ in height, of which each would scatter by weights of its own; expected one of both";

constexpr NotScattered kNotScattered[] = {
    {uv_constant, kScatterUv},
    {uv_per_slice, kScatterUv},
    {uv_patterned, kScatterUv},
    {even_dead_zone, kScatterUv},
    {gel_time,
     "model \"gel-time\"; expected one of both: scattered light of such resins does not add up from slice to slice"},
    {bleaching,
     "[bleaching]; expected one of both: scattered light of such resins does not add up from slice to slice"},
    {reflectance,
     "the platform sends light back, which scatters on a longer way; expected one of both"},
    {own_heights, kScatterHeights},
    {moved_heights, kScatterHeights},
    {exchange,
     "lifts exchange resin in a vat that ends: what lifts leave of light that came from beside is not followed to its "
     "end; expected no lift_exchange, no depth or no scatter",
     true},
};

constexpr const char* kNotBleached =
    "{resin}: bleaching: is not counted in {use}; expected a resin without it";

constexpr const char* kHoldsWhole =
    "resin '{resin}': corrections let each layer over a gap hold at its far edge, whatever skin a film has; expected no "
    "skin here: `verify` judges films by it";

constexpr const char* kUseNames[] = {
    "flowing resin",
    "tomographic printing",
    "printing by beams",
    "an exposure under UV light",
    "the times of test parts",
    "what parts tell of a resin",
    "what scans tell of a resin",
    "times to gel",
    "the choice of an absorber",
    "tables, which have no column for it",
    "assumed light",
    "how sure an exponent is",
    "corrections for films that hang by a skin (skin)",
};
static_assert(std::size(kUseNames) == static_cast<std::size_t>(LawUse::skins) + 1);

constexpr UncountedLaw kUncountedLaws[] = {
    {LawUse::flow, bleaching, kNotBleached},
    {LawUse::tomography, bleaching, kNotBleached},
    {LawUse::tomography, gel_time,
     "{resin}: cure.model: is \"gel-time\"; expected a resin of model \"jacobs\": light from all sides adds up in "
     "mJ/cm³ for that alone, and resinctl derive makes one for an intensity in the vial"},
    {LawUse::beams, bleaching, kNotBleached},
    {LawUse::uv_exposure, gel_time,
     "{resin}: cure.model: the resin has a time to gel, which UV light does not change; expected a resin of model "
     "\"kinetic\" with an [inhibition]"},
    {LawUse::uv_exposure, bleaching,
     "{resin}: bleaching: is not counted under UV light; expected a resin without it"},
    {LawUse::part_times, bleaching, kNotBleached},
    {LawUse::part_times, gel_time,
     "{resin}: cure.model: is \"gel-time\", by which {use} are not reckoned; expected one of another model (resinctl "
     "derive makes one of it)"},
    {LawUse::part_tuning, gel_time,
     "{resin}: cure.model: is \"gel-time\"; parts tune a resin of one law of dose: expected one that resinctl derive "
     "made for the intensities of the printer"},
    {LawUse::part_tuning, bleaching, kNotBleached},
    {LawUse::scan_tuning, gel_time,
     "{resin}: cure.model: is \"gel-time\"; scans tune a resin of one law of dose: expected one that resinctl derive "
     "made for the intensities of the printer"},
    {LawUse::scan_tuning, bleaching, kNotBleached},
    {LawUse::gel_times, bleaching, kNotBleached},
    {LawUse::absorber, gel_time,
     "{resin}: cure.model: is \"gel-time\"; an absorber is chosen for one law of dose: expected a resin that "
     "resinctl derive made for the intensities of the printer"},
    {LawUse::absorber, bleaching, kNotBleached},
    {LawUse::tables, bleaching, kNotBleached},
    {LawUse::assumed_light, gel_time,
     "resin '{resin}' has a time to gel, which counts light in mW/cm²: expected no assumed light with it"},
    {LawUse::assumed_light, bleaching,
     "resin '{resin}' bleaches, which counts light in mW/cm²: expected no assumed light with it"},
    {LawUse::exponent_errors, gel_time,
     "a resin of model \"gel-time\" has no exponent that could be off; expected no error of m"},
    {LawUse::exponent_errors, bleaching,
     "a resin that bleaches is counted with an exponent of 1; expected no error of m"},
    {LawUse::skins, gel_time, kHoldsWhole},
    {LawUse::skins, bleaching, kHoldsWhole},
};

using Name = std::pair<std::string_view, std::string_view>;

/// The text with names in place of marks.
std::string with_names(std::string text, std::initializer_list<Name> names) {
  for (const auto& [mark, name] : names) {
    if (const auto at = text.find(mark); at != text.npos) text.replace(at, mark.size(), name);
  }
  return text;
}
std::string with_names(const char* text, const std::string& printer, const std::string& resin) {
  return with_names(text, {{"{printer}", printer}, {"{resin}", resin}});
}

}  // namespace

std::string name_of(Feature feature) { return kNames[static_cast<std::size_t>(feature)]; }

std::span<const Unsupported> unsupported() { return kTable; }

const char* name_of(LawUse use) { return kUseNames[static_cast<std::size_t>(use)]; }

std::span<const UncountedLaw> uncounted_laws() { return kUncountedLaws; }

void refuse_law(const Resin& resin, LawUse use) {
  for (const UncountedLaw& row : kUncountedLaws) {
    const bool has = row.law == gel_time ? resin.has_gel_time() : resin.bleaches();
    if (row.use != use || !has) continue;
    throw InputError(with_names(row.words, {{"{resin}", resin.name}, {"{use}", name_of(use)}}));
  }
}

std::vector<Feature> features_of(const Printer& printer, const Resin& resin,
                                 const Process& process) {
  const Process lit = as_lamp_shines(process);
  std::vector<Feature> features;
  const auto add = [&](bool is, Feature feature) {
    if (is) features.push_back(feature);
  };
  add(process.mode == ExposureMode::layerwise, layerwise);
  const bool even = process.even_light || process.even_dead_zone != EvenDeadZone::off;
  add(even, even_dead_zone);
  add(!even && lit.uv.kind == UvKind::constant, uv_constant);
  add(!even && lit.uv.kind == UvKind::per_slice, uv_per_slice);
  add(!even && process.uv.kind == UvKind::patterned, uv_patterned);
  add(resin.has_gel_time(), gel_time);
  add(resin.bleaches(), bleaching);
  add(light_spreads(printer, resin, process), spread);
  add(printer.flat_field.has_value(), uneven_light);
  add(printer.resin_depth_um > 0, vat_depth);
  add(printer.platform_reflectance > 0, reflectance);
  add(process.mode == ExposureMode::layerwise && process.lifts == Lifts::each, Feature::lifts);
  add(process.mode == ExposureMode::layerwise && process.lifts == Lifts::each &&
          process.lift_exchange > 0,
      exchange);
  add(process.mode == ExposureMode::continuous && !lit.slice_speed_mm_h.empty() &&
          lit.slice_lamps == SliceLamps::stay,
      lamps_stay);
  add(light_differs(lit) || usual_light_share(lit) != 1, dim_light);
  add(light_differs(lit), own_light);
  const bool heights = !process.layer_heights_um.empty();
  add(heights && process.mode == ExposureMode::layerwise, own_heights);
  add(heights && process.mode == ExposureMode::continuous, moved_heights);
  add(process.surface == Surface::mesh, edge_heights);
  add(process.omega_max < kNoCap, capped_dose);
  // Where dose is light times time it is the same, however the light of a level is made.
  add(printer.grey == GreyLight::pulsed &&
          (resin.m != 1 || resin.has_gel_time() || process.uv.kind != UvKind::off || even),
      pulsed_grey);
  add(printer.uv_flat_field && (process.uv.kind != UvKind::off || even), uneven_uv);
  add(!process.uv_lamp_share.empty() && (process.uv.kind != UvKind::off || even), fading_uv);
  return features;
}

const Unsupported* find_unsupported(std::span<const Feature> features, Verdict verdict) {
  const auto is = [&](Feature f) {
    return std::find(features.begin(), features.end(), f) != features.end();
  };
  for (const Unsupported& pair : kTable) {
    if (pair.verdict == verdict && is(pair.a) && is(pair.b)) return &pair;
  }
  return nullptr;
}

void check_supported(std::span<const Feature> features, const std::string& printer,
                     const std::string& resin) {
  if (const Unsupported* pair = find_unsupported(features, refused)) {
    throw InputError(with_names(pair->words, printer, resin));
  }
}

namespace {

void check_scatter(std::span<const Feature> features, const Printer& printer, const Resin& resin) {
  if (!(resin.scatter_um2_per_um > 0)) return;
  for (const NotScattered& it : kNotScattered) {
    if ((it.in_bath && !(printer.resin_depth_um > 0)) ||
        std::find(features.begin(), features.end(), it.feature) == features.end()) {
      continue;
    }
    throw InputError("resin '" + resin.name + "' has scatter_um2_per_um, and " + it.words);
  }
}

}  // namespace

void check_supported(const Printer& printer, const Resin& resin, const Process& process) {
  check_same_unit(printer, resin);
  const std::vector<Feature> features = features_of(printer, resin, process);
  check_supported(features, printer.name, resin.name);
  check_scatter(features, printer, resin);
}

void check_corrected(const Printer& printer, const Resin& resin, const Process& process) {
  check_same_unit(printer, resin);
  const std::vector<Feature> features = features_of(printer, resin, process);
  check_supported(features, printer.name, resin.name);
  check_scatter(features, printer, resin);
  if (const Unsupported* pair = find_unsupported(features, not_corrected)) {
    throw InputError(with_names(pair->words, printer.name, resin.name));
  }
}

namespace {

/// Why `feature` is left out of a print; null where it is counted.
const char* why_left_out(Feature feature, const Printer& printer, const Resin& resin,
                         const Process& process) {
  const std::vector<Feature> features = features_of(printer, resin, process);
  for (const Unsupported& pair : kTable) {
    if (pair.verdict == without && pair.a == feature &&
        std::find(features.begin(), features.end(), pair.b) != features.end()) {
      return pair.words;
    }
  }
  return nullptr;
}

}  // namespace

const char* leave_out_heights(const Printer& printer, const Resin& resin, Process& process) {
  const char* const why = why_left_out(edge_heights, printer, resin, process);
  if (why) process.surface = Surface::slices;
  return why;
}

const char* leave_out_lifts(const Printer& printer, const Resin& resin, Process& process) {
  if (process.mode != ExposureMode::layerwise || process.lifts == Lifts::none) return nullptr;
  const char* const why = why_left_out(exchange, printer, resin, process);
  if (why) process.lift_exchange = kUnknownExchange;
  return why;
}

const char* leave_out_cap(const Printer& printer, const Resin& resin, Process& process) {
  if (process.omega_max >= kNoCap) return nullptr;
  const char* const why = why_left_out(capped_dose, printer, resin, process);
  if (why) process.omega_max = kNoCap;
  return why;
}

}  // namespace slicecorr
