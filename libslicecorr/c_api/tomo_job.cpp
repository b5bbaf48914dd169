// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic jobs: solving, files, frames, doses, figures.

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <tuple>

#include "c_api/tomo_bench.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown_light.hpp"

namespace slicecorr::c_api {

namespace {

using tomo::Box;
using tomo::TomoJob;

std::unique_ptr<slicecorr_tomo_job> handle_of(TomoJob job) {
  auto made = std::make_unique<slicecorr_tomo_job>();
  made->bench = tomo::make_bench(job.printer, job.resin, job.sampling);
  made->job = std::move(job);
  return made;
}

struct JobProperty {
  const char *name, *what;
  double (*value)(const slicecorr_tomo_job&);
};

const JobProperty kJobProperties[] = {
    {"turns", "whole turns", [](const slicecorr_tomo_job& j) { return double(j.job.turns); }},
    {"print_time_s", "their time",
     [](const slicecorr_tomo_job& j) { return j.job.turns * j.bench.exposure.turn_s; }},
    {"width_px", "columns of a frame",
     [](const slicecorr_tomo_job& j) { return double(j.bench.frame_width); }},
    {"height_px", "rows of a frame",
     [](const slicecorr_tomo_job& j) { return double(j.bench.frame_height); }},
    {"clockwise", "1 when the vial turns clockwise, seen from above",
     [](const slicecorr_tomo_job& j) { return j.bench.clockwise ? 1.0 : 0.0; }},
    {"insert", "1 with an insert",
     [](const slicecorr_tomo_job& j) { return j.job.insert.values.empty() ? 0.0 : 1.0; }},
};

/// A part or an insert on the grid of the vial.
Box<std::uint8_t> placed_array(const slicecorr_array* given, const char* name,
                               const Printer& printer, double voxel_mm) {
  return tomo::placed(ArrayView(given, name, Elements::bytes, false).bytes(), printer, voxel_mm);
}

/// The insert of a part; empty for none.
Box<std::uint8_t> insert_of(const slicecorr_array* given, const slicecorr_array& part,
                            const Printer& printer, double voxel_mm) {
  if (!given) return {};
  const ArrayView view(given, "insert", Elements::bytes, false);
  view.need_shape({part.shape[0], part.shape[1], part.shape[2]}, "those of the part");
  return placed_array(given, "insert", printer, voxel_mm);
}

tomo::PrintOptions options_of(const Choices& choices) {
  tomo::PrintOptions options;
  if (!choices.method.empty()) options.solve.method = tomo::method_named(choices.method);
  if (!choices.window.empty()) options.solve.window = tomo::window_named(choices.window);
  options.solve.steps = std::max(0, choices.iterations);
  options.solve.clip_sigma = choices.clip_sigma;
  options.solve.stop_error = choices.stop_error;
  if ((choices.clip_sigma > 0 || choices.stop_error > 0) &&
      options.solve.method != tomo::Method::osmo) {
    throw InputError("clip_sigma and stop_error are of OSMO; expected method osmo with them");
  }
  options.angles = std::max(0, choices.angles);
  options.most_time_s = choices.max_time_s;
  options.beyond_reach = choices.beyond_reach == "allow";
  return options;
}

}  // namespace

Names tomo_property_names() {
  Names names = bench_property_names();
  for (const JobProperty& p : kJobProperties) names.emplace_back(p.name, p.what);
  return names;
}

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;
namespace tomo = slicecorr::tomo;

slicecorr_status slicecorr_tomo_solve(const slicecorr_array* part, const slicecorr_array* insert,
                                      const slicecorr_setup* setup, slicecorr_job* handle,
                                      slicecorr_tomo_job** tomo_job, slicecorr_figures** figures) {
  return guarded(error_of(handle), [&] {
    if (figures) *figures = nullptr;
    Output output(tomo_job, "tomo_job");
    need(part, "part");
    const Choices& choices = need(setup, "setup").choices;
    const auto [printer, resin] =
        slicecorr::chosen_definitions(choices, slicecorr::ChoiceNames::fields);
    const double voxel_mm = voxel_mm_of(*setup);
    const slicecorr::ExecutionContext context = job_of(handle);
    for (const std::string& text : slicecorr::definition_notices(printer, resin, false)) {
      context.tell(text);
    }
    const tomo::Box<std::uint8_t> box = placed_array(part, "part", printer, voxel_mm);
    tomo::PrintOptions options = options_of(choices);
    options.insert = insert_of(insert, *part, printer, voxel_mm);
    tomo::Print print = tomo::solve_print(box, voxel_mm, printer, resin, options, context);
    auto made = handle_of(std::move(print.job));
    auto told = figures ? figures_of(print.figures.to_json()) : nullptr;
    context.check_cancelled();
    output.give(std::move(made));
    if (figures) *figures = told.release();
  });
}

slicecorr_status slicecorr_tomo_job_of_light(const slicecorr_array* part,
                                             const slicecorr_array* insert,
                                             const slicecorr_array* light, int turns,
                                             const slicecorr_setup* setup,
                                             slicecorr_tomo_job** tomo_job) {
  return guarded(nullptr, [&] {
    Output output(tomo_job, "tomo_job");
    need(part, "part");
    const ArrayView from(light, "light", Elements::floats, false);
    const Choices& choices = need(setup, "setup").choices;
    if (turns < 1) {
      throw slicecorr::InputError("turns is " + std::to_string(turns) + "; expected 1 or more");
    }
    tomo::TomoJob job;
    std::tie(job.printer, job.resin) =
        slicecorr::chosen_definitions(choices, slicecorr::ChoiceNames::fields);
    job.turns = turns;
    job.sampling.voxel_mm = voxel_mm_of(*setup);
    job.part = placed_array(part, "part", job.printer, job.sampling.voxel_mm);
    job.insert = insert_of(insert, *part, job.printer, job.sampling.voxel_mm);
    job.sampling.slices = job.part.nz;
    job.sampling.angles = static_cast<int>(std::min<std::size_t>(from.size(1), 1000000));
    auto made = handle_of(std::move(job));
    const tomo::TomoGrid& grid = made->bench.grid;
    from.need_shape(light_shape(grid), kLightAxes);
    tomo::Light mw_cm2(grid);
    for (std::size_t b = 0; b < grid.blocks(); ++b) {
      from.read(b * static_cast<std::size_t>(grid.lanes()), grid.lanes_used(b), grid.lanes(),
                mw_cm2.block(b));
    }
    made->job.levels = tomo::nearest_levels(mw_cm2, 1, made->bench.mw_cm2);
    output.give(std::move(made));
  });
}

slicecorr_status slicecorr_tomo_job_open(const char* path, slicecorr_job* handle,
                                         slicecorr_tomo_job** tomo_job) {
  return guarded(error_of(handle), [&] {
    Output output(tomo_job, "tomo_job");
    output.give(handle_of(tomo::read_job(&need(path, "path"), job_of(handle))));
  });
}

slicecorr_status slicecorr_tomo_job_write(const slicecorr_tomo_job* tomo_job, const char* path,
                                          slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    need(path, "path");
    if (*path == '\0') throw slicecorr::InputError("the path of the output is empty");
    tomo::write_job(path, j.job, job_of(handle));
  });
}

void slicecorr_tomo_job_free(slicecorr_tomo_job* tomo_job) { delete tomo_job; }

slicecorr_status slicecorr_tomo_job_number(const slicecorr_tomo_job* tomo_job, const char* name,
                                           double* value) {
  return guarded(nullptr, [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    need(value, "value");
    const std::string_view asked = &need(name, "name");
    for (const JobProperty& p : kJobProperties) {
      if (p.name != asked) continue;
      *value = p.value(j);
      return;
    }
    const auto found = bench_number({j.bench.grid, j.bench.rays.alpha_per_mm, &j.bench}, asked);
    if (!found) unknown_name(name, "property", tomo_property_names());
    *value = *found;
  });
}

slicecorr_status slicecorr_tomo_job_frames(const slicecorr_tomo_job* tomo_job, int first,
                                           const slicecorr_array* frames, slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    const ArrayView to(frames, "frames", Elements::bytes, true);
    to.need_shape({to.size(0), static_cast<std::size_t>(j.bench.frame_height),
                   static_cast<std::size_t>(j.bench.frame_width)},
                  "frames, rows, columns");
    const auto angles = static_cast<std::size_t>(j.bench.grid.angles);
    if (first < 0 || static_cast<std::size_t>(first) >= angles ||
        to.size(0) > angles - static_cast<std::size_t>(first)) {
      throw slicecorr::InputError(fmt::format("frames {} to {} are asked for; the job has {}",
                                              first, first + static_cast<double>(to.size(0)) - 1,
                                              angles));
    }
    slicecorr::parallel_for(job_of(handle), "draw", to.size(0), [&](std::size_t n) {
      to.write_slice(n,
                     tomo::frame_image(j.job, j.bench, first + static_cast<int>(n)).pixels.data());
    });
  });
}

slicecorr_status slicecorr_tomo_job_light(const slicecorr_tomo_job* tomo_job,
                                          const slicecorr_array* light, slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    const ArrayView to(light, "light", Elements::floats, true);
    to.need_shape(light_shape(j.bench.grid), kLightAxes);
    job_of(handle).check_cancelled();
    write_light(tomo::shown_light(j.bench, j.job.levels), to);
  });
}

slicecorr_status slicecorr_tomo_job_part(const slicecorr_tomo_job* tomo_job,
                                         const slicecorr_array* part, slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    const ArrayView to(part, "part", Elements::bytes, true);
    to.need_shape(volume_shape(j.bench.grid), kVolumeAxes);
    job_of(handle).check_cancelled();
    for (std::size_t z = 0; z < to.size(0); ++z) {
      to.write_slice(z, &j.job.part.values[j.job.part.at(static_cast<int>(z), 0, 0)]);
    }
  });
}

slicecorr_status slicecorr_tomo_job_dose(const slicecorr_tomo_job* tomo_job,
                                         const slicecorr_array* dose, slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    const ArrayView to(dose, "dose", Elements::floats, true);
    to.need_shape(volume_shape(j.bench.grid), kVolumeAxes);
    const tomo::Box<float> box = tomo::dose_of(j.job, job_of(handle));
    for (std::size_t z = 0; z < to.size(0); ++z) {
      to.write_slice(z, &box.values[box.at(static_cast<int>(z), 0, 0)]);
    }
  });
}

slicecorr_status slicecorr_tomo_verify(const slicecorr_tomo_job* tomo_job,
                                       const slicecorr_array* part, slicecorr_job* handle,
                                       slicecorr_figures** figures) {
  return guarded(error_of(handle), [&] {
    Output output(figures, "figures");
    const slicecorr_tomo_job& j = need(tomo_job, "tomo_job");
    tomo::Box<std::uint8_t> other;
    if (part) {
      other = placed_array(part, "part", j.job.printer, j.job.sampling.voxel_mm);
      if (other.nz != j.job.part.nz) {
        throw slicecorr::InputError(fmt::format("part has {} slices, the job {}; expected as many",
                                                other.nz, j.job.part.nz));
      }
    }
    const slicecorr::ExecutionContext context = job_of(handle);
    const tomo::Box<std::uint8_t>& judged = part ? other : j.job.part;
    tomo::PrintFigures told =
        tomo::figures_of(j.job, tomo::dose_of(j.job, context), judged, context);
    told.gel_centres_below_dose = tomo::share_below_gel(
        j.job, tomo::dose_of(j.job, context, tomo::JudgedAt::centres), judged);
    output.give(figures_of(told.to_json()));
  });
}
