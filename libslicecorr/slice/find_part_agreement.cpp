// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Whether a part is at a place: its surface, face of a voxel by face.

#include <array>

#include "base/coded_band.hpp"
#include "parallel/silent.hpp"
#include "slice/find_part_parts.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail::find {

namespace {

/// Agreement is measured on bands of so many rows, all of them where they have no more voxels.
constexpr int kJudgedRows = 8;
constexpr double kMostJudged = 3e8;
constexpr std::uint8_t kLit = 128;

/// Slices of one band, as 1 where at least half of a pixel is lit.
class LitBand {
 public:
  explicit LitBand(std::size_t columns) : coded_(columns), row_(columns) {}
  void append(const std::uint8_t* rows) {
    if (rows) {
      for (std::size_t i = 0; i < row_.size(); ++i) row_[i] = rows[i] >= kLit;
    }
    coded_.append(rows ? row_.data() : nullptr);
  }
  void read(int slice, std::vector<std::uint8_t>& out) const { coded_.read(slice, out.data()); }

 private:
  detail::CodedBand coded_;
  std::vector<std::uint8_t> row_;
};

struct Faces {
  std::uint64_t all = 0, agree = 0;
};

/// Whether light ends in the archive at a face of the part or at most one voxel before or behind it, along
/// `a`: two voxels before the face, two behind.
bool agrees(const std::array<std::uint8_t, 4>& a, bool lit_first) {
  const std::uint8_t lit = lit_first ? 1 : 0, dark = lit_first ? 0 : 1;
  return (a[0] == lit && a[1] == dark) || (a[1] == lit && a[2] == dark) ||
         (a[2] == lit && a[3] == dark);
}

}  // namespace

double agreement_of(const Voxels& archive, const Voxels& part, const Candidate& at,
                    const ExecutionContext& context) {
  // Faces lie between a voxel and the next: the first are before the part.
  const int width = part.valid.width(), height = part.valid.height();
  const auto bands = size_of(ceil_div(height + 1, kJudgedRows));
  const double of_band =
      static_cast<double>(width) * kJudgedRows * static_cast<double>(part.slices);
  const std::size_t step = std::max<std::size_t>(
      1, static_cast<std::size_t>(of_band * static_cast<double>(bands) / kMostJudged));
  std::vector<Faces> of_bands(bands);
  parallel_for(detail::silent(context), "", (bands + step - 1) / step, [&](std::size_t chosen) {
    Faces& faces = of_bands[chosen * step];
    // In the part's own columns and rows, with two more on all sides.
    const int y0 = static_cast<int>(chosen * step) * kJudgedRows - 1,
              y1 = std::min(height, y0 + kJudgedRows);
    const PixelBox box{-2, y0 - 1, width + 2, y1 + 2};
    const auto wide = size_of(box.width());
    const std::size_t columns = wide * size_of(box.height());
    const auto collect = [&](const Voxels& of, int left, int top, int first, LitBand& band) {
      PixelBox there{box.x0 + left, box.y0 + top, box.x1 + left, box.y1 + top};
      const PixelBox inside = common_box(there, of.valid);
      std::vector<std::uint8_t> padded(columns);
      int next = 0;
      if (!inside.empty()) {
        of.read(inside, [&](int n, const std::uint8_t* rows) {
          for (; next < n - first; ++next) band.append(nullptr);
          if (n < first) return;
          ++next;
          if (!rows) return band.append(nullptr);
          for (int y = inside.y0; y < inside.y1; ++y) {
            std::copy_n(
                rows + size_of(y - inside.y0) * size_of(inside.width()), size_of(inside.width()),
                padded.data() + size_of(y - there.y0) * wide + size_of(inside.x0 - there.x0));
          }
          band.append(padded.data());
        });
      }
    };
    LitBand lit(columns), shown(columns);
    collect(part, 0, 0, 0, lit);
    collect(archive, at.x, at.y, at.z - 2, shown);
    std::vector<std::uint8_t> p(columns), next_p(columns);
    std::array<std::vector<std::uint8_t>, 4> a;
    for (auto& slice : a) slice.resize(columns);
    // Slices m - 1 to m + 2 of the archive, as the part counts them.
    for (int m = -1; m <= part.slices; ++m) {
      if (m == -1) {
        for (int k = 0; k < 4; ++k) shown.read(k, a[size_of(k)]);
      } else {
        std::rotate(a.begin(), a.begin() + 1, a.end());
        shown.read(m + 4, a[3]);
      }
      std::swap(p, next_p);
      lit.read(m + 1, next_p);
      // What stands on the platform has no face there.
      const bool at_platform = m + at.z < 0;
      for (int y = 1; y + 2 < box.height(); ++y) {
        const std::size_t row = size_of(y) * wide;
        for (std::size_t x = 1; x + 2 < wide; ++x) {
          const std::size_t i = row + x;
          if (p[i] != p[i + 1]) {
            ++faces.all;
            faces.agree += agrees({a[1][i - 1], a[1][i], a[1][i + 1], a[1][i + 2]}, p[i] != 0);
          }
          if (p[i] != p[i + wide]) {
            ++faces.all;
            faces.agree +=
                agrees({a[1][i - wide], a[1][i], a[1][i + wide], a[1][i + 2 * wide]}, p[i] != 0);
          }
          if (p[i] != next_p[i] && !at_platform) {
            ++faces.all;
            faces.agree += agrees({a[0][i], a[1][i], a[2][i], a[3][i]}, p[i] != 0);
          }
        }
      }
    }
  });
  Faces sum;
  for (const Faces& f : of_bands) {
    sum.all += f.all;
    sum.agree += f.agree;
  }
  return sum.all ? static_cast<double>(sum.agree) / static_cast<double>(sum.all) : 0.0;
}

}  // namespace slicecorr::detail::find
