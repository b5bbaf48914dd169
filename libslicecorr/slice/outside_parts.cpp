// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/find_part.hpp"

namespace slicecorr {

namespace {

/// Grows what is not 0 by one pixel: from rows of `width` + 2 columns, one more at the top and bottom, to
/// 1 where something is near.
class GrownRows {
 public:
  GrownRows(int width, int height)
      : width_(static_cast<std::size_t>(width)),
        height_(static_cast<std::size_t>(height)),
        across_((width_ + 2) * (height_ + 2)),
        out_(width_ * height_) {}
  std::size_t padded() const { return across_.size(); }

  const std::vector<std::uint8_t>& grow(const std::vector<std::uint8_t>& lit) {
    const std::size_t wide = width_ + 2;
    for (std::size_t y = 0; y < height_ + 2; ++y) {
      const std::uint8_t* from = lit.data() + y * wide;
      std::uint8_t* to = across_.data() + y * wide;
      for (std::size_t x = 0; x < width_; ++x) {
        to[x] = static_cast<std::uint8_t>(from[x] | from[x + 1] | from[x + 2]);
      }
    }
    for (std::size_t y = 0; y < height_; ++y) {
      const std::uint8_t* from = across_.data() + y * wide;
      std::uint8_t* to = out_.data() + y * width_;
      for (std::size_t x = 0; x < width_; ++x) {
        to[x] = static_cast<std::uint8_t>(from[x] | from[x + wide] | from[x + 2 * wide]);
      }
    }
    return out_;
  }

 private:
  std::size_t width_, height_;
  std::vector<std::uint8_t> across_, out_;
};

bool meets(const PixelBox& a, const PixelBox& b) {
  return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1;
}

}  // namespace

OutsideParts::OutsideParts(const SliceSource& archive, std::vector<Placed> parts,
                           const ExecutionContext& context)
    : archive_(archive), parts_(std::move(parts)), bounds_(archive.bounds()) {
  const int rows = band_rows(grid());
  const auto bands = static_cast<std::size_t>((bounds_.height() + rows - 1) / rows);
  std::mutex adding;
  std::uint64_t sum = 0;
  PixelBox lit;
  parallel_for(detail::silent(context), "", bands, [&](std::size_t k) {
    const int y0 = bounds_.y0 + static_cast<int>(k) * rows;
    const PixelBox band{bounds_.x0, y0, bounds_.x1, std::min(bounds_.y1, y0 + rows)};
    const auto width = static_cast<std::size_t>(band.width());
    const std::size_t columns = width * static_cast<std::size_t>(band.height());
    std::uint64_t own = 0;
    PixelBox box;
    read_band(band, [&](int, const std::uint8_t* pixels) {
      if (!pixels) return;
      for (std::size_t i = 0; i < columns; ++i) own += pixels[i];
      for (std::size_t y = 0; y * width < columns; ++y) {
        const std::uint8_t *first = pixels + y * width, *past = first + width;
        const auto is_lit = [](std::uint8_t v) { return v != 0; };
        const std::uint8_t* left = std::find_if(first, past, is_lit);
        if (left == past) continue;
        while (past[-1] == 0) --past;
        const int at = band.y0 + static_cast<int>(y);
        box = box.united({band.x0 + static_cast<int>(left - first), at,
                          band.x0 + static_cast<int>(past - first), at + 1});
      }
    });
    const std::lock_guard lock(adding);
    sum += own;
    lit = lit.united(box);
  });
  bounds_ = lit;
  const Grid& g = grid();
  volume_mm3_ = static_cast<double>(sum) / 255.0 * g.pixel_x_um * g.pixel_y_um * g.layer_um * 1e-9;
}

void OutsideParts::read_band(const PixelBox& band, const Sink& sink) const {
  const int width = band.width(), height = band.height();
  const auto columns = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  // One pixel more on all sides, and one slice, are looked at.
  const PixelBox wider{band.x0 - 1, band.y0 - 1, band.x1 + 1, band.y1 + 1};
  GrownRows grown(width, height);
  struct Near {
    int first_slice;
    detail::CodedBand coded;
  };
  std::vector<Near> near;
  for (const Placed& p : parts_) {
    if (!meets(p.place.box, wider)) continue;
    Near& n = near.emplace_back(Near{p.place.first_slice, detail::CodedBand(grown.padded())});
    p.part->read_band(p.place, wider, [&](int, const std::uint8_t* rows) { n.coded.append(rows); });
  }
  if (near.empty()) return archive_.read_band(band, sink);
  std::vector<std::uint8_t> lit(grown.padded()), one(grown.padded()), out(columns);
  archive_.read_band(band, [&](int n, const std::uint8_t* rows) {
    if (!rows) return sink(n, rows);
    bool any = false;
    for (const Near& part : near) {
      for (int k = n - part.first_slice - 1; k <= n - part.first_slice + 1; ++k) {
        if (part.coded.black(k)) continue;
        part.coded.read(k, any ? one.data() : lit.data());
        for (std::size_t i = 0; any && i < lit.size(); ++i) lit[i] |= one[i];
        any = true;
      }
    }
    if (!any) return sink(n, rows);
    const std::vector<std::uint8_t>& inside = grown.grow(lit);
    for (std::size_t i = 0; i < columns; ++i) {
      out[i] = inside[i] ? std::uint8_t{0} : rows[i];
    }
    sink(n, detail::all_zero(out.data(), columns) ? nullptr : out.data());
  });
}

}  // namespace slicecorr
