// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A setup as text of its own: the block that stacks carry, without a stack.

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow.hpp"
#include "slicecorr/setup.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/definition_json.hpp"
#include "stack/formats/uvj_config.hpp"
#include "support/json/read_json.hpp"
#include "support/text/base64.hpp"

namespace slicecorr {

namespace {
constexpr const char* kPictureKey = "flat_field_png";
constexpr const char* kUvPictureKey = "uv_flat_field_png";
constexpr const char* kGapKey = "gap_um";
constexpr const char* kLooseKey = "loose";
constexpr const char* kNeckKey = "least_neck_mm2";

/// Above 0 and at most `most`; 0 without the key.
double number_of(std::string_view text, const std::string& source, const char* key, double most) {
  const auto json = detail::read_json(text, {source, ""});
  const auto found = json.find(key);
  if (found == json.end()) return 0;
  const double value = found->is_number() ? found->get<double>() : -1;
  if (!(value > 0 && value <= most)) {
    throw InputError(source, key, fmt::format("expected a number above 0 and at most {:g}", most));
  }
  return value;
}

bool refuses_loose(std::string_view text, const std::string& source) {
  const auto json = detail::read_json(text, {source, ""});
  const auto loose = json.find(kLooseKey);
  if (loose == json.end()) return false;
  if (*loose != "refuse") throw InputError(source, kLooseKey, "expected refuse, or no such key");
  return true;
}

void add_picture(nlohmann::ordered_json& json, const Printer& printer) {
  if (printer.flat_field) {
    json[kPictureKey] = detail::base64(detail::flat_field_png(*printer.flat_field));
  }
  if (printer.uv_flat_field) {
    json[kUvPictureKey] = detail::base64(detail::flat_field_png(*printer.uv_flat_field));
  }
}

std::vector<std::uint8_t> png_of(const nlohmann::json& json, const std::string& source,
                                 const char* key) {
  const auto picture = json.find(key);
  auto png = picture != json.end() && picture->is_string()
                 ? detail::from_base64(picture->get_ref<const std::string&>())
                 : std::nullopt;
  if (!png) throw InputError(source, key, "is missing; expected a PNG in base 64");
  return *std::move(png);
}

/// Gives the printer of `contents` the pictures that it speaks of.
void read_picture(const nlohmann::json& json, const std::string& source,
                  detail::ArchiveContents& contents) {
  if (!contents.info.printer) return;
  if (contents.info.printer->flat_field) {
    detail::set_flat_field(contents, png_of(json, source, kPictureKey), source, kPictureKey);
  }
  if (contents.info.printer->uv_flat_field) {
    detail::set_uv_flat_field(contents, png_of(json, source, kUvPictureKey), source, kUvPictureKey);
  }
}

}  // namespace

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
  const bool more = setup.printer.flat_field || setup.printer.uv_flat_field || setup.gap_um > 0 ||
                    setup.refuse_loose || setup.least_neck_mm2 > 0;
  if (!more) return block;
  auto json = detail::own_json<nlohmann::ordered_json>(block);
  if (setup.gap_um > 0) json[kGapKey] = setup.gap_um;
  if (setup.refuse_loose) json[kLooseKey] = "refuse";
  if (setup.least_neck_mm2 > 0) json[kNeckKey] = setup.least_neck_mm2;
  add_picture(json, setup.printer);
  return json.dump();
}

Setup parse_setup_json(std::string_view json, const std::string& source) {
  detail::ArchiveContents contents;
  contents.info.grid.layers = 1;
  detail::read_provenance(json, source, contents);
  if (contents.info.printer &&
      (contents.info.printer->flat_field || contents.info.printer->uv_flat_field)) {
    read_picture(detail::read_json(json, {source, ""}), source, contents);
  }
  const StackInfo& info = contents.info;
  if (!info.printer || !info.resin || !info.process) {
    throw InputError(source, "", "has no printer, resin and process; expected all three");
  }
  Setup setup{for_resin(*info.printer, *info.resin), *info.resin, *info.process,
              number_of(json, source, kGapKey, kMostGapUm)};
  setup.refuse_loose = refuses_loose(json, source);
  setup.least_neck_mm2 = number_of(json, source, kNeckKey, std::numeric_limits<double>::max());
  setup.lift_times = lift_times_of(setup.printer);
  return setup;
}

std::string definitions_json(const Printer& printer, const Resin& resin) {
  nlohmann::ordered_json json;
  json["printer"] = detail::printer_json(printer);
  json["resin"] = detail::resin_json(resin);
  add_picture(json, printer);
  return json.dump();
}

std::pair<Printer, Resin> parse_definitions_json(std::string_view json, const std::string& source) {
  const detail::JsonSource place{source, ""};
  const auto parsed = detail::read_json(json, place);
  const detail::JsonNode<nlohmann::json> root(parsed, "", place);
  detail::ArchiveContents contents;
  contents.info.printer = detail::read_printer(root["printer"]);
  if (contents.info.printer->flat_field) {
    contents.flat_field_crc32 =
        static_cast<std::uint32_t>(root["printer"]["flat_field"]["crc32"].whole(0, 0xffffffff));
  }
  if (contents.info.printer->uv_flat_field) {
    contents.uv_flat_field_crc32 =
        static_cast<std::uint32_t>(root["printer"]["uv_flat_field"]["crc32"].whole(0, 0xffffffff));
  }
  read_picture(parsed, source, contents);
  return {*contents.info.printer, detail::read_resin(root["resin"])};
}

}  // namespace slicecorr
