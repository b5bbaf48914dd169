// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "scan/volume.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>

#include "base/image_module.hpp"
#include "slicecorr/error.hpp"
#include "support/numpy/npy_input.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {

namespace {

namespace fs = std::filesystem;

constexpr int kMostAlongSide = 65536;
constexpr std::size_t kMostVoxels = std::size_t{1} << 36;
constexpr std::size_t kBins = 1024;

/// Slices one after the other.
class Volume {
 public:
  virtual ~Volume() = default;
  virtual int slices() const = 0;
  /// The next slice; all have the same size.
  virtual void next(GreyImageValues& slice) = 0;
};

class NpyVolume final : public Volume {
 public:
  explicit NpyVolume(const std::string& path)
      : in_(path), size_(in_.size({static_cast<std::size_t>(kMostAlongSide), kMostVoxels})) {}
  int slices() const override { return size_[0]; }
  void next(GreyImageValues& slice) override {
    slice.height_px = size_[1];
    slice.width_px = size_[2];
    slice.values.resize(static_cast<std::size_t>(size_[1]) * static_cast<std::size_t>(size_[2]));
    const std::string& type = in_.header().type;
    if (type == "<f4") {
      in_.numbers(slice.values.data(), slice.values.size());
    } else if (type == "<f8") {
      take<double>(slice);
    } else if (type == "<u2") {
      take<std::uint16_t>(slice);
    } else if (type == "<i2") {
      take<std::int16_t>(slice);
    } else if (type == "|u1" || type == "|b1") {
      take<std::uint8_t>(slice);
    } else {
      in_.wrong(fmt::format("holds '{}'; expected '|u1', '<u2', '<i2', '<f4' or '<f8'", type));
    }
    if (++read_ == size_[0]) in_.finish();
  }

 private:
  template <class T>
  void take(GreyImageValues& slice) {
    std::vector<T> numbers(slice.values.size());
    in_.numbers(numbers.data(), numbers.size());
    std::transform(numbers.begin(), numbers.end(), slice.values.begin(),
                   [](T n) { return static_cast<float>(n); });
  }
  NpyInput in_;
  std::array<int, 3> size_;
  int read_ = 0;
};

class TiffVolume final : public Volume {
 public:
  explicit TiffVolume(const std::string& folder) {
    std::size_t others = 0;
    for (const auto& entry : fs::directory_iterator(folder)) {
      const std::string ending = lower_case(entry.path().extension().string());
      if (ending == ".tif" || ending == ".tiff") {
        files_.push_back(entry.path().string());
      } else {
        ++others;
      }
    }
    if (files_.size() < 2) {
      throw InputError(
          folder, "",
          fmt::format("has {} TIFF files (.tif, .tiff) and {} others; expected the slices "
                      "of a volume",
                      files_.size(), others));
    }
    std::sort(files_.begin(), files_.end());
  }
  int slices() const override { return static_cast<int>(files_.size()); }
  void next(GreyImageValues& slice) override {
    const std::string& path = files_[at_];
    const std::string fault = image_functions().read_tiff(path, kMostAlongSide, slice);
    if (!fault.empty()) throw InputError(path, "", fault);
    if (at_++ == 0) {
      width_ = slice.width_px;
      height_ = slice.height_px;
    }
    if (slice.width_px != width_ || slice.height_px != height_) {
      throw InputError(
          path, "",
          fmt::format("has {} x {} pixels, the slices before {} x {}; expected slices of "
                      "one size",
                      slice.width_px, slice.height_px, width_, height_));
    }
  }

 private:
  std::vector<std::string> files_;
  std::size_t at_ = 0;
  int width_ = 0, height_ = 0;
};

std::unique_ptr<Volume> open_volume(const std::string& path) {
  if (fs::is_directory(path)) return std::make_unique<TiffVolume>(path);
  return std::make_unique<NpyVolume>(path);
}

/// Calls `visit` with each slice.
template <class Visit>
void over_slices(const std::string& path, const ExecutionContext& context, const Visit& visit) {
  const std::unique_ptr<Volume> volume = open_volume(path);
  GreyImageValues slice;
  for (int z = 0; z < volume->slices(); ++z) {
    context.check_cancelled();
    volume->next(slice);
    if (!std::all_of(slice.values.begin(), slice.values.end(),
                     [](float v) { return std::isfinite(v); })) {
      throw InputError(path, fmt::format("slice {}", z), "has a value that is not finite");
    }
    visit(z, slice);
  }
}

/// Points of which every second one goes where there are too many.
class ThinnedPoints {
 public:
  explicit ThinnedPoints(std::size_t most) : most_(most) {}
  void add(const Point3& p) {
    if (seen_++ % every_ != 0) return;
    points_.push_back(p);
    if (points_.size() < 2 * most_) return;
    for (std::size_t i = 0; i < most_; ++i) points_[i] = points_[2 * i];
    points_.resize(most_);
    every_ *= 2;
  }
  std::size_t seen() const { return seen_; }
  std::size_t every() const { return every_; }
  std::vector<Point3> take() { return std::move(points_); }

 private:
  std::size_t most_, seen_ = 0, every_ = 1;
  std::vector<Point3> points_;
};

/// The threshold of a volume.
double threshold_of(const std::string& path, std::vector<std::string>& notes,
                    const ExecutionContext& context) {
  float low = std::numeric_limits<float>::infinity(), high = -low;
  over_slices(path, context, [&](int, const GreyImageValues& slice) {
    const auto [least, greatest] = std::minmax_element(slice.values.begin(), slice.values.end());
    low = std::min(low, *least);
    high = std::max(high, *greatest);
  });
  if (!(high > low)) {
    throw InputError(path, "",
                     "has one value everywhere; expected a part brighter than what is around it");
  }
  const auto least = static_cast<double>(low);
  const double width = (static_cast<double>(high) - least) / static_cast<double>(kBins);
  std::vector<double> counts(kBins);
  over_slices(path, context, [&](int, const GreyImageValues& slice) {
    for (const float v : slice.values) {
      const auto bin = static_cast<std::size_t>((static_cast<double>(v) - least) / width);
      ++counts[std::min(kBins - 1, bin)];
    }
  });
  const std::size_t parts = otsu(counts);
  // Half way between what is empty and what is part, as both mostly are.
  const auto median = [&](std::size_t first, std::size_t last) {
    double half = 0;
    for (std::size_t i = first; i < last; ++i) half += 0.5 * counts[i];
    for (std::size_t i = first; i < last; ++i) {
      half -= counts[i];
      if (half <= 0) return least + width * (static_cast<double>(i) + 0.5);
    }
    return least + width * static_cast<double>(last);
  };
  const double empty = median(0, parts), full = median(parts, kBins);
  const double threshold = 0.5 * (empty + full);
  notes.push_back(fmt::format(
      "values from {:.6g} to {:.6g}, threshold {:.6g}: half way between {:.6g} and {:.6g}, the "
      "medians of what Otsu's method parts",
      low, high, threshold, empty, full));
  return threshold;
}

}  // namespace

bool is_volume(const std::string& path) {
  return fs::is_directory(path) || lower_case(fs::path(path).extension().string()) == ".npy";
}

std::size_t otsu(const std::vector<double>& counts) {
  double all = 0, moment = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    all += counts[i];
    moment += counts[i] * static_cast<double>(i);
  }
  double below = 0, below_moment = 0, best = -1;
  std::size_t first = 1, last = 1;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    below += counts[i];
    below_moment += counts[i] * static_cast<double>(i);
    if (below == 0 || below == all) continue;
    const double apart = below_moment / below - (moment - below_moment) / (all - below);
    const double between = below * (all - below) * apart * apart;
    if (between > best * (1 + 1e-12)) {
      best = between;
      first = i + 1;
    }
    // Empty bins between both sides: the middle of them.
    if (between >= best * (1 - 1e-12)) last = i + 1;
  }
  return (first + last) / 2;
}

std::vector<Point3> points_of_volume(const std::string& path, std::size_t most,
                                     std::vector<std::string>& notes,
                                     const ExecutionContext& context) {
  const double threshold = threshold_of(path, notes, context);
  ThinnedPoints points(most);
  std::vector<float> before;
  over_slices(path, context, [&](int z, const GreyImageValues& slice) {
    const auto wide = static_cast<std::size_t>(slice.width_px);
    for (std::size_t i = 0; i < slice.values.size(); ++i) {
      const std::size_t x = i % wide, y = i / wide;
      const Point3 here{static_cast<double>(x), -static_cast<double>(y), static_cast<double>(z)};
      const auto value = static_cast<double>(slice.values[i]);
      // Between this voxel and its neighbour `way` along an axis.
      const auto pass = [&](float neighbour, std::size_t axis, double way) {
        const auto other = static_cast<double>(neighbour);
        if ((value >= threshold) == (other >= threshold)) return;
        Point3 p = here;
        p[axis] += way * (threshold - value) / (other - value);
        points.add(p);
      };
      if (x + 1 < wide) pass(slice.values[i + 1], 0, 1);
      if (i + wide < slice.values.size()) pass(slice.values[i + wide], 1, -1);
      if (z > 0) pass(before[i], 2, -1);
    }
    before = slice.values;
  });
  if (points.every() > 1) {
    notes.push_back(fmt::format("{} places of the surface, of which one in {} is taken",
                                points.seen(), points.every()));
  }
  if (points.seen() < 100) {
    throw InputError(path, "", "has less than 100 places of a surface; expected a scan of a part");
  }
  return points.take();
}

}  // namespace slicecorr::detail
