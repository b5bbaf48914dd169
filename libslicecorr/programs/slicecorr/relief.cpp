// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "relief.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/relief.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

namespace {

/// Wishes that differ, and which of them each pixel has.
struct Wishes {
  int width_px = 0, height_px = 0;
  std::vector<ReliefHeights> wanted;
  std::vector<std::size_t> of_pixel;
  std::vector<std::uint64_t> pixels;  ///< how many have each wish
};

/// What the images show of a relief, level by level.
struct Shown {
  std::vector<int> blue_level, uv_level;  ///< of wishes
  std::vector<ReliefHeights> comes;
  double uv_mw_cm2 = 0;  ///< of a flood
};

Wishes read_wishes(const ReliefOptions& o, const Printer& printer) {
  const auto read = [&](const std::string& path) {
    return read_flat_field_png(path, [&](int width, int height) {
      if (width > printer.width_px || height > printer.height_px) {
        throw InputError(
            path, "",
            fmt::format("is {} x {} pixels; expected at most {} x {}, what printer '{}' shows",
                        width, height, printer.width_px, printer.height_px, printer.name));
      }
    });
  };
  const GreyImage back = read(o.back);
  GreyImage front{back.width_px, back.height_px, std::vector<std::uint8_t>(back.pixels.size(), 0)};
  if (!o.front.empty()) front = read(o.front);
  if (front.width_px != back.width_px || front.height_px != back.height_px) {
    throw InputError(o.front, "",
                     fmt::format("is {} x {} pixels; expected {} x {} as {}", front.width_px,
                                 front.height_px, back.width_px, back.height_px, o.back));
  }
  Wishes w;
  w.width_px = back.width_px;
  w.height_px = back.height_px;
  std::map<std::pair<int, int>, std::size_t> known;
  for (std::size_t i = 0; i < back.pixels.size(); ++i) {
    const int b = back.pixels[i], f = b == 0 ? 0 : front.pixels[i];
    const auto [at, fresh] = known.try_emplace({f, b}, w.wanted.size());
    if (fresh) {
      w.wanted.push_back({o.front_most_um * f / 255, o.back_most_um * b / 255});
      w.pixels.push_back(0);
    }
    ++w.pixels[at->second];
    w.of_pixel.push_back(at->second);
  }
  return w;
}

int nearest(const std::vector<double>& levels, double mw_cm2) {
  const auto above = std::lower_bound(levels.begin(), levels.end(), mw_cm2);
  if (above == levels.begin()) return 0;
  if (above == levels.end()) return static_cast<int>(levels.size()) - 1;
  const auto i = static_cast<int>(above - levels.begin());
  return *above - mw_cm2 < mw_cm2 - *(above - 1) ? i : i - 1;
}

Shown shown_of(const ReliefAnswer& relief, const Kinetics& kinetics, const Printer& printer) {
  Shown s;
  const std::vector<double> blue = level_intensities(printer);
  const bool images = printer.uv && printer.uv->patterned && relief.uv_mw_cm2 > 0;
  const std::vector<double> uv = images ? uv_level_intensities(printer) : std::vector<double>{};
  s.uv_mw_cm2 = relief.uv_mw_cm2;
  for (const ReliefLight& place : relief.places) {
    const int level = nearest(blue, place.blue_mw_cm2);
    const int uv_level = images ? nearest(uv, place.uv_mw_cm2) : 0;
    s.blue_level.push_back(level);
    s.uv_level.push_back(uv_level);
    const double over = images ? uv[static_cast<std::size_t>(uv_level)] : relief.uv_mw_cm2;
    s.comes.push_back(
        gelled_after(kinetics, blue[static_cast<std::size_t>(level)], over, relief.time_s));
  }
  return s;
}

void write_levels(const std::string& path, const Wishes& w, const std::vector<int>& level_of,
                  int levels) {
  GreyImage image{w.width_px, w.height_px, {}};
  for (const std::size_t i : w.of_pixel) {
    image.pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(level_of[i], levels)));
  }
  const auto png = encode_png(image);
  write_text_file(path, std::string(png.begin(), png.end()));
}

/// How far off what the images show is, over pixels.
struct Misses {
  double front_um = 0, back_um = 0;  ///< greatest
  std::uint64_t too_low = 0, dim = 0, not_gelled = 0, gelled = 0;
};

Misses misses_of(const Wishes& w, const ReliefAnswer& relief, const Shown& shown) {
  Misses m;
  for (std::size_t i = 0; i < w.wanted.size(); ++i) {
    const ReliefHeights& wish = w.wanted[i];
    const ReliefHeights& comes = shown.comes[i];
    if (wish.back_um == 0) {
      if (comes.back_um > 0) m.gelled += w.pixels[i];
      continue;
    }
    if (relief.places[i].miss == ReliefMiss::too_low) m.too_low += w.pixels[i];
    if (relief.places[i].miss == ReliefMiss::dim) m.dim += w.pixels[i];
    if (comes.back_um == 0) {
      m.not_gelled += w.pixels[i];
      continue;
    }
    m.front_um = std::max(m.front_um, std::abs(comes.front_um - wish.front_um));
    m.back_um = std::max(m.back_um, std::abs(comes.back_um - wish.back_um));
  }
  return m;
}

std::vector<std::string> words_of(const Misses& m, const ReliefAnswer& relief) {
  std::vector<std::string> words;
  if (m.too_low > 0) {
    words.push_back(fmt::format(
        "{} pixels want a back nearer to the window than {:.4g} um, behind which resin gels first under "
        "this UV light: they get that",
        m.too_low, relief.least_back_um));
  }
  if (m.dim > 0) {
    words.push_back(fmt::format("{} pixels want more light than the lamps give in {:.4g} s", m.dim,
                                relief.time_s));
  }
  if (m.not_gelled > 0)
    words.push_back(fmt::format("{} pixels that should gel do not", m.not_gelled));
  if (m.gelled > 0) {
    words.push_back(fmt::format("{} pixels gel by the light of black that should not", m.gelled));
  }
  return words;
}

int relief(const ReliefOptions& o, const ExecutionContext& context, Console& console) {
  const Printer printer = load_printer(o.printer);
  const Resin resin = load_resin(o.resin);
  refuse_relative(printer, "a relief");
  if (!o.front.empty() && !(o.front_most_um > 0)) {
    throw InputError("--front: expected --front-most-um, the height of white, with it");
  }
  if (printer.uv_flat_field || printer.flat_field || !printer.spread.none()) {
    throw InputError(
        printer.name, "",
        "has light that is uneven or spreads, which a relief does not count; expected even "
        "light of each pixel alone");
  }
  const Wishes wishes = read_wishes(o, printer);
  const bool fronts = std::any_of(wishes.wanted.begin(), wishes.wanted.end(),
                                  [](const ReliefHeights& w) { return w.front_um > 0; });
  if (fronts && printer.grey == GreyLight::pulsed) {
    throw InputError(
        printer.name, "blue.grey",
        "grey by pulses is not counted under UV light; expected no front, or steady grey");
  }
  for (const std::string& text : o.light.checked(printer, resin, fronts)) context.tell(text);
  if (fronts && !resin.inhibition) {
    throw InputError(resin.name, "inhibition",
                     "is missing; fronts above the window need a resin that UV light inhibits");
  }
  const Printer seen = for_resin(printer, resin);
  const Kinetics kinetics = make_kinetics(resin, fronts, false);
  ReliefGoal goal;
  goal.most_blue_mw_cm2 = level_intensities(seen).back();
  goal.most_uv_mw_cm2 = printer.uv ? printer.uv->max_mw_cm2() : 0;
  goal.uv_by_place = printer.uv && printer.uv->patterned;
  if (o.time_s > 0) goal.time_s = o.time_s;
  goal.weight.assign(wishes.pixels.begin(), wishes.pixels.end());
  if (fronts && goal.uv_by_place && o.uv_output.empty()) {
    throw InputError("the UV lamp shows images; expected --uv-output for its image");
  }
  if (!o.uv_output.empty() && !(fronts && goal.uv_by_place)) {
    throw InputError(
        "--uv-output: there is no UV image; expected a front and a UV lamp that shows patterns with it");
  }
  std::vector<std::string> taken{o.back};
  if (!o.front.empty()) taken.push_back(o.front);
  for (const std::string& output : {o.output, o.uv_output, o.json}) {
    check_output(output, taken);
    if (!output.empty() && output != "-") taken.push_back(output);
  }
  const ReliefAnswer found = find_relief(kinetics, wishes.wanted, goal);
  const Shown shown = shown_of(found, kinetics, seen);
  const Misses misses = misses_of(wishes, found, shown);
  const std::vector<std::string> words = words_of(misses, found);
  for (const std::string& text : words) context.tell(text);
  write_levels(o.output, wishes, shown.blue_level, printer.levels());
  if (!o.uv_output.empty()) write_levels(o.uv_output, wishes, shown.uv_level, printer.levels());
  if (!o.json.empty()) {
    nlohmann::ordered_json j;
    j["time_s"] = found.time_s;
    j["uv_mw_cm2"] = found.uv_mw_cm2;
    j["uv_by_place"] = !o.uv_output.empty();
    j["least_back_um"] = found.least_back_um;
    j["front_error_um"] = misses.front_um;
    j["back_error_um"] = misses.back_um;
    j["pixels"] = {{"too_low", misses.too_low},
                   {"dim", misses.dim},
                   {"not_gelled", misses.not_gelled},
                   {"gelled_by_black", misses.gelled}};
    j["warnings"] = words;
    print_or_write(o.json, j.dump(2));
  }
  if (o.json != "-") {
    print_result(fmt::format(
        "{:.5g} s{}; with the levels of the images fronts are off by up to {:.4g} um, backs by up to "
        "{:.4g} um\n",
        found.time_s,
        found.uv_mw_cm2 > 0 ? fmt::format(", {}{:.5g} mW/cm² of UV light",
                                          o.uv_output.empty() ? "" : "up to ", found.uv_mw_cm2)
                            : std::string(),
        misses.front_um, misses.back_um));
  }
  console.say(fmt::format("{}: written", o.output));
  return kDone;
}

}  // namespace

void add_relief(Program& program, ReliefOptions& o) {
  CLI::App* sub = program.add(
      "relief",
      "One exposure that gels from wanted fronts to wanted backs: the image, the UV light and the time",
      [&o](const ExecutionContext& context, Console& console) {
        return relief(o, context, console);
      });
  sub->add_option("--back", o.back,
                  "PNG of how far from the window resin is to gel, black nothing, white "
                  "--back-most-um")
      ->required()
      ->check(CLI::ExistingFile);
  sub->add_option("--back-most-um", o.back_most_um, "Height of white in --back")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--front", o.front,
                  "PNG of how far from the window resin is to begin to gel, white "
                  "--front-most-um [at the window]")
      ->check(CLI::ExistingFile);
  sub->add_option("--front-most-um", o.front_most_um, "Height of white in --front")
      ->check(number_above_zero());
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  o.light.add_to(*sub);
  sub->add_option("--time-s", o.time_s, "Exposure [the shortest that the lamps allow]")
      ->check(number_above_zero());
  sub->add_option("-o,--output", o.output, "PNG of the curing light's levels")->required();
  sub->add_option("--uv-output", o.uv_output,
                  "PNG of the UV light's levels, of lamps that show patterns");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::cli
