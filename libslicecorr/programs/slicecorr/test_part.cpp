#include "test_part.hpp"

#include <fmt/format.h>

#include "programs/common/make_part.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/test_part.hpp"
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

int test_part(const TestPartOptions& o, const ExecutionContext& context, Console& console) {
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
      "testpart",
      "Make a part of lines, gaps and edges from which `resinctl fit-spread` finds how light spreads",
      [&o](const ExecutionContext& context, Console& console) {
        return test_part(o, context, console);
      });
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
