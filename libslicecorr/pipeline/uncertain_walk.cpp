#include "pipeline/uncertain_walk.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

void check_uncertain(const Setup& setup) {
  const auto refuse = [](const char* where) {
    throw InputError(fmt::format("how sure a print is can't be said {}", where));
  };
  if (setup.process.uv.kind != UvKind::off) {
    refuse("under UV light; expected --uncertain without it");
  }
  if (!setup.printer.spread.none()) {
    refuse(
        "where light spreads from pixel to pixel; expected a printer without blue.spread for "
        "--uncertain");
  }
  if (setup.resin.scatter_um2_per_um > 0) {
    refuse("where light scatters in the resin; expected a resin without it for --uncertain");
  }
  if (setup.printer.resin_depth_um > 0) {
    refuse(
        "where the resin ends above the window; expected a printer without vat.depth_um for "
        "--uncertain");
  }
  if (setup.printer.platform_reflectance > 0) {
    refuse(
        "below a platform that sends light back; expected a printer without "
        "vat.platform_reflectance for --uncertain");
  }
}

UncertainTotal::UncertainTotal(const Setup& setup, const PixelBox& box)
    : uncertainty_(*setup.uncertainty), maps_(box) {
  check_uncertainty(uncertainty_);
  check_uncertain(setup);
  total_.inputs = uncertainty_;
}

void UncertainTotal::add(const CureModel& model, std::size_t columns, const ShownSlice& shown,
                         const CodedDesign& design, int all_layers, bool at_heights,
                         const BandPredictor::PixelOfColumn& place,
                         const ExecutionContext& context) {
  UncertainBand band(model, uncertainty_, all_layers, columns);
  if (at_heights) band.aim_at_heights();
  LeftAloneRows left_alone(design.left_alone);
  std::vector<std::uint8_t> coverage(columns), heights(columns), room;
  room.resize(columns);
  for (int n = all_layers; n-- > 0;) {
    if ((n & 63) == 0) context.check_cancelled();
    design.coverage.read(n, coverage.data());
    band.add_slice(n, shown(n), marked(coverage.data(), left_alone.at(n), room),
                   design.heights_at(n, heights.data()));
  }
  UncertainPrint figures;
  band.finish(place, figures);
  maps_.add(band.sides(), place);
  const std::lock_guard lock(merging_);
  total_.merge(figures);
}

std::shared_ptr<const UncertainPrint> UncertainTotal::result(
    const std::optional<RobustFigures>& robust) const {
  auto print = std::make_shared<UncertainPrint>(total_);
  print->robust = robust;
  print->maps = std::make_shared<const SurfaceMaps>(maps_.maps());
  return print;
}

}  // namespace slicecorr::detail
