#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>

#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "stack/png.hpp"
#include "stack/uvj_config.hpp"
#include "stack/zip_output.hpp"

namespace slicecorr {
namespace {

using detail::raw_stride;

constexpr std::size_t memory_budget = std::size_t{256} << 20;
constexpr int tiny_preview_px = 128;

bool all_black(const std::uint8_t* p, std::size_t n) {
  // A range is constant when it equals itself shifted by one; memcmp is as fast as memory.
  return n == 0 || (p[0] == 0 && std::memcmp(p, p + 1, n - 1) == 0);
}

/// The mean of whole boxes of pixels, so that no side is longer than `most_px`.
GreyImage shrink(const GreyImage& image, int most_px) {
  const int longest = std::max(image.width_px, image.height_px);
  if (longest <= most_px) return image;
  const auto scaled = [&](int px) {
    return std::max(1, static_cast<int>(std::int64_t{px} * most_px / longest));
  };
  GreyImage small{scaled(image.width_px), scaled(image.height_px), {}};
  const auto edge = [](int i, int count, int px) {
    return static_cast<std::size_t>(std::int64_t{i} * px / count);
  };
  for (int y = 0; y < small.height_px; ++y) {
    const std::size_t y0 = edge(y, small.height_px, image.height_px);
    const std::size_t y1 = edge(y + 1, small.height_px, image.height_px);
    for (int x = 0; x < small.width_px; ++x) {
      const std::size_t x0 = edge(x, small.width_px, image.width_px);
      const std::size_t x1 = edge(x + 1, small.width_px, image.width_px);
      std::uint64_t sum = 0;
      for (std::size_t row = y0; row < y1; ++row) {
        for (std::size_t column = x0; column < x1; ++column) {
          sum += image.pixels[row * static_cast<std::size_t>(image.width_px) + column];
        }
      }
      const std::uint64_t count = (y1 - y0) * (x1 - x0);
      small.pixels.push_back(static_cast<std::uint8_t>((sum + count / 2) / count));
    }
  }
  return small;
}

}  // namespace

struct StackWriter::Impl {
  using Pieces = std::vector<PieceStore::Piece>;

  /// The piece of a band without light, by its number of rows.
  struct Black {
    std::vector<std::uint8_t> chunk;
    std::uint32_t adler = 1;
  };

  Grid grid;
  Job job;
  detail::ZipOutput output;
  PieceStore store;
  int rows = 0;  ///< of a band
  /// Pieces by slice; of size 0 where black, empty until a band is begun.
  std::vector<Pieces> bands, uv_bands;
  std::optional<std::array<std::uint8_t, 256>> uv_of_pixel;
  std::mutex mutex;  ///< of beginning a band

  Impl(const std::string& path, const Grid& g, const Job& j)
      : grid(g),
        job(j),
        output(path),
        store(output.folder(), memory_budget, j),
        rows(band_rows(g)),
        bands(static_cast<std::size_t>((g.height_px + rows - 1) / rows)) {}

  int rows_of(std::size_t band) const {
    return std::min(rows, grid.height_px - static_cast<int>(band) * rows);
  }
  std::size_t raw_size(std::size_t band) const {
    return raw_stride(grid.width_px) * static_cast<std::size_t>(rows_of(band));
  }
  void begin_band(std::size_t band) {
    const std::scoped_lock lock(mutex);
    if (bands[band].empty()) bands[band].resize(static_cast<std::size_t>(grid.layers));
    if (uv_of_pixel && uv_bands[band].empty()) {
      uv_bands[band].resize(static_cast<std::size_t>(grid.layers));
    }
  }
  /// Pixels of `value`, rows with their filter bytes.
  std::vector<std::uint8_t> plain_band(std::size_t band, std::uint8_t value) const {
    std::vector<std::uint8_t> raw(raw_size(band), value);
    const std::size_t stride = raw_stride(grid.width_px);
    for (std::size_t at = 0; at < raw.size(); at += stride) raw[at] = 0;
    return raw;
  }
  std::map<int, Black> make_black(std::uint8_t value) const;
  /// Checksums of all slices of one set of images, which are then added to the archive.
  struct Images {
    const std::vector<Pieces>& bands;
    std::map<int, Black> black;
    std::vector<std::uint32_t> adlers;
    std::vector<std::uint64_t> sizes;
    bool lit(std::size_t band, std::size_t slice) const {
      return !bands[band].empty() && bands[band][slice].size != 0;
    }
  };
  Images gather(const std::vector<Pieces>& from, std::uint8_t background, std::size_t layers) const;
  void add_images(const char* name, const Images& images);
  void write_archive(const StackInfo& info, const GreyImage& preview);
};

std::map<int, StackWriter::Impl::Black> StackWriter::Impl::make_black(std::uint8_t value) const {
  std::map<int, Black> black;
  detail::IdatEncoder encoder;
  for (const std::size_t band : {std::size_t{0}, bands.size() - 1}) {
    Black& b = black[rows_of(band)];
    if (!b.chunk.empty()) continue;
    b.adler = encoder.encode(plain_band(band, value), b.chunk);
  }
  return black;
}

StackWriter::Impl::Images StackWriter::Impl::gather(const std::vector<Pieces>& from,
                                                    std::uint8_t background,
                                                    std::size_t layers) const {
  Images images{from, make_black(background), std::vector<std::uint32_t>(layers),
                std::vector<std::uint64_t>(layers)};
  for (std::size_t slice = 0; slice < layers; ++slice) {
    std::uint32_t adler = 1;
    std::uint64_t size = detail::png_frame_bytes;
    for (std::size_t band = 0; band < from.size(); ++band) {
      const Black& b = images.black.at(rows_of(band));
      const bool is_lit = images.lit(band, slice);
      size += is_lit ? from[band][slice].size : b.chunk.size();
      adler = detail::join_adler(adler, is_lit ? from[band][slice].adler : b.adler, raw_size(band));
    }
    images.adlers[slice] = adler;
    images.sizes[slice] = size;
  }
  return images;
}

void StackWriter::Impl::add_images(const char* name, const Images& images) {
  output.add_lazily(name, images.sizes, [&](std::size_t slice, std::vector<std::uint8_t>& png) {
    detail::append_png_start(grid.width_px, grid.height_px, png);
    for (std::size_t band = 0; band < images.bands.size(); ++band) {
      if (images.lit(band, slice)) {
        store.get(images.bands[band][slice], png);
      } else {
        const std::vector<std::uint8_t>& chunk = images.black.at(rows_of(band)).chunk;
        png.insert(png.end(), chunk.begin(), chunk.end());
      }
    }
    detail::append_png_end(images.adlers[slice], png);
  });
}

void StackWriter::Impl::write_archive(const StackInfo& info, const GreyImage& preview) {
  const auto layers = static_cast<std::size_t>(info.grid.layers);
  const Images slices = gather(bands, 0, layers);
  std::optional<Images> uv;
  if (uv_of_pixel) uv.emplace(gather(uv_bands, (*uv_of_pixel)[0], layers));
  const auto bytes_of = [](const std::string& text) {
    return std::vector<std::uint8_t>(text.begin(), text.end());
  };
  std::optional<std::uint32_t> uv_crc;
  if (uv) uv_crc = detail::images_crc32(uv->adlers);
  output.add("config.json",
             bytes_of(detail::write_uvj_config(info, detail::images_crc32(slices.adlers), uv_crc)));
  if (preview.width_px > 0 && preview.height_px > 0) {
    output.add("preview/huge.png", encode_png(preview));
    output.add("preview/tiny.png", encode_png(shrink(preview, tiny_preview_px)));
  }
  add_images("slice/%08d.png", slices);
  if (uv) add_images("uv/%08d.png", *uv);
  output.finish(job);
}

StackWriter::StackWriter(const std::string& path, const Grid& grid, const Job& job) {
  if (grid.width_px < 1 || grid.height_px < 1 || grid.layers < 1) {
    throw std::invalid_argument("a stack needs at least one pixel and one slice");
  }
  impl_ = std::make_unique<Impl>(path, grid, job);
}

StackWriter::~StackWriter() = default;

void StackWriter::set_uv_pattern(const std::array<std::uint8_t, 256>& uv_of_pixel) {
  impl_->uv_of_pixel = uv_of_pixel;
  impl_->uv_bands.resize(impl_->bands.size());
}

void StackWriter::finish(const StackInfo& info, const GreyImage& preview) {
  const Grid& grid = impl_->grid;
  if (info.grid.width_px != grid.width_px || info.grid.height_px != grid.height_px ||
      info.grid.layers < 1 || info.grid.layers > grid.layers) {
    throw std::invalid_argument("the info of a stack does not fit its images");
  }
  impl_->write_archive(info, preview);
}

struct StackWriter::BandEncoder::Impl {
  StackWriter::Impl* writer;
  int y0, y1;
  std::vector<std::uint8_t> raw;    ///< one band with filter bytes; black but for columns [x0, x1)
  int x0 = 0, x1 = 0;               ///< columns that may be lit since the last slice
  std::vector<std::uint8_t> chunk;  ///< of the slice at hand
  std::vector<std::uint8_t> uv;     ///< the band in UV light
  detail::IdatEncoder encoder;

  void put_band(std::size_t band, int slice, int columns, const std::uint8_t* rows);
};

StackWriter::BandEncoder::BandEncoder(StackWriter& writer, int y0, int y1)
    : impl_(new Impl{writer.impl_.get(), y0, y1, {}, 0, 0, {}, {}, {}}) {
  StackWriter::Impl& w = *writer.impl_;
  const bool ends_well = y1 == w.grid.height_px || (y1 < w.grid.height_px && y1 % w.rows == 0);
  if (y0 < 0 || y0 >= y1 || y0 % w.rows != 0 || !ends_well) {
    throw std::invalid_argument("rows of a band encoder are no whole bands");
  }
  for (int y = y0; y < y1; y += w.rows) w.begin_band(static_cast<std::size_t>(y / w.rows));
  impl_->raw.resize(w.raw_size(static_cast<std::size_t>(y0 / w.rows)));
}

StackWriter::BandEncoder::~BandEncoder() = default;
StackWriter::BandEncoder::BandEncoder(BandEncoder&&) noexcept = default;

/// Columns [x0, x0 + columns) of the rows of one band.
void StackWriter::BandEncoder::Impl::put_band(std::size_t band, int slice, int columns,
                                              const std::uint8_t* rows) {
  PieceStore::Piece& piece = writer->bands[band][static_cast<std::size_t>(slice)];
  piece = {};
  if (writer->uv_of_pixel) writer->uv_bands[band][static_cast<std::size_t>(slice)] = {};
  const auto n = static_cast<std::size_t>(columns);
  const int height = writer->rows_of(band);
  if (rows == nullptr || all_black(rows, n * static_cast<unsigned>(height))) return;
  const std::size_t stride = raw_stride(writer->grid.width_px);
  for (int y = 0; y < height; ++y) {
    std::memcpy(raw.data() + stride * static_cast<unsigned>(y) + 1 + x0,
                rows + n * static_cast<unsigned>(y), n);
  }
  chunk.clear();
  const std::uint32_t adler = encoder.encode(std::span(raw).first(writer->raw_size(band)), chunk);
  piece = writer->store.put(chunk.data(), chunk.size());
  piece.adler = adler;
  if (!writer->uv_of_pixel) return;
  uv.assign(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(writer->raw_size(band)));
  for (std::size_t i = 0; i < uv.size(); ++i) {
    if (i % stride != 0) uv[i] = (*writer->uv_of_pixel)[uv[i]];
  }
  chunk.clear();
  const std::uint32_t uv_adler = encoder.encode(uv, chunk);
  PieceStore::Piece& uv_piece = writer->uv_bands[band][static_cast<std::size_t>(slice)];
  uv_piece = writer->store.put(chunk.data(), chunk.size());
  uv_piece.adler = uv_adler;
}

void StackWriter::BandEncoder::put(int slice, int x0, int x1, const std::uint8_t* rows) {
  Impl& s = *impl_;
  const Grid& grid = s.writer->grid;
  if (slice < 0 || slice >= grid.layers || x0 < 0 || x1 > grid.width_px) {
    throw std::invalid_argument("slice or columns outside of the stack");
  }
  x1 = std::max(x0, x1);
  if (x0 != s.x0 || x1 != s.x1) {
    std::fill(s.raw.begin(), s.raw.end(), std::uint8_t{0});
    s.x0 = x0;
    s.x1 = x1;
  }
  const int band_height = s.writer->rows;
  for (int y = s.y0; y < s.y1; y += band_height) {
    const std::size_t offset = static_cast<std::size_t>(y - s.y0) * static_cast<unsigned>(x1 - x0);
    s.put_band(static_cast<std::size_t>(y / band_height), slice, x1 - x0,
               rows == nullptr ? nullptr : rows + offset);
  }
}

}  // namespace slicecorr
