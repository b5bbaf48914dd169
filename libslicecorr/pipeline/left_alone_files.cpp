// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/find_part.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/turned.hpp"
#include "slicecorr/uneven_slices.hpp"

namespace slicecorr {

namespace {

/// A mesh as it lies on the plate, in slices like those of `target`.
MeshInLayers slices_of(const std::string& path, const SliceSource& target,
                       const MeshesLeftAlone& meshes, const Printer& printer,
                       const ExecutionContext& context) {
  TriangleMesh mesh = read_mesh(path, meshes.placement, context);
  SliceOptions options;
  options.layer_um = target.grid().layer_um;
  options.antialias = meshes.antialias;
  options.platform_z_mm = -meshes.origin_mm[2];
  // The box is placed by its middle.
  Point3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  widen_box(mesh, low, high);
  options.center_mm = {meshes.origin_mm[0] + 0.5 * (low[0] + high[0]),
                       meshes.origin_mm[1] + 0.5 * (low[1] + high[1])};
  try {
    return {std::move(mesh), printer, options, target.heights(), context};
  } catch (const InputError& e) {
    throw InputError(path, "", std::string("what is left alone must fit the target: ") + e.what());
  }
}

/// Supports that stand beside the part hold nothing.
void tell_apart(const SliceSource& target, const SliceSource& left, const std::string& path,
                const ExecutionContext& context) {
  const PixelBox a = left.bounds(), b = target.bounds();
  if (a.empty() || b.empty()) return;
  const bool touch = a.x0 <= b.x1 && b.x0 <= a.x1 && a.y0 <= b.y1 && b.y0 <= a.y1;
  if (touch) return;
  const auto in_words = [](const PixelBox& box) {
    return fmt::format("x {} to {}, y {} to {}", box.x0, box.x1 - 1, box.y0, box.y1 - 1);
  };
  context.tell(fmt::format("{}: touches nothing of the part: it lies at pixels {}, the part at {}",
                           path, in_words(a), in_words(b)));
}

/// Throws `InputError` where what is left alone has layers at other places than the target.
void check_same_heights(const SliceSource& target, const SliceSource& left,
                        const std::string& path) {
  const LayerHeights ours = target.heights(), theirs = left.heights();
  if (ours.alike() && theirs.alike()) return;
  const double usual_um = target.grid().layer_um, their_um = left.grid().layer_um;
  for (int n = 0; n < target.grid().layers; ++n) {
    const double um = ours.of(n, usual_um), their = theirs.of(n, their_um);
    if (std::abs(um - their) <= 0.01 * um) continue;
    throw InputError(
        path, "",
        fmt::format("layer {} is {:g} um high, that of the target {:g} um; expected the "
                    "same heights",
                    n, their, um));
  }
}

/// All places of the parts in the target. Tells them, and refuses parts that are not there.
std::vector<OutsideParts::Placed> placed_parts(const SliceSource& target, const PartsInside& inside,
                                               const ExecutionContext& context) {
  std::vector<OutsideParts::Placed> all;
  for (const std::string& path : inside.files) {
    const TriangleMesh mesh = read_mesh(path, inside.placement, context);
    std::shared_ptr<const SoughtPart> part;
    try {
      part = std::make_shared<const SoughtPart>(mesh, target.grid(), context);
    } catch (const InputError& e) {
      throw InputError(path, "", e.what());
    }
    const std::vector<PartPlace> places = part->find(target, context);
    if (places.empty() || places[0].agreement < kLeastAgreement) {
      const std::string best =
          places.empty() ? std::string("nothing is like it")
                         : fmt::format("at best {:.1f} % of its surface agrees, at {}",
                                       100 * places[0].agreement,
                                       in_words(places[0], target.grid(), target.frame()));
      throw InputError(
          path, "",
          fmt::format("is not in the archive: {}; expected {:g} % or more, of a mesh as it "
                      "stands on its supports, of the same size and turned about z by "
                      "quarters at most",
                      best, 100 * kLeastAgreement));
    }
    for (const PartPlace& place : places) {
      context.tell(fmt::format("{}: found at {}: {:.1f} % of its surface agrees", path,
                               in_words(place, target.grid(), target.frame()),
                               100 * place.agreement));
      all.push_back({part, place});
    }
  }
  return all;
}

}  // namespace

struct LeftAloneFiles::Impl {
  const SliceSource& target;
  std::deque<MeshInLayers> meshes;
  std::deque<StackReader> stacks;
  std::deque<FittedSlices> fitted;
  std::optional<OutsideParts> outside;
  std::optional<LeavingAlone> leaving;
};

LeftAloneFiles::LeftAloneFiles(const SliceSource& target, const std::vector<std::string>& files,
                               const MeshesLeftAlone& meshes, const Printer& printer,
                               const std::string& scratch_folder, const ExecutionContext& context,
                               const PartsInside& inside) {
  auto impl = std::make_unique<Impl>(Impl{target, {}, {}, {}, {}, {}});
  const Grid& grid = target.grid();
  std::vector<LeftAlone> all;
  for (const std::string& path : files) {
    const bool mesh = is_mesh_name(path);
    const SliceSource* slices = nullptr;
    if (mesh) {
      slices = &*impl->meshes.emplace_back(slices_of(path, target, meshes, printer, context));
    } else {
      check_design(StackReader::read_info(path), path);
      slices =
          &impl->stacks.emplace_back(path, scratch_folder, context,
                                     MissingFacts{grid.pixel_x_um, grid.pixel_y_um, grid.layer_um});
      check_same_heights(target, *slices, path);
    }
    impl->fitted.push_back(FittedSlices::like(target, *slices, scratch_folder, context));
    tell_apart(target, *impl->fitted.back(), path, context);
    all.push_back({&*impl->fitted.back(), path, mesh});
  }
  if (!inside.files.empty()) {
    if (!target.heights().alike()) {
      throw InputError(
          inside.files[0], "",
          "is not looked for in layers of different heights; expected layers of one height");
    }
    impl->outside.emplace(target, placed_parts(target, inside, context), context);
    const double mm3 = impl->outside->volume_mm3();
    context.tell(mm3 > 0 ? fmt::format("{:.4g} mm³ outside of {} are left alone", mm3,
                                       inside.files.size() == 1 ? "it" : "them")
                         : std::string("nothing is lit outside of the part"));
    if (mm3 > 0) all.push_back({&*impl->outside, "what lies outside of " + inside.files[0]});
  }
  if (!all.empty()) impl->leaving.emplace(target, std::move(all));
  impl_ = std::move(impl);
}

LeftAloneFiles::~LeftAloneFiles() = default;

const SliceSource& LeftAloneFiles::operator*() const {
  return impl_->leaving ? *impl_->leaving : impl_->target;
}

}  // namespace slicecorr
