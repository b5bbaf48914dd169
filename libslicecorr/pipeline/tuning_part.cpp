#include "slicecorr/tuning_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"

namespace slicecorr {

namespace {

constexpr int kDark = 20, kTooth = 10, kPlugs = 6;
constexpr int kGaps[] = {4, 6, 8, 12, 16};
constexpr double kSideUm = 4000, kSpineUm = 2000;

int pixels(double um, double pixel_um) {
  return std::max(1, static_cast<int>(std::lround(um / pixel_um)));
}

}  // namespace

std::string tuning_hash(std::string_view text) {
  std::uint64_t hash = 14695981039346656037ull;  // FNV-1a
  for (const char c : text) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 1099511628211ull;
  }
  return fmt::format("{:016x}", hash);
}

TuningPart::TuningPart(TuningPartKind kind, const Printer& printer, const Resin* resin,
                       double layer_um)
    : kind_(kind) {
  grid_ = plate_grid(printer);
  grid_.layer_um = layer_um;
  const int side_x = pixels(kSideUm, grid_.pixel_x_um), side_y = pixels(kSideUm, grid_.pixel_y_um);
  const int spine = pixels(kSpineUm, grid_.pixel_x_um);
  const bool comb = kind == TuningPartKind::comb;
  const int width = comb ? spine + side_x : (3 * kPlugs - 1) * side_x / 2;
  if (width > grid_.width_px || side_y > grid_.height_px) {
    throw InputError(fmt::format(
        "printer '{}' shows {} x {} pixels of the plate; expected at least {} x {}, which the part "
        "takes up",
        printer.name, grid_.width_px, grid_.height_px, width, side_y));
  }
  const int x = (grid_.width_px - width) / 2, y = (grid_.height_px - side_y) / 2;
  if (comb) {
    int at = kDark;
    for (std::size_t tooth = 0;; ++tooth) {
      blocks_.push_back({{x + spine, y, x + width, y + side_y}, at, at + kTooth});
      rows_.push_back({fmt::format("tooth {} begins", tooth + 1), "upper", at * layer_um});
      rows_.push_back({fmt::format("tooth {} ends", tooth + 1), "lower", (at + kTooth) * layer_um});
      at += kTooth;
      if (tooth == std::size(kGaps)) break;
      at += kGaps[tooth];
    }
    grid_.layers = at;
    blocks_.push_back({{x, y, x + spine, y + side_y}, 0, at});
    x_px_ = x + spine + side_x / 2;
    y_px_ = y + side_y / 2;
  } else {
    if (!resin) throw InputError("a staircase needs a resin, which says how long its plugs take");
    const Kinetics k = make_kinetics(*resin, false, false);
    const double light = printer.calibration.back().intensity_mw_cm2;
    if (!(light > 0)) throw InputError("the printer's full light is 0; expected more");
    grid_.layers = kPlugs;
    for (int n = 0; n < kPlugs; ++n) {
      const int left = x + n * 3 * side_x / 2;
      blocks_.push_back({{left, y, left + side_x, y + side_y}, 0, n + 1});
      const double dose = 1.5 * std::pow(6.0, n / (kPlugs - 1.0));
      rows_.push_back({fmt::format("plug {}", n + 1), "plug", 0,
                       k.has_gel_time() ? dose * gel_time_s(k.gel_time, light)
                                        : dose * k.critical_dose_prime / std::pow(light, k.m),
                       light});
    }
  }
  for (const Block& b : blocks_) bounds_ = bounds_.united(b.box);
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
        std::fill(row + (x0 - band.x0), row + (x1 - band.x0), std::uint8_t{255});
        lit = true;
      }
    }
    sink(n, lit ? rows.data() : nullptr);
  }
}

std::string TuningPart::form() const {
  const std::string head =
      fmt::format("part,{},unit,um,layer_um,{:g},width_px,{},height_px,{},x_px,{},y_px,{}",
                  kind_ == TuningPartKind::comb ? "comb" : "staircase", grid_.layer_um,
                  grid_.width_px, grid_.height_px, x_px_, y_px_);
  std::string known = head + "\n", text;
  for (const Row& r : rows_) {
    const std::string row = fmt::format("{},{},{:g},{:.6g},{:.6g}", r.name, r.kind, r.designed_um,
                                        r.exposure_s, r.intensity_mw_cm2);
    known += row + "\n";
    text += row + ",\n";
  }
  return "# For resinctl tune: fill in measured_um, in um; leave empty what was not measured.\n" +
         head + ",hash," + tuning_hash(known) +
         "\nname,kind,designed_um,exposure_s,intensity_mw_cm2,measured_um\n" + text;
}

std::string TuningPart::sheet() const {
  const bool comb = kind_ == TuningPartKind::comb;
  std::string picture, table;
  const double total = grid_.layers * grid_.layer_um;
  if (comb) {
    // The platform is above, as in the printer; 1 unit is 20 um at slices of 50 um.
    const double scale = 320 / total;
    picture =
        "<rect x='60' y='12' width='300' height='8' fill='#888'/><text x='64' y='10'>platform</text>"
        "<rect x='100' y='20' width='60' height='320' fill='#47a'/>";
    for (const Row& r : rows_) {
      const double y = 20 + r.designed_um * scale;
      if (r.kind == "upper") {
        picture += fmt::format("<rect x='160' y='{:.1f}' width='120' height='{:.1f}' fill='#47a'/>",
                               y, kTooth * grid_.layer_um * scale);
      }
      picture += fmt::format(
          "<line x1='280' x2='300' y1='{0:.1f}' y2='{0:.1f}' stroke='#000'/>"
          "<text x='304' y='{1:.1f}'>{2}, {3:g} um</text>",
          y, y + 3.5, r.name, r.designed_um);
    }
  } else {
    for (std::size_t n = 0; n < rows_.size(); ++n) {
      const double height = 40 + 40.0 * static_cast<double>(n);
      picture += fmt::format(
          "<rect x='{0}' y='{1}' width='50' height='{2}' fill='#47a'/><text x='{0}' y='{3}'>{4}"
          "</text><text x='{0}' y='335'>{5:.3g} s</text>",
          40 + 75 * n, 300 - height, height, 318, rows_[n].name, rows_[n].exposure_s);
    }
  }
  double before = 0;
  for (std::size_t n = 0; n < rows_.size(); ++n) {
    const Row& r = rows_[n];
    const std::string image =
        comb ? std::string() : fmt::format("image {}: {:.4g} s", n + 1, r.exposure_s - before);
    before = r.exposure_s;
    table += fmt::format("<tr><td>{}</td><td>{}</td><td></td></tr>\n", r.name,
                         comb ? fmt::format("{:g} um", r.designed_um) : image);
  }
  const std::string how =
      comb
          ? "Print the corrected stack. Wash it, don't cure it further. Lay it on its side under a "
            "microscope with a scale (0.01 mm or finer). Measure from the platform's face of the "
            "spine to both faces of each tooth, in the middle of its width. Leave out what has "
            "grown together."
          : "Take the platform away and put a clean glass of known thickness on the window, or cure "
            "on the window itself, with resin deeper than the highest plug. Show the images one "
            "after the other for the times below, without a pause. Wash with care. Measure each "
            "plug's height in its middle with a gauge of low force or a microscope (0.01 mm).";
  return "<!DOCTYPE html><html lang='en'><meta charset='utf-8'><title>Test part</title><style>"
         "body{font:14px sans-serif;max-width:700px;margin:2em}td,th{border:1px solid #888;padding:"
         "3px 12px;text-align:left}table{border-collapse:collapse}text{font:11px sans-serif}</style>"
         "<h1>" +
         std::string(comb ? "Comb" : "Staircase") + "</h1><p>" + how +
         "</p><svg viewBox='0 0 500 350' width='500' height='350'>" + picture +
         "</svg><table><tr><th>what</th><th>" + (comb ? "designed" : "show") +
         "</th><th>measured, um</th></tr>\n" + table + "</table></html>\n";
}

}  // namespace slicecorr
