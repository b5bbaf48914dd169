// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/job.hpp
/// A tomographic print as a file: the frames of a turn, what they are shown by, and the part.
///
/// A zip with `config.json`, `frame/00000000.png` and so on, an 8-bit grey image of the projector's
/// size per frame, and `part/00000000.png` and so on, a voxel to a pixel, the lowest slice first;
/// with an insert also `insert/00000000.png` and so on, opaque where above 0. Where doses are wanted,
/// `wanted/least.f32`, `wanted/most.f32` and, with weights, `wanted/weight.f32`: numbers of 32 bits, the
/// least byte first, voxel by voxel, x fastest; their CRC-32 stands in `config.json`.
/// Frames are shown in order, each for 1/angles of a turn, while the vial turns as `direction` says.
/// `config.json` has the CRC-32 of all images, `images_crc32`, and of all that it says itself,
/// `block_crc32` as in stacks. The same job gives the same bytes.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/solve.hpp"
#include "slicecorr/tomo/wanted.hpp"

namespace slicecorr {
struct GreyImage;
}
namespace slicecorr::detail {
class Container;
}

namespace slicecorr::tomo {

/// Newest version of `config.json` that this program reads.
inline constexpr int kJobFormat = 1;

/// Where in voxels doses are told: their means, or in their middles.
enum class JudgedAt { means, centres };

struct TomoJob {
  Printer printer;
  Resin resin;
  Sampling sampling;
  int turns = 1;
  /// Coverage of voxels: 255 part, 0 empty, between: neither. Slices of the grid of `make_bench`.
  Box<std::uint8_t> part;
  /// What turns with the part and lets no light through: > 0 opaque, on the part's grid; empty: none.
  Box<std::uint8_t> insert;
  /// Grey levels, laid out as the light of the grid of `make_bench`; 0 in lanes without a slice.
  std::vector<std::uint16_t> levels;
  /// How the solve went, and the bound of contrast that it proved (infinite: none): for pages, no
  /// part of the print. Files that others made have neither.
  std::vector<Step> history;
  /// Whether the file that it was read from has checksums of what it says and shows, which then were
  /// right.
  bool has_checksums = false;
  double contrast_bound = std::numeric_limits<double>::infinity();
  /// Doses that are wanted in place of a part, of which `part` then says what gels; or none.
  DoseBands wanted;
};

/// Frame `frame` of a turn, in the order in which they are shown, as the projector shows it: grey
/// values of its size. `bench` is the job's `make_bench`.
GreyImage frame_image(const TomoJob& job, const Bench& bench, int frame);

/// Written under a temporary name, then renamed. Throws `DeviceError`, and `InputError` as
/// `make_bench`.
void write_job(const std::string& path, const TomoJob& job, const ExecutionContext& context = {});
/// Throws `InputError` naming entry and key for what is missing, damaged, of another size or number
/// than `config.json` says, or of a newer format; for a `config.json` that contradicts itself; and
/// where it, or an image, is another than its checksum says. Without checksums: a notice. What
/// frames show beside the resin is not kept.
TomoJob read_job(const std::string& path, const ExecutionContext& context = {});

/// The frames of a job as its file has them, read one at a time: for machines that show them.
class TomoFrames {
 public:
  /// `job`: of `read_job` of the same path. Throws as `read_job`.
  TomoFrames(const std::string& path, const TomoJob& job, const ExecutionContext& context = {});
  ~TomoFrames();
  int angles() const { return angles_; }
  /// As seen from the projector; `frame` 0..angles() - 1, in the order in which they are shown.
  /// Thread-safe. Throws `InputError` for images that are damaged or of another size.
  GreyImage read(int frame) const;

 private:
  std::unique_ptr<const slicecorr::detail::Container> archive_;
  int angles_, width_px_, height_px_;
};

}  // namespace slicecorr::tomo
