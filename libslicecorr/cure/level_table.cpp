#include <algorithm>

#include "slicecorr/cure.hpp"

namespace slicecorr {

namespace {
// Fine enough that a linear curve of 256 levels has at most one level per bucket.
constexpr std::size_t kBuckets = 1024;
}  // namespace

LevelTable::LevelTable(std::vector<double> level_phi) : phi_(std::move(level_phi)) {
  first_of_plateau_.resize(phi_.size());
  for (std::size_t i = 1; i < phi_.size(); ++i) {
    first_of_plateau_[i] = phi_[i] == phi_[i - 1] ? first_of_plateau_[i - 1] : static_cast<int>(i);
  }
  const double range = phi_.back() - phi_.front();
  scale_ = range > 0 ? static_cast<double>(kBuckets) / range : 0.0;
  start_.assign(kBuckets + 2, static_cast<int>(phi_.size()));
  for (std::size_t i = phi_.size(); i-- > 0;) {
    // All levels before the first one of this bucket lie in lower buckets, so below any phi in it.
    start_[bucket(phi_[i])] = static_cast<int>(i);
  }
  for (std::size_t b = start_.size() - 1; b-- > 0;) start_[b] = std::min(start_[b], start_[b + 1]);
}

std::size_t LevelTable::bucket(double phi) const {
  const double x = (phi - phi_.front()) * scale_;
  if (!(x > 0)) return 0;
  return x >= static_cast<double>(kBuckets) ? kBuckets : static_cast<std::size_t>(x);
}

int LevelTable::at_least(double phi) const {
  const std::size_t b = bucket(phi);
  const auto begin = phi_.begin() + start_[b];
  const auto end = phi_.begin() + std::min(start_[b + 1] + 1, size());
  const auto it = std::lower_bound(begin, end, phi);
  const int level = static_cast<int>(it - phi_.begin());
  return first_of_plateau_[static_cast<std::size_t>(std::min(level, size() - 1))];
}

int LevelTable::at_most(double phi) const {
  const int level = at_least(phi);
  if (phi_[static_cast<std::size_t>(level)] <= phi || level == 0) return level;
  return first_of_plateau_[static_cast<std::size_t>(level - 1)];
}

}  // namespace slicecorr
