// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/dose_combs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

/// The dissertation tried several and found 5.
constexpr std::array kDoseFactors = {1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0};
constexpr int kCombDark = 20, kCombTooth = 10;
constexpr std::array kCombGaps = {12, 16, 20};
constexpr double kCombToothUm = 3000, kCombSpineUm = 1500, kCombDeepUm = 2000, kCombApartUm = 1500;

int whole_pixels(double um, double pixel_um) {
  return std::max(1, static_cast<int>(std::lround(um / pixel_um)));
}

/// Where a tooth lies, in slices.
struct Tooth {
  int first = 0, past = 0;
};
std::vector<Tooth> teeth() {
  std::vector<Tooth> all{{kCombDark, kCombDark + kCombTooth}};
  for (const int gap : kCombGaps)
    all.push_back({all.back().past + gap, all.back().past + gap + kCombTooth});
  return all;
}

/// The design of one comb: teeth to the right of a spine, and dark slices behind it.
class CombDesign final : public SliceSource {
 public:
  CombDesign(const Grid& grid, const PixelBox& box, int spine_px, int dark)
      : grid_(grid), box_(box), spine_px_(spine_px), teeth_(teeth()) {
    grid_.layers = teeth_.back().past + dark;
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return box_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    const auto width = static_cast<std::size_t>(band.width());
    std::vector<std::uint8_t> rows(width * static_cast<std::size_t>(band.height()));
    for (int n = 0; n < grid_.layers; ++n) {
      std::fill(rows.begin(), rows.end(), std::uint8_t{0});
      const bool tooth = std::any_of(teeth_.begin(), teeth_.end(),
                                     [n](const Tooth& t) { return n >= t.first && n < t.past; });
      const int past_x = tooth ? box_.x1 : box_.x0 + spine_px_;
      const int x0 = std::max(box_.x0, band.x0), x1 = std::min(past_x, band.x1);
      bool lit = false;
      if (n < teeth_.back().past) {
        for (int y = std::max(box_.y0, band.y0); y < std::min(box_.y1, band.y1) && x0 < x1; ++y) {
          const auto row = rows.begin() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width();
          std::fill(row + (x0 - band.x0), row + (x1 - band.x0), std::uint8_t{255});
          lit = true;
        }
      }
      sink(n, lit ? rows.data() : nullptr);
    }
  }

 private:
  Grid grid_;
  PixelBox box_;
  int spine_px_;
  std::vector<Tooth> teeth_;
};

}  // namespace

/// A comb with its correction.
class DoseCombs::Comb {
 public:
  Comb(const Grid& grid, const PixelBox& box, int spine_px, int dark, const Setup& setup,
       const ExecutionContext& context)
      : design(grid, box, spine_px, dark), corrected(design, setup, context) {}
  CombDesign design;
  CorrectedSlices corrected;
};

DoseCombs::DoseCombs(const Printer& printer, const Resin& resin, const Ask& ask,
                     const ExecutionContext& context)
    : printer_name_(printer.name), resin_name_(resin.name), ask_(ask), grid_(plate_grid(printer)) {
  if (!(ask.layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!(ask.speed_mm_h > 0)) {
    throw InputError(
        "a part 'dose-combs' is corrected for the speed at which it is printed; expected one");
  }
  if (resin.gel_dose_mj_cm3 == 0 && resin.dose_factor == 1) {
    throw InputError(
        resin.name, "cure.dose_factor",
        "the file gives the dose aimed at alone; expected the dose of gel, which combs take "
        "several times");
  }
  grid_.layer_um = ask.layer_um;
  const int spine = whole_pixels(kCombSpineUm, grid_.pixel_x_um);
  const int across = spine + whole_pixels(kCombToothUm, grid_.pixel_x_um);
  const int down = whole_pixels(kCombDeepUm, grid_.pixel_y_um);
  const int apart_x = whole_pixels(kCombApartUm, grid_.pixel_x_um),
            apart_y = whole_pixels(kCombApartUm, grid_.pixel_y_um);
  const int columns = std::min(static_cast<int>(kDoseFactors.size()),
                               (grid_.width_px + apart_x) / (across + apart_x));
  const int lines = (grid_.height_px + apart_y) / (down + apart_y);
  const auto most = static_cast<std::size_t>(std::max(0, columns) * std::max(0, lines));
  if (most < 2) {
    throw InputError(fmt::format(
        "printer '{}' shows {} x {} pixels of the plate; expected at least {} x {}, which two combs take up",
        printer.name, grid_.width_px, grid_.height_px, 2 * across + apart_x, down));
  }
  Setup setup{printer, resin, {}};
  setup.process.speed_mm_h = ask.speed_mm_h;
  // Which doses can be printed, and how many slices each needs behind the last tooth.
  const PixelBox any{0, 0, across, down};
  std::vector<int> layers;
  ExecutionContext untold = context;
  untold.notice = nullptr;
  for (const double factor : kDoseFactors) {
    setup.resin = with_overrides(resin, {.dc_mj_cm3 = {}, .ha_um = {}, .dose_factor = factor});
    try {
      const Comb tried(grid_, any, spine, 0, setup, untold);
      layers.push_back(tried.corrected.grid().layers);
      factors_.push_back(factor);
    } catch (const InfeasibleError& e) {
      left_out_.push_back(fmt::format("no comb for {:g} times the gel dose: {}", factor, e.what()));
    }
  }
  // On a small plate those in the middle, near the dissertation's 5.
  while (factors_.size() > most) {
    const bool first = factors_.size() > 1 && 5 / factors_.front() > factors_.back() / 5;
    const auto at = first ? 0 : static_cast<std::ptrdiff_t>(factors_.size()) - 1;
    left_out_.push_back(
        fmt::format("no comb for {:g} times the gel dose: the plate is too small for more than {}",
                    factors_[static_cast<std::size_t>(at)], most));
    factors_.erase(factors_.begin() + at);
    layers.erase(layers.begin() + at);
  }
  if (factors_.size() < 2) {
    throw InfeasibleError(fmt::format(
        "combs by critical dose: at {:g} mm/h fewer than two doses can be printed ({}); expected another speed",
        ask.speed_mm_h, left_out_.empty() ? std::string("none") : left_out_.back()));
  }
  const int last = *std::max_element(layers.begin(), layers.end());
  const int wide = std::min(columns, static_cast<int>(factors_.size()));
  const int high = (static_cast<int>(factors_.size()) + wide - 1) / wide;
  const int left = (grid_.width_px - wide * across - (wide - 1) * apart_x) / 2;
  const int top = (grid_.height_px - high * down - (high - 1) * apart_y) / 2;
  for (std::size_t k = 0; k < factors_.size(); ++k) {
    const int i = static_cast<int>(k) % wide, j = static_cast<int>(k) / wide;
    const int x = left + i * (across + apart_x), y = top + j * (down + apart_y);
    const PixelBox box{x, y, x + across, y + down};
    setup.resin = with_overrides(resin, {.dc_mj_cm3 = {}, .ha_um = {}, .dose_factor = factors_[k]});
    // All combs end with the same slice: black behind them gives dose, too.
    combs_.push_back(std::make_unique<Comb>(grid_, box, spine, last - layers[k], setup, untold));
    bounds_ = bounds_.united(box);
    const std::vector<Tooth> all = teeth();
    for (std::size_t t = 0; t < all.size(); ++t) {
      const std::string tooth = fmt::format("{:g} times: tooth {}", factors_[k], t + 1);
      rows_.push_back(
          {tooth + " begins", "upper", factors_[k], all[t].first * grid_.layer_um, box});
      rows_.push_back({tooth + " ends", "lower", factors_[k], all[t].past * grid_.layer_um, box});
    }
  }
  grid_.layers = last;
}

DoseCombs::~DoseCombs() = default;

void DoseCombs::read_band(const PixelBox& band, const Sink& sink) const {
  const auto width = static_cast<std::size_t>(band.width());
  const std::size_t size = width * static_cast<std::size_t>(band.height());
  // Slices of the band; empty where nothing is lit.
  std::vector<std::vector<std::uint8_t>> slices(static_cast<std::size_t>(grid_.layers));
  for (const auto& comb : combs_) {
    const PixelBox box = comb->design.bounds();
    const PixelBox part{std::max(box.x0, band.x0), std::max(box.y0, band.y0),
                        std::min(box.x1, band.x1), std::min(box.y1, band.y1)};
    if (part.x0 >= part.x1 || part.y0 >= part.y1) continue;
    comb->corrected.read_band(part, [&](int n, const std::uint8_t* rows) {
      if (!rows || n >= grid_.layers) return;
      std::vector<std::uint8_t>& slice = slices[static_cast<std::size_t>(n)];
      if (slice.empty()) slice.assign(size, 0);
      for (int y = part.y0; y < part.y1; ++y, rows += part.width()) {
        std::copy_n(rows, part.width(),
                    slice.begin() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width() +
                        (part.x0 - band.x0));
      }
    });
  }
  for (int n = 0; n < grid_.layers; ++n) {
    const std::vector<std::uint8_t>& slice = slices[static_cast<std::size_t>(n)];
    sink(n, slice.empty() ? nullptr : slice.data());
  }
}

std::vector<double> DoseCombs::image_s() const {
  const double seconds = 1e-4 * ask_.layer_um / units::cm_s_from_mm_h(ask_.speed_mm_h);
  return std::vector<double>(static_cast<std::size_t>(grid_.layers), seconds);
}

MeasuringForm DoseCombs::form() const {
  MeasuringForm f;
  f.part = "dose-combs";
  f.add_fact("layer_um", grid_.layer_um);
  f.add_fact("width_px", grid_.width_px);
  f.add_fact("height_px", grid_.height_px);
  f.add_fact("speed_mm_h", ask_.speed_mm_h);
  f.columns = {"name", "kind", "dose_factor", "designed_um", "measured_um"};
  f.known = 4;
  f.note =
      "Fill in measured_um, in um from the platform; leave empty what was not measured, what is not there and what "
      "has grown together; change nothing else.";
  for (const Row& r : rows_) {
    f.rows.push_back(
        {r.name, r.kind, fmt::format("{:g}", r.dose_factor), fmt::format("{:.6g}", r.designed_um)});
  }
  return f;
}

std::string DoseCombs::sheet(const std::string& form_file, const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "Combs by critical dose, " + printer_name_;
  s.about = fmt::format(
      "Equal combs, each corrected for another critical dose of {}, in times its gel dose. The comb whose teeth print "
      "as designed has the dose to aim at.",
      resin_name_);
  s.tools = {"A microscope with a scale, or a measuring projector, 0.01 mm or finer"};
  s.steps = {
      page::markup(
          "Print the stack as it is, at <b>{:g} mm/h</b>, continuously: it is corrected already.",
          ask_.speed_mm_h),
      "Drain and wash with isopropanol for as long as your prints; don't scrape.",
      "Let it dry, and don't cure it any further before you have measured.",
      "Take the combs off the platform with a blade, one by one so that you know which is which.",
      "Lay each on its side. The face of the spine that stood on the platform is 0.",
      "Measure from there to the beginning and the end of each tooth, in the middle of its width.",
      "Leave empty what has grown together or is not there."};
  std::vector<detail::SheetBox> boxes;
  for (std::size_t k = 0; k < combs_.size(); ++k) {
    boxes.push_back({combs_[k]->design.bounds(), 1, fmt::format("{:g}", factors_[k])});
  }
  s.picture = detail::plate_picture(grid_, boxes);
  s.caption =
      "The combs as the images of the stack show them, seen from above through the plate (row 0 at the largest y), "
      "each with its dose in times the gel dose; spines to the left. Your display may mirror or turn them.";
  s.heads = {"edge", "designed, um", "measured, um"};
  for (const Row& r : rows_) s.rows.push_back({r.name, fmt::format("{:g}", r.designed_um)});
  s.after = page::markup(
      "Copy the last column into <b>{}</b>, in um, and leave empty what you did not measure. Change nothing else "
      "there.",
      form_file);
  s.commands = detail::commands_on("dose-combs", form_file, printer_file, printer_name_);
  return detail::sheet_page(s);
}

}  // namespace slicecorr
