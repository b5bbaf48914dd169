// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What tomographic handles hold.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "c_api/arrays.hpp"
#include "c_api/handles.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::c_api {

/// Memory for blocks of volumes and light, one pair for each thread that works at once; kept from one
/// call to the next, because fresh memory costs as much as it takes to fill it.
class BlockMemory {
 public:
  struct Pair {
    tomo::Array<float> field, light;
  };
  /// A pair for as long as this lives.
  class Lease {
   public:
    Lease(BlockMemory& home, const tomo::TomoGrid& grid);
    ~Lease();
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    float* field() { return pair_->field.data(); }
    float* light() { return pair_->light.data(); }

   private:
    BlockMemory& home_;
    std::unique_ptr<Pair> pair_;
  };

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Pair>> free_;
};

}  // namespace slicecorr::c_api

struct slicecorr_tomo_bench {
  slicecorr::tomo::TomoGrid grid;
  slicecorr::tomo::RayTables rays;
  std::optional<slicecorr::tomo::Bench> printed;  ///< nothing: made of plain numbers
  std::shared_ptr<const slicecorr::tomo::Projector> projector;
  mutable slicecorr::c_api::BlockMemory memory;
};

struct slicecorr_tomo_job {
  slicecorr::tomo::TomoJob job;
  slicecorr::tomo::Bench bench;
};

namespace slicecorr::c_api {

using tomo::TomoGrid;

inline constexpr const char* kVolumeAxes = "slices, voxels along y, voxels along x";
inline constexpr const char* kLightAxes = "rows, angles, pixels";
ArrayView::Shape volume_shape(const TomoGrid& grid);
ArrayView::Shape light_shape(const TomoGrid& grid);
/// Writes numbers of a bench's light, block by block.
void write_light(const tomo::Light& light, const ArrayView& to);

/// What properties of benches, and of jobs on them, are made of.
struct BenchFacts {
  const TomoGrid& grid;
  double alpha_per_mm = 0;
  const tomo::Bench* printed = nullptr;  ///< null: plain numbers
};
/// Nothing for an unknown name.
std::optional<double> bench_number(const BenchFacts& facts, std::string_view name);

/// Coverage of an array of bytes that has the grid's shape.
tomo::Volume volume_of(const TomoGrid& grid, const ArrayView& bytes);

/// The voxels that a setup names. Throws `InputError` when it does not.
double voxel_mm_of(const slicecorr_setup& setup);

}  // namespace slicecorr::c_api
