#include "tomo.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown.hpp"

namespace slicecorr::cli {

namespace {

using tomo::Box;
using tomo::PrintFigures;

tomo::Method method_named(const std::string& name) {
  if (name == "osmo") return tomo::Method::kOsmo;
  if (name == "kelly") return tomo::Method::kKelly;
  if (name == "fbp") return tomo::Method::kFbp;
  return tomo::Method::kLadder;
}

tomo::Window window_named(const std::string& name) {
  if (name == "ram-lak") return tomo::Window::kRamLak;
  if (name == "kelly") return tomo::Window::kKelly;
  return tomo::Window::kHamming;
}

std::string in_words(const PrintFigures& f) {
  const auto& m = f.metrics;
  std::string text = fmt::format(
      "contrast {:.4g}{}: void begins to gel after {:.4g} times the print's time\n"
      "part {} voxels, void {}, of which {} gel with the part\n"
      "dose in the part {:.4g} to {:.4g} mJ/cm³, in void up to {:.4g}; {:.4g} gels\n"
      "overlap {:.5f} at that dose, {:.5f} at the best\n"
      "{} turns, {:.0f} min {:02.0f} s; light {:.2f} % of the brightest in the mean; alpha R {:.3g}",
      m.contrast,
      std::isfinite(f.contrast_bound)
          ? fmt::format(" (no light has more than {:.4g})", f.contrast_bound)
          : std::string(),
      m.contrast, m.gel, m.empty, m.void_gelled, m.min_gel, m.max_gel, m.max_void,
      f.gel_dose_mj_cm3, f.jaccard_at_dose, m.best_jaccard, f.turns,
      std::floor(f.print_time_s / 60), std::fmod(f.print_time_s, 60.0), 100 * f.efficiency,
      f.alpha_r);
  if (!f.feasible()) {
    text += m.contrast < 1 ? "\nvoid gels before the part does"
                           : "\nsome of the part gets less than what gels";
  }
  return text + "\n";
}

int tell(const PrintFigures& figures, const std::string& json, Console& console) {
  if (json.empty()) {
    print_result(in_words(figures));
  } else {
    print_or_write(json, figures.to_json());
    console.say(in_words(figures));
  }
  return figures.feasible() ? kDone : kMissed;
}

struct Voxels {
  Box<std::uint8_t> part, insert;
};

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

Voxels voxels_of_volumes(const TomoOptions& o, const Printer& printer, double voxel_mm) {
  const Box<std::uint8_t> part = tomo::read_part_npy(o.volume);
  Voxels voxels{tomo::placed(part, printer, voxel_mm), {}};
  for (const std::string& path : o.inserts) {
    const Box<std::uint8_t> insert = tomo::read_part_npy(path);
    if (insert.nx != part.nx || insert.ny != part.ny || insert.nz != part.nz) {
      throw InputError(path, "",
                       fmt::format("has {} x {} x {} voxels, the part {} x {} x {}; expected an "
                                   "insert in a volume of the part's size",
                                   insert.nx, insert.ny, insert.nz, part.nx, part.ny, part.nz));
    }
    merge(tomo::placed(insert, printer, voxel_mm), voxels.insert);
  }
  return voxels;
}

Voxels voxels_of_meshes(const TomoOptions& o, const Printer& printer, double voxel_mm,
                        const ExecutionContext& context) {
  TriangleMesh mesh = read_parts(o.mesh, context).mesh;
  const tomo::PartFrame frame = tomo::frame_of(mesh, context);
  Voxels voxels{tomo::voxelise(std::move(mesh), printer, voxel_mm, context), {}};
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

int solve(const TomoOptions& o, const ExecutionContext& context, Console& console) {
  if (o.volume.empty() == o.mesh.parts.empty()) {
    throw InputError("expected meshes, or a volume (--volume)");
  }
  if (!o.mesh.center_mm.empty()) {
    throw InputError("--center-mm has no place here: parts are middled on the axis");
  }
  if ((o.clip_sigma > 0 || o.stop_error > 0) && o.method != "osmo") {
    throw InputError("--clip-sigma and --stop-error are of OSMO; expected --method osmo with them");
  }
  std::vector<std::string> inputs = o.mesh.parts;
  inputs.insert(inputs.end(), o.inserts.begin(), o.inserts.end());
  if (!o.volume.empty()) inputs.push_back(o.volume);
  check_output(o.output, inputs);
  check_output(o.json, inputs);
  const Printer printer = load_printer(o.printer);
  const Resin resin = load_resin(o.resin);
  const double voxel_mm = o.voxel_mm > 0        ? o.voxel_mm
                          : o.mesh.layer_um > 0 ? o.mesh.layer_um * 1e-3
                                                : printer.pixel_y_um * 1e-3;
  if (!o.volume.empty() && o.voxel_mm <= 0) {
    throw InputError("--volume does not say how large its voxels are; expected --voxel-mm");
  }
  tomo::PrintOptions options;
  options.solve.method = method_named(o.method);
  options.solve.window = window_named(o.window);
  options.solve.steps = o.iterations;
  options.solve.clip_sigma = o.clip_sigma;
  options.solve.stop_error = o.stop_error;
  options.angles = o.angles;
  options.most_time_s = o.most_time_s;
  options.beyond_reach = o.beyond_reach;
  Voxels voxels = o.volume.empty() ? voxels_of_meshes(o, printer, voxel_mm, context)
                                   : voxels_of_volumes(o, printer, voxel_mm);
  options.insert = std::move(voxels.insert);
  options.checkpoint = o.output + ".resume";
  options.checkpoint_s = o.checkpoint_s;
  options.resume = o.resume;
  const auto forget = [&] {
    std::error_code error;
    std::filesystem::remove(options.checkpoint, error);
  };
  const tomo::Print print = [&] {
    try {
      return tomo::solve_print(voxels.part, voxel_mm, printer, resin, options, context);
    } catch (const Cancelled&) {
      if (std::filesystem::exists(options.checkpoint)) {
        console.say(
            fmt::format("{}: what was found so far; the same command with --resume goes on "
                        "from there",
                        options.checkpoint));
      }
      throw;
    } catch (const InfeasibleError&) {
      forget();
      throw;
    }
  }();
  tomo::write_job(o.output, print.job, context);
  forget();
  console.say(fmt::format("{}: {} frames of {} x {} pixels", o.output, print.job.sampling.angles,
                          printer.width_px, printer.height_px));
  return tell(print.figures, o.json, console);
}

int verify(const TomoOptions& o, const ExecutionContext& context, Console& console) {
  for (const std::string& output : {o.dose, o.json})
    check_output(output, {o.job, o.volume, o.shown});
  const tomo::TomoJob job = tomo::read_job(o.job, context);
  const Box<std::uint8_t> part =
      o.volume.empty()
          ? job.part
          : tomo::placed(tomo::read_part_npy(o.volume), job.printer, job.sampling.voxel_mm);
  if (part.nz != job.part.nz) {
    throw InputError(
        o.volume, "",
        fmt::format("has {} slices, the job {}; expected as many", part.nz, job.part.nz));
  }
  const Box<float> dose = [&] {
    if (o.shown.empty()) return tomo::dose_of(job, context);
    const tomo::Shown shown = tomo::read_shown(o.shown, job.sampling.angles);
    if (shown.without_end > 0) {
      console.say(
          fmt::format("{}: {} rows have no end and are left out", o.shown, shown.without_end));
    }
    return tomo::dose_of(job, shown.showings, context);
  }();
  if (!o.dose.empty()) tomo::write_npy(o.dose, dose);
  return tell(tomo::figures_of(job, dose, part, context), o.json, console);
}

}  // namespace

void add_tomo(Program& program, TomoOptions& o) {
  CLI::App* group = program.add_group(
      "tomo", "Print whole parts at once, in a vial that turns before a projector");
  using Command = int (*)(const TomoOptions&, const ExecutionContext&, Console&);
  const auto add = [&](const char* name, const char* text, Command command) {
    return program.add_to(group, name, text,
                          [&o, command](const ExecutionContext& context, Console& console) {
                            return command(o, context, console);
                          });
  };
  CLI::App* sub = add("solve", "Find the frames of a part, and write them as a job", solve);
  sub->add_option("PART", o.mesh.parts, "Meshes (stl, obj, ply, off, 3mf; also .gz)");
  sub->add_option(
      "--volume", o.volume,
      "A volume in place of meshes (.npy, axes z, y, x: 255 part, 0 empty, else neither)");
  sub->add_option(
         "--insert", o.inserts,
         "What turns with the part and lets no light through, in the part's coordinates: a "
         "mesh, with --volume a volume of its size (> 0 opaque); may be given again")
      ->allow_extra_args(false);
  sub->add_option("--voxel-mm", o.voxel_mm, "Side of a voxel [--layer-um, else the pixel's pitch]")
      ->check(number_above_zero());
  sub->add_option("--layer-um", o.mesh.layer_um, "The same in micrometres")
      ->check(number_in(1, 1000));
  o.mesh.add_placement_to(*sub);
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  sub->add_option("-o,--output", o.output, "File of the job to write (.frames)")->required();
  sub->add_option("--angles", o.angles, "Frames of a turn [as many as resolve the voxels]")
      ->check(CLI::Range(3, 100000));
  sub->add_option("--method", o.method,
                  "How light is found: contrast ladder, OSMO, Kelly's gradient, or filtered back "
                  "projection alone")
      ->check(CLI::IsMember({"ladder", "osmo", "kelly", "fbp"}))
      ->capture_default_str();
  sub->add_option("--window", o.window, "Window of the filter that it starts from")
      ->check(CLI::IsMember({"hamming", "ram-lak", "kelly"}))
      ->capture_default_str();
  sub->add_option("--iterations", o.iterations, "Steps, with the ladder of each rung [60, 20, 10]")
      ->check(CLI::Range(1, 100000));
  sub->add_option(
         "--clip-sigma", o.clip_sigma,
         "OSMO: cut off light above the mean and so many standard deviations [none; Webber: 3]")
      ->check(number_above_zero());
  sub->add_option("--stop-error", o.stop_error,
                  "OSMO: stop when doses are wrong by less than this share of the part's [none; "
                  "Webber: 0.005]")
      ->check(number_above_zero());
  sub->add_option("--max-time-s", o.most_time_s,
                  "Most time to print: the ladder keeps the light within it, what takes longer is "
                  "refused")
      ->check(number_above_zero());
  sub->add_flag("--resume", o.resume,
                "Go on from what a solve that was stopped left in OUTPUT.resume, if it is there");
  sub->add_option("--checkpoint-s", o.checkpoint_s,
                  "Seconds at least between what is left there; 0: after each rung or step")
      ->check(number_in(0, 1e9))
      ->capture_default_str();
  sub->add_flag("--beyond-reach", o.beyond_reach,
                "Allow parts that reach further than light from all directions does");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");

  sub = add("verify", "Say what a job's frames print, by a direct sum of their light", verify);
  sub->add_option("JOB", o.job, "File of the job (.frames)")->required();
  sub->add_option("--volume", o.volume, "Another part to judge by (.npy), with the job's voxels");
  sub->add_option("--shown", o.shown,
                  "Judge by what a machine really showed: frames.csv of printbridge, or the record "
                  "of printer-sim (.csv)");
  sub->add_option("--dose", o.dose, "Write the dose of the print, mJ/cm³, to FILE (.npy)");
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");

  add_tomo_views(program, group, o.views);
}

}  // namespace slicecorr::cli
