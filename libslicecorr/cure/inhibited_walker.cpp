#include <algorithm>
#include <cmath>
#include <cstring>

#include "cure/walkers.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

namespace {

/// The sum over the nearest slices from the kernel's tables, with the rest recursed. Most pixels
/// have shown one level for long: running sums of the tables stand for those slices.
class InhibitedWalker final : public BandDose::Walker {
 public:
  InhibitedWalker(const CureModel& model, std::size_t columns)
      : model_(model),
        kernel_(*model.inhibited),
        near_(static_cast<std::size_t>(kernel_.near())),
        stride_(static_cast<std::size_t>(kernel_.levels()) + 1),
        columns_(columns),
        ring_(near_, std::vector<std::uint16_t>(columns, off())),
        slots_(near_),
        same_(columns, 0) {
    lower.assign(columns, 0.0);
    middle.assign(columns, 0.0);
    upper.assign(columns, 0.0);
    for (auto& tail : tail_) tail.assign(columns, 0.0);
    for (int v = 0; v < 256; ++v) {
      level_of_[v] = static_cast<std::uint16_t>((v * (kernel_.levels() - 1) + 127) / 255);
    }
    table_.resize(static_cast<std::size_t>(kernel_.settings() * InhibitedKernel::places));
    sums_.resize(table_.size());
  }

  void add_slice(int slice, const std::uint8_t* pixels) override {
    const Slot slot{kernel_.setting_of_slice(slice), model_.ratio(slice)};
    prepare(slot.setting);
    // The slot that comes free holds the slice that leaves the tables' reach.
    newest_ = newest_ == 0 ? near_ - 1 : newest_ - 1;
    std::vector<std::uint16_t>& row = ring_[newest_];
    const Slot leaving = slots_[newest_];
    const bool jump = any_ && (slot.setting != slots_[(newest_ + 1) % near_].setting ||
                               slot.ratio != slots_[(newest_ + 1) % near_].ratio);
    const std::vector<std::uint16_t>& before = ring_[(newest_ + 1) % near_];
    const double a = kernel_.a();
    for (std::size_t i = 0; i < columns_; ++i) {
      for (const Kept& kept : kKept) {
        double& tail = tail_[kept.index][i];
        double gone = 0;
        if (row[i] != off()) {
          gone = leaving.ratio * table(leaving.setting, kept.place)[(near_ - 1) * stride_ + row[i]];
        }
        tail = a * (tail + gone);
      }
      const std::uint16_t level = pixels ? level_of_[pixels[i]] : off();
      const bool same = !jump && any_ && level == before[i];
      same_[i] = same ? static_cast<std::uint16_t>(std::min<std::size_t>(same_[i] + 1U, near_))
                      : std::uint16_t{1};
      row[i] = level;
    }
    slots_[newest_] = slot;
    any_ = true;

    if (model_.mode == ExposureMode::continuous) {
      lower.swap(upper);
    } else {
      gather(InhibitedKernel::lower_end, tail_[0].data(), lower.data());
    }
    gather(InhibitedKernel::middle, tail_[1].data(), middle.data());
    gather(InhibitedKernel::upper_end, tail_[2].data(), upper.data());
  }

  double crossing(std::size_t i) const override {
    // The quartic through the five tabulated places.
    double y[InhibitedKernel::places];
    y[0] = lower[i];
    y[2] = middle[i];
    y[4] = upper[i];
    const double r = std::sqrt(std::sqrt(kernel_.a()));
    y[1] = sum_of(InhibitedKernel::quarter, i) + tail_[1][i] / r;
    y[3] = sum_of(InhibitedKernel::three_quarters, i) + tail_[1][i] * r;
    const auto at = [&](double t) {
      double sum = 0;
      for (int p = 0; p < 5; ++p) {
        double weight = y[p];
        for (int q = 0; q < 5; ++q) {
          if (q != p) weight *= (4.0 * t - q) / (p - q);
        }
        sum += weight;
      }
      return sum;
    };
    double low = 0, high = 1;
    const bool rises = y[4] >= 1.0;
    // To 2^-40 of a slice.
    for (int step = 0; step < 40; ++step) {
      const double half = 0.5 * (low + high);
      ((at(half) >= 1.0) == rises ? high : low) = half;
    }
    return 0.5 * (low + high);
  }

 private:
  struct Slot {
    int setting = 0;
    double ratio = 1;
  };
  /// Places whose doses are kept for every layer, with their tails.
  struct Kept {
    int index;
    InhibitedKernel::Place place;
  };
  static constexpr Kept kKept[3] = {{0, InhibitedKernel::lower_end},
                                    {1, InhibitedKernel::middle},
                                    {2, InhibitedKernel::upper_end}};

  std::uint16_t off() const { return static_cast<std::uint16_t>(stride_ - 1); }

  /// Tables with a level more, for light off, and their running sums.
  void prepare(int setting) {
    if (!table_[index(setting, InhibitedKernel::upper_end)].empty()) return;
    for (int place = 0; place < InhibitedKernel::places; ++place) {
      const double* from = kernel_.table(setting, static_cast<InhibitedKernel::Place>(place));
      std::vector<double>& table = table_[index(setting, place)];
      std::vector<double>& sums = sums_[index(setting, place)];
      table.assign(near_ * stride_, 0.0);
      sums.assign((near_ + 1) * stride_, 0.0);
      for (std::size_t j = 0; j < near_; ++j) {
        for (std::size_t l = 0; l + 1 < stride_; ++l) {
          table[j * stride_ + l] = from[j * (stride_ - 1) + l];
          sums[(j + 1) * stride_ + l] = sums[j * stride_ + l] + table[j * stride_ + l];
        }
      }
    }
  }
  std::size_t index(int setting, int place) const {
    return static_cast<std::size_t>(setting * InhibitedKernel::places + place);
  }
  const double* table(int setting, int place) const { return table_[index(setting, place)].data(); }

  double sum_of(int place, std::size_t i) const {
    const std::size_t same = same_[i];
    const Slot& now = slots_[newest_];
    double sum = now.ratio * sums_[index(now.setting, place)][same * stride_ + ring_[newest_][i]];
    for (std::size_t j = same; j < near_; ++j) {
      const std::size_t at = (newest_ + j) % near_;
      const Slot& slot = slots_[at];
      if (ring_[at][i] == off()) continue;
      sum += slot.ratio * table(slot.setting, place)[j * stride_ + ring_[at][i]];
    }
    return sum;
  }
  void gather(int place, const double* tail, double* out) const {
    for (std::size_t i = 0; i < columns_; ++i) out[i] = sum_of(place, i) + tail[i];
  }

  const CureModel& model_;
  const InhibitedKernel& kernel_;
  std::size_t near_, stride_, columns_;
  std::vector<std::vector<std::uint16_t>> ring_;  ///< levels of the last `near_` slices
  std::vector<Slot> slots_;
  std::size_t newest_ = 0;
  bool any_ = false;
  std::vector<std::uint16_t> same_;  ///< slices for which a column has shown its level
  std::vector<double> tail_[3];
  std::vector<std::vector<double>> table_, sums_;
  std::uint16_t level_of_[256];
};

}  // namespace

std::unique_ptr<BandDose::Walker> make_inhibited_walker(const CureModel& model,
                                                        std::size_t columns) {
  return std::make_unique<InhibitedWalker>(model, columns);
}

}  // namespace slicecorr::detail
