// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "c_api/slice_store.hpp"

#include <algorithm>
#include <cstring>
#include <new>
#include <stdexcept>
#include <vector>

#include "base/coded_band.hpp"
#include "base/run_length.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr::c_api {

namespace {

constexpr std::size_t kMemoryBudget = std::size_t{256} << 20;

/// A blob begins with its columns [x0, x1) and rows [y0, y1) in the image; their code follows.
struct Head {
  std::int32_t x0, y0, x1, y1;
};

/// The smallest box around what is lit of `box`.
PixelBox lit_box(const PixelBox& box, const std::uint8_t* pixels, std::ptrdiff_t stride) {
  PixelBox lit{box.x1, box.y1, box.x0, box.y0};
  const auto dark = [](std::uint8_t v) { return v == 0; };
  for (int y = box.y0; y < box.y1; ++y, pixels += stride) {
    if (detail::all_zero(pixels, static_cast<std::size_t>(box.width()))) continue;
    const std::uint8_t* const end = pixels + box.width();
    const std::uint8_t* const first = std::find_if_not(pixels, end, dark);
    const std::uint8_t* last = end;
    while (last[-1] == 0) --last;
    lit.x0 = std::min(lit.x0, box.x0 + static_cast<int>(first - pixels));
    lit.x1 = std::max(lit.x1, box.x0 + static_cast<int>(last - pixels));
    lit.y0 = std::min(lit.y0, y);
    lit.y1 = y + 1;
  }
  return lit.empty() ? PixelBox{} : lit;
}

std::size_t size_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}

}  // namespace

struct SliceStore::Scratch {
  std::vector<std::uint8_t> code, pixels;
};

SliceStore::SliceStore(const Grid& grid, const std::string& scratch_folder,
                       const ExecutionContext& context)
    : grid_(grid),
      rows_(band_rows(grid)),
      store_(scratch_folder, kMemoryBudget, context),
      index_(nullptr, &std::free) {
  const int bands = (grid.height_px + rows_ - 1) / rows_;
  void* const memory =
      std::calloc(static_cast<std::size_t>(bands) * static_cast<std::size_t>(grid.layers),
                  sizeof(BlobStore::Blob));
  if (!memory) throw std::bad_alloc();
  index_.reset(static_cast<BlobStore::Blob*>(memory));
}

PixelBox SliceStore::bounds() const {
  const std::scoped_lock lock(mutex_);
  return bounds_;
}

BlobStore::Blob& SliceStore::blob(int band, int slice) const {
  return index_[static_cast<std::size_t>(band) * static_cast<std::size_t>(grid_.layers) +
                static_cast<std::size_t>(slice)];
}

void SliceStore::put_rows(int slice, const PixelBox& box, const std::uint8_t* pixels,
                          std::ptrdiff_t stride) {
  BlobStore::Blob& at = blob(box.y0 / rows_, slice);
  at = {};
  const PixelBox lit = pixels ? lit_box(box, pixels, stride) : PixelBox{};
  if (lit.empty()) return;
  std::vector<std::uint8_t> inside(size_of(lit)), code(sizeof(Head));
  const auto width = static_cast<std::size_t>(lit.width());
  for (int y = lit.y0; y < lit.y1; ++y) {
    std::memcpy(inside.data() + static_cast<std::size_t>(y - lit.y0) * width,
                pixels + (y - box.y0) * stride + (lit.x0 - box.x0), width);
  }
  const Head head{lit.x0, lit.y0, lit.x1, lit.y1};
  std::memcpy(code.data(), &head, sizeof head);
  detail::run_length_encode(inside.data(), inside.size(), code);
  at = store_.put(code.data(), code.size());
  const std::scoped_lock lock(mutex_);
  bounds_ = bounds_.united(lit);
}

void SliceStore::put_band(int slice, const PixelBox& box, const std::uint8_t* rows) {
  if (box.y0 < 0 || box.y1 > grid_.height_px || box.x0 < 0 || box.x1 > grid_.width_px ||
      box.empty() || box.y0 / rows_ != (box.y1 - 1) / rows_) {
    throw std::out_of_range("rows of more than one band");
  }
  put_rows(slice, box, rows, box.width());
}

void SliceStore::put(int slice, const std::uint8_t* pixels, std::ptrdiff_t stride) {
  for (int y = 0; y < grid_.height_px; y += rows_) {
    put_rows(slice, {0, y, grid_.width_px, std::min(y + rows_, grid_.height_px)},
             pixels + y * stride, stride);
  }
}

void SliceStore::copy(const BlobStore::Blob& from, int band, const PixelBox& box, Scratch& scratch,
                      std::uint8_t* out, std::ptrdiff_t stride) const {
  const int band_end = std::min((band + 1) * rows_, grid_.height_px);
  const PixelBox part{box.x0, std::max(box.y0, band * rows_), box.x1, std::min(box.y1, band_end)};
  for (int y = part.y0; y < part.y1; ++y) {
    std::memset(out + (y - box.y0) * stride, 0, static_cast<std::size_t>(box.width()));
  }
  if (from.size == 0) return;
  scratch.code.clear();
  store_.get(from, scratch.code);
  Head head;
  std::memcpy(&head, scratch.code.data(), sizeof head);
  const PixelBox lit{head.x0, head.y0, head.x1, head.y1};
  scratch.pixels.resize(size_of(lit));
  detail::run_length_decode(scratch.code.data() + sizeof head,
                            scratch.code.data() + scratch.code.size(), scratch.pixels.data(),
                            scratch.pixels.size());
  const int x0 = std::max(lit.x0, box.x0), x1 = std::min(lit.x1, box.x1);
  if (x0 >= x1) return;
  for (int y = std::max(lit.y0, part.y0); y < std::min(lit.y1, part.y1); ++y) {
    std::memcpy(out + (y - box.y0) * stride + (x0 - box.x0),
                scratch.pixels.data() +
                    static_cast<std::size_t>(y - lit.y0) * static_cast<std::size_t>(lit.width()) +
                    static_cast<std::size_t>(x0 - lit.x0),
                static_cast<std::size_t>(x1 - x0));
  }
}

void SliceStore::get(int slice, std::uint8_t* pixels, std::ptrdiff_t stride) const {
  const PixelBox all{0, 0, grid_.width_px, grid_.height_px};
  Scratch scratch;
  for (int y = 0; y < grid_.height_px; y += rows_) {
    copy(blob(y / rows_, slice), y / rows_, all, scratch, pixels, stride);
  }
}

void SliceStore::read_band(const PixelBox& box, const Sink& sink) const {
  if (box.x0 < 0 || box.y0 < 0 || box.x1 > grid_.width_px || box.y1 > grid_.height_px) {
    throw std::out_of_range("band reaches over the image");
  }
  const int first = box.empty() ? 0 : box.y0 / rows_;
  const int last = box.empty() ? 0 : (box.y1 + rows_ - 1) / rows_;
  Scratch scratch;
  std::vector<std::uint8_t> out(size_of(box));
  for (int slice = 0; slice < grid_.layers; ++slice) {
    bool lit = false;
    for (int band = first; band < last; ++band) lit |= blob(band, slice).size != 0;
    for (int band = first; lit && band < last; ++band) {
      copy(blob(band, slice), band, box, scratch, out.data(), box.width());
    }
    sink(slice, lit ? out.data() : nullptr);
  }
}

std::unique_ptr<SliceStore> keep_slices(const SliceSource& source, const std::string& stage,
                                        const std::string& scratch_folder,
                                        const ExecutionContext& context) {
  refuse_recording(source);
  const Grid& grid = source.grid();
  auto store = std::make_unique<SliceStore>(grid, scratch_folder, context);
  store->set_frame(source.frame());
  const PixelBox lit = source.bounds();
  const int rows = band_rows(grid);
  const int first = lit.empty() ? 0 : lit.y0 / rows;
  const int last = lit.empty() ? 0 : (lit.y1 + rows - 1) / rows;
  parallel_for(context, stage, static_cast<std::size_t>(last - first), [&](std::size_t i) {
    const int y = (first + static_cast<int>(i)) * rows;
    const PixelBox band{lit.x0, y, lit.x1, std::min(y + rows, grid.height_px)};
    source.read_band(band, [&](int slice, const std::uint8_t* pixels) {
      if ((slice & 63) == 0) context.check_cancelled();
      store->put_band(slice, band, pixels);
    });
  });
  return store;
}

}  // namespace slicecorr::c_api
