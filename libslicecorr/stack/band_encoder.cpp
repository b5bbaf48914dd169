// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// From rows of pixels to the pieces of a stack.
#include <cstring>
#include <span>
#include <stdexcept>

#include "base/run_end.hpp"
#include "base/run_length.hpp"
#include "stack/stack_writer_parts.hpp"

namespace slicecorr {

using detail::raw_stride;

struct StackWriter::BandEncoder::Impl {
  /// Makes the pieces of plain grey images that have much in common.
  struct Plain {
    detail::IdatEncoder encoder;
    BlobStore::Blob last;  ///< what `encoder` made last
  };

  StackWriter::Impl* writer;
  int y0, y1;
  Plain slices, edges;
  std::vector<std::uint8_t> chunk;  ///< of the present slice
  /// Where the bytes of images are not the grey values: rows of a band with their filter bytes,
  /// black but for the columns that were put; and the same in the image's pixel code.
  std::vector<std::uint8_t> raw, changed;
  detail::IdatEncoder uv_encoder;

  BlobStore::Blob piece_of(Plain& images, detail::IdatEncoder::Found found,
                           const detail::GreyRows& rows);
  void put_band(std::size_t band, int slice, const detail::GreyRows& rows);
  void put_edges(std::size_t band, int node, const detail::GreyRows& rows);
  template <class Put>
  void put_bands(int x0, int x1, const std::uint8_t* rows, const Put& put);
  BlobStore::Blob keep(std::uint32_t adler);
  BlobStore::Blob keep_runs(const detail::GreyRows& rows);
  std::vector<std::uint8_t> last_runs;  ///< of a binary file's band, as `keep_runs` made them last
  BlobStore::Blob last_runs_blob;
  std::span<const std::uint8_t> make_raw(std::size_t band, const detail::GreyRows& rows);
};

StackWriter::BandEncoder::BandEncoder(StackWriter& writer, int y0, int y1)
    : impl_(new Impl{writer.impl_.get(), y0, y1, {}, {}, {}, {}, {}, {}, {}, {}}) {
  StackWriter::Impl& w = *writer.impl_;
  const bool ends_well = y1 == w.grid.height_px || (y1 < w.grid.height_px && y1 % w.rows == 0);
  if (y0 < 0 || y0 >= y1 || y0 % w.rows != 0 || !ends_well) {
    throw std::invalid_argument("rows of a band encoder are no whole bands");
  }
  for (int y = y0; y < y1; y += w.rows) w.begin_band(static_cast<std::size_t>(y / w.rows));
}

StackWriter::BandEncoder::~BandEncoder() = default;
StackWriter::BandEncoder::BandEncoder(BandEncoder&&) noexcept = default;

/// Puts the chunk of the present slice into the store.
BlobStore::Blob StackWriter::BandEncoder::Impl::keep(std::uint32_t adler) {
  BlobStore::Blob piece = writer->store.put(chunk.data(), chunk.size());
  piece.adler = adler;
  return piece;
}

/// Columns and their runs, as StackReader keeps them: binary files code whole images.
BlobStore::Blob StackWriter::BandEncoder::Impl::keep_runs(const detail::GreyRows& rows) {
  const std::int32_t columns[2] = {rows.x0, rows.x1};
  const auto pixels =
      static_cast<std::size_t>(rows.x1 - rows.x0) * static_cast<unsigned>(rows.rows);
  if (pixels == 0 || (rows.pixels[0] == 0 && detail::run_end(rows.pixels, 0, pixels) == pixels)) {
    return {};
  }
  chunk.resize(sizeof columns);
  std::memcpy(chunk.data(), columns, sizeof columns);
  detail::run_length_encode(rows.pixels, pixels, chunk);
  if (chunk != last_runs) {
    last_runs = chunk;
    last_runs_blob = writer->store.put(chunk.data(), chunk.size());
  }
  return last_runs_blob;
}

std::span<const std::uint8_t> StackWriter::BandEncoder::Impl::make_raw(
    std::size_t band, const detail::GreyRows& rows) {
  raw.assign(writer->raw_size(band), 0);
  const std::size_t stride = raw_stride(rows.width_px);
  const auto width = static_cast<std::size_t>(rows.x1 - rows.x0);
  for (int y = 0; y < rows.rows; ++y) {
    std::memcpy(raw.data() + stride * static_cast<unsigned>(y) + 1 + rows.x0,
                rows.pixels + width * static_cast<unsigned>(y), width);
  }
  return raw;
}

/// The piece of what `images.encoder` took last. Parts that go straight up repeat a slice many
/// times: its chunk is kept once.
BlobStore::Blob StackWriter::BandEncoder::Impl::piece_of(Plain& images,
                                                         detail::IdatEncoder::Found found,
                                                         const detail::GreyRows& rows) {
  if (found == detail::IdatEncoder::Found::other) {
    chunk.clear();
    images.encoder.make(chunk);
    images.last = keep(detail::adler_of(rows));
  }
  return images.last;
}

void StackWriter::BandEncoder::Impl::put_edges(std::size_t band, int node,
                                               const detail::GreyRows& rows) {
  BlobStore::Blob& piece = writer->edge_bands[band][static_cast<std::size_t>(node)];
  piece = {};
  if (rows.pixels == nullptr) return;
  const detail::IdatEncoder::Found found = edges.encoder.take(rows);
  if (found != detail::IdatEncoder::Found::black) piece = piece_of(edges, found, rows);
}

void StackWriter::BandEncoder::Impl::put_band(std::size_t band, int slice,
                                              const detail::GreyRows& rows) {
  using Found = detail::IdatEncoder::Found;
  const auto n = static_cast<std::size_t>(slice);
  BlobStore::Blob& piece = writer->bands[band][n];
  piece = {};
  if (writer->uv_of_pixel) writer->uv_bands[band][n] = {};
  if (rows.pixels == nullptr) return;
  if (writer->codec) {
    piece = keep_runs(rows);
    return;
  }
  const Found found = slices.encoder.take(rows);
  if (found == Found::black) return;
  if (writer->code.is_plain()) {
    piece = piece_of(slices, found, rows);
  } else {
    const std::span<const std::uint8_t> grey = make_raw(band, rows);
    writer->grey_adlers[band][n] = detail::adler_of(grey);
    writer->code.expand(grey, rows.width_px, changed);
    chunk.clear();
    const std::uint32_t adler = slices.encoder.encode(changed, chunk);
    piece = keep(adler);
  }
  if (!writer->uv_of_pixel) return;
  const std::size_t stride = raw_stride(rows.width_px);
  make_raw(band, rows);
  const int first_row = static_cast<int>(band) * writer->rows;
  for (std::size_t i = 0; i < raw.size(); i += stride) {
    const std::span<std::uint8_t> row(raw.data() + i + 1, stride - 1);
    if (writer->uv_rows) {
      writer->uv_rows(slice, first_row + static_cast<int>(i / stride), row);
    } else {
      for (std::uint8_t& pixel : row) pixel = (*writer->uv_of_pixel)[pixel];
    }
  }
  chunk.clear();
  const std::uint32_t adler = uv_encoder.encode(raw, chunk);
  writer->uv_bands[band][n] = keep(adler);
}

/// Calls `put` for each band of the rows, with what is in it.
template <class Put>
void StackWriter::BandEncoder::Impl::put_bands(int x0, int x1, const std::uint8_t* rows,
                                               const Put& put) {
  const Grid& grid = writer->grid;
  if (x0 < 0 || x1 > grid.width_px) throw std::invalid_argument("columns outside of the stack");
  x1 = std::max(x0, x1);
  for (int y = y0; y < y1; y += writer->rows) {
    const auto band = static_cast<std::size_t>(y / writer->rows);
    const std::size_t offset = static_cast<std::size_t>(y - y0) * static_cast<unsigned>(x1 - x0);
    put(band, detail::GreyRows{grid.width_px, x0, x1, writer->rows_of(band),
                               rows == nullptr ? nullptr : rows + offset});
  }
}

void StackWriter::BandEncoder::put(int slice, int x0, int x1, const std::uint8_t* rows) {
  Impl& s = *impl_;
  if (slice < 0 || slice >= s.writer->grid.layers) {
    throw std::invalid_argument("slice outside of the stack");
  }
  s.put_bands(x0, x1, rows,
              [&](std::size_t band, const detail::GreyRows& its) { s.put_band(band, slice, its); });
}

void StackWriter::BandEncoder::put_edge_heights(int node, int x0, int x1,
                                                const std::uint8_t* rows) {
  Impl& s = *impl_;
  if (s.writer->edge_bands.empty()) return;
  if (node < 0 || node > s.writer->grid.layers) {
    throw std::invalid_argument("node outside of the stack");
  }
  s.put_bands(x0, x1, rows,
              [&](std::size_t band, const detail::GreyRows& its) { s.put_edges(band, node, its); });
}

}  // namespace slicecorr
