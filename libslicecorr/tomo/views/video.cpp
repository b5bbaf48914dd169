// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/video.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/bench.hpp"

namespace slicecorr::tomo {

namespace {

/// The fraction of smallest terms that is off by less than 1e-9 of the value: continued fractions.
void fraction_of(double value, std::int64_t& over, std::int64_t& under) {
  std::int64_t before_over = 1, before_under = 0;
  over = static_cast<std::int64_t>(std::floor(value));
  under = 1;
  for (double rest = value - std::floor(value);
       std::abs(static_cast<double>(over) / static_cast<double>(under) - value) >= 1e-9 * value;) {
    const double inverse = 1 / rest;
    const auto whole = static_cast<std::int64_t>(std::floor(inverse));
    rest = inverse - std::floor(inverse);
    const std::int64_t next_over = whole * over + before_over,
                       next_under = whole * under + before_under;
    // Players read both as 32-bit numbers.
    if (next_over > std::numeric_limits<std::int32_t>::max() ||
        next_under > std::numeric_limits<std::int32_t>::max()) {
      break;
    }
    before_over = over;
    before_under = under;
    over = next_over;
    under = next_under;
  }
}

}  // namespace

VideoPlan plan_video(const TomoJob& job, const VideoOptions& options) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const int angles = bench.grid.angles;
  const double fps = options.fps > 0 ? options.fps : angles / bench.exposure.turn_s;
  if (!(fps >= 0.001 && fps <= 1e6)) {
    throw InputError(fmt::format("{:g} images a second; expected 0.001 to 1000000", fps));
  }
  const double most = job.printer.rotation->max_fps;
  if (most > 0 && fps > most * (1 + 1e-9)) {
    throw InputError(
        fmt::format("{:g} images a second; the projector of printer '{}' shows {:g} at most", fps,
                    job.printer.name, most));
  }
  if (options.turns < 0 || options.turns > 1000000000) {
    throw InputError(fmt::format("{} turns; expected 1 to 1000000000", options.turns));
  }
  if (!(options.tail_s >= 0 && options.tail_s <= 86400)) {
    throw InputError(fmt::format("a tail of {:g} s; expected 0 to 86400", options.tail_s));
  }
  VideoPlan plan;
  plan.width_px = bench.frame_width;
  plan.height_px = bench.frame_height;
  fraction_of(fps, plan.rate, plan.per_s);
  plan.turns = options.turns > 0 ? options.turns : job.turns;
  plan.tail = static_cast<std::int64_t>(std::ceil(options.tail_s * fps * (1 - 1e-9)));
  plan.images = static_cast<std::int64_t>(plan.turns) * angles + plan.tail;
  plan.deg_s = 360 * fps / angles;
  return plan;
}

void write_y4m(const TomoJob& job, const VideoPlan& plan, const VideoSink& sink,
               const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const auto put = [&](const std::string& text) {
    sink(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  };
  put(fmt::format("YUV4MPEG2 W{} H{} F{}:{} Ip A1:1 Cmono XCOLORRANGE=FULL\n", plan.width_px,
                  plan.height_px, plan.rate, plan.per_s));
  const auto size =
      static_cast<std::size_t>(plan.width_px) * static_cast<std::size_t>(plan.height_px);
  const std::vector<std::uint8_t> black(size, 0);
  const std::int64_t lit = plan.images - plan.tail;
  for (std::int64_t i = 0; i < plan.images; ++i) {
    context.check_cancelled();
    put("FRAME\n");
    if (i < lit) {
      const GreyImage image = frame_image(job, bench, static_cast<int>(i % bench.grid.angles));
      sink(image.pixels.data(), image.pixels.size());
    } else {
      sink(black.data(), black.size());
    }
    context.report("writing", static_cast<double>(i + 1) / static_cast<double>(plan.images));
  }
}

}  // namespace slicecorr::tomo
