// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "target_page.hpp"

#include <fmt/format.h>

#include <cmath>

#include "slicecorr/cure.hpp"
#include "slicecorr/vial.hpp"
#include "support/page/html_page.hpp"
#include "support/text/base64.hpp"

namespace slicecorr::cli {

using namespace page;
using tomo::TargetKind;
using tomo::TargetPicture;

namespace {

/// What a page says.
struct Words {
  std::string title, about, vial;
  std::vector<Markup> steps;
  Markup table;       ///< to write measurements into
  std::string enter;  ///< lines of the printer file, or commands
};

Markup blank_table(const std::vector<std::string>& heads, const std::vector<std::string>& rows) {
  Table table("blank");
  for (const std::string& h : heads) table.column(h);
  for (const std::string& r : rows) {
    table.row(r);
    for (std::size_t i = 1; i < heads.size(); ++i) table.cell("");
  }
  return table;
}

Words axis_words(const Printer& p) {
  Words w;
  w.title = "Axis of rotation";
  w.about =
      "Where the image shows the axis, whether the axis leans, and how it wobbles. Light beside its "
      "place blurs a part from all sides.";
  w.vial =
      "A straight pin of 0.3 to 1 mm, pale and dull, upright and near the axis; resin without "
      "photoinitiator, or another clear liquid of its index, around it.";
  w.steps = {
      markup("Show <b>axis-comb.png</b>, pixel by pixel, on the projector. Look from the side: one "
             "line or the gap between two lights the pin."),
      "Turn the stage by hand. Note the columns of the pin's middle where it stands farthest left "
      "and farthest right, at the top and at the bottom of the image; a quarter of a line's "
      "distance can be told.",
      markup(
          "The axis is in the middle of both, at each height. For wobble note the column at each "
          "10 degrees, for a pin 3 mm from the axis and another one at the other side, as points "
          "of <code>resinctl fit-optics</code>."),
      markup("Enter what you found, then show <b>axis-cross.png</b>, which is made again from the "
             "printer file: the upright line must stay on the axis at all heights.")};
  w.table = blank_table({"row", "farthest left", "farthest right", "middle"}, {"top", "bottom"});
  w.enter = fmt::format(
      "[optics]\n"
      "axis_right_px = ...   # mean of both middles - {:g}; it is {:g}\n"
      "axis_up_px = ...      # {:g} - row of the optical axis (target scale); it is {:g}\n"
      "tilt_deg = ...        # atan((middle at the top - middle at the bottom) / rows between); it "
      "is {:g}\n"
      "\n"
      "[rotation]\n"
      "wobble = \"wobble.csv\" # of resinctl fit-optics --wobble wobble.csv",
      (p.width_px - 1) / 2.0, p.optics->axis_right_px, (p.height_px - 1) / 2.0,
      p.optics->axis_up_px, p.optics->tilt_deg);
  return w;
}

Words focus_words(const Printer& p) {
  Words w;
  w.title = "Focus";
  w.about = "The image is to be sharp on the plane through the axis that faces the projector.";
  w.vial =
      "No vial: a white card or ground glass where the axis is, facing the projector. (The vial "
      "bends light, so the image of a filled vial is sharp elsewhere: printing counts on focus in "
      "air.)";
  if (p.bath) {
    const Bath& b = *p.bath;
    w.vial = fmt::format(
        "No vial, but the tank filled with its liquid, and in it a white card or ground glass where "
        "the axis is, facing the projector. (The window moves the focus by {:.3g} mm, away from the "
        "projector. The vial moves it, too: printing counts on focus without it.)",
        b.n * (b.window_mm - b.wall_mm / b.n_wall) - (b.window_mm - b.wall_mm));
  }
  w.steps = {
      markup("Show <b>focus.png</b>. Set the lens so that the finest line pairs are apart, upright "
             "and level ones alike, and the grey disc in the middle of the star is smallest."),
      "Note the finest pair that is apart.",
      "Move the card by 5 mm towards the projector. Note the finest pair again: its width, in mm, "
      "is about the width of the blur there.",
      "Do the same 5 mm behind the axis. Where both differ much, the focus is not on the axis."};
  w.table = blank_table({"card", "finest upright pair, pixels", "finest level pair, pixels"},
                        {"on the axis", "5 mm before it", "5 mm behind it"});
  w.enter = fmt::format(
      "[optics]\n"
      "half_angle_deg = ...  # atan(width of the blur in mm / 2 / 5); it is {:g}\n"
      "rays_per_pixel = 13   # where the cone counts; 1 pixel is {:g} mm",
      p.optics->half_angle_deg, p.pixel_x_um * 1e-3);
  return w;
}

Words scale_words(const Printer& p) {
  Words w;
  w.title = "Scale and distance";
  w.about = "How large a pixel is on the plane of the axis, and from how far its light comes.";
  w.vial = p.bath
               ? "No vial and no tank, as both keys are those in air: a white card where the axis "
                 "is, facing the projector."
               : "No vial: a white card where the axis is, facing the projector.";
  const int columns = (p.width_px - 1) / 100 * 100, rows = (p.height_px - 1) / 100 * 100;
  w.steps = {
      markup("Show <b>scale.png</b>. Measure with a calliper from column 0 to column {}, from left "
             "edge to left edge of the thick lines. By the printer file it is {:.3f} mm.",
             columns, columns * p.pixel_x_um * 1e-3),
      fmt::format("Measure from row 0 to row {}. By the printer file it is {:.3f} mm.", rows,
                  rows * p.pixel_y_um * 1e-3),
      "Move the card by 20 mm towards the projector and measure the columns again. Light is "
      "parallel where nothing changes.",
      "The row that stays at its height as the card moves is that of the optical axis."};
  w.table = blank_table({"card", "columns, mm", "rows, mm"}, {"on the axis", "20 mm before it"});
  w.enter = fmt::format(
      "[display]\n"
      "pixel_um = [..., ...]  # 1000 x mm / {}, 1000 x mm / {}; it is [{:g}, {:g}]\n"
      "\n"
      "[optics]\n"
      "kind = \"pinhole\"       # \"telecentric\" where both are the same; it is {}\n"
      "distance_mm = ...      # 20 / (1 - width before / width on the axis); it is {:g}",
      columns, rows, p.pixel_x_um, p.pixel_y_um, name_of(p.optics->kind), p.optics->distance_mm);
  return w;
}

Words direction_words(const Printer& p) {
  Words w;
  w.title = "Direction of rotation";
  w.about =
      "Turned the other way, or shown in a mirror, a part is printed as its mirror image: nothing "
      "else tells it before the print is done.";
  w.vial =
      "A pin or a strip of paper at the wall of the vial. Turn the stage so that it faces the "
      "projector: this is angle 0.";
  w.steps = {
      markup(
          "Look from the projector towards the vial. The <b>F</b> must be an F, upright: if it is "
          "one in a mirror, set the projector (front or rear, table or ceiling) first."),
      markup("Show <b>direction-000.png</b>: the bar lights the pin, in the middle."),
      markup("Let the stage turn by 90 degrees as it does when it prints, and show "
             "<b>direction-090.png</b>. The bar must light the pin."),
      "If the pin is on the dark side, the stage turns the other way than the printer file says. "
      "Make sure at 180 (middle, behind the axis) and 270 degrees."};
  w.table = blank_table({"angle", "the pin is lit"}, {"0", "90", "180", "270"});
  const bool clockwise = p.rotation->direction == TurnDirection::clockwise;
  w.enter = fmt::format(
      "[rotation]\n"
      "direction = \"{}\"  # seen from above, as it is; \"{}\" where the pin was dark at 90 and 270",
      name_of(p.rotation->direction), clockwise ? "counterclockwise" : "clockwise");
  return w;
}

Words light_words(const Printer& p) {
  Words w;
  w.title = "Light";
  w.about = "How bright each level is, and how evenly the projector shines.";
  w.vial = "No vial: the sensor of a power meter, and then a white card, where the axis is.";
  w.steps = {
      markup("Show <b>light-*.png</b> one after the other, from dark to bright. Note mW/cm² in the "
             "middle of the image at each, black too: its light adds up over the whole print."),
      markup("Show <b>light-{:03}.png</b>. Photograph the card, square on, in focus, with fixed "
             "exposure and no part of it white in the photograph; crop it to the image's four "
             "corners.",
             p.levels() - 1),
      "Or walk the power meter over the image in a raster, and make a grey picture of the "
      "readings, white the greatest.",
      markup("Import both; what they say is counted by <code>slicecorr tomo solve</code> and "
             "<code>verify</code>, place by place.")};
  std::vector<std::string> rows;
  for (int k = 0; k <= 8; ++k) {
    const std::string level = fmt::format("{}", std::lround(k / 8.0 * (p.levels() - 1)));
    if (rows.empty() || rows.back() != level) rows.push_back(level);
  }
  w.table = blank_table({"level", "mW/cm²"}, rows);
  w.enter =
      "resinctl import levels.csv --format calibration --printer my-printer.toml --name my-printer "
      "--replace\n"
      "resinctl import photograph.png --format flat-field --printer my-printer.toml --name "
      "my-printer --replace";
  return w;
}

/// mW/cm² of the levels of rows and discs, for tables.
std::vector<std::string> light_of_levels(const Printer& p) {
  const std::vector<double> light = level_intensities(p);
  std::vector<std::string> rows;
  for (const int level : tomo::target_levels(p)) {
    rows.push_back(fmt::format("{:.4g}", light[static_cast<std::size_t>(level)]));
  }
  return rows;
}

Words dose_words(const Printer& p) {
  Words w;
  w.title = "Dose matrix";
  w.about =
      "How long resin takes to gel, by how bright light is: rows of several levels, columns that are lit for "
      "several times.";
  w.vial =
      "A cuvette of 1 mm, or resin between two glasses 0.3 mm apart, where the axis is, facing the "
      "projector; nothing turns. Resin that is to be measured must be thin: light must hardly fade in it.";
  w.steps = {
      "Guess the time T in which the brightest row gels. Any guess will do: the matrix reaches from half of "
      "it to ten times.",
      markup(
          "Show <b>dose-1.png</b> to <b>dose-8.png</b> one after the other, without a gap, each for "
          "its seconds in the table, times T. A column goes dark when its time is over."),
      "Rinse. In each row note the time at which the first column is lit (the sum up to its picture) in which "
      "resin stayed.",
      markup(
          "Write these times into <code>times.csv</code> with the light of their rows. The fit says "
          "gel dose and threshold of the resin.")};
  Table table("blank");
  for (const char* head : {"picture", "seconds, times T", "until then, times T"})
    table.column(head);
  double before = 0;
  int k = 0;
  for (const double until : tomo::target_times()) {
    table.row(fmt::format("dose-{}", ++k));
    table.cell(fmt::format("{:.3f}", until - before));
    table.cell(fmt::format("{:.3f}", until));
    before = until;
  }
  w.table = table;
  w.enter = "# times.csv\nintensity_mw_cm2,time_s\n";
  for (const std::string& light : light_of_levels(p)) w.enter += light + ",...\n";
  w.enter += "\nresinctl fit times.csv --model gel-time --threshold --resin my-resin";
  return w;
}

Words threshold_words(const Printer& p) {
  Words w;
  w.title = "Threshold";
  w.about =
      "Below which light resin never gels, because oxygen comes back as fast as light takes it: discs of "
      "several levels on the axis (Kelly's thesis, figures 4-10 and 4-11).";
  w.vial =
      "The vial with resin, turning as it does when it prints; a camera that looks from the side.";
  w.steps = {
      markup("Show <b>threshold.png</b> while the vial turns. Film it from the side."),
      "Note for each disc, from the top, the time at which something shows on the axis. A disc that shows "
      "nothing in ten times the time of the first one is below the threshold: leave it out.",
      markup(
          "Write the times into <code>times.csv</code>. Light is that of the projector: on its way to the "
          "axis it fades by e<sup>-alpha R</sup>, so multiply both figures of the fit by that.")};
  w.table = blank_table({"mW/cm²", "seconds"}, light_of_levels(p));
  w.enter = "# times.csv\nintensity_mw_cm2,time_s\n";
  for (const std::string& light : light_of_levels(p)) w.enter += light + ",...\n";
  w.enter += "\nresinctl fit times.csv --model gel-time --threshold --resin my-resin";
  return w;
}

Words words_of(TargetKind kind, const Printer& p) {
  switch (kind) {
    case TargetKind::dose:
      return dose_words(p);
    case TargetKind::threshold:
      return threshold_words(p);
    case TargetKind::axis:
      return axis_words(p);
    case TargetKind::focus:
      return focus_words(p);
    case TargetKind::scale:
      return scale_words(p);
    case TargetKind::direction:
      return direction_words(p);
    case TargetKind::light:
      break;
  }
  return light_words(p);
}

}  // namespace

std::string target_page(TargetKind kind, const Printer& printer,
                        const std::vector<TargetPicture>& pictures) {
  const Words w = words_of(kind, printer);
  Page page(w.title + ": " + printer.name,
            {"pre{overflow-x:auto;font-size:.9rem}.blank td{min-width:9rem}li{margin:.4em 0}figure "
             "img{background:#000;image-rendering:auto}@media print{figure{break-inside:avoid}}"});
  page += markup(
      R"(<p class="dim">{} x {} pixels of {:g} x {:g} um on the plane of the axis, {} light</p><p>{}</p><h2>Into the vial</h2><p>{}</p><h2>Show and measure</h2><ol>{}</ol>{}<h2>Enter it</h2><pre>{}</pre><h2>Pictures</h2>)",
      printer.width_px, printer.height_px, printer.pixel_x_um, printer.pixel_y_um,
      name_of(printer.optics->kind), w.about, w.vial, items(w.steps), w.table, w.enter);
  Markup figures;
  for (const TargetPicture& p : pictures) {
    figures += captioned(markup(R"(<img alt="{}" src="data:image/png;base64,{}">)", p.what,
                                detail::base64(encode_png(p.image))),
                         p.name + ".png: " + p.what);
  }
  page += markup(R"(<div class="pair">{}</div>)", figures);
  return page.html() + "\n";
}

}  // namespace slicecorr::cli
