#include "slicecorr/tomo/job.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/vial.hpp"
#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"
#include "stack/formats/definition_json.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::tomo {

namespace {

constexpr const char* kConfig = "config.json";

std::string frame_name(int frame) { return fmt::format("frame/{:08}.png", frame); }
std::string part_name(int slice) { return fmt::format("part/{:08}.png", slice); }

/// Most bytes that a PNG of an image may have: that of one that does not deflate.
std::uint64_t png_limit(int width, int height) {
  return 2 * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) + (1 << 16);
}

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
  j["printer"] = detail::printer_json(job.printer);
  j["resin"] = detail::resin_json(job.resin);
  return j;
}

/// The entry as an image of this size.
GreyImage image_of(const detail::Container& archive, const std::string& name, int width,
                   int height) {
  const detail::Container::Entry* const entry = archive.find(name);
  if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
  std::vector<std::uint8_t> png;
  archive.read(*entry, png_limit(width, height), png);
  return decode_png(png, width, height, archive.path(), name);
}

void check_box(const Bench& bench, const Box<std::uint8_t>& part) {
  const TomoGrid& grid = bench.grid;
  if (part.nx == grid.voxels && part.ny == grid.voxels && part.nz == grid.slices) return;
  throw InputError(fmt::format("the part has {} x {} x {} voxels; expected {} x {} x {}", part.nx,
                               part.ny, part.nz, grid.voxels, grid.voxels, grid.slices));
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
    const int slice = bench.row_slice[static_cast<std::size_t>(row)];
    if (slice < 0) continue;
    std::uint8_t* const out =
        &image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) +
                      static_cast<std::size_t>(bench.first_column)];
    for (int i = 0; i < grid.pixels; ++i) {
      out[i] =
          static_cast<std::uint8_t>(pixel_of_level(job.levels[grid.pixel(m, i, slice)], levels));
    }
  }
  return image;
}

void write_job(const std::string& path, const TomoJob& job, const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  check_box(bench, job.part);
  const TomoGrid& grid = bench.grid;
  if (job.levels.size() != grid.blocks() * grid.light_of_block()) {
    throw InputError("the job's levels are not those of its grid");
  }
  const auto output = detail::make_container_output(path, detail::ContainerKind::zip, "",
                                                    detail::ImagePacking::stored);
  output->add_text(kConfig, config_of(bench, job).dump(1) + "\n");
  for (int frame = 0; frame < grid.angles; ++frame) {
    context.check_cancelled();
    output->add(frame_name(frame), encode_png(frame_image(job, bench, frame)));
  }
  const std::size_t size =
      static_cast<std::size_t>(job.part.nx) * static_cast<std::size_t>(job.part.ny);
  for (int z = 0; z < job.part.nz; ++z) {
    const std::uint8_t* const from = job.part.values.data() + static_cast<std::size_t>(z) * size;
    output->add(part_name(z), encode_png(GreyImage{job.part.nx, job.part.ny, {from, from + size}}));
  }
  output->finish(context);
}

TomoJob read_job(const std::string& path, const ExecutionContext& context) {
  const auto archive = detail::open_container(path, detail::path_parts(path).folder, context);
  if (!archive->has(kConfig)) {
    throw InputError(path, kConfig, "is missing; expected a job that tomo solve wrote");
  }
  const detail::JsonSource source{path, kConfig};
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(archive->text(kConfig));
  } catch (const nlohmann::json::exception& e) {
    throw InputError(path, kConfig, std::string("not valid JSON: ") + e.what());
  }
  const detail::JsonNode<nlohmann::json> config(json, "", source);
  const int format = config["format"].integer(1, 1000000);
  if (format > kJobFormat) {
    throw InputError(path, kConfig,
                     fmt::format("has format {}; this program knows up to {}", format, kJobFormat));
  }
  TomoJob job;
  job.printer = detail::read_printer(config["printer"]);
  job.resin = detail::read_resin(config["resin"]);
  if (job.printer.flat_field) {
    throw InputError(path, kConfig, "has a flat-field, which tomographic jobs have not");
  }
  job.turns = config["turns"].integer(1, 1000000000);
  job.sampling.voxel_mm = config["voxel_mm"].positive();
  job.sampling.angles = config["angles"].integer(3, 100000);
  const auto voxels = config["voxels"].list(3, 3);
  job.sampling.slices = voxels[0].integer(1, kMostAlongAxis);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& grid = bench.grid;
  job.part.nz = grid.slices;
  job.part.ny = job.part.nx = grid.voxels;
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

  for (int z = 0; z < grid.slices; ++z) {
    const GreyImage slice = image_of(*archive, part_name(z), grid.voxels, grid.voxels);
    job.part.values.insert(job.part.values.end(), slice.pixels.begin(), slice.pixels.end());
  }
  job.levels.assign(grid.blocks() * grid.light_of_block(), 0);
  const int levels = job.printer.levels();
  for (int frame = 0; frame < grid.angles; ++frame) {
    context.check_cancelled();
    const GreyImage image =
        image_of(*archive, frame_name(frame), bench.frame_width, bench.frame_height);
    const int m = bench.frame_of_angle(frame);
    for (int row = 0; row < image.height_px; ++row) {
      const int slice = bench.row_slice[static_cast<std::size_t>(row)];
      if (slice < 0) continue;
      const std::uint8_t* const from =
          &image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) +
                        static_cast<std::size_t>(bench.first_column)];
      for (int i = 0; i < grid.pixels; ++i) {
        job.levels[grid.pixel(m, i, slice)] =
            static_cast<std::uint16_t>(level_of_pixel(from[i], levels));
      }
    }
  }
  return job;
}

}  // namespace slicecorr::tomo
