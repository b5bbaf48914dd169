#include "programs/common/tomo_options.hpp"

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

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

}  // namespace

void TomoPrintOptions::add_to(CLI::App& app) {
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
  app.add_option("--max-time-s", most_time_s, "Refuse what takes longer to print")
      ->check(number_above_zero());
  app.add_flag("--beyond-reach", beyond_reach,
               "Allow parts that reach further than light from all directions does");
}

double TomoPrintOptions::side_of_voxel_mm(const Printer& printer) const {
  if (voxel_mm > 0) return voxel_mm;
  if (!volume.empty()) {
    throw InputError("--volume does not say how large its voxels are; expected --voxel-mm");
  }
  return mesh.layer_um > 0 ? mesh.layer_um * 1e-3 : printer.pixel_y_um * 1e-3;
}

tomo::PrintOptions TomoPrintOptions::print_options() const {
  tomo::PrintOptions o;
  o.solve.method = method_named(method);
  o.solve.window = window_named(window);
  o.solve.steps = iterations;
  o.angles = angles;
  o.most_time_s = most_time_s;
  o.beyond_reach = beyond_reach;
  return o;
}

tomo::Box<std::uint8_t> tomo_part(const TomoPrintOptions& o, const Printer& printer,
                                  const ExecutionContext& context) {
  const double voxel_mm = o.side_of_voxel_mm(printer);
  if (!o.volume.empty()) {
    return tomo::placed(tomo::read_part_npy(o.volume), printer, voxel_mm);
  }
  return tomo::voxelise(read_parts(o.mesh, context).mesh, printer, voxel_mm, context);
}

}  // namespace slicecorr::cli
