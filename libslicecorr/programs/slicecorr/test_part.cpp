// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "test_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <optional>

#include "programs/common/make_part.hpp"
#include "slicecorr/dose_combs.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/file_greys.hpp"
#include "slicecorr/films_part.hpp"
#include "slicecorr/grid_part.hpp"
#include "slicecorr/letter_part.hpp"
#include "slicecorr/level_images.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/test_part.hpp"
#include "slicecorr/tuning_part.hpp"
#include "slicecorr/turned.hpp"
#include "slicecorr/write_images.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::cli {

namespace {

namespace fs = std::filesystem;

constexpr std::array kKinds = {TuningPartKind::comb,       TuningPartKind::staircase,
                               TuningPartKind::wedge,      TuningPartKind::dead_zone,
                               TuningPartKind::flat_field, TuningPartKind::lift_comb};

/// Options of some kinds alone: given to another kind they would be dropped.
struct OfSomeKinds {
  const char* option;
  std::vector<std::string_view> kinds;
};

const std::vector<OfSomeKinds>& options_of_some() {
  static const std::vector<OfSomeKinds> options = {
      {"--resin", {"staircase", "wedge", "flat-field", "dose-combs"}},
      {"--other-wavelength", {"staircase", "wedge", "flat-field", "dose-combs"}},
      {"--speed-mm-h", {"dose-combs"}},
      {"--form",
       {"staircase", "comb", "lift-comb", "wedge", "dead-zone", "spread", "flat-field", "levels",
        "films", "grid", "dose-combs"}},
      {"--height-um", {"spread"}},
      {"--uv-mw-cm2", {"dead-zone"}},
      {"--exposure-s", {"dead-zone", "levels", "films", "f", "grid"}},
      {"--picture", {"spread", "f"}},
  };
  return options;
}

void refuse_ignored(const CLI::App& sub, const std::string& kind) {
  for (const OfSomeKinds& of : options_of_some()) {
    if (sub.get_option(of.option)->count() == 0) continue;
    if (std::find(of.kinds.begin(), of.kinds.end(), kind) != of.kinds.end()) continue;
    throw InputError(fmt::format("{}: a part '{}' does not take it; it is of: {}", of.option, kind,
                                 fmt::join(of.kinds, ", ")));
  }
}

/// One slice as the display shows it.
GreyImage slice_picture(const SliceSource& slices) {
  const Grid& g = slices.grid();
  GreyImage image{g.width_px, g.height_px, {}};
  slices.read_slices({0, 0, g.width_px, g.height_px}, 0, 1, [&](int, const std::uint8_t* rows) {
    image.pixels.assign(rows, rows + static_cast<std::ptrdiff_t>(g.width_px) * g.height_px);
  });
  return image;
}

/// Where the table and the sheet go: beside the stack where nothing else was asked for.
struct Beside {
  std::string form, sheet;
  explicit Beside(const TestPartOptions& o)
      : form(o.form.empty() ? beside(o, ".csv") : o.form),
        sheet(o.sheet.empty() ? beside(o, ".html") : o.sheet) {
    const std::vector<std::string> inputs = {o.printer, o.resin, o.output, o.kept};
    check_output(o.output, {o.printer, o.resin, o.kept});
    check_output(form, inputs);
    check_output(sheet, inputs);
    if (form == sheet) throw InputError("--form and --sheet are the same file; expected two");
  }
  static std::string beside(const TestPartOptions& o, const char* ending) {
    return fs::path(o.output).replace_extension(ending).string();
  }
  std::string form_name() const { return fs::path(form).filename().string(); }
  /// What was measured is not written over.
  void check(const std::string& text) const {
    std::ifstream in(form, std::ios::binary);
    if (!in && errno == ENOENT) return;
    if (!in) throw InputError(detail::errno_message(form, "can't be read"));
    const std::string there{std::istreambuf_iterator<char>(in), {}};
    if (there.empty() || there == text || !fs::is_regular_file(form)) return;
    throw InputError(form, "",
                     "is there already, and is not the empty table of this part: measurements are "
                     "not written over; expected another name by --form, or move it away");
  }
  void write(const std::string& form_text, const std::string& page) const {
    write_text_file(form, form_text);
    write_text_file(sheet, page);
  }
};

/// The archive to write, in the place of the layers of another where one is given.
StackFile file_of(const TestPartOptions& o, const ExecutionContext& context) {
  StackFile file(o.output);
  file.format = o.format;
  file.format = format_of(file);
  if (!o.kept.empty()) {
    file.keep_from = o.kept;
    context.tell(o.kept + ": its settings and pictures stay, its layers become those of the part");
  }
  check_read_by(o.printer, file);
  file.machine_height_mm = load_display(o.printer).travel_mm;
  return file;
}

/// For how long an image is shown, or a plug is lit, where nothing else was asked for.
double shown_s(const TestPartOptions& o, double otherwise_s = 30) {
  return o.exposure_s > 0 ? o.exposure_s : otherwise_s;
}

/// Images that an archive shows as they are, with a table and a sheet.
template <class Images>
StackInfo write_measured(const Images& part, const StackFile& file, const Printer& printer,
                         const TestPartOptions& o, const ExecutionContext& context) {
  const Beside beside(o);
  const std::string form = form_text(part.form());
  beside.check(form);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  StackInfo info = write_images(*fitted, part.image_s(), file, context);
  beside.write(form, part.sheet(beside.form_name(), o.printer));
  return info;
}

int level_images(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  const Printer printer = load_display(o.printer);
  tell_unread(printer.unread, context);
  const LevelImages part(printer, greys_of_file(file, plate_grid(printer)),
                         {.layer_um = o.layer_um, .image_s = shown_s(o)});
  const StackInfo info = write_measured(part, file, printer, o, context);
  console.say(fmt::format("{}: {} images of one grey level each, {:g} s each; fill in {}, print {}",
                          o.output, info.grid.layers, shown_s(o), beside.form, beside.sheet));
  return kDone;
}

int films_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  const Printer printer = load_display(o.printer);
  tell_unread(printer.unread, context);
  const FilmsPart part(printer, greys_of_file(file, plate_grid(printer)),
                       {.layer_um = o.layer_um, .image_s = shown_s(o, FilmsPart::Ask().image_s)});
  if (part.greys() == 0) {
    context.tell(
        fmt::format("{}: the file shows black and full light alone: the films tell how the "
                    "resin cures, and nothing of grey levels",
                    o.output));
  }
  const StackInfo info = write_measured(part, file, printer, o, context);
  console.say(fmt::format(
      "{}: {} squares of {} grey levels, {:g} to {:g} s, by {} images of {:g} s that add up; fill in "
      "{}, print {}",
      o.output, part.squares().size(), part.greys() + 1, part.image_s().front(),
      part.image_s().front() * FilmsPart::kImages, info.grid.layers, part.image_s().front(),
      beside.form, beside.sheet));
  return kDone;
}

int grid_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  Printer printer = load_display(o.printer);
  tell_unread(printer.unread, context);
  const bool known = printer.distortion.has_value();
  const GridPart part(printer, o.layer_um, shown_s(o));
  const StackInfo info = write_measured(part, file, printer, o, context);
  if (known) {
    context.tell(fmt::format(
        "printer '{}' has a distortion already; the crosses are those of its even images",
        printer.name));
  }
  console.say(fmt::format("{}: {} crosses, shown {} times, {:g} s each; fill in {}, print {}",
                          o.output, part.crosses().size(), info.grid.layers, shown_s(o),
                          beside.form, beside.sheet));
  return kDone;
}

/// Nothing is measured: there is a sheet, and no table.
int letter_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  const StackFile file = file_of(o, context);
  const std::string sheet = o.sheet.empty() ? Beside::beside(o, ".html") : o.sheet;
  check_output(o.output, {o.printer, o.kept});
  check_output(sheet, {o.printer, o.kept, o.output});
  check_output(o.picture, {o.printer, o.kept, o.output, sheet});
  const Printer printer = load_display(o.printer);
  tell_unread(printer.unread, context);
  const LetterPart part(printer, o.layer_um, shown_s(o));
  const FittedSlices shown = FittedSlices::for_display(part, printer, folder_of(o.output), context);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  const StackInfo info = write_images(*fitted, part.image_s(), file, context);
  write_text_file(sheet, part.sheet(o.printer));
  if (!o.picture.empty()) {
    const auto png = encode_png(slice_picture(*shown));
    write_text_file(o.picture, {png.begin(), png.end()});
  }
  console.say(
      fmt::format("{}: an F, shown {} times, {:g} s each; how it stands on the screen says "
                  "what {} must say: {}",
                  o.output, info.grid.layers, shown_s(o), o.printer, sheet));
  return kDone;
}

int tuning_part(TuningPartKind kind, const TestPartOptions& o, const ExecutionContext& context,
                Console& console) {
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  Printer printer = load_printer(o.printer);
  // Levels are such as the archive holds, at the light that it really shows.
  const bool grey = kind != TuningPartKind::comb && kind != TuningPartKind::lift_comb &&
                    kind != TuningPartKind::flat_field;
  if (grey) {
    ExecutionContext untold = context;
    untold.notice = nullptr;
    const int levels = printer.levels();
    printer = printer_for_file(printer, file, plate_grid(printer), untold);
    if (printer.levels() < levels) {
      context.tell(
          fmt::format("{}: the format {} holds fewer grey levels than printer {} has: those of "
                      "the part are such as it holds",
                      file.path, file.format, printer.name));
    }
  }
  if (o.resin.empty()) tell_unread(printer.unread, context);
  std::optional<Resin> resin;
  if (!o.resin.empty()) {
    resin = load_resin(o.resin);
    for (const std::string& text : o.light.checked(printer, *resin, o.uv_mw_cm2 > 0)) {
      context.tell(text);
    }
  }
  TuningPart::Ask ask;
  ask.layer_um = o.layer_um;
  ask.resin = resin ? &*resin : nullptr;
  ask.uv_mw_cm2 = o.uv_mw_cm2;
  ask.exposure_s = shown_s(o);
  const TuningPart part(kind, printer, ask);
  const std::string form = form_text(part.form());
  beside.check(form);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  // Combs are corrected before they are printed, which says how long.
  const StackInfo info = part.image_s().empty()
                             ? write_target(*fitted, file, context)
                             : write_images(*fitted, part.image_s(), file, context);
  beside.write(form, part.sheet(beside.form_name(), o.printer));
  console.say(fmt::format("{}: {} images, {} places to measure; fill in {}, print {}", o.output,
                          info.grid.layers, part.rows().size(), beside.form, beside.sheet));
  return kDone;
}

int dose_combs(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  Printer printer = load_printer(o.printer);
  printer = printer_for_file(printer, file, plate_grid(printer), context);
  if (o.resin.empty() || !(o.speed_mm_h > 0)) {
    throw InputError(
        "a part 'dose-combs' is corrected for resin and speed; expected --resin and --speed-mm-h");
  }
  const Resin resin = load_resin(o.resin);
  for (const std::string& text : o.light.checked(printer, resin, false)) context.tell(text);
  const DoseCombs part(printer, resin, {o.layer_um, o.speed_mm_h}, context);
  for (const std::string& why : part.left_out()) context.tell(why);
  const StackInfo info = write_measured(part, file, printer, o, context);
  console.say(fmt::format(
      "{}: {} combs for {:g} to {:g} times the gel dose, {} images of {:.4g} s, corrected: print it as it is at "
      "{:g} mm/h; fill in {}, print {}",
      o.output, part.dose_factors().size(), part.dose_factors().front(), part.dose_factors().back(),
      info.grid.layers, part.image_s().front(), o.speed_mm_h, beside.form, beside.sheet));
  return kDone;
}

/// Layers are as high as those of the file that gets them, where nothing else was asked for.
void take_layer_height(TestPartOptions& o) {
  constexpr double kUsualUm = 50;
  if (o.layer_um > 0) return;
  o.layer_um = kUsualUm;
  if (o.kept.empty()) return;
  const double um = StackReader::read_info(o.kept).grid.layer_um;
  if (um > 0) o.layer_um = um;
}

int test_part(const TestPartOptions& asked, const ExecutionContext& context, Console& console) {
  TestPartOptions o = asked;
  take_layer_height(o);
  for (const TuningPartKind kind : kKinds) {
    if (o.kind == word_of(kind)) return tuning_part(kind, o, context, console);
  }
  if (o.kind == "levels") return level_images(o, context, console);
  if (o.kind == "films") return films_part(o, context, console);
  if (o.kind == "dose-combs") return dose_combs(o, context, console);
  if (o.kind == "grid") return grid_part(o, context, console);
  if (o.kind == "f") return letter_part(o, context, console);
  const StackFile file = file_of(o, context);
  const Beside beside(o);
  check_output(o.picture, {o.printer, o.output});
  const Printer printer = load_display(o.printer);
  tell_unread(printer.unread, context);
  const SpreadTestPart part(printer, o.layer_um, o.height_um);
  const std::string form = form_text(part.form());
  beside.check(form);
  const FittedSlices shown = FittedSlices::for_display(part, printer, folder_of(o.output), context);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  const StackInfo info = write_target(*fitted, file, context);
  beside.write(form, part.sheet(beside.form_name(), o.printer));
  if (!o.picture.empty()) {
    const auto png = encode_png(slice_picture(*shown));
    write_text_file(o.picture, {png.begin(), png.end()});
  }
  console.say(fmt::format(
      "{}: {} slices, {:.4f} ml; lines and gaps of {:g} to {:g} um; fill in {}, print {}", o.output,
      info.grid.layers, info.part_volume_mm3 * 1e-3, part.features().front().width_um,
      part.features().back().width_um, beside.form, beside.sheet));
  return kDone;
}

}  // namespace

void add_test_part(Program& program, TestPartOptions& o) {
  CLI::App* sub = program.add(
      "testpart",
      "Make a part to print and measure, with a sheet that says how and a table to fill in",
      [&o](const ExecutionContext& context, Console& console) {
        refuse_ignored(*o.app, o.kind);
        return test_part(o, context, console);
      });
  o.app = sub;
  sub->add_option(
         "KIND", o.kind,
         "staircase (plugs of several intensities and doses), comb (teeth and gaps, "
         "printed), lift-comb (the same, printed layer by layer), dose-combs (combs corrected for several critical doses), wedge (steps of rising dose), dead-zone (plugs under UV light), spread "
         "(lines and gaps), flat-field (plugs all over the plate), grid (crosses, which show where pixels land), levels (even images of grey "
         "levels, for a power meter), films (squares of times and grey levels, for calipers), f (an F, which shows how the screen turns and mirrors)")
      ->check(CLI::IsMember({"spread", "comb", "lift-comb", "dose-combs", "staircase", "wedge",
                             "dead-zone", "flat-field", "grid", "levels", "films", "f"}))
      ->capture_default_str();
  sub->add_option("--resin", o.resin,
                  "Resin of a staircase, wedge, flat-field or dose-combs: a .toml file or a name");
  sub->add_option("--speed-mm-h", o.speed_mm_h, "dose-combs: speed at which they are printed")
      ->check(number_in(0, 1e6, true));
  o.light.add_to(*sub);
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("-o,--output", o.output, "Stack to write (.uvj, or another format)")->required();
  sub->add_option("--form", o.form, "The table to fill in (.csv) [beside the stack]");
  sub->add_option("--sheet", o.sheet, "What to measure where, to print (.html) [beside the stack]");
  sub->add_option("--layer-um", o.layer_um, "Height of the layers [50; those of --template]")
      ->check(layer_height());
  sub->add_option("--height-um", o.height_um, "spread: height of the part; one layer: a thin film")
      ->check(number_in(1, 1e5))
      ->capture_default_str();
  sub->add_option("--uv-mw-cm2", o.uv_mw_cm2, "dead-zone: UV light at the window")
      ->check(number_in(0, 1e6, true));
  sub->add_option(
         "--exposure-s", o.exposure_s,
         "dead-zone, levels, films, f, grid: how long plugs are lit, or an image is shown [30; "
         "films: 2]")
      ->check(number_in(0, 1e6, true));
  sub->add_option(
         "--template", o.kept,
         "File of the same format whose settings and pictures stay, as the printer's slicer "
         "made it")
      ->check(CLI::ExistingFile);
  sub->add_option("--format", o.format, "Format of the archive, where its name does not tell")
      ->check(value_is(ValueKind::format));
  sub->add_option("--picture", o.picture,
                  "spread, f: write a slice as the display shows it (.png)");
  sub->footer(
      "Example:\n  slicecorr testpart staircase --printer my-printer.toml --resin my-resin.toml -o "
      "stairs.uvj\n");
}

}  // namespace slicecorr::cli
