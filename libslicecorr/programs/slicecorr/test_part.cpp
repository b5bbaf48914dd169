#include "test_part.hpp"

#include <fmt/format.h>

#include <optional>

#include "programs/common/make_part.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/test_part.hpp"
#include "slicecorr/tuning_part.hpp"
#include "slicecorr/turned.hpp"

namespace slicecorr::cli {

namespace {

/// One slice as the display shows it.
GreyImage picture_of(const SliceSource& slices) {
  const Grid& g = slices.grid();
  GreyImage image{g.width_px, g.height_px, {}};
  slices.read_slices({0, 0, g.width_px, g.height_px}, 0, 1, [&](int, const std::uint8_t* rows) {
    image.pixels.assign(rows, rows + static_cast<std::ptrdiff_t>(g.width_px) * g.height_px);
  });
  return image;
}

int tuning_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  if (!o.picture.empty()) throw InputError("--picture is of the part `spread`; expected --sheet");
  StackFile file(o.output);
  file.format = o.format;
  format_of(file);
  for (const std::string& output : {o.output, o.form, o.sheet}) {
    check_output(output, {o.printer, o.resin});
  }
  const Printer printer = load_printer(o.printer);
  std::optional<Resin> resin;
  if (!o.resin.empty()) resin = load_resin(o.resin);
  const TuningPart part(o.kind == "comb" ? TuningPartKind::comb : TuningPartKind::staircase,
                        printer, resin ? &*resin : nullptr, o.layer_um);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  if (!o.form.empty()) write_text_file(o.form, part.form());
  if (!o.sheet.empty()) write_text_file(o.sheet, part.sheet());
  const StackInfo info = write_target(*fitted, file, context);
  console.say(fmt::format("{}: {} images, {} places to measure", o.output, info.grid.layers,
                          part.rows().size()));
  return kDone;
}

int test_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
  if (o.kind != "spread") return tuning_part(o, context, console);
  if (!o.sheet.empty() || !o.resin.empty()) {
    throw InputError("--sheet and --resin are of combs and staircases; expected `testpart comb`");
  }
  StackFile file(o.output);
  file.format = o.format;
  format_of(file);
  check_output(o.output, {o.printer});
  for (const std::string& output : {o.form, o.picture}) check_output(output, {o.printer, o.output});
  const Printer printer = load_printer(o.printer);
  const SpreadTestPart part(printer, o.layer_um, o.height_um);
  const FittedSlices shown = FittedSlices::for_display(part, printer, folder_of(o.output), context);
  const FittedSlices fitted = fit_for_output(part, file, printer, context);
  if (!o.form.empty()) write_text_file(o.form, part.form());
  if (!o.picture.empty()) {
    const auto png = encode_png(picture_of(*shown));
    write_text_file(o.picture, {png.begin(), png.end()});
  }
  const StackInfo info = write_target(*fitted, file, context);
  console.say(fmt::format("{}: {} slices, {:.4f} ml; lines and gaps of {:g} to {:g} um", o.output,
                          info.grid.layers, info.part_volume_mm3 * 1e-3,
                          part.features().front().width_um, part.features().back().width_um));
  return kDone;
}

}  // namespace

void add_test_part(Program& program, TestPartOptions& o) {
  CLI::App* sub = program.add(
      "testpart", "Make a part to print and measure, for `resinctl fit-spread` and `resinctl tune`",
      [&o](const ExecutionContext& context, Console& console) {
        return test_part(o, context, console);
      });
  sub->add_option("KIND", o.kind,
                  "spread (lines and gaps, for fit-spread), comb or staircase (for tune)")
      ->check(CLI::IsMember({"spread", "comb", "staircase"}))
      ->capture_default_str();
  sub->add_option("--resin", o.resin, "Resin of a staircase: a .toml file or a name");
  sub->add_option("--sheet", o.sheet, "Comb, staircase: write what to measure where (.html)");
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("-o,--output", o.output, "Stack to write (.uvj, or another format)")->required();
  sub->add_option("--layer-um", o.layer_um, "Height of the layers")
      ->check(number_in(1, 1000))
      ->capture_default_str();
  sub->add_option("--height-um", o.height_um, "Height of the part; one layer: a thin film")
      ->check(number_in(1, 1e5))
      ->capture_default_str();
  sub->add_option("--format", o.format, "Format of the archive, where its name does not tell");
  sub->add_option("--form", o.form, "Write the table to fill in (.csv)");
  sub->add_option("--picture", o.picture,
                  "Write a slice as the display shows it, for a camera at the window (.png)");
}

}  // namespace slicecorr::cli
