// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/beams_job.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"
#include "stack/formats/definition_json.hpp"
#include "support/files/temporary.hpp"
#include "support/json/finite.hpp"
#include "support/json/read_json.hpp"
#include "tomo/print/job_check.hpp"

namespace slicecorr::tomo {
namespace {

using slicecorr::detail::finite_or_null;
using slicecorr::detail::JsonNode;
using slicecorr::detail::JsonSource;

constexpr const char* kConfig = "config.json";
constexpr const char* kKind = "beams";
constexpr double kLongestS = 1e9;

std::string display_name(int display) { return fmt::format("display/{}.png", display); }
std::string beam_name(std::size_t beam) { return fmt::format("beam/{:02}.png", beam); }

nlohmann::ordered_json vat_json(const BeamVat& vat) {
  nlohmann::ordered_json j;
  j["vat_mm"] = vat.inside_mm;
  j["ways"] = nlohmann::ordered_json::array();
  for (const BeamWay& way : vat.ways) {
    j["ways"].push_back({{"from", side_of(way)},
                         {"display", way.display},
                         {"middle_px", {way.column_px, way.row_px}},
                         {"mirror", way.mirror}});
  }
  if (vat.phase) {
    nlohmann::ordered_json& p = j["phase"];
    p["focal_mm"] = vat.phase->focal_mm;
    p["pitch_um"] = vat.phase->pitch_um;
    p["image_mm"] = {vat.phase->dx_mm, vat.phase->dy_mm};
    p["levels"] = vat.phase->levels;
    if (vat.phase->stroke_turns) p["stroke_turns"] = *vat.phase->stroke_turns;
    if (vat.phase->fill) p["fill"] = *vat.phase->fill;
  }
  return j;
}

BeamVat read_vat(const JsonNode<nlohmann::json>& node) {
  BeamVat vat;
  const auto size = node["vat_mm"].list(3, 3);
  for (std::size_t i = 0; i < 3; ++i) vat.inside_mm[i] = size[i].positive(kMostVatMm);
  for (const auto& w : node["ways"].list(1, 6)) {
    BeamWay way = way_of_side(w["from"].string());
    way.display = w["display"].integer(1, kMostDisplays);
    const auto at = w["middle_px"].list(2, 2);
    way.column_px = at[0].number(0, 1e6);
    way.row_px = at[1].number(0, 1e6);
    way.mirror = w["mirror"].flag();
    vat.ways.push_back(way);
  }
  if (node.has("phase")) {
    const auto p = node["phase"];
    PhaseVat phase;
    phase.focal_mm = p["focal_mm"].positive();
    phase.pitch_um = p["pitch_um"].positive();
    const auto at = p["image_mm"].list(2, 2);
    phase.dx_mm = at[0].number(-kMostVatMm, kMostVatMm);
    phase.dy_mm = at[1].number(-kMostVatMm, kMostVatMm);
    phase.levels = p["levels"].integer(2, 256);
    if (p.has("stroke_turns")) phase.stroke_turns = p["stroke_turns"].positive();
    if (p.has("fill")) phase.fill = p["fill"].positive(1);
    vat.phase = phase;
  }
  return vat;
}

nlohmann::ordered_json config_of(const BeamJob& job) {
  nlohmann::ordered_json j;
  j["kind"] = kKind;
  j["format"] = kBeamJobFormat;
  j["exposure_s"] = job.exposure_s;
  j["brightest_mw_cm2"] = job.brightest_mw_cm2;
  j["time_window_s"] = {finite_or_null(job.window.first_s), finite_or_null(job.window.last_s)};
  j["contrast"] = finite_or_null(job.contrast);
  j["images"] = name_of(job.setup.images);
  j["cell_mm"] = job.setup.cell_mm;
  j["cells"] = {job.cells[2], job.cells[1], job.cells[0]};
  j["vat"] = vat_json(job.vat);
  j["groups"] = nlohmann::ordered_json::array();
  nlohmann::ordered_json shown = nlohmann::ordered_json::array();
  for (std::size_t d = 0; d < job.shown.displays.size(); ++d) {
    shown.push_back(display_name(static_cast<int>(d) + 1));
  }
  j["groups"].push_back(shown);
  j["beams"] = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < job.setup.beams.size(); ++k) {
    nlohmann::ordered_json beam;
    beam["from"] = side_of(job.setup.beams[k]);
    beam["image"] = beam_name(k);
    const BeamImage& image = job.shown.images[k];
    beam["size_px"] = {image.columns, image.rows};
    if (k < job.shown.laser_mw.size()) {
      beam["efficiency"] = job.shown.efficiency[k];
      beam["rms_error_padded"] = job.shown.rms_error[k];
      beam["laser_mw"] = job.shown.laser_mw[k];
    }
    j["beams"].push_back(beam);
  }
  j["printer"] = slicecorr::detail::printer_json(job.printer);
  j["resin"] = slicecorr::detail::resin_json(job.resin);
  return j;
}

nlohmann::json parse_config(const slicecorr::detail::Container& archive) {
  return slicecorr::detail::read_json(archive.text(kConfig), {archive.path(), kConfig});
}

}  // namespace

void write_beam_job(const std::string& path, const BeamJob& job, const ExecutionContext& context) {
  const auto output = slicecorr::detail::make_container_output(
      path, slicecorr::detail::ContainerKind::zip, "", slicecorr::detail::ImagePacking::stored);
  detail::ImagesCrc crc;
  for (std::size_t d = 0; d < job.shown.displays.size(); ++d) {
    context.check_cancelled();
    crc.add(job.shown.displays[d]);
    output->add(display_name(static_cast<int>(d) + 1), encode_png(job.shown.displays[d]));
  }
  for (std::size_t k = 0; k < job.shown.images.size(); ++k) {
    const BeamImage& image = job.shown.images[k];
    const GreyImage seen = seen_image(image, way_of(job.vat, image.beam));
    crc.add(seen);
    output->add(beam_name(k), encode_png(seen));
  }
  nlohmann::ordered_json config = config_of(job);
  detail::add_checksums(config, crc.value());
  output->add_text(kConfig, config.dump(1) + "\n");
  output->finish(context);
}

BeamJob read_beam_job(const std::string& path, const ExecutionContext& context) {
  const auto archive =
      slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder, context);
  if (!archive->has(kConfig)) {
    throw InputError(path, kConfig, "is missing; expected a job of `slicecorr beams`");
  }
  const JsonSource source{path, kConfig};
  const nlohmann::json json = parse_config(*archive);
  const JsonNode<nlohmann::json> config(json, "", source);
  if (!config.has("kind") || !config["kind"].is_text(kKind)) {
    throw InputError(path, kConfig,
                     "is not that of a print with beams; expected a job of `slicecorr beams`");
  }
  const int format = config["format"].integer(1, 1000000);
  if (format > kBeamJobFormat) {
    throw InputError(
        path, kConfig,
        fmt::format("has format {}; this program knows up to {}", format, kBeamJobFormat));
  }
  BeamJob job;
  job.printer = slicecorr::detail::read_printer(config["printer"]);
  job.resin = slicecorr::detail::read_resin(config["resin"]);
  job.vat = read_vat(config["vat"]);
  job.exposure_s = config["exposure_s"].positive(kLongestS);
  job.brightest_mw_cm2 = config["brightest_mw_cm2"].positive();
  const auto window = config["time_window_s"].list(2, 2);
  const auto seconds = [](const JsonNode<nlohmann::json>& node) {
    return node.json().is_null() ? std::numeric_limits<double>::infinity()
                                 : node.number(0, JsonSource::kLargest);
  };
  job.window = {seconds(window[0]), seconds(window[1])};
  // Rounded as other programs may write it.
  if (job.exposure_s < job.window.first_s * (1 - 1e-6) ||
      job.exposure_s > job.window.last_s * (1 + 1e-6)) {
    config["exposure_s"].fail(fmt::format("{:.6g} to {:.6g}, the job's time_window_s",
                                          job.window.first_s, job.window.last_s));
  }
  job.contrast = config["contrast"].json().is_null()
                     ? std::numeric_limits<double>::infinity()
                     : config["contrast"].number(0, JsonSource::kLargest);
  job.setup.images = beam_images_named(config["images"].string());
  job.setup.cell_mm = config["cell_mm"].positive();
  job.setup.alpha_per_mm = absorption_per_cm(job.resin) * 0.1;
  job.setup.vat_mm = job.vat.inside_mm;
  take_spread(job.setup, job.printer, job.resin);
  const auto cells = config["cells"].list(3, 3);
  for (std::size_t i = 0; i < 3; ++i) job.cells[2 - i] = cells[i].integer(1, kMostAlongAxis);
  for (const auto& beam : config["beams"].list(1, 6)) {
    const BeamWay way = way_of_side(beam["from"].string());
    job.setup.beams.push_back({way.axis, way.from_plus});
    way_of(job.vat, job.setup.beams.back());
  }
  const auto groups = config["groups"].list(1, 1);
  const auto shown = groups.front().list(static_cast<std::size_t>(job.vat.displays()),
                                         static_cast<std::size_t>(job.vat.displays()));
  detail::ImagesCrc crc;
  const auto image_of = [&](const std::string& name, int width, int height) {
    const auto* const entry = archive->find(name);
    if (entry == nullptr) throw InputError(path, name, "is missing");
    std::vector<std::uint8_t> png;
    archive->read(*entry, detail::png_limit(width, height), png);
    GreyImage image = decode_png(png, width, height, path, name);
    crc.add(image);
    return image;
  };
  for (std::size_t d = 0; d < shown.size(); ++d) {
    const std::string name = display_name(static_cast<int>(d) + 1);
    if (shown[d].string() != name) shown[d].fail("\"" + name + "\"");
    job.shown.displays.push_back(image_of(name, job.printer.width_px, job.printer.height_px));
  }
  for (const auto& beam : config["beams"].list(1, 6)) {
    if (!beam.has("size_px")) continue;  // of another program
    const auto size = beam["size_px"].list(2, 2);
    image_of(beam["image"].string(), size[0].integer(1, kMostAlongAxis),
             size[1].integer(1, kMostAlongAxis));
  }
  job.has_checksums = detail::check(config, crc.value(), path, context);
  return job;
}

bool is_beam_job(const std::string& path) {
  try {
    const auto archive =
        slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder, {});
    if (!archive->has(kConfig)) return false;
    const nlohmann::json json = parse_config(*archive);
    return json.is_object() && json.contains("kind") && json["kind"] == kKind;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace slicecorr::tomo
