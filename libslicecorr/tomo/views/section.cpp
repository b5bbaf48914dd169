// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/section.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "picture/canvas.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/vial_outline.hpp"
#include "support/chart/chart.hpp"
#include "tomo/views/section_cut.hpp"

namespace slicecorr::tomo {

namespace {

using slicecorr::detail::Canvas;
using slicecorr::detail::Colour;
using slicecorr::detail::kInk;
using slicecorr::detail::PixelCanvas;
using slicecorr::detail::Segment;
using slicecorr::detail::SvgCanvas;

constexpr Colour kEmpty{255, 255, 255}, kRight{128, 134, 140}, kPale{208, 213, 218},
    kOutside{228, 232, 236}, kInsert{70, 60, 50}, kOutline{0, 150, 70};
/// Hatched wrong voxels: ground and stripe.
constexpr std::array<Colour, 2> kGelled{{{214, 48, 49}, {142, 21, 22}}},
    kMissing{{{38, 103, 214}, {157, 192, 255}}};

Colour mixed(Colour a, Colour b, double share) {
  Colour c;
  for (std::size_t k = 0; k < c.size(); ++k) {
    c[k] = static_cast<std::uint8_t>(std::lround(a[k] + share * (b[k] - a[k])));
  }
  return c;
}

/// Liquid in blues, gelled in yellow to red: the step at the gel dose is what counts.
Colour dose_colour(double dose, double gel, double most) {
  if (dose < gel) return mixed({16, 24, 48}, {122, 168, 230}, std::max(0.0, dose / gel));
  const double share = most > gel ? (dose - gel) / (most - gel) : 0;
  return mixed({255, 226, 120}, {150, 20, 30}, std::min(1.0, share));
}

char letter_of(Axis axis) { return "xyz"[static_cast<int>(axis)]; }

/// A voxel of a plane, by its column and row.
struct Place {
  int z = 0, y = 0, x = 0;
};
Place voxel_at(Axis axis, int index, int column, int row) {
  switch (axis) {
    case Axis::x:
      return {row, column, index};
    case Axis::y:
      return {row, index, column};
    case Axis::z:
      break;
  }
  return {index, row, column};
}

/// Voxels from `first` to `last` along each axis: z, y, x.
struct VoxelRange {
  std::array<int, 3> first{}, last{};
};

bool wrong(const PrintSection& s, std::size_t k) {
  if (s.matter[k] != Matter::resin) return false;
  const bool gels = s.dose[k] >= s.gel_dose;
  return (s.target[k] == 0 && gels) || (s.target[k] == 255 && !gels);
}

std::size_t wrong_voxels(const PrintSection& s, std::uint8_t target) {
  std::size_t n = 0;
  for (std::size_t k = 0; k < s.dose.size(); ++k) n += s.target[k] == target && wrong(s, k);
  return n;
}

/// A picture of the voxels, `scale` pixels to each; below 1, a pixel shows the voxel in its middle,
/// but a wrong one it covers is never left out.
ColourImage raster(const PrintSection& s, ColouredBy by, double most, double scale) {
  ColourImage image;
  image.width_px = std::max(1, static_cast<int>(std::lround(s.width * scale)));
  image.height_px = std::max(1, static_cast<int>(std::lround(s.height * scale)));
  image.rgb.reserve(3 * static_cast<std::size_t>(image.width_px) *
                    static_cast<std::size_t>(image.height_px));
  const auto range = [](int i, int pixels, int voxels) {
    const auto from = static_cast<int>(static_cast<std::int64_t>(i) * voxels / pixels);
    const auto to = static_cast<int>(static_cast<std::int64_t>(i + 1) * voxels / pixels);
    return std::pair(from, std::max(from + 1, to));
  };
  const auto at = [&](int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(s.width) +
           static_cast<std::size_t>(column);
  };
  for (int py = 0; py < image.height_px; ++py) {
    // The lowest row of voxels is the picture's last.
    const auto [r0, r1] = range(image.height_px - 1 - py, image.height_px, s.height);
    for (int px = 0; px < image.width_px; ++px) {
      const auto [c0, c1] = range(px, image.width_px, s.width);
      std::size_t k = at((r0 + r1) / 2, (c0 + c1) / 2);
      for (int r = r0; r < r1 && !wrong(s, k); ++r) {
        for (int c = c0; c < c1; ++c) {
          if (wrong(s, at(r, c))) k = at(r, c);
        }
      }
      Colour colour = kOutside;
      if (s.matter[k] == Matter::insert) {
        colour = kInsert;
      } else if (wrong(s, k)) {
        const bool gelled = s.target[k] == 0;
        const int across = gelled ? px + py : px - py + 65536 * 6;
        colour = (gelled ? kGelled : kMissing)[across % 6 < 2 ? 1 : 0];
      } else if (s.matter[k] == Matter::resin) {
        switch (by) {
          case ColouredBy::dose:
            colour = dose_colour(s.dose[k], s.gel_dose, most);
            break;
          case ColouredBy::print:
            colour = s.dose[k] < s.gel_dose ? kEmpty : s.target[k] == 255 ? kRight : kPale;
            break;
          case ColouredBy::target:
            colour = mixed(kEmpty, kRight, s.target[k] / 255.0);
            break;
        }
      }
      image.rgb.insert(image.rgb.end(), colour.begin(), colour.end());
    }
  }
  return image;
}

/// Where numbers at the middles of voxels cross a level: marching squares. `takes`: whether a voxel
/// counts. In pixels from the picture's upper left corner.
template <typename Value, typename Takes>
std::vector<Segment> contour(const PrintSection& s, double scale, double level, Value value,
                             Takes takes) {
  std::vector<Segment> segments;
  for (int r = 0; r + 1 < s.height; ++r) {
    for (int c = 0; c + 1 < s.width; ++c) {
      // Around the square: lower left, lower right, upper right, upper left.
      const std::array<std::array<int, 2>, 4> corner{
          {{r, c}, {r, c + 1}, {r + 1, c + 1}, {r + 1, c}}};
      std::array<double, 4> v{};
      bool all = true;
      for (std::size_t i = 0; i < 4; ++i) {
        const std::size_t k =
            static_cast<std::size_t>(corner[i][0]) * static_cast<std::size_t>(s.width) +
            static_cast<std::size_t>(corner[i][1]);
        all = all && takes(k);
        v[i] = value(k);
      }
      if (!all) continue;
      std::array<std::array<double, 2>, 4> crossing{};
      std::size_t crossings = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        const std::size_t j = (i + 1) % 4;
        if ((v[i] >= level) == (v[j] >= level)) continue;
        const double t = (level - v[i]) / (v[j] - v[i]);
        const double row = corner[i][0] + t * (corner[j][0] - corner[i][0]);
        const double column = corner[i][1] + t * (corner[j][1] - corner[i][1]);
        crossing[crossings++] = {(column + 0.5) * scale, (s.height - row - 0.5) * scale};
      }
      // In a saddle, four crossings: the first two and the last two keep what is above together or
      // apart; either is as good.
      for (std::size_t i = 0; i + 1 < crossings; i += 2) {
        segments.push_back(
            {crossing[i][0], crossing[i][1], crossing[i + 1][0], crossing[i + 1][1]});
      }
    }
  }
  return segments;
}

std::vector<Segment> moved(std::vector<Segment> segments, double x, double y) {
  for (Segment& s : segments) {
    s.x0 += x;
    s.x1 += x;
    s.y0 += y;
    s.y1 += y;
  }
  return segments;
}

/// 1, 2 or 5 times a power of ten, at most `most`.
double round_length(double most) {
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  for (const double factor : {5.0, 2.0}) {
    if (power * factor <= most) return power * factor;
  }
  return power;
}

std::string length_in_words(double mm) {
  return mm >= 0.1 ? fmt::format("{:g} mm", mm) : fmt::format("{:g} µm", mm * 1000);
}

struct Size {
  double width = 0, height = 0;
};

/// Draws on a canvas and says how much of it is used.
Size draw(Canvas& canvas, const std::vector<PrintSection>& sections, ColouredBy by,
          const std::string& title) {
  constexpr double kGap = 24, kSide = 16, kLine = Canvas::kLine;
  // A picture is about 460 pixels at its longer side; voxels are whole pixels where that is near.
  int longest = 1;
  double most = 0;
  for (const PrintSection& s : sections) {
    longest = std::max({longest, s.width, s.height});
    most = std::max(most, s.gel_dose);
    for (const float d : s.dose) most = std::max<double>(most, d);
  }
  double scale = 460.0 / longest;
  scale = scale >= 1 ? std::min(std::floor(scale), 24.0) : scale;

  double x = kSide, y = kLine + 4, bottom = y;
  canvas.text(x, y, title);
  double right = x + canvas.width_of(title);
  y += 10;
  for (const PrintSection& s : sections) {
    const ColourImage image = raster(s, by, most, scale);
    std::string words =
        fmt::format("{} = {:.3f} mm, {} to the right, {} up", letter_of(s.axis), s.at_mm,
                    s.axis == Axis::x ? 'y' : 'x', s.axis == Axis::z ? 'y' : 'z');
    const double top = y + kLine;
    canvas.text(x, top - 6, words);
    canvas.rect(x - 1, top - 1, image.width_px + 2, image.height_px + 2, {128, 134, 140});
    canvas.image(x, top, image);
    // Where voxels are small, lines would hide the wrong ones.
    const auto clear = [&](std::size_t k) { return scale >= 4 || !wrong(s, k); };
    const auto outline = contour(
        s, scale, 127.5, [&](std::size_t k) { return s.target[k]; }, clear);
    const auto gel = contour(
        s, scale, s.gel_dose, [&](std::size_t k) { return s.dose[k]; },
        [&](std::size_t k) { return s.matter[k] == Matter::resin && clear(k); });
    canvas.lines(moved(outline, x, top), kOutline, 2);
    canvas.lines(moved(gel, x, top), {255, 255, 255}, 3);
    canvas.lines(moved(gel, x, top), kInk, 1.4);
    words = fmt::format("missing: {}, gelled: {}", s.missing(), s.gelled());
    canvas.text(x, top + image.height_px + kLine - 2, words);
    const double width = std::max<double>(image.width_px, canvas.width_of(words));
    right = std::max(right, x + std::max(width, canvas.width_of("x = -00.000 mm, x to the right")));
    bottom = std::max(bottom, top + image.height_px + kLine + 4);
    x += std::max(width, canvas.width_of("x = -00.000 mm, y to the right, z up")) + kGap;
  }
  right = std::max(right, x - kGap);

  // Scale bar.
  x = kSide;
  y = bottom + kLine;
  const double voxel_mm = sections.front().voxel_mm;
  const double bar_mm = round_length(120 / scale * voxel_mm), bar = bar_mm / voxel_mm * scale;
  canvas.rect(x, y - 8, bar, 4, kInk);
  for (const double end : {x, x + bar - 2}) canvas.rect(end, y - 13, 2, 14, kInk);
  canvas.text(x + bar + 10, y, length_in_words(bar_mm));
  // Doses.
  const PrintSection& s = sections.front();
  if (by == ColouredBy::dose) {
    y += kLine + 12;
    constexpr int kRamp = 360;
    ColourImage ramp{kRamp, 14, {}};
    for (int py = 0; py < ramp.height_px; ++py) {
      for (int px = 0; px < kRamp; ++px) {
        const Colour c = dose_colour(most * (px + 0.5) / kRamp, s.gel_dose, most);
        ramp.rgb.insert(ramp.rgb.end(), c.begin(), c.end());
      }
    }
    canvas.image(x, y - 14, ramp);
    const double at = x + kRamp * s.gel_dose / most;
    canvas.rect(at - 1, y - 18, 2, 22, kInk);
    const std::string range = fmt::format("dose, 0 to {} {}", chart::figure(most), s.unit);
    canvas.text(x + kRamp + 10, y, range);
    right = std::max(right, x + kRamp + 10 + canvas.width_of(range));
    y += kLine;
    const std::string words = fmt::format("gels at {}", chart::figure(s.gel_dose));
    canvas.text(std::clamp(at - canvas.width_of(words) / 2, x, x + kRamp), y, words);
  }
  // Keys, one below the other where they do not fit beside each other.
  const auto key = [&](auto mark, const std::string& words) {
    const double width = 30 + canvas.width_of(words) + kGap;
    if (x > kSide && x + width > right) {
      x = kSide;
      y += kLine;
    }
    mark();
    canvas.text(x + 30, y, words);
    x += width;
    right = std::max(right, x - kGap);
  };
  const auto hatched = [&](const std::array<Colour, 2>& colours, bool rising) {
    ColourImage image{20, 14, {}};
    for (int py = 0; py < image.height_px; ++py) {
      for (int px = 0; px < image.width_px; ++px) {
        const int across = rising ? px + py : px - py + 60;
        const Colour c = colours[across % 6 < 2 ? 1 : 0];
        image.rgb.insert(image.rgb.end(), c.begin(), c.end());
      }
    }
    canvas.image(x, y - 13, image);
  };
  const auto square = [&](Colour c) {
    return [&canvas, &x, &y, c] {
      canvas.rect(x, y - 13, 20, 14, {128, 134, 140});
      canvas.rect(x + 1, y - 12, 18, 12, c);
    };
  };
  y += kLine + 2;
  key([&] { canvas.lines({{x, y - 6, x + 20, y - 6}}, kInk, 1.4); }, "gel dose reached");
  key([&] { canvas.lines({{x, y - 6, x + 20, y - 6}}, kOutline, 2); }, "outline of the target");
  key([&] { hatched(kMissing, false); }, "missing: part below the gel dose");
  key([&] { hatched(kGelled, true); }, "gelled: void at the gel dose or above");
  if (by == ColouredBy::print) {
    key(square(kRight), "gels, as it should");
    key(square(kPale), "gels, neither part nor void");
  }
  if (by == ColouredBy::target) key(square(kRight), "part");
  bool insert = false, outside = false;
  for (const PrintSection& section : sections) {
    for (const Matter m : section.matter) {
      insert = insert || m == Matter::insert;
      outside = outside || m == Matter::nothing;
    }
  }
  if (insert) key(square(kInsert), "insert");
  if (outside) key(square(kOutside), "no resin");
  return {right + kSide, y + 14};
}

}  // namespace

Printed printed(TomoJob job, const ExecutionContext& context) {
  Printed p{std::move(job), {}, {}};
  p.dose = dose_of(p.job, context);
  p.figures = figures_of(p.job, p.dose, p.job.part, context);
  p.figures.contrast_bound = p.job.contrast_bound;
  return p;
}

std::size_t PrintSection::missing() const { return wrong_voxels(*this, 255); }
std::size_t PrintSection::gelled() const { return wrong_voxels(*this, 0); }

std::vector<Plane> middle_planes(const Printed& print) {
  const Box<std::uint8_t>& part = print.job.part;
  VoxelRange e{{part.nz, part.ny, part.nx}, {-1, -1, -1}};
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        if (part.values[part.at(z, y, x)] == 0) continue;
        const std::array<int, 3> at{z, y, x};
        for (std::size_t k = 0; k < 3; ++k) {
          e.first[k] = std::min(e.first[k], at[k]);
          e.last[k] = std::max(e.last[k], at[k]);
        }
      }
    }
  }
  const double voxel = print.job.sampling.voxel_mm;
  const auto middle = [&](std::size_t k, int n) {
    if (e.last[k] < 0) return k == 0 ? print.job.sampling.middle_z_mm : 0.0;
    const int index = (e.first[k] + e.last[k]) / 2;
    if (k == 0) return print.job.sampling.z_mm(index);
    return (index - 0.5 * (n - 1)) * voxel;
  };
  return {
      {Axis::x, middle(2, part.nx)}, {Axis::y, middle(1, part.ny)}, {Axis::z, middle(0, part.nz)}};
}

std::vector<PrintSection> detail::cut(const Solid& solid, const std::vector<Plane>& planes) {
  const auto& [dose, part, insert, voxel_mm, gel_dose, middle_z_mm, beyond, shown] = solid;
  const int n = part.nx;
  const auto is_beyond = [&, &beyond = beyond](int y, int x) {
    return !beyond.empty() && beyond[static_cast<std::size_t>(y) * static_cast<std::size_t>(n) +
                                     static_cast<std::size_t>(x)];
  };
  const auto is_insert = [&, &insert = insert](int z, int y, int x) {
    return !insert.values.empty() && insert.values[insert.at(z, y, x)] > 0 && !is_beyond(y, x);
  };
  const std::array<int, 3> sizes{part.nz, part.ny, part.nx};
  const double radius = 0.5 * (n - 1);
  const auto matter_at = [&](const Place& p) {
    const double dx = p.x - radius, dy = p.y - radius;
    if (dx * dx + dy * dy > radius * radius || is_beyond(p.y, p.x)) return Matter::nothing;
    return is_insert(p.z, p.y, p.x) ? Matter::insert : Matter::resin;
  };
  // What all sections are cut down to.
  VoxelRange e{sizes, {-1, -1, -1}};
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const std::size_t k = part.at(z, y, x);
        const bool counts = part.values[k] > 0 || dose.values[k] >= gel_dose || is_insert(z, y, x);
        if (!counts) continue;
        const std::array<int, 3> at{z, y, x};
        for (std::size_t i = 0; i < 3; ++i) {
          e.first[i] = std::min(e.first[i], at[i]);
          e.last[i] = std::max(e.last[i], at[i]);
        }
      }
    }
  }
  int longest = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    if (e.last[i] < 0) {
      e.first[i] = 0;
      e.last[i] = sizes[i] - 1;
    }
    longest = std::max(longest, e.last[i] - e.first[i] + 1);
  }
  const int margin = std::max(2, longest / 12);
  for (std::size_t i = 0; i < 3; ++i) {
    e.first[i] = std::max(0, e.first[i] - margin);
    e.last[i] = std::min(sizes[i] - 1, e.last[i] + margin);
  }

  std::vector<PrintSection> sections;
  for (const Plane& plane : planes) {
    const std::size_t kept = 2 - static_cast<std::size_t>(plane.axis);
    const double half = 0.5 * (sizes[kept] - 1);
    const double middle = kept == 0 ? middle_z_mm : 0;
    const double index = std::round((plane.at_mm - middle) / voxel_mm + half);
    if (!(index >= 0 && index < sizes[kept])) {
      throw InputError(
          fmt::format("{} = {:g} mm lies outside of the voxels; expected {:.3f} to {:.3f} mm",
                      letter_of(plane.axis), plane.at_mm, middle - (half + 0.5) * voxel_mm,
                      middle + (half + 0.5) * voxel_mm));
    }
    PrintSection s;
    s.axis = plane.axis;
    s.at_mm = middle + (index - half) * voxel_mm;
    s.voxel_mm = voxel_mm;
    s.gel_dose = gel_dose;
    const std::size_t across = plane.axis == Axis::x ? 1 : 2, up = plane.axis == Axis::z ? 1 : 0;
    s.width = e.last[across] - e.first[across] + 1;
    s.height = e.last[up] - e.first[up] + 1;
    for (int row = 0; row < s.height; ++row) {
      for (int column = 0; column < s.width; ++column) {
        const Place p = voxel_at(plane.axis, static_cast<int>(index), column + e.first[across],
                                 row + e.first[up]);
        const std::size_t k = part.at(p.z, p.y, p.x);
        s.dose.push_back(dose.values[k]);
        s.target.push_back(part.values[k]);
        s.matter.push_back(matter_at(p));
      }
    }
    sections.push_back(std::move(s));
  }
  return sections;
}

std::vector<PrintSection> sections_of(const Box<float>& dose, const Box<std::uint8_t>& part,
                                      const Box<std::uint8_t>& insert, double voxel_mm,
                                      double gel_dose, const std::vector<Plane>& planes,
                                      double middle_z_mm) {
  return detail::cut({dose, part, insert, voxel_mm, gel_dose, middle_z_mm}, planes);
}

std::vector<PrintSection> sections_of(const Printed& print, const std::vector<Plane>& planes) {
  const TomoJob& job = print.job;
  const double voxel_mm = job.sampling.voxel_mm;
  return detail::cut(
      {print.dose, job.part, job.insert, voxel_mm, print.figures.gel_dose_mj_cm3,
       job.sampling.middle_z_mm, beyond_walls(*job.printer.vial, job.part.nx, voxel_mm)},
      planes);
}

PrintSection section_of(const Evidence& e) {
  PrintSection s =
      detail::cut({e.dose, e.part, e.insert, e.voxel_mm, 1, 0, e.beyond}, {{Axis::z, 0}})[0];
  s.at_mm = e.z_mm;
  s.unit = "times the gel dose";
  return s;
}

std::string sections_svg(const std::vector<PrintSection>& sections, ColouredBy by,
                         const std::string& title) {
  std::string words = title;
  for (const PrintSection& s : sections) {
    words += fmt::format(". Plane {} = {:.3f} mm: {} voxels missing, {} gelled that should not",
                         letter_of(s.axis), s.at_mm, s.missing(), s.gelled());
  }
  SvgCanvas canvas(words);
  const Size size = draw(canvas, sections, by, title);
  return canvas.file(size.width, size.height);
}

std::string sections_png(const std::vector<PrintSection>& sections, ColouredBy by,
                         const std::string& title) {
  PixelCanvas canvas;
  const Size size = draw(canvas, sections, by, title);
  return canvas.file(size.width, size.height);
}

}  // namespace slicecorr::tomo
