// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "hologram.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"
#include "slicecorr/load_printer.hpp"
#include "support/files/lasting_folder.hpp"

namespace slicecorr::cli {

namespace {

namespace fs = std::filesystem;

/// OUTPUT alone, or with a number before its ending.
std::string name_of(const std::string& output, int index, int count) {
  if (count == 1) return output;
  const fs::path path(output);
  return (path.parent_path() /
          fmt::format("{}-{:04}{}", path.stem().string(), index + 1, path.extension().string()))
      .string();
}

/// One shift for each target, or one for all of them.
double shift(const std::vector<double>& all, std::size_t i, std::size_t targets,
             const char* option) {
  if (all.empty()) return 0;
  if (all.size() != 1 && all.size() != targets) {
    throw InputError(fmt::format("{} has {} values for {} targets; expected one for each, or one",
                                 option, all.size(), targets));
  }
  return all[all.size() == 1 ? 0 : i];
}

/// Frames that follow each other while the resin still waits, and whether they are enough.
void check_time(const HologramArguments& o) {
  if (o.inhibition_s <= 0 || o.holograms < 2) return;
  const double frames = std::floor(o.frame_hz * o.inhibition_s * (1 + 1e-9));
  if (frames < 4) {
    throw InfeasibleError(fmt::format(
        "{:g} frames a second for {:g} s are {:g} frames, too few to average speckle over; expected "
        "4 or more: a display of {:.4g} frames a second, or resin that is inhibited for {:.3g} s",
        o.frame_hz, o.inhibition_s, frames, 4 / o.inhibition_s, 4 / o.frame_hz));
  }
  if (o.holograms > frames) {
    throw InfeasibleError(fmt::format(
        "{} holograms take longer than the {:g} s in which the resin takes them for one; expected "
        "up to {:g} of them (--holograms)",
        o.holograms, o.inhibition_s, frames));
  }
}

/// 0 where the display's fill or stroke is not known.
double zero_order_of(const HologramArguments& o, const PhaseDisplay& display) {
  if (!display.stroke_turns || !display.fill) return 0;
  return zero_order(*display.fill, o.reflection, *display.stroke_turns);
}

void write_stack(const HologramArguments& o, const PhaseDisplay& display,
                 const HologramOptics& optics, const std::vector<std::vector<float>>& phases,
                 const ExecutionContext& context, Console& console) {
  if (o.stack.empty()) return;
  const double first = o.stack_mm[0], last = o.stack_mm[1], step = o.stack_mm[2];
  const auto count = static_cast<int>(std::floor((last - first) / step * (1 + 1e-9))) + 1;
  std::error_code ec;
  slicecorr::detail::make_lasting_folder(o.stack, ec);
  if (!fs::is_directory(o.stack)) {
    throw DeviceError(o.stack + " can't be made; expected a folder for the images");
  }
  const int width = 2 * display.width_px, height = 2 * display.height_px;
  const double zero = zero_order_of(o, display);
  const std::vector<float> flat(phases.front().size(), 0.0F);
  const auto power_of = [&](double z) {
    std::vector<float> power;
    for (const auto& phase : phases) {
      const auto one = power_at(display, optics, phase, z, 2, context);
      if (power.empty()) power.resize(one.size());
      for (std::size_t i = 0; i < one.size(); ++i) power[i] += one[i];
    }
    if (zero > 0) {
      // What no phase moves is the light of a display without phases. How it interferes with the rest is
      // as random as the phases are: powers add.
      const auto still = power_at(display, optics, flat, z, 2, context);
      const auto of_all = static_cast<float>(zero * static_cast<double>(phases.size()));
      for (std::size_t i = 0; i < still.size(); ++i) {
        power[i] = static_cast<float>(1 - zero) * power[i] + of_all * still[i];
      }
    }
    return power;
  };
  // Twice, so that no more than one plane is held: white is one power in all of them. A thousandth
  // of the samples may be brighter, or single grains would leave all else dark.
  double white = 0;
  for (int i = 0; i < count; ++i) {
    std::vector<float> power = power_of(first + step * i);
    const auto at =
        power.begin() + static_cast<std::ptrdiff_t>(power.size() - 1 - power.size() / 1000);
    std::nth_element(power.begin(), at, power.end());
    white = std::max(white, static_cast<double>(*at));
    context.report("looking through depth", 0.5 * (i + 1) / count);
  }
  for (int i = 0; i < count; ++i) {
    const double z = first + step * i;
    GreyImage image{width, height, {}};
    for (const float p : power_of(z)) {
      image.pixels.push_back(
          static_cast<std::uint8_t>(std::lround(255 * std::min(1.0, p / white))));
    }
    const auto png = encode_png(image);
    write_text_file((fs::path(o.stack) / fmt::format("{:04}_{:+.4f}mm.png", i, z)).string(),
                    std::string(png.begin(), png.end()));
    context.report("looking through depth", 0.5 + 0.5 * (i + 1) / count);
  }
  console.say(fmt::format(
      "{}: {} images from {:g} to {:g} mm behind the focal plane, {}", o.stack, count, first,
      first + step * (count - 1),
      zero > 0 ? fmt::format("with the {:.2f} % of the light that stays on the axis", 100 * zero)
               : std::string("without what stays on the axis (--fill, "
                             "--stroke-turns)")));
}

int hologram(const HologramArguments& o, const ExecutionContext& context, Console& console) {
  check_output(o.json, o.targets);
  check_output(o.picture, o.targets);
  if (!o.output.ends_with(".png")) {
    throw InputError(o.output, "", "expected a name that ends in .png");
  }
  for (int i = 0; i < o.holograms; ++i) {
    check_output(name_of(o.output, i, o.holograms), o.targets);
  }
  if (!o.picture.empty() && !o.picture.ends_with(".png") && !o.picture.ends_with(".svg")) {
    throw InputError(o.picture, "", "expected a name that ends in .png or .svg");
  }
  if (o.stack.empty() != o.stack_mm.empty()) {
    throw InputError("--stack and --stack-mm belong together; expected both");
  }
  if (!o.stack_mm.empty() && !(o.stack_mm[2] > 0 && o.stack_mm[1] >= o.stack_mm[0])) {
    throw InputError(
        "--stack-mm: expected FIRST,LAST,STEP with a step above 0 and LAST not before FIRST");
  }
  check_time(o);
  std::vector<GreyImage> pictures;
  for (const std::string& path : o.targets) {
    const CameraPicture read = read_camera_png(path);
    GreyImage grey{read.width_px, read.height_px, {}};
    for (const std::uint16_t v : read.pixels) {
      grey.pixels.push_back(static_cast<std::uint8_t>(std::lround(255.0 * v / read.white)));
    }
    pictures.push_back(std::move(grey));
  }
  PhaseDisplay display;
  display.width_px = o.display_px.empty() ? pictures.front().width_px : o.display_px[0];
  display.height_px = o.display_px.empty() ? pictures.front().height_px : o.display_px[1];
  display.pitch_um = o.pitch_um;
  display.levels = o.levels;
  if (o.stroke_turns > 0) display.stroke_turns = o.stroke_turns;
  if (o.fill > 0) display.fill = o.fill;
  display.front_reflection = o.reflection;
  HologramOptics optics;
  optics.wavelength_nm = o.wavelength_nm;
  optics.focal_mm = o.focal_mm;
  if (!o.relay_mm.empty()) {
    optics.relay_f1_mm = o.relay_mm[0];
    optics.relay_f2_mm = o.relay_mm[1];
  }
  std::vector<HologramPlane> planes;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    planes.push_back(
        plane_of_picture(pictures[i], o.targets[i], display, optics, o.target_pixel_um));
    planes.back().dx_mm = shift(o.dx_mm, i, pictures.size(), "--dx-mm");
    planes.back().dy_mm = shift(o.dy_mm, i, pictures.size(), "--dy-mm");
    planes.back().dz_mm = shift(o.dz_mm, i, pictures.size(), "--dz-mm");
  }
  HologramOptions options;
  options.steps = o.steps;
  options.seed = o.seed;
  options.holograms = o.holograms;
  options.free_outside = o.free_outside;
  const auto images = make_holograms(display, optics, planes, options, context);
  std::vector<std::vector<float>> shown;
  for (int i = 0; i < o.holograms; ++i) {
    const PhaseImage& image = images[static_cast<std::size_t>(i)];
    const GreyImage grey = grey_of_phase(display, image.phase_rad);
    shown.push_back(phase_of_grey(display, grey));
    const auto png = encode_phase_png(
        grey,
        fmt::format("hologram: seed {}, {} steps, pitch {:g} um, {:g} nm, f {:g} mm, {} levels, "
                    "stroke {:g} turns",
                    image.seed, o.steps, o.pitch_um, o.wavelength_nm, o.focal_mm, o.levels,
                    display.stroke_turns.value_or(1)));
    write_text_file(name_of(o.output, i, o.holograms), std::string(png.begin(), png.end()));
  }
  const HologramGeometry g = geometry_of(display, optics);
  nlohmann::ordered_json json;
  nlohmann::ordered_json of_planes = nlohmann::ordered_json::array();
  ImageFigures all;
  std::string text;
  std::vector<SeenPlane> seen;
  for (const HologramPlane& p : planes) {
    seen.emplace_back();
    const bool keep = !o.picture.empty() && p.dx_mm == 0 && p.dy_mm == 0;
    seen.back().figures =
        figures_of(display, optics, p, shown, context, keep ? &seen.back().power : nullptr);
    const ImageFigures& f = seen.back().figures;
    // Of several: light on any of them, and the worst errors.
    all.efficiency += f.efficiency;
    all.rms_error = std::max(all.rms_error, f.rms_error);
    all.rms_error_padded = std::max(all.rms_error_padded, f.rms_error_padded);
    all.speckle_contrast = std::max(all.speckle_contrast, f.speckle_contrast);
    of_planes.push_back({{"target", p.name},
                         {"dx_mm", p.dx_mm},
                         {"dy_mm", p.dy_mm},
                         {"dz_mm", p.dz_mm},
                         {"efficiency", f.efficiency},
                         {"rms_error", f.rms_error},
                         {"rms_error_padded", f.rms_error_padded},
                         {"speckle_contrast", f.speckle_contrast}});
    text += fmt::format(
        "{}: {:.1f} % of the light; RMS error {:.3f} on its pixels, {:.3f} between them; speckle {:.3f}\n",
        p.name, 100 * f.efficiency, f.rms_error, f.rms_error_padded, f.speckle_contrast);
  }
  text += fmt::format(
      "field {:.4g} mm, pixel {:.4g} x {:.4g} um, depth of focus {:.4g} x {:.4g} mm\n", g.field_mm,
      1e3 * g.pixel_x_mm, 1e3 * g.pixel_y_mm, g.depth_of_focus_x_mm, g.depth_of_focus_y_mm);
  const bool known = display.stroke_turns && display.fill;
  if (known) {
    text += fmt::format("{:.2f} % of the light stays on the axis\n",
                        100 * zero_order(*display.fill, o.reflection, *display.stroke_turns));
  }
  json["efficiency"] = all.efficiency;
  json["rms_error"] = all.rms_error;
  json["rms_error_padded"] = all.rms_error_padded;
  json["speckle_contrast"] = all.speckle_contrast;
  json["planes"] = of_planes;
  json["seed"] = o.seed;
  json["steps"] = o.steps;
  json["holograms"] = o.holograms;
  json["levels"] = o.levels;
  json["field_mm"] = g.field_mm;
  json["half_field_deg"] = g.half_field_deg;
  json["pixel_mm"] = {g.pixel_x_mm, g.pixel_y_mm};
  json["depth_of_focus_mm"] = {g.depth_of_focus_x_mm, g.depth_of_focus_y_mm};
  json["zero_order"] = nullptr;
  if (known) json["zero_order"] = zero_order(*display.fill, o.reflection, *display.stroke_turns);
  if (!o.picture.empty()) {
    write_text_file(o.picture,
                    hologram_picture(display, optics, planes, shown, o.picture, context, &seen));
  }
  write_stack(o, display, optics, shown, context, console);
  console.say(fmt::format("{}: {} phase image{} of {} x {} pixels", o.output, o.holograms,
                          o.holograms == 1 ? "" : "s", display.width_px, display.height_px));
  if (o.json.empty()) {
    print_result(text);
  } else {
    print_or_write(o.json, json.dump(2));
    console.say(text);
  }
  return kDone;
}

}  // namespace

void add_hologram(Program& program, HologramArguments& o) {
  CLI::App* sub = program.add("hologram",
                              "Make phase images for a phase-only display and its lens, and say "
                              "what light they bring where",
                              [&o](const ExecutionContext& context, Console& console) {
                                return hologram(o, context, console);
                              });
  sub->add_option("TARGET", o.targets,
                  "Pictures of the light that is wanted (.png), one for each plane")
      ->required();
  sub->add_option("-o,--output", o.output, "File to write (.png); several holograms get numbers")
      ->required();
  sub->add_option("--pitch-um", o.pitch_um, "Distance of the display's pixels")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--wavelength-nm", o.wavelength_nm, "Of the laser")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--focal-mm", o.focal_mm, "Of the lens between display and image (2f)")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--relay-mm", o.relay_mm, "F1,F2: a relay of two lenses behind the image (4f)")
      ->delimiter(',')
      ->expected(2)
      ->check(number_above_zero());
  sub->add_option("--display-px", o.display_px, "WIDTH,HEIGHT [as the first target has]")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::Range(2, 16384));
  sub->add_option("--target-pixel-um", o.target_pixel_um,
                  "Side of the targets' pixels in the image [theirs are the image's own]")
      ->check(number_above_zero());
  const auto shifts = [&](const char* name, std::vector<double>& to, const char* text) {
    sub->add_option(name, to, text)->delimiter(',')->check(number_in(-1e6, 1e6));
  };
  shifts("--dx-mm", o.dx_mm, "Move images to the right; one value for each target, or one");
  shifts("--dy-mm", o.dy_mm, "Move images up");
  shifts("--dz-mm", o.dz_mm, "Move images away from the lens");
  sub->add_option("--steps", o.steps, "Steps of the iteration")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  sub->add_option("--seed", o.seed, "Of the first phases; written into the file")
      ->capture_default_str();
  sub->add_option("--holograms", o.holograms,
                  "Holograms of their own phases, to be shown in turn against speckle")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  sub->add_option("--inhibition-s", o.inhibition_s,
                  "Time in which the resin takes frames for one: its inhibition time")
      ->check(number_above_zero());
  sub->add_option("--frame-hz", o.frame_hz, "Frames of the display in a second")
      ->check(number_above_zero())
      ->capture_default_str();
  sub->add_flag("--free-outside", o.free_outside, "Leave light beside the targets to itself");
  sub->add_option("--levels", o.levels, "Phases that the display can tell apart")
      ->check(CLI::Range(2, 256))
      ->capture_default_str();
  sub->add_option("--stroke-turns", o.stroke_turns,
                  "Phase from grey 0 to 256, in turns, as measured [1]")
      ->check(number_above_zero());
  sub->add_option("--fill", o.fill,
                  "Lit share of a pixel's area; with it, images are made even over the field")
      ->check(number_in(0, 1, true));
  sub->add_option("--reflection", o.reflection,
                  "Share of the light that the display's glass reflects")
      ->check(number_in(0, 1))
      ->capture_default_str();
  sub->add_option("--picture", o.picture,
                  "Draw targets beside what falls into their planes (.png or .svg)");
  sub->add_option("--stack", o.stack, "Folder for images of the light through depth")
      ->check(value_is(ValueKind::folder));
  sub->add_option("--stack-mm", o.stack_mm,
                  "FIRST,LAST,STEP: depths of these, behind the focal plane")
      ->delimiter(',')
      ->expected(3)
      ->check(number_in(-1e6, 1e6));
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::cli
