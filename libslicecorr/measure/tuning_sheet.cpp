// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What to measure on the parts of tuning_part.hpp, in words.
#include <fmt/format.h>

#include <algorithm>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "slicecorr/tuning_part.hpp"

namespace slicecorr {

using detail::PartSheet;
using detail::SheetBox;
using namespace page;

namespace {

constexpr const char* kGauge =
    "A gauge of low force (0.5 N or less, flat tip) or a microscope that focuses on top and bottom, "
    "0.01 mm or finer";
constexpr const char* kWell =
    "A glass slide with a wall around it, with resin 2 mm deeper than the highest plug, on the "
    "window; or the window itself, with the platform taken away";
/// A sixtieth of a second more or less, which displays make, is then less than a sixth.
constexpr double kShortImage = 0.1;
constexpr const char* kWash =
    "Drain and wash with isopropanol for as long as your prints; don't scrape. Let it dry, don't "
    "cure it any further before you have measured.";

/// The comb from the side: the platform is above, as in the printer.
Markup comb_picture(const TuningPart& part) {
  const double total_um = part.grid().layers * part.grid().layer_um, scale = 420 / total_um;
  Markup svg = markup(
      R"(<svg viewBox="0 0 560 460" width="560" height="460" role="img" aria-label="comb from the side"><rect class="plate" x="40" y="14" width="280" height="10"/><text x="44" y="11" font-size="11">platform: measure from here</text><rect class="part" x="80" y="24" width="70" height="420"/>)");
  for (std::size_t i = 0; i < part.rows().size(); ++i) {
    const TuningPart::Row& r = part.rows()[i];
    const double y = 24 + r.designed_um * scale;
    if (r.kind == "upper") {
      svg += markup(R"(<rect class="part" x="150" y="{:.1f}" width="140" height="{:.1f}"/>)", y,
                    (part.rows()[i + 1].designed_um - r.designed_um) * scale);
    }
    // Gaps of four slices are less high than words.
    const double words = y + (r.kind == "upper" ? 9.0 : 1.0);
    svg += markup(
        R"(<line class="place" x1="290" x2="312" y1="{0:.1f}" y2="{0:.1f}"/><text x="316" y="{1:.1f}" font-size="11">{2}, {3:g} um</text>)",
        y, words, r.name, r.designed_um);
  }
  return svg + markup("</svg>");
}

std::string seconds(double s) { return fmt::format("{:.4g} s", s); }

}  // namespace

std::string TuningPart::sheet(const std::string& form_file, const std::string& printer_file) const {
  using enum TuningPartKind;
  PartSheet s;
  const auto rows = [&](const auto& cells) {
    for (const Row& r : rows_) s.rows.push_back(cells(r));
  };
  std::vector<SheetBox> plate;
  double brightest = 0;
  for (const Row& r : rows_) brightest = std::max(brightest, r.intensity_mw_cm2);
  for (const Row& r : rows_) {
    // "plug 2-3" is too long for a plug.
    const auto digit = r.name.find_first_of("0123456789");
    std::string words = r.name.substr(digit == std::string::npos ? 0 : digit);
    if (kind_ == flat_field) words = fmt::format("{}", &r - rows_.data() + 1);
    plate.push_back({r.box, r.intensity_mw_cm2 / brightest, words});
  }
  if (!is_comb()) {
    s.picture = plate_picture(grid_, plate);
    s.caption =
        "The plugs as the images of the stack show them, seen from above through the plate "
        "(row 0 at the largest y). Your display may mirror or turn them: look at which plug "
        "is which before you wash.";
  }
  s.after = markup(
      "Copy the last column into <b>{}</b>, in um, and leave empty what you did not measure. Change "
      "nothing else there. A copy of the table for each further sample makes the answer surer.",
      form_file);
  switch (kind_) {
    case comb:
    case lift_comb:
      s.title = kind_ == comb ? "Comb" : "Lift comb";
      s.about =
          kind_ == comb
              ? "Edges of a print that is corrected: light that passes through the teeth cures what "
                "lies above. They tell light over dose, absorbance height and stray light."
              : "Edges of a print that is corrected, over teeth of few and of many layers: they tell "
                "how much of the liquid resin each lift exchanges, and the absorbance height.";
      s.tools = {"A microscope with a scale, or a measuring projector, 0.01 mm or finer"};
      s.steps = {
          kind_ == comb
              ? "Correct the stack for the resin and speed that you print with, and print it "
                "continuously. Keep the corrected stack: it says what was shown."
              : "Correct the stack for the resin and exposure that you print with, as if lifts "
                "exchanged nothing (a lift_exchange of 0), and print it layer by layer. Keep the "
                "corrected stack: it says what was shown.",
          kWash,
          "Take it off the platform with a blade and lay it on its side, so that you look at the "
          "teeth from the side as in the picture.",
          "Measure from the face of the spine that stood on the platform to the beginning and the "
          "end of each tooth, in the middle of its width. The face is 0.",
          "Leave empty what has grown together or is not there."};
      s.picture = comb_picture(*this);
      s.caption = "The comb from the side, platform above as in the printer.";
      s.heads = {"edge", "designed, um", "measured, um"};
      rows([](const Row& r) {
        return std::vector<std::string>{r.name, fmt::format("{:g}", r.designed_um)};
      });
      break;
    case staircase: {
      s.title = "Working-curve staircase";
      s.about =
          "Heights of plugs against dose, at several intensities on one plate. They tell "
          "absorbance height and gel dose, and whether half the light for twice the time is "
          "the same.";
      s.tools = {kWell, kGauge};
      Markup images;
      for (std::size_t n = 0; n < image_s_.size(); ++n) {
        images += markup("{}{}: <b>{}</b>", n ? ", " : "", n + 1, seconds(image_s_[n]));
      }
      s.steps = {
          "No UV light, no stage. Fill the well, wait until bubbles are gone.",
          "Show the images one after the other without a pause, each for its time: " + images +
              ". A stack whose format has times of single layers says them, too: where a printer "
              "shows it by itself, take off the platform first, and see that its lamp is off while "
              "its motor moves.",
          // NOLINTNEXTLINE(bugprone-suspicious-missing-comma): a sentence on several lines.
          "Switch the light off right after the last one: black pixels give dose, too, which "
          "is counted up to there.",
          kWash, "Measure each plug's height in its middle, from the glass."};
      s.heads = {"plug", "light, mW/cm²", "lit for", "height, um"};
      rows([](const Row& r) {
        return std::vector<std::string>{r.name, fmt::format("{:.4g}", r.intensity_mw_cm2),
                                        seconds(r.shown_s)};
      });
      break;
    }
    case wedge:
      s.title = "Dose wedge";
      s.about =
          "Steps of one piece, each of its own grey level, in a single image. Their heights "
          "tell absorbance height and gel dose from one exposure, and whether the calibration "
          "of the grey levels is right: a level that is off stands out of the line.";
      s.tools = {kWell, kGauge};
      s.steps = {"No UV light, no stage. Fill the well, wait until bubbles are gone.",
                 markup("Show the image for <b>{}</b>, then switch the light off.",
                        seconds(image_s_.front())),
                 kWash,
                 "Measure the height of each step in its middle, from the glass. Leave out steps "
                 "that came off."};
      s.heads = {"step", "light, mW/cm²", "height, um"};
      rows([](const Row& r) {
        return std::vector<std::string>{r.name, fmt::format("{:.4g}", r.intensity_mw_cm2)};
      });
      break;
    case dead_zone:
      s.title = "Dead-zone ladder";
      s.about = fmt::format(
          "Plugs under even UV light of {:g} mW/cm² and blue light of many intensities. What stays "
          "liquid between window and plug tells how UV light inhibits.",
          ask_.uv_mw_cm2);
      s.tools = {
          "Two glass slides, and spacers whose thickness you have measured: thicker than the "
          "dead zones, thinner than the plugs would grow (0.3 to 1 mm)",
          "A micrometer, 0.002 mm"};
      s.steps = {
          "Lay the slides on the window with the spacers between them and fill the gap with "
          "resin. Plugs must reach the upper slide.",
          markup("Set the UV light to <b>{:g} mW/cm²</b> at the window, evenly. Show the image for "
                 "<b>{}</b> with both lights on, and switch both off at the same moment.",
                 ask_.uv_mw_cm2, seconds(image_s_.front())),
          "Take the slides apart and wash: plugs stick to the upper one. Cure them under "
          "white light so that they can be handled.",
          markup(
              "Measure each plug's thickness. <b>Dead zone = thickness of the spacers - thickness "
              "of the plug.</b> 0 where it stuck to the lower slide; leave empty where nothing "
              "cured.")};
      s.heads = {"plug", "blue, mW/cm²", "plug, um", "dead zone, um"};
      rows([](const Row& r) {
        return std::vector<std::string>{r.name, fmt::format("{:.4g}", r.intensity_mw_cm2), ""};
      });
      break;
    case flat_field:
      s.title = "Flat-field grid";
      s.about = "Equal plugs all over the plate. Where they are higher there is more light.";
      s.tools = {kWell + std::string(". It must cover all of the window: do it in parts, or on the "
                                     "window itself"),
                 kGauge};
      s.steps = {
          "No UV light, no stage.",
          markup("Show the image for <b>{}</b>, then switch the light off.",
                 seconds(image_s_.front())),
          kWash,
          fmt::format("Measure each plug's height in its middle. 10 um are {:.2g} % of light "
                      "in this resin; one with a larger absorbance height shows more.",
                      1000 / height_e_um_)};
      s.heads = {"number", "plug", "height, um"};
      for (std::size_t i = 0; i < rows_.size(); ++i) {
        s.rows.push_back({fmt::format("{}", i + 1), rows_[i].name});
      }
      break;
  }
  if (!image_s_.empty() && *std::min_element(image_s_.begin(), image_s_.end()) < kShortImage) {
    s.steps.insert(
        s.steps.begin(),
        markup("<b>Times are short</b> for a display, whose images last for whole sixtieths of a "
               "second or so. Turn the lamp down if you can, write the light that you then measure "
               "into a copy of the printer file, and make the part again for it."));
  }
  s.title += ", " + printer_name_;
  s.commands = detail::commands_on(word_of(kind_), form_file, printer_file, printer_name_);
  return sheet_page(s);
}

}  // namespace slicecorr
