// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Proves what scripts/bench measured: reads slices back with libzip and libpng, which share no
// code with ours, and compares light. See the usage below.
//
// Light is the sum over pixels, 1 for a pixel fully lit. Bounds, derived as in peer_test.cpp:
//  - *Ours against the mesh's own cross-section* (closed meshes only), antialiased: a grey value is
//    off by at most half a level, so G grey pixels by at most G / 510.
//  - *Theirs against ours, antialiased.* PrusaSlicer's edges are off by at most d = sqrt(2) 3/512
//    pixel + 6e-6 mm, its grey values by one level, and an edge in a pixel is at most sqrt(2) long:
//    E edge pixels differ by at most E (sqrt(2) d + 1/255) in sum. Its heights are off by 6e-6 mm
//    as well; how much light a height is worth is seen from the slices above and below.
//  - *Pixel centres* are held against the same part sliced with antialiasing: PrusaSlicer lights
//  what
//    is half covered, so grey values a level and 256 sqrt(2) d away from the half decide; what
//    remains is bounded as above. Ours lights a centre, which is never in a pixel without light.
#include <png.h>
#include <zip.h>

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/target.hpp"

namespace {

using Json = nlohmann::ordered_json;

struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
};

class Archive {
 public:
  explicit Archive(const std::string& path) : path_(path) {
    int code = 0;
    zip_ = zip_open(path.c_str(), ZIP_RDONLY, &code);
    if (!zip_) throw std::runtime_error(path + ": cannot be opened as a zip");
    for (zip_int64_t i = 0; i < zip_get_num_entries(zip_, 0); ++i) {
      const std::string name = zip_get_name(zip_, static_cast<zip_uint64_t>(i), 0);
      // Heights of edges are no slices.
      const bool picture = name.starts_with("preview") || name.starts_with("thumbnail") ||
                           name.starts_with("slicecorr/");
      if (name.ends_with(".png") && !picture) names_.push_back(name);
    }
    // Numbers have leading zeros, in UVJ as in SL1.
    std::sort(names_.begin(), names_.end());
  }
  ~Archive() { zip_discard(zip_); }
  Archive(const Archive&) = delete;
  Archive& operator=(const Archive&) = delete;

  int slices() const { return static_cast<int>(names_.size()); }

  Image slice(int n) const {
    const std::string& name = names_.at(static_cast<std::size_t>(n));
    zip_stat_t stat;
    zip_file_t* file = zip_fopen(zip_, name.c_str(), 0);
    if (!file || zip_stat(zip_, name.c_str(), 0, &stat) != 0) fail(name, "cannot be read");
    std::vector<std::uint8_t> bytes(stat.size);
    const bool whole =
        zip_fread(file, bytes.data(), bytes.size()) == static_cast<zip_int64_t>(bytes.size());
    zip_fclose(file);
    if (!whole) fail(name, "ends early");
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    if (!png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()))
      fail(name, png.message);
    if (png.format & (PNG_FORMAT_FLAG_COLOR | PNG_FORMAT_FLAG_ALPHA)) fail(name, "is not grey");
    png.format = PNG_FORMAT_GRAY;
    Image image{static_cast<int>(png.width), static_cast<int>(png.height), {}};
    image.pixels.resize(PNG_IMAGE_SIZE(png));
    if (!png_image_finish_read(&png, nullptr, image.pixels.data(), 0, nullptr)) {
      fail(name, png.message);
    }
    return image;
  }

 private:
  [[noreturn]] void fail(const std::string& name, const std::string& what) const {
    throw std::runtime_error(path_ + ": " + name + ": " + what);
  }
  std::string path_;
  zip_t* zip_ = nullptr;
  std::vector<std::string> names_;
};

double light(const Image& image) {
  std::uint64_t sum = 0;
  for (const std::uint8_t v : image.pixels) sum += v;
  return static_cast<double>(sum) / 255;
}

/// Light that changes between two images.
double change(const Image& a, const Image& b) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    sum += static_cast<std::uint64_t>(std::abs(int{a.pixels[i]} - int{b.pixels[i]}));
  }
  return static_cast<double>(sum) / 255;
}

/// The first and the last row with light, of the slices in the middle of each twentieth.
std::pair<int, int> lit_rows(const Archive& archive) {
  int top = INT_MAX, bottom = 0;
  for (int k = 0; k < 20; ++k) {
    const Image image = archive.slice(archive.slices() * (2 * k + 1) / 40);
    for (int y = 0; y < image.height; ++y) {
      const auto row = image.pixels.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
      if (std::none_of(row, row + image.width, [](std::uint8_t v) { return v > 0; })) continue;
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
  }
  return {std::min(top, bottom), bottom};
}

struct Edges {
  double grey = 0, all = 0;  ///< grey pixels; those and pixels beside a jump from dark to full
};
Edges edges_of(const Image& image) {
  Edges edges;
  const auto w = static_cast<std::size_t>(image.width);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    const int v = image.pixels[i];
    const bool grey = v > 0 && v < 255;
    const bool right = (i + 1) % w != 0 && std::abs(v - int{image.pixels[i + 1]}) == 255;
    const bool below = i + w < image.pixels.size() && std::abs(v - int{image.pixels[i + w]}) == 255;
    edges.grey += grey;
    edges.all += grey || right || below;
  }
  return edges;
}

/// Pixels lit whose coverage is at most `dark`, and dark ones whose coverage is at least `full`.
double misjudged(const Image& centres, const Image& coverage, int dark, int full) {
  double count = 0;
  for (std::size_t i = 0; i < centres.pixels.size(); ++i) {
    const int c = coverage.pixels[i];
    count += centres.pixels[i] ? c <= dark : c >= full;
  }
  return count;
}

/// Area of a cut through the mesh, by Green's theorem from its triangles one by one.
double section_mm2(const slicecorr::TriangleMesh& mesh, double z) {
  double area = 0;
  for (const auto& t : mesh.triangles) {
    // The two points where the triangle's outline goes up and down through the plane.
    double up[2]{}, down[2]{};
    int found = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& a = mesh.vertices[t[k]];
      const auto& b = mesh.vertices[t[(k + 1) % 3]];
      if ((a[2] < z) == (b[2] < z)) continue;
      // The same point from both sides of an edge.
      const auto& low = a[2] < b[2] ? a : b;
      const auto& high = a[2] < b[2] ? b : a;
      const double s = (z - low[2]) / (high[2] - low[2]);
      double* p = a[2] < z ? up : down;
      p[0] = low[0] + s * (high[0] - low[0]);
      p[1] = low[1] + s * (high[1] - low[1]);
      ++found;
    }
    if (found == 2) area += 0.5 * (down[0] * up[1] - up[0] * down[1]);
  }
  return std::abs(area);
}

struct Options {
  std::string mesh, ours, theirs;
  std::string coverage;  ///< the part sliced with antialiasing, where `ours` is not
  double layer_mm = 0, pixel_mm = 0;
  bool closed = false;
  int samples = 5;
};

Json compare(const Options& o) {
  Json report;
  std::vector<std::string> wrong;
  const auto check = [&](bool fine, const std::string& what) {
    if (!fine) wrong.push_back(what);
  };

  const slicecorr::TriangleMesh mesh = slicecorr::read_mesh(o.mesh);
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (const auto& v : mesh.vertices) {
    low = std::min(low, v[2]);
    high = std::max(high, v[2]);
  }
  // A slice is there when its middle is inside; either answer is right within rounding.
  const double exact = (high - low) / o.layer_mm - 0.5;
  const int least = static_cast<int>(std::ceil(exact - 1e-4));
  const int most = static_cast<int>(std::floor(exact + 1e-4)) + 1;
  report["triangles"] = mesh.triangles.size();
  check(!mesh.triangles.empty(), "the mesh has no triangles");

  const Archive ours(o.ours);
  report["slices"] = ours.slices();
  report["slices_expected"] = most;
  check(ours.slices() >= least && ours.slices() <= most,
        "ours has " + std::to_string(ours.slices()) + " slices, expected " + std::to_string(most));
  int common = ours.slices();
  if (!o.theirs.empty()) {
    const Archive theirs(o.theirs);
    report["slices_theirs"] = theirs.slices();
    // PrusaSlicer leaves out a layer that is not full.
    check(theirs.slices() >= least - 1 && theirs.slices() <= most,
          "theirs has " + std::to_string(theirs.slices()) + " slices, expected " +
              std::to_string(most) + " or one less");
    common = std::min(common, theirs.slices());
  }

  // What threads share out: bands of rows, those of the part's box.
  const auto [top, bottom] = lit_rows(ours);
  const Image first = ours.slice(0);
  slicecorr::Grid grid;
  grid.width_px = first.width;
  grid.height_px = first.height;
  grid.layers = ours.slices();
  const int rows = slicecorr::band_rows(grid);
  report["bands"] = bottom / rows - top / rows + 1;

  const double d = std::numbers::sqrt2 * 3 / 512 + 6e-6 / o.pixel_mm;
  for (int k = 1; k <= o.samples; ++k) {
    const int n = static_cast<int>(static_cast<std::int64_t>(common) * k / (o.samples + 1));
    const std::string name = "slice " + std::to_string(n);
    const Image mine = ours.slice(n);
    const Archive covered(o.coverage.empty() ? o.ours : o.coverage);
    const Image coverage = covered.slice(n);
    const Edges edges = edges_of(coverage);
    const double section_px =
        section_mm2(mesh, low + (n + 0.5) * o.layer_mm) / (o.pixel_mm * o.pixel_mm);
    Json s{{"slice", n}, {"ours_px", light(mine)}, {"mesh_px", section_px}};
    check(light(mine) > 0, name + " of ours is dark");
    if (!o.coverage.empty()) {
      check(misjudged(mine, coverage, 0, 255) == 0,
            name + " of ours has light where there is no part, or none inside");
    } else if (o.closed) {
      // Rounding of coordinates beside that of grey values.
      const double bound = edges.grey / 510 + 1e-6 * section_px + 1e-3;
      s["mesh_bound_px"] = bound;
      check(std::abs(light(mine) - section_px) <= bound,
            name + " of ours differs from the mesh's section");
    }
    if (!o.theirs.empty()) {
      const Image other = Archive(o.theirs).slice(n);
      if (other.width != mine.width || other.height != mine.height) {
        throw std::runtime_error(o.theirs + ": images are " + std::to_string(other.width) + " x " +
                                 std::to_string(other.height) + ", ours are " +
                                 std::to_string(mine.width) + " x " + std::to_string(mine.height));
      }
      double height_px = 0;
      for (const int m : {n - 1, n + 1}) {
        if (m < 0 || m >= covered.slices()) continue;
        height_px = std::max(height_px, 6e-6 / o.layer_mm * change(coverage, covered.slice(m)));
      }
      const double bound = edges.all * (std::numbers::sqrt2 * d + 1.0 / 255) + height_px;
      const int margin = static_cast<int>(std::ceil(1 + 256 * std::numbers::sqrt2 * d));
      const double apart = o.coverage.empty()
                               ? change(mine, other)
                               : misjudged(other, coverage, 127 - margin, 128 + margin);
      s["theirs_px"] = light(other);
      s["apart_px"] = apart;
      s["bound_px"] = bound;
      check(apart <= bound,
            name + ": " + std::to_string(apart) + " pixels apart, bound " + std::to_string(bound));
    }
    report["samples"].push_back(std::move(s));
  }
  report["wrong"] = wrong;
  return report;
}

int usage() {
  std::fprintf(
      stderr,
      "usage: compare_slices MESH LAYER_UM PIXEL_UM OURS.uvj [--theirs FILE.sl1]\n"
      "                      [--centres COVERAGE.uvj] [--closed] [--samples N]\n"
      "Compares the light of N slices (5) with the mesh's cross-sections and with the other file.\n"
      "--centres: OURS is sliced without antialiasing, COVERAGE with.\n"
      "--closed: the mesh is closed and does not overlap itself.\n"
      "JSON on stdout. Exit codes: 0 all within bounds, 1 not, 2 something can't be read.\n");
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return usage();
  Options o;
  o.mesh = argv[1];
  o.layer_mm = std::atof(argv[2]) / 1e3;
  o.pixel_mm = std::atof(argv[3]) / 1e3;
  o.ours = argv[4];
  for (int i = 5; i < argc; ++i) {
    const std::string a = argv[i];
    if (a == "--centres" && i + 1 < argc) {
      o.coverage = argv[++i];
    } else if (a == "--closed") {
      o.closed = true;
    } else if (a == "--theirs" && i + 1 < argc) {
      o.theirs = argv[++i];
    } else if (a == "--samples" && i + 1 < argc) {
      o.samples = std::atoi(argv[++i]);
    } else {
      return usage();
    }
  }
  if (!(o.layer_mm > 0) || !(o.pixel_mm > 0) || o.samples < 1) return usage();
  try {
    const Json report = compare(o);
    std::printf("%s\n", report.dump(1).c_str());
    for (const auto& w : report["wrong"])
      std::fprintf(stderr, "compare_slices: %s\n", w.get<std::string>().c_str());
    return report["wrong"].empty() ? 0 : 1;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "compare_slices: %s\n", e.what());
    return 2;
  }
}
