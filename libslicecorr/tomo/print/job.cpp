// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/job.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/vial.hpp"
#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/definition_json.hpp"
#include "stack/isa_l.hpp"
#include "support/files/temporary.hpp"
#include "support/json/read_json.hpp"
#include "tomo/print/job_check.hpp"

namespace slicecorr::tomo {

namespace {

constexpr const char* kConfig = "config.json";
/// Steps of a history at most.
constexpr std::size_t kMostSteps = 10000000;

std::string frame_name(int frame) { return fmt::format("frame/{:08}.png", frame); }
constexpr const char* kInsertKey = "insert";
constexpr const char* kMiddleKey = "middle_z_mm";
std::string insert_name(int slice) { return fmt::format("insert/{:08}.png", slice); }
std::string part_name(int slice) { return fmt::format("part/{:08}.png", slice); }

nlohmann::ordered_json config_of(const Bench& bench, const TomoJob& job) {
  nlohmann::ordered_json j;
  j["format"] = kJobFormat;
  j["angles"] = bench.grid.angles;
  j["direction"] = name_of(job.printer.rotation->direction);
  j["turn_s"] = bench.exposure.turn_s;
  j["turns"] = job.turns;
  j["pitch_mm"] = job.printer.pixel_x_um * 1e-3;
  j["width_px"] = bench.frame_width;
  j["height_px"] = bench.frame_height;
  j["calibration"] = nlohmann::ordered_json::array();
  for (const CalibrationPoint& c : job.printer.calibration) {
    j["calibration"].push_back({c.level, c.intensity_mw_cm2});
  }
  j["voxel_mm"] = job.sampling.voxel_mm;
  j["voxels"] = {job.part.nz, job.part.ny, job.part.nx};
  if (job.sampling.middle_z_mm != 0) j[kMiddleKey] = job.sampling.middle_z_mm;
  if (!job.insert.values.empty()) j[kInsertKey] = true;
  j["printer"] = slicecorr::detail::printer_json(job.printer);
  j["resin"] = slicecorr::detail::resin_json(job.resin);
  if (std::isfinite(job.contrast_bound)) j["contrast_bound"] = job.contrast_bound;
  if (!job.history.empty()) {
    j["history"] = nlohmann::ordered_json::array();
    for (const Step& s : job.history) {
      // Contrast is infinite where no light falls into void: JSON has no such number.
      j["history"].push_back(
          {{"rung", s.rung},
           {"step", s.step},
           {"loss", s.loss},
           {"ver", s.ver},
           {"pw", s.pw},
           {"contrast", std::isfinite(s.contrast) ? nlohmann::ordered_json(s.contrast)
                                                  : nlohmann::ordered_json(nullptr)}});
    }
  }
  return j;
}

void read_history(const slicecorr::detail::JsonNode<nlohmann::json>& config, TomoJob& job) {
  if (config.has("contrast_bound")) {
    job.contrast_bound =
        config["contrast_bound"].number(0, slicecorr::detail::JsonSource::kLargest);
  }
  if (!config.has("history")) return;
  constexpr double kMost = slicecorr::detail::JsonSource::kLargest;
  for (const auto& node : config["history"].list(0, kMostSteps)) {
    Step s;
    s.rung = node["rung"].number(0, 1);
    s.step = node["step"].integer(0, 1000000000);
    s.loss = node["loss"].number(0, kMost);
    s.ver = node["ver"].number(0, 1);
    s.pw = node["pw"].number(-1, 1);
    s.contrast = node["contrast"].json().is_null() ? std::numeric_limits<double>::infinity()
                                                   : node["contrast"].number(0, kMost);
    job.history.push_back(s);
  }
}

/// The entry as an image of this size.
GreyImage image_of(const slicecorr::detail::Container& archive, const std::string& name, int width,
                   int height) {
  const slicecorr::detail::Container::Entry* const entry = archive.find(name);
  if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
  std::vector<std::uint8_t> png;
  archive.read(*entry, detail::png_limit(width, height), png);
  return decode_png(png, width, height, archive.path(), name);
}

/// Slices of voxels, one after another.
Box<std::uint8_t> slices_of(const slicecorr::detail::Container& archive, const TomoGrid& grid,
                            std::string (*name)(int), detail::ImagesCrc& crc) {
  Box<std::uint8_t> box{grid.slices, grid.voxels, grid.voxels, {}};
  for (int z = 0; z < grid.slices; ++z) {
    const GreyImage slice = image_of(archive, name(z), grid.voxels, grid.voxels);
    crc.add(slice);
    box.values.insert(box.values.end(), slice.pixels.begin(), slice.pixels.end());
  }
  return box;
}

void add_slices(slicecorr::detail::ContainerOutput& output, const Box<std::uint8_t>& box,
                std::string (*name)(int), detail::ImagesCrc& crc) {
  const std::size_t size = static_cast<std::size_t>(box.nx) * static_cast<std::size_t>(box.ny);
  for (int z = 0; z < box.nz; ++z) {
    const std::uint8_t* const from = box.values.data() + static_cast<std::size_t>(z) * size;
    const GreyImage image{box.nx, box.ny, {from, from + size}};
    crc.add(image);
    output.add(name(z), encode_png(image));
  }
}

/// Gives the printer the picture of its flat-field.
void read_flat_field(const slicecorr::detail::Container& archive,
                     const slicecorr::detail::JsonNode<nlohmann::json>& said, TomoJob& job) {
  FlatField& field = *job.printer.flat_field;
  check_flat_field(field, job.printer, archive.path() + ": " + slicecorr::detail::kFlatFieldEntry);
  GreyImage image =
      image_of(archive, slicecorr::detail::kFlatFieldEntry, field.width_px, field.height_px);
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(image.pixels));
  if (slicecorr::detail::flat_field_crc32(field) != said["crc32"].whole(0, 0xffffffff) ||
      field.greatest() == 0) {
    throw InputError(archive.path(), slicecorr::detail::kFlatFieldEntry,
                     "is not the flat-field that the job was made with");
  }
}

constexpr const char* kWantedKey = "wanted";
constexpr const char* kSlackBoundKey = "slack_bound";

/// A box of wanted doses, and how its entry and key are named.
struct WantedBox {
  const char* name;
  Box<float> DoseBands::*box;
};
constexpr std::array<WantedBox, 3> kWantedBoxes{
    {{"least", &DoseBands::least}, {"most", &DoseBands::most}, {"weight", &DoseBands::weight}}};
std::string wanted_entry(const WantedBox& box) { return fmt::format("wanted/{}.f32", box.name); }
std::string wanted_crc_key(const WantedBox& box) { return fmt::format("{}_crc32", box.name); }

/// Numbers of 32 bits, the least byte first.
std::vector<std::uint8_t> bytes_of(const Box<float>& box) {
  std::vector<std::uint8_t> bytes;
  bytes.reserve(4 * box.values.size());
  for (const float value : box.values) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (unsigned shift = 0; shift < 32; shift += 8) {
      bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
    }
  }
  return bytes;
}
std::uint32_t crc32_of(const std::vector<std::uint8_t>& bytes) {
  return isal::crc32(0, bytes.data(), bytes.size());
}

void add_wanted(slicecorr::detail::ContainerOutput& output, const DoseBands& wanted,
                nlohmann::ordered_json& config) {
  if (!wanted.any()) return;
  nlohmann::ordered_json said = nlohmann::ordered_json::object();
  for (const WantedBox& box : kWantedBoxes) {
    if ((wanted.*box.box).values.empty()) continue;
    std::vector<std::uint8_t> bytes = bytes_of(wanted.*box.box);
    said[wanted_crc_key(box)] = crc32_of(bytes);
    output.add(wanted_entry(box), std::move(bytes));
  }
  if (std::isfinite(wanted.slack_bound)) said[kSlackBoundKey] = wanted.slack_bound;
  config[kWantedKey] = std::move(said);
}

DoseBands read_wanted(const slicecorr::detail::Container& archive, const TomoGrid& grid,
                      const slicecorr::detail::JsonNode<nlohmann::json>& said) {
  DoseBands wanted;
  for (const WantedBox& box : kWantedBoxes) {
    const bool may_lack = &box == &kWantedBoxes.back();
    if (may_lack && !said.has(wanted_crc_key(box).c_str())) continue;
    const std::string name = wanted_entry(box);
    const slicecorr::detail::Container::Entry* const entry = archive.find(name);
    if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
    Box<float> numbers{grid.slices, grid.voxels, grid.voxels, {}};
    const std::size_t count = numbers.at(grid.slices, 0, 0);
    std::vector<std::uint8_t> bytes;
    archive.read(*entry, 4 * count, bytes);
    if (bytes.size() != 4 * count) {
      throw InputError(
          archive.path(), name,
          fmt::format("has {} bytes; expected {}, four a voxel", bytes.size(), 4 * count));
    }
    if (crc32_of(bytes) != said[wanted_crc_key(box).c_str()].whole(0, 0xffffffff)) {
      throw InputError(archive.path(), name, "is not what the job was made with");
    }
    for (std::size_t i = 0; i < count; ++i) {
      std::uint32_t bits = 0;
      for (std::size_t k = 0; k < 4; ++k) bits |= std::uint32_t{bytes[4 * i + k]} << (8 * k);
      const auto value = std::bit_cast<float>(bits);
      if (!(value >= 0 && std::isfinite(value))) {
        throw InputError(archive.path(), name, fmt::format("number {} is not one of 0 or more", i));
      }
      numbers.values.push_back(value);
    }
    wanted.*box.box = std::move(numbers);
  }
  if (said.has(kSlackBoundKey)) {
    wanted.slack_bound = said[kSlackBoundKey].number(0, slicecorr::detail::JsonSource::kLargest);
  }
  return wanted;
}

/// What other programs read, against the printer and the bench.
void check_said_twice(const slicecorr::detail::JsonNode<nlohmann::json>& config, const Bench& bench,
                      const TomoJob& job) {
  const std::string turning = name_of(job.printer.rotation->direction);
  if (!config["direction"].is_text(turning.c_str())) {
    config["direction"].fail("\"" + turning + "\", as its printer turns");
  }
  detail::check_number(config["turn_s"], bench.exposure.turn_s, "its printer");
  detail::check_number(config["pitch_mm"], job.printer.pixel_x_um * 1e-3, "its printer");
  if (config.has("width_px")) {
    detail::check_number(config["width_px"], bench.frame_width, "its printer");
  }
  if (config.has("height_px")) {
    detail::check_number(config["height_px"], bench.frame_height, "its printer");
  }
  const auto& curve = job.printer.calibration;
  const auto points = config["calibration"].list(curve.size(), curve.size());
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const auto point = points[i].list(2, 2);
    detail::check_number(point[0], curve[i].level, "its printer");
    detail::check_number(point[1], curve[i].intensity_mw_cm2, "its printer");
  }
}

void check_box(const Bench& bench, const char* what, const Box<std::uint8_t>& part) {
  const TomoGrid& grid = bench.grid;
  if (part.nx == grid.voxels && part.ny == grid.voxels && part.nz == grid.slices) return;
  throw InputError(fmt::format("the {} has {} x {} x {} voxels; expected {} x {} x {}", what,
                               part.nx, part.ny, part.nz, grid.voxels, grid.voxels, grid.slices));
}

}  // namespace

GreyImage frame_image(const TomoJob& job, const Bench& bench, int frame) {
  // Frame f is shown at the angle whose frame it is; the two are each other's inverse.
  const int m = bench.frame_of_angle(frame);
  const TomoGrid& grid = bench.grid;
  const int levels = job.printer.levels();
  GreyImage image{bench.frame_width, bench.frame_height, {}};
  image.pixels.assign(
      static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px), 0);
  for (int row = 0; row < image.height_px; ++row) {
    std::uint8_t* const out =
        &image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px)];
    for (int column = 0; column < image.width_px; ++column) {
      const FramePlaces::Lit lit = bench.places.lit_by(m, column, row);
      const int level = lit.any() ? job.levels[grid.pixel(m, lit.pixel, lit.row)] : 0;
      out[column] = static_cast<std::uint8_t>(pixel_of_level(level, levels));
    }
  }
  return image;
}

void write_job(const std::string& path, const TomoJob& job, const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  check_box(bench, "part", job.part);
  if (!job.insert.values.empty()) check_box(bench, "insert", job.insert);
  const TomoGrid& grid = bench.grid;
  if (job.levels.size() != grid.blocks() * grid.light_of_block()) {
    throw InputError("the job's levels are not those of its grid");
  }
  const auto output = slicecorr::detail::make_container_output(
      path, slicecorr::detail::ContainerKind::zip, "", slicecorr::detail::ImagePacking::stored);
  detail::ImagesCrc crc;
  for (int frame = 0; frame < grid.angles; ++frame) {
    context.check_cancelled();
    const GreyImage image = frame_image(job, bench, frame);
    crc.add(image);
    output->add(frame_name(frame), encode_png(image));
  }
  if (job.printer.flat_field) {
    output->add(slicecorr::detail::kFlatFieldEntry,
                slicecorr::detail::flat_field_png(*job.printer.flat_field));
  }
  add_slices(*output, job.part, part_name, crc);
  if (!job.insert.values.empty()) add_slices(*output, job.insert, insert_name, crc);
  nlohmann::ordered_json config = config_of(bench, job);
  add_wanted(*output, job.wanted, config);
  detail::add_checksums(config, crc.value());
  output->add_text(kConfig, config.dump(1) + "\n");
  output->finish(context);
}

TomoJob read_job(const std::string& path, const ExecutionContext& context) {
  const auto archive =
      slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder, context);
  if (!archive->has(kConfig)) {
    throw InputError(path, kConfig, "is missing; expected a job that tomo solve wrote");
  }
  const slicecorr::detail::JsonSource source{path, kConfig};
  const auto json = slicecorr::detail::read_json(archive->text(kConfig), source);
  const slicecorr::detail::JsonNode<nlohmann::json> config(json, "", source);
  if (!config.has("format") && !config.has("angles")) {
    throw InputError(path, kConfig,
                     "is not that of a tomographic job; expected a job that tomo solve wrote");
  }
  const int format = config["format"].integer(1, 1000000);
  if (format > kJobFormat) {
    throw InputError(path, kConfig,
                     fmt::format("has format {}; this program knows up to {}", format, kJobFormat));
  }
  TomoJob job;
  job.printer = slicecorr::detail::read_printer(config["printer"]);
  job.resin = slicecorr::detail::read_resin(config["resin"]);
  if (job.printer.flat_field) read_flat_field(*archive, config["printer"]["flat_field"], job);
  job.turns = config["turns"].integer(1, 1000000000);
  job.sampling.voxel_mm = config["voxel_mm"].positive();
  job.sampling.angles = config["angles"].integer(3, 100000);
  const auto voxels = config["voxels"].list(3, 3);
  job.sampling.slices = voxels[0].integer(1, kMostAlongAxis);
  if (config.has(kMiddleKey)) job.sampling.middle_z_mm = config[kMiddleKey].number(-1e6, 1e6);
  read_history(config, job);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& grid = bench.grid;
  check_said_twice(config, bench, job);
  for (std::size_t k = 1; k < 3; ++k) {
    if (voxels[k].integer(1, kMostAlongAxis) != grid.voxels) {
      voxels[k].fail(fmt::format("{}, as the vial and voxel_mm say", grid.voxels));
    }
  }
  std::size_t frames = 0;
  for (const auto& entry : archive->entries()) frames += entry.name.starts_with("frame/");
  if (frames != static_cast<std::size_t>(grid.angles)) {
    throw InputError(path, "frame/",
                     fmt::format("has {} images; expected {}, one per angle", frames, grid.angles));
  }

  detail::ImagesCrc crc;
  job.levels.assign(grid.blocks() * grid.light_of_block(), 0);
  const int levels = job.printer.levels();
  for (int frame = 0; frame < grid.angles; ++frame) {
    context.check_cancelled();
    const GreyImage image =
        image_of(*archive, frame_name(frame), bench.frame_width, bench.frame_height);
    crc.add(image);
    const int m = bench.frame_of_angle(frame);
    for (int row = 0; row < image.height_px; ++row) {
      const std::uint8_t* const from =
          &image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px)];
      for (int column = 0; column < image.width_px; ++column) {
        const FramePlaces::Lit lit = bench.places.lit_by(m, column, row);
        if (!lit.any()) continue;
        job.levels[grid.pixel(m, lit.pixel, lit.row)] =
            static_cast<std::uint16_t>(level_of_pixel(from[column], levels));
      }
    }
  }
  job.part = slices_of(*archive, grid, part_name, crc);
  if (config.has(kInsertKey)) {
    if (config[kInsertKey].json() != true) config[kInsertKey].fail("true, or no such key");
    job.insert = slices_of(*archive, grid, insert_name, crc);
  }
  if (config.has(kWantedKey)) job.wanted = read_wanted(*archive, grid, config[kWantedKey]);
  job.has_checksums = detail::check(config, crc.value(), path, context);
  return job;
}

TomoFrames::TomoFrames(const std::string& path, const TomoJob& job, const ExecutionContext& context)
    : archive_(slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder,
                                                 context)),
      angles_(job.sampling.angles),
      width_px_(job.printer.width_px),
      height_px_(job.printer.height_px) {}
TomoFrames::~TomoFrames() = default;

GreyImage TomoFrames::read(int frame) const {
  return image_of(*archive_, frame_name(frame), width_px_, height_px_);
}

}  // namespace slicecorr::tomo
