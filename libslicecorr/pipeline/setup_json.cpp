// A setup as text of its own: the block that stacks carry, without a stack.

#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/uvj_config.hpp"
#include "support/text/base64.hpp"

namespace slicecorr {

namespace {
constexpr const char* kPictureKey = "flat_field_png";
}

std::string setup_json(const Setup& setup) {
  StackInfo info;
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  info.grid.pixel_x_um = setup.printer.pixel_x_um;
  info.grid.pixel_y_um = setup.printer.pixel_y_um;
  info.grid.layer_um = 1;
  std::string block = detail::setup_block(info);
  if (!setup.printer.flat_field) return block;
  auto json = nlohmann::ordered_json::parse(block);
  json[kPictureKey] = detail::base64(detail::flat_field_png(*setup.printer.flat_field));
  return json.dump();
}

Setup parse_setup_json(std::string_view json, const std::string& source) {
  detail::ArchiveContents contents;
  contents.info.grid.layers = 1;
  detail::read_provenance(json, source, contents);
  if (contents.info.printer && contents.info.printer->flat_field) {
    const auto block = nlohmann::json::parse(json);
    const auto picture = block.find(kPictureKey);
    const auto png = picture != block.end() && picture->is_string()
                         ? detail::from_base64(picture->get_ref<const std::string&>())
                         : std::nullopt;
    if (!png) throw InputError(source, kPictureKey, "is missing; expected a PNG in base 64");
    detail::set_flat_field(contents, *png, source, kPictureKey);
  }
  const StackInfo& info = contents.info;
  if (!info.printer || !info.resin || !info.process) {
    throw InputError(source, "", "has no printer, resin and process; expected all three");
  }
  return {*info.printer, *info.resin, *info.process};
}

}  // namespace slicecorr
