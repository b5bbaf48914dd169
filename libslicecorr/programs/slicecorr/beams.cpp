// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "beams.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "slicecorr/beam_vat.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/beams.hpp"
#include "slicecorr/tomo/beams_job.hpp"
#include "slicecorr/tomo/beams_page.hpp"
#include "slicecorr/units.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::cli {

namespace {

using slicecorr::detail::finite_or_null;
using tomo::Beam;
using tomo::BeamImages;
using tomo::Box;

/// A bound of contrast of 1, with what single precision leaves.
constexpr double kProven = 1.002;
/// Absorption times the vat's length from which on absorption counts.
constexpr double kDim = 0.05;

Box<std::uint8_t> read_cells(const BeamsArguments& o, double cell_mm,
                             const ExecutionContext& context) {
  if (!o.volume.empty()) return tomo::read_part_npy(o.volume);
  return tomo::cut_cells(read_parts(o.mesh, context).mesh, cell_mm, context);
}

double side_of_cell_mm(const BeamsArguments& o, const Printer& printer) {
  if (o.voxel_mm > 0) return o.voxel_mm;
  if (!o.volume.empty()) {
    throw InputError("--volume does not say how large its cells are; expected --voxel-mm");
  }
  return o.mesh.layer_um > 0 ? o.mesh.layer_um * 1e-3
                             : std::max(printer.pixel_x_um, printer.pixel_y_um) * 1e-3;
}

/// Beams of this number. Where the vat has none from a side, that from the other one will do.
std::vector<Beam> beams_for(int count, const std::optional<BeamVat>& vat) {
  const auto has = [&](const Beam& beam) {
    return std::any_of(vat->ways.begin(), vat->ways.end(), [&](const BeamWay& w) {
      return w.axis == beam.axis && w.from_plus == beam.from_end;
    });
  };
  if (count == 0) {
    const int of_vat = vat ? static_cast<int>(vat->ways.size()) : 0;
    count = of_vat == 2 || of_vat == 4 || of_vat == 6 ? of_vat : 3;
  }
  std::vector<Beam> beams = tomo::beams_of(count);
  if (!vat || count > 3) return beams;
  for (Beam& beam : beams) {
    if (!has(beam)) beam.from_end = has({beam.axis, !beam.from_end});
  }
  return beams;
}

/// All that is known of a print with beams.
struct Result {
  tomo::BeamJob job;
  Box<std::uint8_t> part;
  tomo::BeamPrint print;
  Box<float> light;                   ///< as shown
  tomo::BeamFigures figures;          ///< of it
  double most_absorption_per_mm = 0;  ///< of images that do not print because of absorption
  bool printable() const { return job.window.open(); }
};

std::string json_of(const Result& r) {
  const tomo::BeamJob& job = r.job;
  const tomo::BeamFigures& f = r.figures;
  nlohmann::ordered_json j;
  j["printable"] = r.printable();
  j["contrast"] = finite_or_null(r.print.figures.contrast);
  j["contrast_shown"] = finite_or_null(f.contrast);
  j["contrast_bound"] = finite_or_null(r.print.contrast_bound);
  j["jaccard"] = f.jaccard;
  j["best_jaccard"] = f.best_jaccard;
  j["hull_jaccard"] = r.print.hull_jaccard;
  j["hull_cells"] = r.print.hull_cells;
  j["ver"] = f.ver;
  j["time_window_s"] = {finite_or_null(job.window.first_s), finite_or_null(job.window.last_s)};
  j["exposure_s"] = finite_or_null(job.exposure_s);
  j["brightest_mw_cm2"] = job.brightest_mw_cm2;
  j["least_inside_mw_cm2"] = f.least_inside * job.brightest_mw_cm2;
  j["most_outside_mw_cm2"] = f.most_outside * job.brightest_mw_cm2;
  j["images"] = tomo::name_of(job.setup.images);
  j["beams"] = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < job.setup.beams.size(); ++k) {
    nlohmann::ordered_json beam;
    beam["from"] = tomo::side_of(job.setup.beams[k]);
    beam["display"] = tomo::way_of(job.vat, job.setup.beams[k]).display;
    if (k < job.shown.laser_mw.size()) {
      beam["efficiency"] = job.shown.efficiency[k];
      beam["rms_error_padded"] = job.shown.rms_error[k];
      beam["laser_mw"] = finite_or_null(job.shown.laser_mw[k]);
    }
    j["beams"].push_back(beam);
  }
  j["part_cells"] = f.part_cells;
  j["outside_cells"] = f.outside_cells;
  j["wrong_cells"] = f.wrong_cells;
  j["unlit_cells"] = f.unlit_cells;
  j["cell_mm"] = job.setup.cell_mm;
  j["cells"] = {job.cells[2], job.cells[1], job.cells[0]};
  j["vat_mm"] = job.vat.inside_mm;
  j["alpha_per_mm"] = job.setup.alpha_per_mm;
  if (r.most_absorption_per_mm > 0) j["most_absorption_per_mm"] = r.most_absorption_per_mm;
  j["in_the_way"] = r.print.in_the_way;
  return j.dump(2);
}

std::string number(double v) { return std::isfinite(v) ? fmt::format("{:.4g}", v) : "infinite"; }

std::string in_words(const Result& r) {
  const tomo::BeamJob& job = r.job;
  const tomo::BeamFigures& f = r.figures;
  std::string sides;
  for (const Beam& beam : job.setup.beams) sides += (sides.empty() ? "" : ", ") + side_of(beam);
  std::string text = fmt::format("{} images for beams from {}; part {} cells, outside {}\n",
                                 name_of(job.setup.images), sides, f.part_cells, f.outside_cells);
  text += fmt::format("contrast {}", number(r.print.figures.contrast));
  if (std::isfinite(r.print.contrast_bound)) {
    text += fmt::format(" (no images have more than {:.4g})", r.print.contrast_bound);
  }
  if (!job.vat.phase) text += fmt::format("; {} as the display shows it", number(f.contrast));
  text += fmt::format(
      "\noverlap {:.5f} when all of the part has gelled, {:.5f} at the best exposure; what silhouettes "
      "mark out has {:.5f}, {} cells too many\n",
      f.jaccard, f.best_jaccard, r.print.hull_jaccard, r.print.hull_cells);
  text += fmt::format("light in the part at least {:.4g} mW/cm², outside at most {:.4g}\n",
                      f.least_inside * job.brightest_mw_cm2, f.most_outside * job.brightest_mw_cm2);
  if (r.printable()) {
    text += fmt::format(
        "expose for {:.4g} s at {:.4g} mW/cm²: all of the part has gelled after {:.4g} s, {}\n",
        job.exposure_s, job.brightest_mw_cm2, job.window.first_s,
        std::isfinite(job.window.last_s)
            ? fmt::format("something else does after {:.4g} s", job.window.last_s)
            : "nothing else does");
  }
  for (std::size_t k = 0; k < job.shown.laser_mw.size(); ++k) {
    text += fmt::format(
        "beam from {}: {:.4g} mW of laser light, of which {:.1f} % falls on the image; RMS error "
        "{:.3f}\n",
        side_of(job.setup.beams[k]), job.shown.laser_mw[k], 100 * job.shown.efficiency[k],
        job.shown.rms_error[k]);
  }
  return text;
}

std::string cells_in_words(const Result& r) {
  std::string text;
  const auto& cells = r.print.in_the_way;
  for (std::size_t i = 0; i < std::min<std::size_t>(cells.size(), 3); ++i) {
    text += fmt::format("{}({}, {}, {})", i > 0 ? ", " : "", cells[i][0], cells[i][1], cells[i][2]);
  }
  return text + (cells.size() > 3 ? " and others" : "");
}

/// Why a part can't be printed like this, and what would do.
std::string why_not(Result& r, const ExecutionContext& context) {
  const tomo::BeamSetup& setup = r.job.setup;
  const tomo::BeamFigures& ideal = r.print.figures;
  if (ideal.unlit_cells > 0) {
    return fmt::format(
        "{} of {} cells of the part lie on no ray that meets nothing but part from wall to wall, so "
        "end-on images leave them dark; expected grey images (--images grey), silhouettes, or a vat "
        "that ends where the part does (--vat-mm)",
        ideal.unlit_cells, ideal.part_cells);
  }
  const double pixel_um = std::max(r.job.printer.pixel_x_um, r.job.printer.pixel_y_um);
  if (ideal.contrast > 1 && pixel_um > 1e3 * setup.cell_mm * (1 + 1e-9)) {
    return fmt::format(
        "the images have a contrast of {:.4g}, but pixels of {:g} um are coarser than cells of {:g} "
        "mm and leave {:.4g} of it; expected cells of {:g} mm or more (--voxel-mm)",
        ideal.contrast, pixel_um, setup.cell_mm, r.figures.contrast, pixel_um * 1e-3);
  }
  if (ideal.contrast > 1) {
    return fmt::format(
        "the images have a contrast of {:.4g}, but {} grey levels from {:.4g} to {:.4g} mW/cm² leave "
        "{:.4g} of it; expected a darker black, or more levels",
        ideal.contrast, r.job.printer.levels(), r.job.printer.calibration.front().intensity_mw_cm2,
        r.job.brightest_mw_cm2, r.figures.contrast);
  }
  const bool grey = setup.images == BeamImages::grey;
  if (!grey && r.print.hull_cells > 0) {
    return fmt::format(
        "silhouettes of these beams mark out {} cells more than the part has (overlap {:.4f}), such "
        "as {}; these gel with it. Grey images may do (--images grey)",
        r.print.hull_cells, r.print.hull_jaccard, cells_in_words(r));
  }
  std::string text =
      grey && r.print.contrast_bound <= kProven
          ? fmt::format(
                "no images of these beams print this part: outside of it, cells such as {} "
                "must get as much light (no contrast is above {:.4g})",
                cells_in_words(r), r.print.contrast_bound)
          : fmt::format(
                "the images have a contrast of {:.4g}: cells outside such as {} get as much "
                "light as the part",
                ideal.contrast, cells_in_words(r));
  r.most_absorption_per_mm =
      setup.alpha_per_mm > 0 ? tomo::most_absorption_per_mm(r.part, r.print.images, setup, context)
                             : 0;
  if (r.most_absorption_per_mm > 0) {
    text += fmt::format(
        ". The resin absorbs {:.4g} per mm; with less than {:.4g} (an absorbance height of {:.4g} "
        "um, base 10) these images do",
        setup.alpha_per_mm, r.most_absorption_per_mm,
        units::height10_from_e(1e3 / r.most_absorption_per_mm));
  }
  // Where hardly any light is lost on its way, beams from both sides are no better.
  const bool dim =
      setup.alpha_per_mm * *std::max_element(setup.vat_mm.begin(), setup.vat_mm.end()) > kDim;
  const auto beams = static_cast<int>(setup.beams.size());
  if (dim && beams <= 3) {
    text += fmt::format("{} {} beams, from both sides, lose less (--beams {})",
                        r.most_absorption_per_mm > 0 ? "; or" : ". Beside less absorption,",
                        2 * beams, 2 * beams);
  } else if (r.most_absorption_per_mm == 0) {
    text += ". Expected another part";
  }
  return text;
}

void tell_spread(const Result& r, const ExecutionContext& context) {
  const double d = r.job.resin.dose_diffusion_m2_s;
  if (!(d > 0) || !std::isfinite(r.job.exposure_s)) return;
  const double sigma_mm = 1e3 * std::sqrt(2 * d * r.job.exposure_s);
  if (sigma_mm < 0.5 * r.job.setup.cell_mm) return;
  context.tell(fmt::format(
      "dose spreads by {:.3g} mm during the exposure, and cells are {:g} mm: edges are less sharp "
      "than told; brighter light prints faster",
      sigma_mm, r.job.setup.cell_mm));
}

/// Reads, finds and judges.
Result made(const BeamsArguments& o, const ExecutionContext& context, Console& console) {
  Result r;
  tomo::BeamJob& job = r.job;
  tomo::BeamSetup& setup = job.setup;
  job.printer = load_printer(o.printer);
  job.resin = load_resin(o.resin);
  tomo::take_spread(setup, job.printer, job.resin);
  refuse_relative(job.printer, "an exposure by beams");
  for (const std::string& text : o.light.checked(job.printer, job.resin)) context.tell(text);
  const std::optional<BeamVat> of_printer = load_beam_vat(o.printer, job.printer);
  setup.cell_mm = side_of_cell_mm(o, job.printer);
  setup.images = tomo::beam_images_named(o.images);
  setup.beams = beams_for(o.beams, of_printer);
  setup.steps = o.steps;
  setup.alpha_per_mm = absorption_per_cm(job.resin) * 0.1;
  const Box<std::uint8_t> cells = read_cells(o, setup.cell_mm, context);
  std::array<double, 3> inside{cells.nx * setup.cell_mm, cells.ny * setup.cell_mm,
                               cells.nz * setup.cell_mm};
  if (!o.vat_mm.empty()) {
    std::copy_n(o.vat_mm.begin(), 3, inside.begin());
  } else if (of_printer) {
    inside = of_printer->inside_mm;
  } else {
    console.say(fmt::format(
        "{} has no [beams]: the vat is taken to end where the part does, {:.4g} x {:.4g} x {:.4g} "
        "mm, with a display for each beam (--vat-mm)",
        job.printer.name, inside[0], inside[1], inside[2]));
  }
  if (of_printer) {
    job.vat = *of_printer;
    job.vat.inside_mm = inside;
  } else {
    std::vector<std::string> sides;
    for (const Beam& beam : setup.beams) sides.push_back(side_of(beam));
    job.vat = plain_vat(inside, sides, job.printer);
  }
  for (const Beam& beam : setup.beams) tomo::way_of(job.vat, beam);
  setup.vat_mm = inside;
  r.part = tomo::filled_vat(cells, setup);
  job.cells[0] = r.part.nx;
  job.cells[1] = r.part.ny;
  job.cells[2] = r.part.nz;
  console.say(fmt::format("{} x {} x {} cells of {:g} mm, some {:.3g} MB of memory", r.part.nx,
                          r.part.ny, r.part.nz, setup.cell_mm,
                          tomo::bytes_of_beams(r.part, setup) * 1e-6));
  const double most = level_intensities(job.printer).back();
  job.brightest_mw_cm2 = o.intensity_mw_cm2 > 0 ? o.intensity_mw_cm2 : most;
  r.print = tomo::find_beams(r.part, setup, context);
  job.shown =
      tomo::shown_beams(r.print.images, setup, job.vat, job.printer, job.brightest_mw_cm2, context);
  r.light = tomo::light_of(r.part.nz, r.part.ny, r.part.nx, job.shown.images, setup, context);
  r.figures = tomo::figures_of(r.part, r.light);
  job.contrast = r.figures.contrast;
  const tomo::GelTimeOf gel_time = tomo::time_to_gel_of(job.resin);
  job.window = tomo::time_window(r.figures, gel_time, job.brightest_mw_cm2);
  if (o.exposure_s > 0) {
    job.exposure_s = o.exposure_s;
  } else {
    job.exposure_s = r.printable() ? job.window.middle_s()
                                   : gel_time(r.figures.threshold * job.brightest_mw_cm2);
  }
  return r;
}

int beams(const BeamsArguments& o, const ExecutionContext& context, Console& console) {
  if (o.volume.empty() == o.mesh.parts.empty()) {
    throw InputError("expected meshes, or a volume (--volume)");
  }
  if (!o.mesh.center_mm.empty()) {
    throw InputError("--center-mm has no place here: parts are in the middle of the vat");
  }
  std::vector<std::string> inputs = o.mesh.parts;
  if (!o.volume.empty()) inputs.push_back(o.volume);
  for (const std::string& output : {o.output, o.json, o.report, o.dose, o.cells}) {
    check_output(output, inputs);
    if (!output.empty() && output != "-") inputs.push_back(output);
  }
  if (!o.report.empty() && !o.report.ends_with(".html")) {
    throw InputError(o.report, "", "expected a name that ends in .html");
  }
  Result r = made(o, context, console);
  const std::string why = r.printable() ? "" : why_not(r, context);
  if (!o.cells.empty()) tomo::write_npy(o.cells, r.part);
  if (!o.dose.empty()) {
    Box<float> dose = r.light;
    const double per_share =
        curing_absorption_per_cm(r.job.resin) * r.job.brightest_mw_cm2 * r.job.exposure_s;
    for (float& v : dose.values) v = static_cast<float>(v * per_share);
    tomo::write_npy(o.dose, dose);
  }
  if (!o.report.empty()) {
    const std::string& named = o.volume.empty() ? o.mesh.parts.front() : o.volume;
    write_text_file(o.report,
                    tomo::beams_page({r.job, r.part, r.print, r.light, r.figures, why},
                                     std::filesystem::path(named).filename().string(), context));
  }
  const std::string words = in_words(r);
  if (o.json.empty()) {
    print_result(words);
  } else {
    print_or_write(o.json, json_of(r));
    console.say(words);
  }
  if (!why.empty()) throw InfeasibleError(why);
  tell_spread(r, context);
  if (o.exposure_s > 0 &&
      !(o.exposure_s >= r.job.window.first_s && o.exposure_s < r.job.window.last_s)) {
    throw InfeasibleError(fmt::format(
        "{:g} s are not within the time in which all of the part has gelled and nothing else has; "
        "expected {:.4g} s to {} s",
        o.exposure_s, r.job.window.first_s,
        std::isfinite(r.job.window.last_s) ? fmt::format("{:.4g}", r.job.window.last_s)
                                           : std::string("any number of")));
  }
  tomo::write_beam_job(o.output, r.job, context);
  console.say(fmt::format("{}: {} images on {} displays of {} x {} pixels", o.output,
                          r.print.images.size(), r.job.shown.displays.size(),
                          r.job.printer.width_px, r.job.printer.height_px));
  return kDone;
}

}  // namespace

void add_beams(Program& program, BeamsArguments& o) {
  CLI::App* sub = program.add(
      "beams",
      "Print a whole part with a few still images at once, along the axes of a vat: find them, and "
      "say what they print",
      [&o](const ExecutionContext& context, Console& console) {
        return beams(o, context, console);
      });
  sub->add_option("PART", o.mesh.parts, "Meshes (stl, obj, ply, off, 3mf; also .gz)");
  sub->add_option(
      "--volume", o.volume,
      "A volume in place of meshes (.npy, axes z, y, x: 255 part, 0 empty, else neither)");
  sub->add_option("--voxel-mm", o.voxel_mm, "Side of a cell [--layer-um, else the pixel's pitch]")
      ->check(number_above_zero());
  sub->add_option("--layer-um", o.mesh.layer_um, "Side of a cell in micrometres")
      ->check(layer_height());
  o.mesh.add_placement_to(*sub);
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name, best with [beams]")
      ->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  o.light.add_to(*sub);
  sub->add_option("-o,--output", o.output, "File of the job to write")->required();
  sub->add_option("--beams", o.beams,
                  "2: along x and y; 3: all axes; 4, 6: the same from both sides [those of the "
                  "printer, else 3]")
      ->check(CLI::IsMember({2, 3, 4, 6}));
  sub->add_option("--images", o.images,
                  "silhouette: lit where the part is on the ray; end-on: where nothing else is; "
                  "grey: whatever separates the part best")
      ->check(CLI::IsMember({"silhouette", "end-on", "grey"}))
      ->capture_default_str();
  sub->add_option("--vat-mm", o.vat_mm, "X,Y,Z: inside of the vat [the printer's, else the part's]")
      ->delimiter(',')
      ->expected(3)
      ->check(number_in(0, kMostVatMm, true));
  sub->add_option("--intensity-mw-cm2", o.intensity_mw_cm2,
                  "Of the brightest pixels, at the vat's wall [the printer's brightest]")
      ->check(number_above_zero());
  sub->add_option("--exposure-s", o.exposure_s,
                  "How long to expose [the middle of the time window]")
      ->check(number_above_zero());
  sub->add_option("--steps", o.steps,
                  "Grey: steps of the solver for each contrast that it tries [60]")
      ->check(CLI::Range(1, 100000));
  sub->add_option("--dose", o.dose, "Write the dose of the exposure, mJ/cm³, to FILE (.npy)");
  sub->add_option("--cells", o.cells,
                  "Write the cells of the vat to FILE (.npy: 255 part, 0 empty, else neither)");
  sub->add_option("--report", o.report, "Write a page that shows what is printed (.html)");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::cli
