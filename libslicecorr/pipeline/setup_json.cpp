// A setup as text of its own: the block that stacks carry, without a stack.

#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "stack/archive_format.hpp"
#include "stack/uvj_config.hpp"

namespace slicecorr {

std::string setup_json(const Setup& setup) {
  StackInfo info;
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  info.grid.pixel_x_um = setup.printer.pixel_x_um;
  info.grid.pixel_y_um = setup.printer.pixel_y_um;
  info.grid.layer_um = 1;
  return detail::write_provenance(info, 0, std::nullopt);
}

Setup parse_setup_json(std::string_view json, const std::string& source) {
  detail::ArchiveContents contents;
  contents.info.grid.layers = 1;
  detail::read_provenance(json, source, contents);
  const StackInfo& info = contents.info;
  if (!info.printer || !info.resin || !info.process) {
    throw InputError(source, "", "has no printer, resin and process; expected all three");
  }
  return {*info.printer, *info.resin, *info.process};
}

}  // namespace slicecorr
