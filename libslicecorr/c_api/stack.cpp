// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Stacks: archives and slices in memory, and what they say about themselves.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "c_api/handles.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::c_api {

namespace {

double flag(bool set) { return set ? 1 : 0; }

struct NumberProperty {
  const char *name, *what;
  double (*value)(const slicecorr_stack&);
};

PrintTime time_of(const slicecorr_stack& s) {
  StackInfo info = s.info;
  if (s.missing.layer_um > 0) info.grid.layer_um = s.missing.layer_um;
  return print_time(info);
}

const NumberProperty kNumbers[] = {
    {"width_px", "columns of a slice",
     [](const slicecorr_stack& s) { return double(s.info.grid.width_px); }},
    {"height_px", "rows of a slice",
     [](const slicecorr_stack& s) { return double(s.info.grid.height_px); }},
    {"layers", "number of slices",
     [](const slicecorr_stack& s) { return double(s.info.grid.layers); }},
    {"pixel_x_um", "width of a pixel",
     [](const slicecorr_stack& s) {
       return s.missing.pixel_x_um > 0 ? s.missing.pixel_x_um : s.info.grid.pixel_x_um;
     }},
    {"pixel_y_um", "height of a pixel",
     [](const slicecorr_stack& s) {
       return s.missing.pixel_y_um > 0 ? s.missing.pixel_y_um : s.info.grid.pixel_y_um;
     }},
    {"layer_um", "height of a layer",
     [](const slicecorr_stack& s) {
       return s.missing.layer_um > 0 ? s.missing.layer_um : s.info.grid.layer_um;
     }},
    {"target_layers", "layers of the part",
     [](const slicecorr_stack& s) { return double(s.info.target_layers); }},
    {"part_volume_mm3", "volume of the target's coverage",
     [](const slicecorr_stack& s) { return s.info.part_volume_mm3; }},
    {"exposure_s", "light-on time of normal layers",
     [](const slicecorr_stack& s) {
       return s.info.process ? s.info.process->exposure_s : s.info.exposure_s;
     }},
    {"bottom_exposure_s", "light-on time of the first layers",
     [](const slicecorr_stack& s) {
       return s.info.process ? s.info.process->bottom_exposure_s : s.info.bottom_exposure_s;
     }},
    {"bottom_layers", "number of these first layers",
     [](const slicecorr_stack& s) {
       return double(s.info.process ? s.info.process->bottom_layers : s.info.bottom_layers);
     }},
    {"fade_layers", "layers after them that lead to the normal time",
     [](const slicecorr_stack& s) {
       return double(s.info.process ? s.info.process->fade_layers : s.info.fade_layers);
     }},
    {"speed_mm_h", "print speed",
     [](const slicecorr_stack& s) { return s.info.process ? s.info.process->speed_mm_h : 0; }},
    {"uv_mw_cm2", "intensity of the UV light, where it is constant",
     [](const slicecorr_stack& s) { return s.info.process ? s.info.process->uv.uv_mw_cm2 : 0; }},
    {"dead_zone_um", "dead zone that the UV light is to hold",
     [](const slicecorr_stack& s) { return s.info.process ? s.info.process->uv.dead_zone_um : 0; }},
    {"light_s", "time in which slices are shown",
     [](const slicecorr_stack& s) { return time_of(s).light_s; }},
    {"print_time_s", "the whole print, with lifts; 0 where these are not known",
     [](const slicecorr_stack& s) { return time_of(s).all_s().value_or(0); }},
    {"own_print_time_s", "time of the print that the archive says itself",
     [](const slicecorr_stack& s) { return s.info.own_print_time_s; }},
    {"for_display", "1 when the display shows the slices as they are, else 0: they show the plate",
     [](const slicecorr_stack& s) { return flag(s.info.for_display); }},
    {"portrait", "1 when x of the plate runs up in the slices, y to the left",
     [](const slicecorr_stack& s) { return flag(s.info.orientation.portrait); }},
    {"mirror_x", "1 when left and right are then swapped",
     [](const slicecorr_stack& s) { return flag(s.info.orientation.mirror_x); }},
    {"mirror_y", "1 when top and bottom are then swapped",
     [](const slicecorr_stack& s) { return flag(s.info.orientation.mirror_y); }},
    {"corrected", "1 for a corrected stack, else 0",
     [](const slicecorr_stack& s) { return flag(s.info.kind == StackKind::corrected); }},
    {"parameters_checked",
     "1 when the archive has a checksum of its parameters (where it is wrong, opening fails)",
     [](const slicecorr_stack& s) { return flag(s.info.parameters_checked); }},
    {"in_memory", "1 when the images are in memory, else 0",
     [](const slicecorr_stack& s) { return flag(s.slices != nullptr); }},
};

struct TextProperty {
  const char *name, *what;
  const char* (*value)(const slicecorr_stack&);
};

const TextProperty kTexts[] = {
    {"path", "of the archive", [](const slicecorr_stack& s) { return s.path.c_str(); }},
    {"format", "of the archive", [](const slicecorr_stack& s) { return s.info.format.c_str(); }},
    {"kind", "target, corrected or foreign",
     [](const slicecorr_stack& s) {
       return s.info.kind == StackKind::target      ? "target"
              : s.info.kind == StackKind::corrected ? "corrected"
              : s.info.kind == StackKind::recorded  ? "recorded"
                                                    : "foreign";
     }},
    {"program", "that made it", [](const slicecorr_stack& s) { return s.info.program.c_str(); }},
    {"mode", "continuous or layerwise, of a corrected stack",
     [](const slicecorr_stack& s) {
       return !s.info.process                                   ? ""
              : s.info.process->mode == ExposureMode::layerwise ? "layerwise"
                                                                : "continuous";
     }},
    {"printer", "that it was corrected for",
     [](const slicecorr_stack& s) { return s.info.printer ? s.info.printer->name.c_str() : ""; }},
    {"resin", "that it was corrected for",
     [](const slicecorr_stack& s) { return s.info.resin ? s.info.resin->name.c_str() : ""; }},
    {"printer_profile", "as the slicer named it",
     [](const slicecorr_stack& s) { return s.info.profiles.printer.c_str(); }},
    {"material_profile", "as the slicer named it",
     [](const slicecorr_stack& s) { return s.info.profiles.material.c_str(); }},
    {"print_profile", "as the slicer named it",
     [](const slicecorr_stack& s) { return s.info.profiles.print.c_str(); }},
};

struct ListProperty {
  const char *name, *what;
  std::vector<double> (*values)(const slicecorr_stack&);
};

const ListProperty kLists[] = {
    {"layer_exposure_s", "light-on time of each layer",
     [](const slicecorr_stack& s) {
       const bool layerwise = s.info.process && s.info.process->mode == ExposureMode::layerwise;
       std::vector<double> times;
       for (int n = 0; layerwise && n < s.info.grid.layers; ++n) {
         times.push_back(layer_exposure_s(*s.info.process, n));
       }
       return s.info.process ? times : s.info.layer_exposure_s;
     }},
    {"light_share", "share of full light of each layer; empty where all is full",
     [](const slicecorr_stack& s) {
       const Process p = process_of_times(s.info);
       std::vector<double> shares;
       if (p.light_share.empty()) return shares;
       for (int n = 0; n < s.info.grid.layers; ++n) shares.push_back(light_share(p, n));
       return shares;
     }},
    {"layer_heights_um", "height of each layer; empty where all are alike",
     [](const slicecorr_stack& s) {
       std::vector<double> heights;
       if (process_of_times(s.info).layer_heights_um.empty()) return heights;
       for (int n = 0; n < s.info.grid.layers; ++n) heights.push_back(layer_height_um(s.info, n));
       return heights;
     }},
    {"uv_slice_mw_cm2", "UV intensity of each slice",
     [](const slicecorr_stack& s) {
       std::vector<double> uv;
       if (s.info.process) uv = s.info.process->uv.slice_mw_cm2;
       // The last holds for slices after it.
       if (!uv.empty()) uv.resize(static_cast<std::size_t>(s.info.grid.layers), uv.back());
       return uv;
     }},
    {"uv_of_pixel", "UV pixel value of each pixel value",
     [](const slicecorr_stack& s) { return s.uv_of_pixel; }},
};

template <class Table>
const auto& property(const Table& table, const char* name) {
  need(name, "name");
  for (const auto& p : table) {
    if (std::strcmp(p.name, name) == 0) return p;
  }
  unknown_name(name, "property of this type", property_names());
}

Grid grid_of(const slicecorr_grid& given) {
  check_struct(given, "slicecorr_grid");
  if (given.reserved != 0) {
    throw BadCall("slicecorr_grid says something that this version of the library can't do");
  }
  const auto check = [](const char* name, double value, double least, double most) {
    if (value >= least && value <= most) return;
    throw InputError(fmt::format("{} is {:g}; expected {:g} to {:g}", name, value, least, most));
  };
  check("width_px", given.width_px, 1, kMostPixelsAcross);
  check("height_px", given.height_px, 1, kMostPixelsAcross);
  check("layers", given.layers, 1, 1000000);
  check("pixel_x_um", given.pixel_x_um, 0.001, 10000);
  check("pixel_y_um", given.pixel_y_um, 0.001, 10000);
  check("layer_um", given.layer_um, 0.1, 10000);
  return {given.width_px,   given.height_px,  given.layers,
          given.pixel_x_um, given.pixel_y_um, given.layer_um};
}

/// Checks slice and stride of an image that is put or taken.
SliceStore& slices_for(const slicecorr_stack& stack, int slice, std::ptrdiff_t stride) {
  if (!stack.slices) throw BadCall("the images are not in memory; expected slicecorr_stack_load()");
  const Grid& grid = stack.slices->grid();
  if (slice < 0 || slice >= grid.layers) {
    throw BadCall(fmt::format("slice is {}; expected 0 to {}", slice, grid.layers - 1));
  }
  if (std::abs(stride) < grid.width_px) {
    throw BadCall(fmt::format("stride is {}; expected at least the width, {}, either way", stride,
                              grid.width_px));
  }
  return *stack.slices;
}

/// Sets what an archive does not say; false for other names.
bool set_missing(slicecorr_stack& s, const std::string& name, double value) {
  struct Fact {
    const char* name;
    double MissingFacts::*missing;
    double Grid::*known;
  };
  constexpr Fact facts[] = {{"pixel_x_um", &MissingFacts::pixel_x_um, &Grid::pixel_x_um},
                            {"pixel_y_um", &MissingFacts::pixel_y_um, &Grid::pixel_y_um},
                            {"layer_um", &MissingFacts::layer_um, &Grid::layer_um}};
  for (const Fact& fact : facts) {
    if (name != fact.name) continue;
    if (!(value > 0) || !(value <= 10000)) {
      throw InputError(
          fmt::format("{} is {:g}; expected a number above 0 and at most 10000", name, value));
    }
    if (s.info.grid.*fact.known > 0) {
      throw InputError(s.path, name, fmt::format("the stack says {:g}", s.info.grid.*fact.known));
    }
    s.missing.*fact.missing = value;
    return true;
  }
  return false;
}

/// Sets how the slices of a target in memory lie; false for other names.
bool set_lie(slicecorr_stack& s, const std::string& name, double value) {
  Orientation& o = s.info.orientation;
  bool* const place = name == "for_display" ? &s.info.for_display
                      : name == "portrait"  ? &o.portrait
                      : name == "mirror_x"  ? &o.mirror_x
                      : name == "mirror_y"  ? &o.mirror_y
                                            : nullptr;
  if (!place) return false;
  if (value != 0 && value != 1) {
    throw InputError(fmt::format("{} is {:g}; expected 0 or 1", name, value));
  }
  if (!s.path.empty() || s.info.kind != StackKind::target) {
    throw BadCall(name + " is set for stacks of slicecorr_stack_create() only");
  }
  *place = value == 1;
  // Slices of the plate lie like the plate unless said otherwise.
  if (name != "for_display" || value == 0) s.info.orientation_known = true;
  s.slices->set_frame(image_frame(s.info));
  return true;
}

}  // namespace

void check_unchanged(const slicecorr_stack& stack, const StackInfo& now) {
  const StackInfo& then = stack.info;
  if (now.kind == then.kind && now.format == then.format &&
      now.grid.width_px == then.grid.width_px && now.grid.height_px == then.grid.height_px &&
      now.grid.layers == then.grid.layers && now.exposure_s == then.exposure_s &&
      now.layer_exposure_s == then.layer_exposure_s) {
    return;
  }
  throw InputError(stack.path, "", "was changed after it was opened; expected to open it again");
}

Names property_names() {
  Names names;
  for (const auto& p : kNumbers) names.emplace_back(p.name, p.what);
  for (const auto& p : kLists) names.emplace_back(p.name, p.what);
  for (const auto& p : kTexts) names.emplace_back(p.name, p.what);
  return names;
}

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_status slicecorr_stack_open(const char* path, slicecorr_stack** stack) {
  return guarded(nullptr, [&] {
    Output output(stack, "stack");
    auto made = std::make_unique<slicecorr_stack>();
    made->path = &need(path, "path");
    made->info = slicecorr::StackReader::read_info(made->path);
    output.give(std::move(made));
  });
}

slicecorr_status slicecorr_stack_create(const slicecorr_grid* grid, slicecorr_stack** stack) {
  return guarded(nullptr, [&] {
    Output output(stack, "stack");
    auto made = std::make_unique<slicecorr_stack>();
    made->info.grid = grid_of(need(grid, "grid"));
    made->info.kind = slicecorr::StackKind::target;
    made->info.for_display = true;
    made->info.target_layers = made->info.grid.layers;
    made->info.program = std::string("slicecorr ") + slicecorr::version;
    made->slices = std::make_shared<SliceStore>(made->info.grid, scratch_folder(nullptr));
    made->slices->set_frame(image_frame(made->info));
    output.give(std::move(made));
  });
}

void slicecorr_stack_free(slicecorr_stack* stack) { delete stack; }

slicecorr_status slicecorr_stack_put(slicecorr_stack* stack, int slice, const uint8_t* pixels,
                                     ptrdiff_t stride) {
  return guarded(nullptr, [&] {
    const slicecorr_stack& s = need(stack, "stack");
    if (!s.path.empty() || s.info.kind != slicecorr::StackKind::target) {
      throw BadCall("slices are put into stacks of slicecorr_stack_create() only");
    }
    slices_for(s, slice, stride).put(slice, &need(pixels, "pixels"), stride);
  });
}

slicecorr_status slicecorr_stack_get(const slicecorr_stack* stack, int slice, uint8_t* pixels,
                                     ptrdiff_t stride) {
  return guarded(nullptr, [&] {
    const SliceStore& slices = slices_for(need(stack, "stack"), slice, stride);
    slices.get(slice, &need(pixels, "pixels"), stride);
  });
}

slicecorr_status slicecorr_stack_load(slicecorr_stack* stack, slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    slicecorr_stack& s = need(stack, "stack");
    if (s.slices) return;
    const slicecorr::ExecutionContext context = job_of(handle);
    const std::string folder = scratch_folder(handle);
    const slicecorr::StackReader reader(s.path, folder, context, s.missing);
    check_unchanged(s, reader.info());
    auto slices = keep_slices(reader, "keep", folder, context);
    s.info = reader.info();
    s.missing = {};
    s.slices = std::move(slices);
  });
}

slicecorr_status slicecorr_stack_set_number(slicecorr_stack* stack, const char* name,
                                            double value) {
  return guarded(nullptr, [&] {
    slicecorr_stack& s = need(stack, "stack");
    need(name, "name");
    if (set_missing(s, name, value) || set_lie(s, name, value)) return;
    unknown_name(name, "number that can be set",
                 {{"pixel_x_um", ""},
                  {"pixel_y_um", ""},
                  {"layer_um", ""},
                  {"for_display", ""},
                  {"portrait", ""},
                  {"mirror_x", ""},
                  {"mirror_y", ""}});
  });
}

slicecorr_status slicecorr_stack_set_doses(slicecorr_stack* target, const slicecorr_stack* doses,
                                           double greatest, const char* side) {
  return guarded(nullptr, [&] {
    slicecorr_stack& t = need(target, "target");
    if (!doses) {
      t.doses.reset();
      return;
    }
    if (!doses->slices) {
      throw slicecorr::c_api::BadCall(
          "the doses are not in memory; expected slicecorr_stack_load()");
    }
    slicecorr::DoseScale scale = slicecorr::DoseScale::even(greatest);
    if (side) scale.side = slicecorr::dose_side_named(side);
    t.doses = doses->slices;
    t.dose_scale = scale;
  });
}

slicecorr_status slicecorr_stack_number(const slicecorr_stack* stack, const char* name,
                                        double* value) {
  return guarded(nullptr, [&] {
    const slicecorr_stack& s = need(stack, "stack");
    need(value, "value") = property(slicecorr::c_api::kNumbers, name).value(s);
  });
}

slicecorr_status slicecorr_stack_numbers(const slicecorr_stack* stack, const char* name,
                                         double* values, size_t capacity, size_t* count) {
  return guarded(nullptr, [&] {
    const slicecorr_stack& s = need(stack, "stack");
    need(count, "count") = 0;
    const auto list = property(slicecorr::c_api::kLists, name).values(s);
    if (capacity > 0) {
      need(values, "values");
      std::copy_n(list.begin(), std::min(capacity, list.size()), values);
    }
    *count = list.size();
  });
}

const char* slicecorr_stack_text(const slicecorr_stack* stack, const char* name) {
  if (!stack || !name) return nullptr;
  for (const auto& p : slicecorr::c_api::kTexts) {
    if (std::strcmp(p.name, name) == 0) return p.value(*stack);
  }
  return nullptr;
}
