#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <new>

#include "slicecorr/report.hpp"
#include "stack/png/png.hpp"

namespace slicecorr {

namespace {

using Colour = std::array<std::uint8_t, 3>;
constexpr Colour kEmpty{255, 255, 255}, kRight{128, 134, 140}, kCureThrough{214, 48, 49},
    kUndercure{38, 103, 214}, kGreyPrinted{176, 182, 188}, kGreyEmpty{228, 232, 236},
    kNotYet{178, 203, 245}, kWindow{27, 31, 36};

/// Draws voxel by voxel at the scale at which the section fits; a picture pixel shows the voxel at
/// its middle, but a wrong voxel it covers is never left out.
template <typename ColourOf, typename Weight>
ColourImage draw(const Section& s, double pixel_x_um, double layer_um, int most_px, ColourOf colour,
                 Weight weight) {
  const double width_um = s.width * pixel_x_um, height_um = s.layers * layer_um;
  // Not finer than two picture pixels per voxel, not coarser than fits.
  const double scale =
      std::min(2.0 / std::min(pixel_x_um, layer_um), most_px / std::max(width_um, height_um));
  ColourImage image;
  image.width_px = std::max(1, static_cast<int>(std::lround(width_um * scale)));
  image.height_px = std::max(1, static_cast<int>(std::lround(height_um * scale)));
  image.rgb.resize(static_cast<std::size_t>(image.width_px) *
                   static_cast<std::size_t>(image.height_px) * 3);
  const auto range = [](int i, int pixels, int voxels) {
    const int from = static_cast<int>(static_cast<std::int64_t>(i) * voxels / pixels);
    const int to = static_cast<int>(static_cast<std::int64_t>(i + 1) * voxels / pixels);
    return std::pair(from, std::max(from + 1, to));
  };
  for (int py = 0; py < image.height_px; ++py) {
    const auto [n0, n1] = range(py, image.height_px, s.layers);
    for (int px = 0; px < image.width_px; ++px) {
      const auto [x0, x1] = range(px, image.width_px, s.width);
      std::size_t best =
          static_cast<std::size_t>((n0 + n1) / 2) * static_cast<std::size_t>(s.width) +
          static_cast<std::size_t>((x0 + x1) / 2);
      int most = weight(best);
      for (int n = n0; n < n1; ++n) {
        for (int x = x0; x < x1; ++x) {
          const std::size_t k = static_cast<std::size_t>(n) * static_cast<std::size_t>(s.width) +
                                static_cast<std::size_t>(x);
          if (weight(k) > most) {
            most = weight(k);
            best = k;
          }
        }
      }
      const Colour c = colour(best);
      std::copy(c.begin(), c.end(),
                image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(py) * image.width_px + px));
    }
  }
  return image;
}

}  // namespace

ColourImage cure_picture(const Section& s, double pixel_x_um, double layer_um, int most_px) {
  const auto wrong = [&](std::size_t k) {
    const bool printed = s.dose[k] >= 1.0F;
    return (s.coverage[k] == 0 && printed) || (s.coverage[k] == 255 && !printed) ? 1 : 0;
  };
  const auto colour = [&](std::size_t k) {
    const bool printed = s.dose[k] >= 1.0F;
    if (s.coverage[k] == 0) return printed ? kCureThrough : kEmpty;
    if (s.coverage[k] == 255) return printed ? kRight : kUndercure;
    return printed ? kGreyPrinted : kGreyEmpty;
  };
  return draw(s, pixel_x_um, layer_um, most_px, colour, wrong);
}

ColourImage grey_picture(const Section& s, double pixel_x_um, double layer_um, int most_px) {
  const auto colour = [&](std::size_t k) { return Colour{s.pixels[k], s.pixels[k], s.pixels[k]}; };
  return draw(s, pixel_x_um, layer_um, most_px, colour, [](std::size_t) { return 0; });
}

ColourImage surface_picture(const SurfaceMaps& maps, bool from_below, double scale_um) {
  const std::vector<float>& um = from_below ? maps.below_um : maps.above_um;
  constexpr int least_side = 320;
  const int times = std::max(1, least_side / std::max({1, maps.width, maps.height}));
  ColourImage image{std::max(1, maps.width * times), std::max(1, maps.height * times), {}};
  image.rgb.assign(
      static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px) * 3,
      255);
  const auto colour = [&](float value) {
    if (std::isnan(value)) return kEmpty;
    const double share = std::clamp(value / scale_um, -1.0, 1.0);
    const Colour& end = share > 0 ? kCureThrough : kUndercure;
    Colour c;
    for (std::size_t k = 0; k < c.size(); ++k) {
      c[k] = static_cast<std::uint8_t>(
          std::lround(kGreyEmpty[k] + std::abs(share) * (end[k] - kGreyEmpty[k])));
    }
    return c;
  };
  for (int y = 0; y < maps.height * times; ++y) {
    for (int x = 0; x < maps.width * times; ++x) {
      const auto cell = static_cast<std::size_t>(y / times) * static_cast<std::size_t>(maps.width) +
                        static_cast<std::size_t>(x / times);
      const Colour c = colour(um[cell]);
      std::copy(c.begin(), c.end(),
                image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(y) * image.width_px + x));
    }
  }
  return image;
}

ColourImage side_by_side(const ColourImage& left, const ColourImage& right) {
  constexpr int gap = 24;
  ColourImage both{
      left.width_px + gap + right.width_px, std::max(left.height_px, right.height_px), {}};
  both.rgb.assign(
      static_cast<std::size_t>(both.width_px) * static_cast<std::size_t>(both.height_px) * 3, 255);
  const auto paste = [&](const ColourImage& part, int x) {
    for (int y = 0; y < part.height_px; ++y) {
      std::copy_n(part.rgb.begin() + static_cast<std::ptrdiff_t>(y) * part.width_px * 3,
                  static_cast<std::ptrdiff_t>(part.width_px) * 3,
                  both.rgb.begin() + (static_cast<std::ptrdiff_t>(y) * both.width_px + x) * 3);
    }
  };
  paste(left, 0);
  paste(right, left.width_px + gap);
  return both;
}

ColourImage progress_picture(const SectionHistory& h, std::size_t frame, int most_px) {
  const SectionHistory::Still& f = h.frames[frame];
  Section s;
  s.width = h.width;
  s.layers = h.layers;
  const auto width = static_cast<std::size_t>(h.width);
  const double reached = f.z_window_um / h.layer_um - 0.5;
  const auto coverage = [&](std::size_t k) { return h.coverage.empty() ? 255 : h.coverage[k]; };
  const auto colour = [&](std::size_t k) {
    const bool printed = f.gelled[k] != 0;
    if (h.coverage.empty()) return printed ? kRight : kEmpty;
    const int c = coverage(k);
    if (c == 0) return printed ? kCureThrough : kEmpty;
    if (printed) return c == 255 ? kRight : kGreyPrinted;
    const std::size_t layer = k / width;
    if (static_cast<double>(layer) > reached || c < 255) return kGreyEmpty;
    return f.ended ? kUndercure : kNotYet;
  };
  const auto wrong = [&](std::size_t k) { return f.gelled[k] != 0 && coverage(k) == 0 ? 1 : 0; };
  ColourImage image = draw(s, h.pixel_x_um, h.layer_um, most_px, colour, wrong);
  const double per_um = image.height_px / (h.layers * h.layer_um);
  const int line = std::clamp(static_cast<int>(f.z_window_um * per_um), 0, image.height_px - 1);
  for (int x = 0; x < image.width_px; ++x) {
    std::copy(kWindow.begin(), kWindow.end(),
              image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(line) * image.width_px + x));
  }
  return image;
}

ColourImage tiled(const std::vector<ColourImage>& pictures, int columns) {
  constexpr int gap = 24;
  ColourImage all;
  if (pictures.empty()) return all;
  const int width = pictures[0].width_px, height = pictures[0].height_px;
  const int count = static_cast<int>(pictures.size());
  const int across = std::clamp(columns, 1, count), rows = (count + across - 1) / across;
  all.width_px = across * width + (across - 1) * gap;
  all.height_px = rows * height + (rows - 1) * gap;
  all.rgb.assign(
      static_cast<std::size_t>(all.width_px) * static_cast<std::size_t>(all.height_px) * 3, 255);
  for (int i = 0; i < count; ++i) {
    const int x = i % across * (width + gap), top = i / across * (height + gap);
    const ColourImage& part = pictures[static_cast<std::size_t>(i)];
    for (int y = 0; y < height; ++y) {
      std::copy_n(part.rgb.begin() + static_cast<std::ptrdiff_t>(y) * width * 3,
                  static_cast<std::ptrdiff_t>(width) * 3,
                  all.rgb.begin() + (static_cast<std::ptrdiff_t>(top + y) * all.width_px + x) * 3);
    }
  }
  return all;
}

namespace {

/// A row of RGB pixels as PNG stores it: the filter's number, then the bytes less what it guesses
/// from the pixel to the left (1), from the row above (2), or nothing (0). Of these the one whose
/// bytes are the smallest in sum.
void filter_row(const std::uint8_t* row, const std::uint8_t* above, std::size_t bytes,
                std::uint8_t* out) {
  const auto filtered = [&](int filter, std::size_t i) {
    const std::uint8_t left = i < 3 ? 0 : row[i - 3];
    return static_cast<std::uint8_t>(row[i] - (filter == 1 ? left : filter == 2 ? above[i] : 0));
  };
  std::uint64_t least = UINT64_MAX;
  int best = 0;
  for (const int filter : {0, 2, 1}) {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bytes; ++i) {
      sum += static_cast<unsigned>(std::abs(static_cast<std::int8_t>(filtered(filter, i))));
    }
    if (sum >= least) continue;
    least = sum;
    best = filter;
  }
  out[0] = static_cast<std::uint8_t>(best);
  for (std::size_t i = 0; i < bytes; ++i) out[i + 1] = filtered(best, i);
}

}  // namespace

std::vector<std::uint8_t> encode_png(const ColourImage& image) {
  const auto bytes = static_cast<std::size_t>(image.width_px) * 3;
  const auto height = static_cast<std::size_t>(image.height_px);
  std::vector<std::uint8_t> raw((bytes + 1) * height);
  const std::vector<std::uint8_t> black(bytes, 0);
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint8_t* const row = image.rgb.data() + y * bytes;
    filter_row(row, y ? row - bytes : black.data(), bytes, raw.data() + y * (bytes + 1));
  }
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(7), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::vector<std::uint8_t> png;
  detail::PixelCode rgb;
  rgb.colour = 2;
  detail::append_png_header(image.width_px, image.height_px, rgb, png);
  const std::size_t chunk = detail::begin_chunk("IDAT", png), start = png.size();
  png.resize(start + libdeflate_zlib_compress_bound(compressor.get(), raw.size()));
  png.resize(start + libdeflate_zlib_compress(compressor.get(), raw.data(), raw.size(),
                                              png.data() + start, png.size() - start));
  detail::end_chunk(chunk, png);
  detail::append_png_iend(png);
  return png;
}

}  // namespace slicecorr
