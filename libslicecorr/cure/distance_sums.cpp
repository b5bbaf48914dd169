// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/distance_sums.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "cure/shown_slices.hpp"

namespace slicecorr::detail {

namespace {

/// Distances of so few slices keep what they have spread.
constexpr int kKeptSlices = 6;

PixelBox shared(const PixelBox& a, const PixelBox& b) {
  PixelBox box{std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1),
               std::min(a.y1, b.y1)};
  return box.x0 < box.x1 && box.y0 < box.y1 ? box : PixelBox{a.x0, a.y0, a.x0, a.y0};
}

}  // namespace

DistanceSums::DistanceSums(const std::vector<DistanceBlur>& blurs, Scene scene)
    : scene_(std::move(scene)), left_(columns_of(scene_.window), 0.0) {
  for (std::size_t k = 1; k < blurs.size(); ++k) {
    const DistanceBlur& of = blurs[k];
    distances_.push_back({&of, {}, {}, {}, std::vector<double>(left_.size(), 0.0)});
    longest_ = std::max(longest_, static_cast<std::size_t>(of.to == kNoEnd ? of.from : of.to));
  }
}

void DistanceSums::add(std::vector<Lit> lit) {
  if (longest_ == 0) return;
  // Walls go straight down: images are often the same again.
  if (!shown_.empty() && shown_.front().size() == lit.size()) {
    for (std::size_t k = 0; k < lit.size(); ++k) {
      const Lit& before = shown_.front()[k];
      if (before.image && lit[k].image && *before.image == *lit[k].image) {
        lit[k].image = before.image;
      }
    }
  }
  shown_.push_front(std::move(lit));
  if (shown_.size() > longest_) shown_.pop_back();
}

const std::vector<double>& DistanceSums::next() {
  bool first = true;
  for (Distance& d : distances_) {
    for (double& v : d.sum) v *= scene_.a;
    come(d);
    if (d.of->to != kNoEnd) go(d);
    if (first) {
      left_ = d.sum;
    } else {
      for (std::size_t i = 0; i < left_.size(); ++i) left_[i] += d.sum[i];
    }
    first = false;
  }
  return left_;
}

/// What the slice that is so far away shows; null: it is dark.
const std::vector<DistanceSums::Lit>* DistanceSums::shown(int slices) const {
  const auto at = static_cast<std::size_t>(slices) - 1;
  return at < shown_.size() ? &shown_[at] : nullptr;
}

/// Adds the light of the slice that comes to be at a distance.
void DistanceSums::come(Distance& distance) {
  const DistanceBlur& of = *distance.of;
  const std::vector<Lit>* const lit = shown(of.from);
  if (!lit) return;
  const bool keeps = of.to != kNoEnd && of.to - of.from <= kKeptSlices;
  if (keeps) distance.kept.emplace_front();
  const double weight = scene_.gain * std::pow(scene_.a, of.from - 1);
  for (const Lit& l : *lit) {
    const Field light = spread(of, distance.come, l.image);
    const double its = weight * l.weight;
    for (std::size_t i = 0; i < light->size(); ++i) distance.sum[i] += its * (*light)[i];
    if (keeps) distance.kept.front().emplace_back(light, l.weight);
  }
}

/// Takes away that of the slice that is at a distance no more.
void DistanceSums::go(Distance& distance) {
  const DistanceBlur& of = *distance.of;
  const std::vector<Lit>* const lit = shown(of.to);
  if (!lit) return;
  const double weight = scene_.gain * std::pow(scene_.a, of.to - 1);
  const auto take = [&](const std::vector<double>& light, double its) {
    for (std::size_t i = 0; i < light.size(); ++i) distance.sum[i] -= its * light[i];
  };
  if (of.to - of.from <= kKeptSlices) {
    for (const auto& [light, its] : distance.kept.back()) take(*light, weight * its);
    distance.kept.pop_back();
    return;
  }
  for (const Lit& l : *lit) take(*spread(of, distance.gone, l.image), weight * l.weight);
}

/// What of the window is lit otherwise than `spread` has it.
PixelBox DistanceSums::changed(const Spread& spread, const Image* image) const {
  if (!spread.light) return scene_.window;
  const PixelBox& all = scene_.images;
  const auto width = static_cast<std::size_t>(all.width());
  PixelBox box{all.x1, all.y1, all.x0, all.y0};
  const auto pixel = [&](const Image* of, std::size_t at) { return of ? (*of)[at] : 0; };
  for (int y = all.y0; y < all.y1; ++y) {
    const std::size_t row = static_cast<std::size_t>(y - all.y0) * width;
    if (image && spread.image &&
        std::memcmp(image->data() + row, spread.image->data() + row, width) == 0) {
      continue;
    }
    std::size_t first = 0, past = width;
    while (first < past && pixel(image, row + first) == pixel(spread.image.get(), row + first)) {
      ++first;
    }
    if (first == past) continue;
    while (pixel(image, row + past - 1) == pixel(spread.image.get(), row + past - 1)) --past;
    box.x0 = std::min(box.x0, all.x0 + static_cast<int>(first));
    box.x1 = std::max(box.x1, all.x0 + static_cast<int>(past));
    box.y0 = std::min(box.y0, y);
    box.y1 = y + 1;
  }
  return box;
}

const DistanceSums::Field& DistanceSums::spread(const DistanceBlur& of, Spread& spread,
                                                const std::shared_ptr<const Image>& image) {
  if (spread.light && spread.image == image) return spread.light;
  const int x = of.blur.reach_x(), y = of.blur.reach_y();
  const auto grown = [&](const PixelBox& box) {
    return PixelBox{box.x0 - x, box.y0 - y, box.x1 + x, box.y1 + y};
  };
  PixelBox to = changed(spread, image.get());
  if (spread.light && to.x0 < to.x1) to = shared(scene_.window, grown(to));
  spread.image = image;
  if (to.x0 >= to.x1 || to.y0 >= to.y1) {
    if (!spread.light) spread.light = std::make_shared<const std::vector<double>>(left_.size());
    return spread.light;
  }
  // Others may still have what was spread before.
  auto light = spread.light ? std::make_shared<std::vector<double>>(*spread.light)
                            : std::make_shared<std::vector<double>>(left_.size());
  const PixelBox from = shared(scene_.display, grown(to));
  in_.resize(columns_of(from));
  out_.resize(columns_of(to));
  scene_.shine(image.get(), from, in_.data());
  of.blur.apply(in_.data(), from, out_.data(), to);
  if (scene_.m != 1) {
    // Light is the same over much of an image.
    double last = 0, raised = 0;
    for (double& v : out_) {
      if (v != last) {
        last = v;
        raised = std::pow(std::max(v, 0.0), scene_.m);
      }
      v = raised;
    }
  }
  for (int row = to.y0; row < to.y1; ++row) {
    const auto width = static_cast<std::ptrdiff_t>(to.width());
    std::copy_n(out_.begin() + (row - to.y0) * width, width,
                light->begin() +
                    static_cast<std::ptrdiff_t>(row - scene_.window.y0) * scene_.window.width() +
                    (to.x0 - scene_.window.x0));
  }
  spread.light = std::move(light);
  return spread.light;
}

}  // namespace slicecorr::detail
