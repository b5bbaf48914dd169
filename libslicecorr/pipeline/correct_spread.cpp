#include "pipeline/correct_spread.hpp"

#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "pipeline/bands.hpp"
#include "pipeline/coded_stack.hpp"
#include "pipeline/shortcomings.hpp"
#include "pipeline/target_scan.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr::detail {

namespace {

/// Reads all slices of another while they are given on.
class Scanned final : public SliceSource {
 public:
  Scanned(const SliceSource& source, TargetScan& scan) : source_(source), scan_(scan) {}
  const Grid& grid() const override { return source_.grid(); }
  PixelBox bounds() const override { return source_.bounds(); }
  ImageFrame frame() const override { return source_.frame(); }
  const SliceSource* edge_heights() const override { return source_.edge_heights(); }
  bool ends_below_last_node() const override { return source_.ends_below_last_node(); }
  void read_band(const PixelBox& band, const Sink& sink) const override { scan_.read(band, sink); }

 private:
  const SliceSource& source_;
  TargetScan& scan_;
};

}  // namespace

Correction correct_spread_stack(const SliceSource& target, const Setup& setup,
                                const StackFile& file, const CorrectionAsk& ask,
                                const ExecutionContext& context) {
  TargetScan scan(target);
  const Scanned scanned(target, scan);
  const CorrectedSlices alone(scanned, setup, context);
  const Grid& grid = alone.grid();
  StackWriter writer(file, grid, context);
  CodedStack stack(grid, target.frame(), bands_of(grid, target.bounds()),
                   std::filesystem::path(file.path).parent_path().string(), context);
  parallel_for(context, "correct", stack.bands().size(),
               [&](std::size_t i) { stack.put(i, coded_band_of(alone, stack.bands()[i])); });

  parallel_for(context, "encode", stack.bands().size(), [&](std::size_t i) {
    const PixelBox& band = stack.bands()[i];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    stack.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      encoder.put(n, band.x0, band.x1, rows);
    });
  });

  Correction result;
  StackInfo& info = result.info;
  info.grid = grid;
  set_frame(info, target);
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  if (!target.edge_heights()) info.process->surface = Surface::slices;
  info.original_sha256 = file.original_sha256;
  scan.fill(info);
  result.after = verify_stack(stack, target, setup, context);
  if (ask.before || ask.volume_cells > 0) {
    const SlicesAlone shown(target);
    result.before = verify_stack(shown, target, setup, context);
  }
  if (ask.volume_cells > 0) {
    result.volume = std::make_shared<ReducedVolume>(
        reduce_volume(stack, target, setup, ask.volume_cells, context));
  }
  const PlaceModels models(setup.printer, setup.resin, setup.process, grid, target.frame());
  tell_shortcomings(result.after, models.brightest(), setup.process, setup.printer.levels(),
                    context);
  if (ask.before_writing) ask.before_writing(result);
  writer.finish(info, scan.picture());
  return result;
}

}  // namespace slicecorr::detail
