// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Where things are in the parts to measure, and how long they are lit.
#include "slicecorr/tuning_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

constexpr int kDark = 20, kPlugs = 6, kSteps = 12, kZoneColumns = 4, kZoneRows = 3;
/// Teeth, and the gaps after all but the last, in slices.
struct Teeth {
  std::array<int, 6> teeth;
  std::array<int, 5> gaps;
};
constexpr Teeth kComb = {{10, 10, 10, 10, 10, 10}, {4, 6, 8, 12, 16}};
constexpr Teeth kLiftComb = {{1, 2, 4, 8, 16, 32}, {16, 16, 16, 16, 16}};
/// Over the gel dose. Up to where heights go with the logarithm of the dose for sure, from where a
/// plug is high enough to be handled.
constexpr double kLeastDose = 1.5, kMostDose = 9, kFirstStep = 1.3;
constexpr double kSideUm = 4000, kLeastSideUm = 500, kSpineUm = 2000, kFlatPitchUm = 8000;
/// Share of a plug's dose that may come from black pixels.
constexpr double kMostBlack = 0.5;

int pixels(double um, double pixel_um) {
  return std::max(1, static_cast<int>(std::lround(um / pixel_um)));
}

/// Light of the levels where a plug is.
class PlateLight {
 public:
  explicit PlateLight(const Printer& printer)
      : map_(printer, plate_grid(printer), ImageFrame{}), levels_(level_intensities(printer)) {}
  int top() const { return static_cast<int>(levels_.size()) - 1; }
  /// In the middle of a box.
  double at(const PixelBox& box, int level) const {
    const int x = (box.x0 + box.x1) / 2, y = (box.y0 + box.y1) / 2;
    return levels_[static_cast<std::size_t>(level)] * map_.factor(map_.value(x, y));
  }
  /// The level whose light is nearest to a share of full light.
  int nearest(double share) const {
    int best = 0;
    for (int n = 1; n <= top(); ++n) {
      const auto off = [&](int level) {
        return std::abs(levels_[static_cast<std::size_t>(level)] - share * levels_.back());
      };
      if (off(n) < off(best)) best = n;
    }
    return best;
  }

 private:
  LightMap map_;
  std::vector<double> levels_;
};

std::uint8_t value_of(int level, const Printer& printer) {
  return static_cast<std::uint8_t>(pixel_of_level(level, printer.levels()));
}

}  // namespace

const char* word_of(TuningPartKind kind) {
  switch (kind) {
    case TuningPartKind::comb:
      return "comb";
    case TuningPartKind::staircase:
      return "staircase";
    case TuningPartKind::wedge:
      return "wedge";
    case TuningPartKind::dead_zone:
      return "dead-zone";
    case TuningPartKind::lift_comb:
      return "lift-comb";
    case TuningPartKind::flat_field:
      break;
  }
  return "flat-field";
}

TuningPart::TuningPart(TuningPartKind kind, const Printer& printer, const Ask& ask)
    : kind_(kind), ask_(ask), printer_name_(printer.name), grid_(plate_grid(printer)) {
  using enum TuningPartKind;
  grid_.layer_um = ask.layer_um;
  if (!(ask.layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!ask.resin && (kind == staircase || kind == wedge || kind == flat_field)) {
    throw InputError(
        fmt::format("a part '{}' needs a resin, which says how long its plugs take; expected one",
                    word_of(kind)));
  }
  // Fits take their tables for mW/cm²; films (films_part.hpp) do without.
  if (!is_comb() && kind != flat_field) {
    refuse_relative(printer, fmt::format("a part '{}'", word_of(kind)).c_str());
  }
  if (ask.resin) check_same_unit(printer, *ask.resin);
  if (ask.resin) refuse_law(*ask.resin, LawUse::part_times);
  if (!is_comb() && !(printer.calibration.back().intensity_mw_cm2 > 0)) {
    throw InputError(fmt::format("printer '{}' has no light at full level", printer.name));
  }
  if (ask.resin) height_e_um_ = units::height_e_from_10(ask.resin->absorbance_height10_um);
  if (is_comb()) make_comb(printer);
  if (kind == staircase) make_staircase(printer);
  if (kind == wedge) make_wedge(printer);
  if (kind == dead_zone) make_dead_zone(printer);
  if (kind == flat_field) make_flat_field(printer);
  ask_.resin = nullptr;
  for (const Block& b : blocks_) bounds_ = bounds_.united(b.box);
}

void TuningPart::make_comb(const Printer& printer) {
  const int side_x = pixels(kSideUm, grid_.pixel_x_um), side_y = pixels(kSideUm, grid_.pixel_y_um);
  const int spine = pixels(kSpineUm, grid_.pixel_x_um), width = spine + side_x;
  if (width > grid_.width_px || side_y > grid_.height_px) {
    throw InputError(fmt::format(
        "printer '{}' shows {} x {} pixels of the plate; expected at least {} x {}, which the part "
        "takes up",
        printer.name, grid_.width_px, grid_.height_px, width, side_y));
  }
  const int x = (grid_.width_px - width) / 2, y = (grid_.height_px - side_y) / 2;
  const auto edge = [&](std::size_t tooth, const char* what, const char* kind, int node,
                        const PixelBox& box) {
    Row r;
    r.name = fmt::format("tooth {} {}", tooth + 1, what);
    r.kind = kind;
    r.box = box;
    r.designed_um = node * grid_.layer_um;
    rows_.push_back(r);
  };
  int at = kDark;
  const Teeth& sizes = kind_ == TuningPartKind::comb ? kComb : kLiftComb;
  for (std::size_t tooth = 0; tooth < sizes.teeth.size(); ++tooth) {
    if (tooth > 0) at += sizes.gaps[tooth - 1];
    const PixelBox box{x + spine, y, x + width, y + side_y};
    const int past = at + sizes.teeth[tooth];
    blocks_.push_back({box, at, past, 255});
    edge(tooth, "begins", "upper", at, box);
    edge(tooth, "ends", "lower", past, box);
    at = past;
  }
  grid_.layers = at;
  blocks_.push_back({{x, y, x + spine, y + side_y}, 0, at, 255});
  x_px_ = x + spine + side_x / 2;
  y_px_ = y + side_y / 2;
}

std::vector<PixelBox> TuningPart::boxes(const Printer& printer, int columns, int rows,
                                        bool apart) const {
  // Sides of a plug and half a side of dark between two.
  const double across = apart ? 1.5 * columns - 0.5 : columns;
  const double down = apart ? 1.5 * rows - 0.5 : rows;
  const double side_um = std::min({kSideUm, grid_.width_px * grid_.pixel_x_um / across,
                                   grid_.height_px * grid_.pixel_y_um / down});
  const int side_x = static_cast<int>(side_um / grid_.pixel_x_um + 1e-9);
  const int side_y = static_cast<int>(side_um / grid_.pixel_y_um + 1e-9);
  if (side_um < kLeastSideUm || side_x < 1 || side_y < 1) {
    throw InputError(fmt::format(
        "the plate of printer '{}' is {:.3g} x {:.3g} mm; expected at least {:.3g} x {:.3g} mm, "
        "which the part takes up",
        printer.name, grid_.width_px * grid_.pixel_x_um * 1e-3,
        grid_.height_px * grid_.pixel_y_um * 1e-3, across * kLeastSideUm * 1e-3,
        down * kLeastSideUm * 1e-3));
  }
  const int step_x = apart ? side_x + side_x / 2 : side_x;
  const int step_y = apart ? side_y + side_y / 2 : side_y;
  const int x = (grid_.width_px - (columns - 1) * step_x - side_x) / 2;
  const int y = (grid_.height_px - (rows - 1) * step_y - side_y) / 2;
  std::vector<PixelBox> all;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const int left = x + i * step_x, top = y + j * step_y;
      all.push_back({left, top, left + side_x, top + side_y});
    }
  }
  return all;
}

void TuningPart::make_staircase(const Printer& printer) {
  const Kinetics k = make_kinetics(*ask_.resin, false, false);
  const PlateLight light(printer);
  std::vector<int> levels;
  for (const double share : {1.0, 0.5, 0.25}) {
    const int level = light.nearest(share);
    if (level > 0 && (levels.empty() || level < levels.back())) levels.push_back(level);
  }
  const auto rate = [&](double mw_cm2) { return std::pow(mw_cm2, k.m); };
  // All is dark at the same moment, when the slowest plug is done; until then black pixels give dose
  // to those that are done. Intensities that leave too much to these are left out.
  std::vector<PixelBox> places;
  double all_s = 0;
  while (true) {
    places = boxes(printer, kPlugs, static_cast<int>(levels.size()), true);
    all_s = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double lit = light.at(places[i], levels[i / kPlugs]);
      all_s = std::max(all_s, kMostDose * k.critical_dose_prime / rate(lit));
    }
    double black = 0;
    for (const PixelBox& box : places) black = std::max(black, rate(light.at(box, 0)));
    if (black * all_s <= kMostBlack * kLeastDose * k.critical_dose_prime) break;
    levels.pop_back();
    if (!levels.empty()) continue;
    throw InputError(fmt::format(
        "black pixels of printer '{}' are too bright for a staircase: in the {:.3g} s of its "
        "longest plug they give {:.2g} times the gel dose; expected less than {:g}",
        printer.name, all_s, black * all_s / k.critical_dose_prime, kMostBlack * kLeastDose));
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::size_t of_level = i % kPlugs;
    const int level = levels[i / kPlugs];
    Row r;
    r.kind = "plug";
    r.name = fmt::format("plug {}-{}", i / kPlugs + 1, of_level + 1);
    r.box = places[i];
    r.intensity_mw_cm2 = light.at(r.box, level);
    r.dark_mw_cm2 = light.at(r.box, 0);
    const double dose =
        kLeastDose *
        std::pow(kMostDose / kLeastDose, static_cast<double>(of_level) / (kPlugs - 1.0)) *
        k.critical_dose_prime;
    const double lit = rate(r.intensity_mw_cm2), dark = rate(r.dark_mw_cm2);
    r.shown_s = std::min(all_s, (dose - dark * all_s) / (lit - dark));
    r.dark_s = all_s - r.shown_s;
    r.exposure_s = r.shown_s + dark / lit * r.dark_s;
    rows_.push_back(r);
    image_s_.push_back(r.shown_s);
  }
  // An image for each time at which a plug goes dark; a ten thousandth is one and the same.
  std::sort(image_s_.begin(), image_s_.end());
  std::vector<double> ends;
  for (const double s : image_s_) {
    if (ends.empty() || s > ends.back() * 1.0001) ends.push_back(s);
  }
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const auto past = std::find_if(ends.begin(), ends.end(),
                                   [&](double s) { return s * 1.0001 >= rows_[i].shown_s; });
    blocks_.push_back({rows_[i].box, 0, static_cast<int>(past - ends.begin()) + 1,
                       value_of(levels[i / kPlugs], printer)});
  }
  image_s_.clear();
  for (std::size_t n = 0; n < ends.size(); ++n) {
    image_s_.push_back(ends[n] - (n ? ends[n - 1] : 0));
  }
  grid_.layers = static_cast<int>(ends.size());
}

void TuningPart::make_wedge(const Printer& printer) {
  const Kinetics k = make_kinetics(*ask_.resin, false, false);
  const PlateLight light(printer);
  const auto places = boxes(printer, kSteps, 1, false);
  const double seconds =
      kMostDose * k.critical_dose_prime / std::pow(light.at(places.back(), light.top()), k.m);
  int before = 0;
  for (int n = 0; n < kSteps; ++n) {
    const double dose = kFirstStep * std::pow(kMostDose / kFirstStep, n / (kSteps - 1.0));
    const int level = light.nearest(std::pow(dose / kMostDose, 1 / k.m));
    if (level <= before) continue;  // few levels: steps that would be alike
    before = level;
    Row r;
    r.kind = "plug";
    r.name = fmt::format("step {}", rows_.size() + 1);
    r.box = places[static_cast<std::size_t>(n)];
    r.intensity_mw_cm2 = light.at(r.box, level);
    r.shown_s = r.exposure_s = seconds;
    r.dark_mw_cm2 = light.at(r.box, 0);
    rows_.push_back(r);
    blocks_.push_back({r.box, 0, 1, value_of(level, printer)});
  }
  image_s_ = {seconds};
  grid_.layers = 1;
}

void TuningPart::make_dead_zone(const Printer& printer) {
  if (!(ask_.uv_mw_cm2 > 0)) {
    throw InputError(
        "a part 'dead-zone' is lit by UV light, too; expected its intensity, above 0 mW/cm2");
  }
  if (!(ask_.exposure_s > 0)) throw InputError("plugs are lit for 0 s; expected more");
  const PlateLight light(printer);
  const auto places = boxes(printer, kZoneColumns, kZoneRows, true);
  constexpr int plugs = kZoneColumns * kZoneRows;
  int before = light.top() + 1;
  for (int n = 0; n < plugs; ++n) {
    const int level = light.nearest(std::pow(10, -n / (plugs - 1.0)));
    if (level >= before || level == 0) continue;
    before = level;
    Row r;
    r.kind = "plug";
    r.name = fmt::format("plug {}", rows_.size() + 1);
    r.box = places[static_cast<std::size_t>(n)];
    r.intensity_mw_cm2 = light.at(r.box, level);
    r.shown_s = r.exposure_s = ask_.exposure_s;
    r.dark_mw_cm2 = light.at(r.box, 0);
    rows_.push_back(r);
    blocks_.push_back({r.box, 0, 1, value_of(level, printer)});
  }
  image_s_ = {ask_.exposure_s};
  grid_.layers = 1;
}

void TuningPart::make_flat_field(const Printer& printer) {
  const Kinetics k = make_kinetics(*ask_.resin, false, false);
  const double width_um = grid_.width_px * grid_.pixel_x_um;
  const double height_um = grid_.height_px * grid_.pixel_y_um;
  const auto places_along = [](double um) {
    return std::clamp(static_cast<int>(std::lround(um / kFlatPitchUm)), 3, 12);
  };
  columns_ = places_along(width_um);
  const int rows = places_along(height_um);
  // The picture that is made of it has a pixel for each plug, whose middle is that of the plug.
  const double side_um = std::min({kSideUm, width_um / columns_ / 1.5, height_um / rows / 1.5});
  if (side_um < kLeastSideUm) {
    throw InputError(fmt::format(
        "the plate of printer '{}' is {:.3g} x {:.3g} mm; expected at least 2.25 x 2.25 mm, which "
        "the part takes up",
        printer.name, width_um * 1e-3, height_um * 1e-3));
  }
  const int side_x = pixels(side_um, grid_.pixel_x_um), side_y = pixels(side_um, grid_.pixel_y_um);
  const double light = printer.calibration.back().intensity_mw_cm2;
  // The middle of what staircases span.
  const double seconds =
      std::sqrt(kLeastDose * kMostDose) * k.critical_dose_prime / std::pow(light, k.m);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns_; ++i) {
      const int left =
          static_cast<int>(std::lround((i + 0.5) * grid_.width_px / columns_ - side_x / 2.0));
      const int top =
          static_cast<int>(std::lround((j + 0.5) * grid_.height_px / rows - side_y / 2.0));
      Row r;
      r.kind = "plug";
      r.name = fmt::format("row {} column {}", j + 1, i + 1);
      r.box = {left, top, left + side_x, top + side_y};
      r.intensity_mw_cm2 = light;
      r.shown_s = r.exposure_s = seconds;
      rows_.push_back(r);
      blocks_.push_back({r.box, 0, 1, 255});
    }
  }
  image_s_ = {seconds};
  grid_.layers = 1;
}

void TuningPart::read_band(const PixelBox& band, const Sink& sink) const {
  const auto width = static_cast<std::size_t>(band.width());
  std::vector<std::uint8_t> rows(width * static_cast<std::size_t>(band.height()));
  for (int n = 0; n < grid_.layers; ++n) {
    std::fill(rows.begin(), rows.end(), std::uint8_t{0});
    bool lit = false;
    for (const Block& b : blocks_) {
      if (n < b.first || n >= b.past) continue;
      const int x0 = std::max(b.box.x0, band.x0), x1 = std::min(b.box.x1, band.x1);
      for (int y = std::max(b.box.y0, band.y0); y < std::min(b.box.y1, band.y1) && x0 < x1; ++y) {
        const auto row = rows.begin() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width();
        std::fill(row + (x0 - band.x0), row + (x1 - band.x0), b.value);
        lit = true;
      }
    }
    sink(n, lit ? rows.data() : nullptr);
  }
}

MeasuringForm TuningPart::form() const {
  using enum TuningPartKind;
  MeasuringForm f;
  f.part = word_of(kind_);
  const auto fact = [&](const char* name, double value) { f.add_fact(name, value); };
  fact("layer_um", grid_.layer_um);
  fact("width_px", grid_.width_px);
  fact("height_px", grid_.height_px);
  if (is_comb()) {
    fact("x_px", x_px_);
    fact("y_px", y_px_);
  }
  if (kind_ == flat_field) {
    fact("columns", columns_);
    fact("height_e_um", height_e_um_);
  }
  const auto with = [&](std::vector<std::string> known, const char* measured) {
    f.known = known.size();
    f.columns = std::move(known);
    f.columns.emplace_back(measured);
    f.note = fmt::format(
        "Fill in {}, in um; leave empty what was not measured, change nothing else.", measured);
  };
  if (is_comb()) with({"name", "kind", "designed_um"}, "measured_um");
  if (kind_ == staircase || kind_ == wedge) {
    with({"name", "intensity_mw_cm2", "exposure_s", "shown_s", "dark_s", "dark_mw_cm2"},
         "cured_height_um");
  }
  if (kind_ == dead_zone) {
    with({"name", "blue_mw_cm2", "uv_mw_cm2", "exposure_s"}, "dead_zone_um");
  }
  if (kind_ == flat_field) {
    with({"name", "x_px", "y_px", "intensity_mw_cm2", "exposure_s"}, "cured_height_um");
  }
  const auto number = [](double v) { return fmt::format("{:.6g}", v); };
  for (const Row& r : rows_) {
    std::vector<std::string> cells = {r.name};
    if (is_comb()) {
      cells.insert(cells.end(), {r.kind, number(r.designed_um)});
    } else if (kind_ == dead_zone) {
      cells.insert(cells.end(),
                   {number(r.intensity_mw_cm2), number(ask_.uv_mw_cm2), number(r.exposure_s)});
    } else {
      if (kind_ == flat_field) {
        cells.insert(cells.end(),
                     {number((r.box.x0 + r.box.x1) / 2.0), number((r.box.y0 + r.box.y1) / 2.0)});
      }
      cells.insert(cells.end(), {number(r.intensity_mw_cm2), number(r.exposure_s)});
      if (kind_ != flat_field) {
        cells.insert(cells.end(), {number(r.shown_s), number(r.dark_s), number(r.dark_mw_cm2)});
      }
    }
    f.rows.push_back(std::move(cells));
  }
  return f;
}

}  // namespace slicecorr
