// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/tomo_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/read_wanted.hpp"
#include "slicecorr/vial.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::cli {

namespace {

using tomo::Box;

struct Voxels {
  Box<std::uint8_t> part, insert;
  double middle_z_mm = 0;
};

/// Where part i is to lie.
Point3 place_of(const TomoPrintOptions& o, std::size_t i) {
  if (o.at_mm.empty()) return {};
  return {o.at_mm[3 * i], o.at_mm[3 * i + 1], o.at_mm[3 * i + 2]};
}

void check_places(const TomoPrintOptions& o, std::size_t parts) {
  if (o.at_mm.empty() || o.at_mm.size() == 3 * parts) return;
  throw InputError(
      fmt::format("--at-mm says {} numbers for {} {}; expected x, y and z for each, in their order",
                  o.at_mm.size(), parts, parts == 1 ? "part" : "parts"));
}

/// Adds an insert to those before.
void merge(Box<std::uint8_t> insert, Box<std::uint8_t>& all) {
  if (all.values.empty()) {
    all = std::move(insert);
    return;
  }
  for (std::size_t i = 0; i < all.values.size(); ++i) {
    all.values[i] = std::max(all.values[i], insert.values[i]);
  }
}

/// Parts keep their places beside each other; all together are middled.
tomo::PartFrame place_as_in_files(std::vector<tomo::PlacedPart>& parts) {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  const auto box_of = [&](const tomo::PlacedPart& part, Point3& low, Point3& high) {
    low.fill(kFar);
    high.fill(-kFar);
    widen_box(part.mesh, low, high);
  };
  Point3 all_low{kFar, kFar, kFar}, all_high{-kFar, -kFar, -kFar}, low, high;
  for (const tomo::PlacedPart& part : parts) widen_box(part.mesh, all_low, all_high);
  for (tomo::PlacedPart& part : parts) {
    box_of(part, low, high);
    for (std::size_t k = 0; k < 3; ++k) {
      const bool base = k == 2 && part.on_base;
      part.at_mm[k] =
          base ? low[k] - all_low[k] : 0.5 * (low[k] + high[k]) - 0.5 * (all_low[k] + all_high[k]);
    }
  }
  return {0.5 * (all_low[0] + all_high[0]), 0.5 * (all_low[1] + all_high[1]), all_low[2]};
}

Voxels voxels_of_volumes(const TomoPrintOptions& o, const Printer& printer, double voxel_mm) {
  const Box<std::uint8_t> part = tomo::read_part_npy(o.volume);
  check_places(o, 1);
  const Point3 at = place_of(o, 0);
  Voxels voxels{tomo::placed(part, printer, voxel_mm, {at[0], at[1]}), {}, at[2]};
  if (o.base_on_axis) voxels.middle_z_mm += 0.5 * part.nz * voxel_mm;
  for (const std::string& path : o.inserts) {
    const Box<std::uint8_t> insert = tomo::read_part_npy(path);
    if (insert.nx != part.nx || insert.ny != part.ny || insert.nz != part.nz) {
      throw InputError(path, "",
                       fmt::format("has {} x {} x {} voxels, the part {} x {} x {}; expected an "
                                   "insert in a volume of the part's size",
                                   insert.nx, insert.ny, insert.nz, part.nx, part.ny, part.nz));
    }
    merge(tomo::placed(insert, printer, voxel_mm, {at[0], at[1]}), voxels.insert);
  }
  return voxels;
}

Voxels voxels_of_meshes(const TomoPrintOptions& o, const Printer& printer, double voxel_mm,
                        const ExecutionContext& context) {
  const std::vector<std::string> files = o.mesh.files();
  check_places(o, files.size());
  if (files.size() > 1 && !o.inserts.empty() && !o.at_mm.empty()) {
    throw InputError(
        "--insert has the part's coordinates, of which there are several with --at-mm; expected one part "
        "with an insert");
  }
  // All are scaled alike (--fit-mm), as long as they are known together.
  MeshOptions one = o.mesh;
  one.placement();
  std::vector<tomo::PlacedPart> parts;
  for (std::size_t i = 0; i < files.size(); ++i) {
    one.parts = {files[i]};
    parts.push_back({files[i], read_parts(one, context).mesh, place_of(o, i), o.base_on_axis});
  }
  Voxels voxels;
  tomo::PartFrame frame = tomo::frame_of(parts.front().mesh, context);
  if (files.size() == 1 && o.at_mm.empty()) {
    voxels.part = tomo::voxelise(std::move(parts.front().mesh), printer, voxel_mm, context);
    if (o.base_on_axis) voxels.middle_z_mm = 0.5 * voxels.part.nz * voxel_mm;
  } else {
    if (o.at_mm.empty()) {
      frame = place_as_in_files(parts);
    } else {
      frame.axis_x_mm -= parts.front().at_mm[0];
      frame.axis_y_mm -= parts.front().at_mm[1];
    }
    tomo::PlacedVoxels placed = tomo::voxelise(std::move(parts), printer, voxel_mm, context);
    voxels.part = std::move(placed.part);
    if (!o.at_mm.empty() || o.base_on_axis) voxels.middle_z_mm = placed.middle_z_mm;
  }
  for (const std::string& path : o.inserts) {
    // Turned and scaled as the part is.
    MeshOptions insert = o.mesh;
    insert.parts = {path};
    TriangleMesh mesh_of_insert = read_parts(insert, context).mesh;
    try {
      merge(tomo::voxelise_insert(std::move(mesh_of_insert), frame, voxels.part, printer, voxel_mm,
                                  context),
            voxels.insert);
    } catch (const InputError& e) {
      throw InputError(path, "", e.what());
    }
  }
  return voxels;
}

}  // namespace

void TomoPrintOptions::add_to(CLI::App& app) {
  app.add_option("--insert", inserts,
                 "What turns with the part and lets no light through, in the part's coordinates: a "
                 "mesh, with a volume another of its size (> 0 opaque); may be given again")
      ->allow_extra_args(false);
  app.add_option("--voxel-mm", voxel_mm, "Side of a voxel [--layer-um, else the pixel's pitch]")
      ->check(number_above_zero());
  app.add_option("--angles", angles, "Frames of a turn [as many as resolve the voxels]")
      ->check(CLI::Range(3, 100000));
  app.add_option("--method", method,
                 "How light is found: contrast ladder, OSMO, Kelly's gradient, or filtered back "
                 "projection alone")
      ->check(CLI::IsMember({"ladder", "osmo", "kelly", "fbp"}))
      ->capture_default_str();
  app.add_option("--window", window, "Window of the filter that it starts from")
      ->check(CLI::IsMember({"hamming", "ram-lak", "kelly"}))
      ->capture_default_str();
  app.add_option("--iterations", iterations, "Steps, with the ladder of each rung [60, 20, 10]")
      ->check(CLI::Range(1, 100000));
  app.add_option(
         "--clip-sigma", clip_sigma,
         "OSMO: cut off light above the mean and so many standard deviations [none; Webber: 3]")
      ->check(number_above_zero());
  app.add_option("--stop-error", stop_error,
                 "OSMO: stop when doses are wrong by less than this share of the part's [none; "
                 "Webber: 0.005]")
      ->check(number_above_zero());
  app.add_option("--max-time-s", most_time_s,
                 "Most time to print: the ladder keeps the light within it, what takes longer is "
                 "refused")
      ->check(number_above_zero());
  app.add_flag("--beyond-reach", beyond_reach,
               "Allow parts that reach further than light from all directions does");
}

void TomoPrintOptions::add_numbers_to(CLI::App& app) {
  app.add_option(
         "--hold", hold,
         "Frames in which each angle's light is shown, by levels that make up for each other: 1, "
         "3, 5 .. [as many as gain contrast where few levels are used]")
      ->check(CLI::Range(1, 999));
  app.add_option("--k0", k0,
                 "Window kelly: where it is 1/e, as a share of the highest frequency [0.5]")
      ->check(number_in(1e-3, 100));
  app.add_option("--osmo-low", osmo_low,
                 "OSMO: void is made darker above this share of the largest dose [0.6]")
      ->check(number_in(1e-3, 1));
  app.add_option("--osmo-high", osmo_high,
                 "OSMO: the part is made brighter below this share of the largest dose [0.85]")
      ->check(number_in(1e-3, 1));
}

void TomoPrintOptions::add_places_to(CLI::App& app) {
  app.add_option(
         "--at-mm", at_mm,
         "X,Y,Z: where the middle of a part's box lies, from the axis and upwards from the optical "
         "axis; given once for each part, in their order [as they lie in their files, middled]")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(-1e6, 1e6));
  app.add_flag("--base-on-axis", base_on_axis,
               "The lowest point of the parts lies on the optical axis, or at the Z of --at-mm, "
               "instead of their middle");
}

double TomoPrintOptions::side_of_voxel_mm(const Printer& printer) const {
  if (voxel_mm > 0) return voxel_mm;
  if (!volume.empty()) {
    throw InputError("--volume does not say how large its voxels are; expected --voxel-mm");
  }
  return mesh.layer_um > 0 ? mesh.layer_um * 1e-3 : printer.pixel_y_um * 1e-3;
}

void TomoPrintOptions::add_wanted_to(CLI::App& app) {
  app.add_option(
      "--wanted", wanted,
      "Doses in place of a part, mJ/cm³ for each voxel, 0 void: .npy, or a folder or zip of grey "
      "PNG images, the lowest slice first");
  app.add_option("--white", white, "What white in images of --wanted and --tolerance stands for")
      ->check(number_above_zero());
  app.add_option("--tolerance", tolerance,
                 "By how much wanted doses may be missed: a number, or numbers as with --wanted");
  app.add_option("--weights", weights,
                 "How much a voxel's miss counts (.npy); 0: it is not judged [1]");
  app.add_option("--conversion-curve", conversion_curve,
                 "Wanted are conversions, reached at the doses of this table (.csv: dose_mj_cm3, "
                 "conversion)");
}

namespace {

void check_wanted_options(const TomoPrintOptions& o) {
  const bool turned = o.mesh.scale != 1 || o.mesh.fit_mm > 0 || !o.mesh.rotate_deg.empty() ||
                      o.mesh.units != "auto";
  if (turned && o.mesh.parts.empty()) {
    throw InputError(
        "--scale, --fit-mm, --rotate-deg and --units are of meshes; expected voxels that have their size and "
        "turn");
  }
  if (o.wanted.empty()) {
    if (o.tolerance.empty() && o.weights.empty() && o.conversion_curve.empty() && o.white == 0) {
      return;
    }
    throw InputError(
        "--tolerance, --weights, --white and --conversion-curve are of wanted doses; expected "
        "--wanted with them");
  }
  if (!o.mesh.parts.empty() || !o.volume.empty()) {
    throw InputError("--wanted says what is printed; expected no mesh and no --volume with it");
  }
  if (o.tolerance.empty()) {
    throw InputError("--wanted does not say by how much doses may be missed; expected --tolerance");
  }
  if (o.voxel_mm <= 0) {
    throw InputError("--wanted does not say how large its voxels are; expected --voxel-mm");
  }
  if (!o.inserts.empty()) {
    throw InputError("--insert is beside a part; expected no --insert with --wanted");
  }
  if (!o.at_mm.empty()) {
    throw InputError("--at-mm places parts; expected wanted doses that lie where they are wanted");
  }
}

/// What is wanted as doses on the grid of the vial.
tomo::DoseBands read_wanted_doses(const TomoPrintOptions& o, const Printer& printer,
                                  double gel_mj_cm3, const ExecutionContext& context) {
  tomo::WantedValues values;
  values.wanted = tomo::read_numbers(o.wanted, o.white, context);
  if (const auto number = number_in_text(o.tolerance)) {
    values.tolerance = {1, 1, 1, {static_cast<float>(*number)}};
  } else {
    values.tolerance = tomo::read_numbers(o.tolerance, o.white, context);
  }
  if (!o.weights.empty()) values.weight = tomo::read_numbers(o.weights, 0, context);
  std::vector<tomo::CurvePoint> curve;
  if (!o.conversion_curve.empty()) curve = tomo::read_conversion_curve(o.conversion_curve);
  tomo::DoseBands doses = tomo::wanted_doses(values, curve, gel_mj_cm3);
  const auto place = [&](Box<float>& box, float around) {
    if (!box.values.empty()) box = tomo::placed(box, printer, o.voxel_mm, around);
  };
  place(doses.least, 0);
  place(doses.most, static_cast<float>(gel_mj_cm3));
  place(doses.weight, 1);
  return doses;
}

/// All but what is printed. Throws `InputError` for options of another method.
TomoPrint with_numbers(const TomoPrintOptions& o) {
  if ((o.clip_sigma > 0 || o.stop_error > 0) && o.method != "osmo") {
    throw InputError("--clip-sigma and --stop-error are of OSMO; expected --method osmo with them");
  }
  if ((o.osmo_low > 0 || o.osmo_high > 0) && o.method != "osmo") {
    throw InputError("--osmo-low and --osmo-high are of OSMO; expected --method osmo with them");
  }
  if (o.k0 > 0 && o.window != "kelly") {
    throw InputError("--k0 is of Kelly's window; expected --window kelly with it");
  }
  TomoPrint print;
  print.options.solve.method = tomo::method_named(o.method);
  print.options.solve.window = tomo::window_named(o.window);
  if (o.k0 > 0) print.options.solve.window.k0 = o.k0;
  if (o.osmo_low > 0) print.options.solve.osmo_low = o.osmo_low;
  if (o.osmo_high > 0) print.options.solve.osmo_high = o.osmo_high;
  print.options.solve.steps = o.iterations;
  print.options.solve.clip_sigma = o.clip_sigma;
  print.options.solve.stop_error = o.stop_error;
  print.options.angles = o.angles;
  print.options.most_time_s = o.most_time_s;
  print.options.hold = o.hold;
  print.options.beyond_reach = o.beyond_reach;
  return print;
}

}  // namespace

TomoPrint read_tomo_print(const TomoPrintOptions& o, const Printer& printer,
                          const ExecutionContext& context) {
  check_wanted_options(o);
  TomoPrint print = with_numbers(o);
  print.voxel_mm = o.side_of_voxel_mm(printer);
  Voxels voxels = o.volume.empty() ? voxels_of_meshes(o, printer, print.voxel_mm, context)
                                   : voxels_of_volumes(o, printer, print.voxel_mm);
  print.part = std::move(voxels.part);
  print.options.insert = std::move(voxels.insert);
  print.options.middle_z_mm = voxels.middle_z_mm;
  return print;
}

TomoPrint read_wanted_print(const TomoPrintOptions& o, const Printer& printer, const Resin& resin,
                            const ExecutionContext& context) {
  check_wanted_options(o);
  TomoPrint print = with_numbers(o);
  print.voxel_mm = o.voxel_mm;
  const double gel_mj_cm3 = dose_to_gel_mj_cm3(resin);
  print.options.wanted = read_wanted_doses(o, printer, gel_mj_cm3, context);
  print.part = tomo::part_of(print.options.wanted, gel_mj_cm3);
  if (o.base_on_axis) print.options.middle_z_mm = 0.5 * print.part.nz * o.voxel_mm;
  return print;
}

}  // namespace slicecorr::cli
