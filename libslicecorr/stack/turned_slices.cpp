// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstring>
#include <vector>

#include "base/run_length.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/turned.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr {

namespace {

constexpr std::size_t kTurnedMemory = std::size_t{256} << 20;
/// Most bytes of pixels that a band works on at a time.
constexpr std::size_t kChunkBytes = std::size_t{16} << 20;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

/// The source with rows and columns exchanged. A *strip* is some rows of the source, a *block* its
/// columns that make up a band of the transposed image; of a block some slices at a time, a
/// *chunk*, are one blob: slice by slice, in each the rows of the transposed image.
class TurnedSlices::Transposed {
 public:
  Transposed(const SliceSource& source, const std::string& folder, const ExecutionContext& context)
      : store_(folder, kTurnedMemory, context),
        box_(source.bounds()),
        layers_(source.grid().layers),
        side_(std::max(1, band_rows(source.grid()))) {
    const int longest = std::max(box_.width(), box_.height());
    chunk_ = static_cast<int>(std::clamp(kChunkBytes / (at(side_) * at(std::max(1, longest))),
                                         std::size_t{16}, std::size_t{4096}));
    chunks_ = (layers_ + chunk_ - 1) / chunk_;
    strips_ = (box_.height() + side_ - 1) / side_;
    blocks_ = (box_.width() + side_ - 1) / side_;
    blobs_.resize(at(strips_) * at(blocks_) * at(chunks_));
    parallel_for(context, "turn", at(strips_),
                 [&](std::size_t s) { cut(source, static_cast<int>(s), context); });
  }

  /// In pixels of the transposed image.
  void read_band(const PixelBox& band, const Sink& sink) const {
    const std::size_t area = at(band.width()) * at(band.height());
    std::vector<std::uint8_t> rows(area * at(chunk_)), code, block;
    std::vector<bool> lit(at(chunk_));
    // The source's rows are columns here.
    const int strip0 = strip_of(band.x0), strip1 = strip_of(band.x1 - 1);
    const int block0 = block_of(band.y0), block1 = block_of(band.y1 - 1);
    for (int c = 0; c < chunks_; ++c) {
      std::fill(rows.begin(), rows.end(), std::uint8_t{0});
      std::fill(lit.begin(), lit.end(), false);
      const int slices = std::min(chunk_, layers_ - c * chunk_);
      for (int s = std::max(0, strip0); s <= std::min(strips_ - 1, strip1); ++s) {
        for (int b = std::max(0, block0); b <= std::min(blocks_ - 1, block1); ++b) {
          const BlobStore::Blob& blob = blobs_[index(s, b, c)];
          if (blob.size == 0) continue;
          code.clear();
          store_.get(blob, code);
          const PixelBox from = block_box(s, b);
          block.resize(at(from.width()) * at(from.height()) * at(slices));
          detail::run_length_decode(code.data(), code.data() + code.size(), block.data(),
                                    block.size());
          for (int n = 0; n < slices; ++n) {
            lit[at(n)] = true;
            copy(block.data() + at(n) * at(from.width()) * at(from.height()), from,
                 rows.data() + at(n) * area, band);
          }
        }
      }
      for (int n = 0; n < slices; ++n) {
        sink(c * chunk_ + n, lit[at(n)] ? rows.data() + at(n) * area : nullptr);
      }
    }
  }

 private:
  std::size_t index(int strip, int block, int chunk) const {
    return (at(strip) * at(blocks_) + at(block)) * at(chunks_) + at(chunk);
  }
  int strip_of(int x) const { return x < box_.y0 ? -1 : (x - box_.y0) / side_; }
  int block_of(int y) const { return y < box_.x0 ? -1 : (y - box_.x0) / side_; }
  /// Pixels of the transposed image.
  PixelBox block_box(int strip, int block) const {
    const int x0 = box_.y0 + strip * side_, y0 = box_.x0 + block * side_;
    return {x0, y0, std::min(x0 + side_, box_.y1), std::min(y0 + side_, box_.x1)};
  }
  static void copy(const std::uint8_t* pixels, const PixelBox& from, std::uint8_t* rows,
                   const PixelBox& to) {
    const int x0 = std::max(from.x0, to.x0), x1 = std::min(from.x1, to.x1);
    if (x0 >= x1) return;
    for (int y = std::max(from.y0, to.y0); y < std::min(from.y1, to.y1); ++y) {
      std::memcpy(rows + at(y - to.y0) * at(to.width()) + at(x0 - to.x0),
                  pixels + at(y - from.y0) * at(from.width()) + at(x0 - from.x0), at(x1 - x0));
    }
  }

  /// Reads a strip and keeps its blocks.
  void cut(const SliceSource& source, int strip, const ExecutionContext& context) {
    const int y0 = box_.y0 + strip * side_;
    const PixelBox band{box_.x0, y0, box_.x1, std::min(y0 + side_, box_.y1)};
    const std::size_t height = at(band.height()), width = at(band.width());
    std::vector<std::uint8_t> pixels(width * height * at(chunk_)), code;
    bool lit = false;
    int filled = 0;
    // Blocks of a chunk lie one after the other, each with all slices of the chunk.
    const auto keep = [&](int chunk) {
      for (int b = 0; lit && b < blocks_; ++b) {
        const std::size_t begin = at(b * side_) * height * at(chunk_);
        const std::size_t columns = at(block_box(strip, b).height());
        const std::uint8_t* from = pixels.data() + begin;
        const std::size_t size = columns * height * at(filled);
        if (std::all_of(from, from + size, [](std::uint8_t v) { return v == 0; })) continue;
        code.clear();
        detail::run_length_encode(from, size, code);
        blobs_[index(strip, b, chunk)] = store_.put(code.data(), code.size());
      }
      std::fill(pixels.begin(), pixels.end(), std::uint8_t{0});
      lit = false;
      filled = 0;
    };
    source.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      if (rows) {
        lit = true;
        for (std::size_t x = 0; x < width; ++x) {
          const std::size_t b = x / at(side_);
          const std::size_t columns = std::min(at(side_), width - b * at(side_));
          std::uint8_t* out = pixels.data() + b * at(side_) * height * at(chunk_) +
                              at(filled) * columns * height + (x - b * at(side_)) * height;
          for (std::size_t y = 0; y < height; ++y) out[y] = rows[y * width + x];
        }
      }
      ++filled;
      if (filled == chunk_ || n + 1 == layers_) keep(n / chunk_);
    });
  }

  BlobStore store_;
  PixelBox box_;  ///< of the source
  int layers_, side_, chunk_ = 1, chunks_ = 0, strips_ = 0, blocks_ = 0;
  std::vector<BlobStore::Blob> blobs_;
};

TurnedSlices::TurnedSlices(const SliceSource& source, const Turn& turn,
                           const std::string& scratch_folder, const ExecutionContext& context,
                           const std::optional<ImageFrame>& frame)
    : source_(source),
      turn_(turn),
      grid_(turned(source.grid(), turn)),
      frame_(frame.value_or(turned(source.frame(), turn))) {
  refuse_recording(source);
  if (turn.swap_axes) {
    transposed_ = std::make_unique<const Transposed>(source, scratch_folder, context);
  }
  if (const SliceSource* edges = source.edge_heights()) {
    edge_heights_ =
        std::make_unique<const TurnedSlices>(*edges, turn, scratch_folder, context, frame_);
  }
}

TurnedSlices::~TurnedSlices() = default;

PixelBox TurnedSlices::bounds() const {
  const Grid& g = source_.grid();
  return turned(source_.bounds(), turn_, g.width_px, g.height_px);
}

void TurnedSlices::read_band(const PixelBox& band, const Sink& sink) const {
  // After the exchange of axes only flips are left.
  const Turn flips{false, turn_.flip_x, turn_.flip_y};
  const PixelBox from = turned(band, flips, grid_.width_px, grid_.height_px);
  const auto width = at(band.width()), height = at(band.height());
  std::vector<std::uint8_t> rows(width * height);
  const Sink flip = [&](int n, const std::uint8_t* in) {
    if (!in || flips.is_identity()) return sink(n, in);
    for (std::size_t y = 0; y < height; ++y) {
      const std::uint8_t* row = in + (flips.flip_y ? height - 1 - y : y) * width;
      if (flips.flip_x) {
        std::reverse_copy(row, row + width, rows.data() + y * width);
      } else {
        std::copy_n(row, width, rows.data() + y * width);
      }
    }
    sink(n, rows.data());
  };
  if (transposed_) {
    transposed_->read_band(from, flip);
  } else {
    source_.read_band(from, flip);
  }
}

FittedSlices FittedSlices::for_display(const SliceSource& source, const Printer& printer,
                                       const std::string& scratch_folder,
                                       const ExecutionContext& context) {
  FittedSlices fitted(source);
  if (source.frame().to_display || !printer.orientation) return fitted;
  fitted.turned_ = std::make_unique<const TurnedSlices>(
      source, turn_to_display(source.frame(), printer), scratch_folder, context,
      ImageFrame{Turn{}, printer.orientation, source.frame().made_for});
  return fitted;
}

FittedSlices FittedSlices::like(const SliceSource& other, const SliceSource& source,
                                const std::string& scratch_folder,
                                const ExecutionContext& context) {
  FittedSlices fitted(source);
  const ImageFrame is = source.frame(), wanted = other.frame();
  if (!is.orientation || !wanted.orientation || *is.orientation == *wanted.orientation) {
    return fitted;
  }
  fitted.turned_ = std::make_unique<const TurnedSlices>(
      source, turn_between(*is.orientation, *wanted.orientation), scratch_folder, context, wanted);
  return fitted;
}

}  // namespace slicecorr
