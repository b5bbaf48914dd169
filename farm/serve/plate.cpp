// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/plate.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm::detail {

namespace {

static_assert(std::endian::native == std::endian::little, "the files are little-endian");

constexpr std::size_t kLayersHead = 8;

struct Box {
  Point3 lower, upper;
};

Box box_of(const TriangleMesh& mesh) {
  Box box;
  box.lower.fill(std::numeric_limits<double>::infinity());
  box.upper.fill(-std::numeric_limits<double>::infinity());
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t v : triangle) {
      for (std::size_t k = 0; k < 3; ++k) {
        box.lower[k] = std::min(box.lower[k], mesh.vertices[v][k]);
        box.upper[k] = std::max(box.upper[k], mesh.vertices[v][k]);
      }
    }
  }
  return box;
}

template <typename T>
void put(std::string& text, const T& value) {
  text.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Corners in the same cell of a grid of `cells` along the longest side become one.
TriangleMesh clustered(const TriangleMesh& mesh, const Box& box, int cells) {
  double longest = 0;
  for (std::size_t k = 0; k < 3; ++k) longest = std::max(longest, box.upper[k] - box.lower[k]);
  const double step = longest > 0 ? longest / cells : 1;
  TriangleMesh out;
  std::unordered_map<std::uint64_t, std::uint32_t> first;
  std::vector<std::uint32_t> joined(mesh.vertices.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    std::uint64_t key = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double at = std::clamp((mesh.vertices[v][k] - box.lower[k]) / step, 0.0, 1e6);
      key = key << 21 | static_cast<std::uint64_t>(at);
    }
    const auto [place, added] =
        first.try_emplace(key, static_cast<std::uint32_t>(out.vertices.size()));
    if (added) out.vertices.push_back(mesh.vertices[v]);
    joined[v] = place->second;
  }
  for (const auto& t : mesh.triangles) {
    const std::array<std::uint32_t, 3> n{joined[t[0]], joined[t[1]], joined[t[2]]};
    if (n[0] != n[1] && n[1] != n[2] && n[0] != n[2]) out.triangles.push_back(n);
  }
  return out;
}

/// What is taken away has no surface of its own to be seen.
TriangleMesh shown_of(const TriangleMesh& mesh) {
  TriangleMesh out;
  out.vertices = mesh.vertices;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (mesh.adds(i)) out.triangles.push_back(mesh.triangles[i]);
  }
  return out;
}

/// A slice's pixels in a box, joined `step` by `step`: the brightest counts.
GreyImage shrunk(const std::vector<std::uint8_t>& pixels, int width_px, const PixelBox& box,
                 int step) {
  GreyImage image;
  image.width_px = (box.width() + step - 1) / step;
  image.height_px = (box.height() + step - 1) / step;
  image.pixels.assign(static_cast<std::size_t>(image.width_px) * image.height_px, 0);
  for (int y = box.y0; y < box.y1; ++y) {
    const std::uint8_t* row = pixels.data() + static_cast<std::size_t>(y) * width_px;
    std::uint8_t* out =
        image.pixels.data() + static_cast<std::size_t>((y - box.y0) / step) * image.width_px;
    for (int x = box.x0; x < box.x1; ++x) {
      std::uint8_t& to = out[(x - box.x0) / step];
      to = std::max(to, row[x]);
    }
  }
  return image;
}

/// The stack's images, slice after slice.
void each_slice(const StackReader& stack, const ExecutionContext& context,
                const std::function<void(int, const std::vector<std::uint8_t>&)>& use) {
  const Grid& grid = stack.grid();
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(grid.width_px) * grid.height_px);
  for (int n = 0; n < grid.layers; ++n) {
    context.check_cancelled();
    stack.read_slice(n, pixels.data());
    use(n, pixels);
  }
}

std::string layers_file(const StackReader& stack, const PixelBox& box, int step,
                        const ExecutionContext& context) {
  const auto layers = static_cast<std::uint32_t>(stack.grid().layers);
  std::vector<std::uint64_t> offsets;
  std::string images;
  const std::uint64_t begin = kLayersHead + 8 * (std::uint64_t{layers} + 1);
  each_slice(stack, context, [&](int, const std::vector<std::uint8_t>& pixels) {
    offsets.push_back(begin + images.size());
    const auto png = encode_png(shrunk(pixels, stack.grid().width_px, box, step));
    images.append(reinterpret_cast<const char*>(png.data()), png.size());
  });
  offsets.push_back(begin + images.size());
  std::string text = "SCL1";
  put(text, layers);
  for (const std::uint64_t o : offsets) put(text, o);
  return text + images;
}

}  // namespace

TriangleMesh simplified(const TriangleMesh& mesh, std::size_t most) {
  if (mesh.triangles.size() <= most) return mesh;
  const Box box = box_of(mesh);
  for (int cells = 1024;; cells = cells * 3 / 4) {
    TriangleMesh out = clustered(mesh, box, cells);
    if (out.triangles.size() <= most || cells < 8) return out;
  }
}

TriangleMesh cell_faces(const SliceSource& stack, int most_cells) {
  const Grid& grid = stack.grid();
  const PixelBox box = stack.bounds();
  TriangleMesh mesh;
  if (box.empty()) return mesh;
  const auto step_of = [&](int n) { return (n + most_cells - 1) / most_cells; };
  const int sx = step_of(box.width()), sy = step_of(box.height()), sz = step_of(grid.layers);
  const int nx = (box.width() + sx - 1) / sx, ny = (box.height() + sy - 1) / sy,
            nz = (grid.layers + sz - 1) / sz;
  std::vector<int> lit(static_cast<std::size_t>(nx) * ny * nz);
  const auto at = [&](int x, int y, int z) {
    return (static_cast<std::size_t>(z) * ny + y) * nx + x;
  };
  stack.read_band(box, [&](int n, const std::uint8_t* rows) {
    if (!rows) return;
    for (int y = 0; y < box.height(); ++y) {
      for (int x = 0; x < box.width(); ++x) {
        lit[at(x / sx, y / sy, n / sz)] +=
            rows[static_cast<std::size_t>(y) * box.width() + x] > 127;
      }
    }
  });
  const auto full = [&](int x, int y, int z) {
    if (x < 0 || y < 0 || z < 0 || x >= nx || y >= ny || z >= nz) return false;
    return 2 * lit[at(x, y, z)] >= sx * sy * sz;
  };
  const double dx = sx * grid.pixel_x_um * 1e-3, dy = sy * grid.pixel_y_um * 1e-3,
               dz = sz * grid.layer_um * 1e-3;
  const double x0 = box.x0 * grid.pixel_x_um * 1e-3;
  // Row 0 is at the largest y.
  const double y0 = (grid.height_px - box.y0) * grid.pixel_y_um * 1e-3;
  const auto face = [&](const std::array<Point3, 4>& corners, bool turned) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (const Point3& c : corners) {
      mesh.vertices.push_back({x0 + c[0] * dx, y0 - c[1] * dy, c[2] * dz});
    }
    const std::uint32_t second = turned ? 2 : 1;
    mesh.triangles.push_back({first, first + second, first + 3 - second});
    mesh.triangles.push_back({first, first + 1 + second, first + 4 - second});
  };
  for (int z = 0; z < nz; ++z) {
    for (int y = 0; y < ny; ++y) {
      for (int x = 0; x < nx; ++x) {
        if (!full(x, y, z)) continue;
        for (int axis = 0; axis < 3; ++axis) {
          for (const int side : {-1, 1}) {
            std::array<int, 3> next{x, y, z};
            next[axis] += side;
            if (full(next[0], next[1], next[2])) continue;
            const Point3 base{double(x), double(y), double(z)};
            std::array<Point3, 4> corners{base, base, base, base};
            const int u = (axis + 1) % 3, v = (axis + 2) % 3;
            for (int c = 0; c < 4; ++c) {
              corners[c][axis] += side > 0 ? 1 : 0;
              corners[c][u] += c == 1 || c == 2 ? 1 : 0;
              corners[c][v] += c >= 2 ? 1 : 0;
            }
            // y is mirrored, which turns every face.
            face(corners, side > 0);
          }
        }
      }
    }
  }
  return mesh;
}

std::string triangles_file(const TriangleMesh& mesh) {
  const Box box = box_of(mesh);
  std::string text = "SCP1";
  put(text, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const Point3* p : {&box.lower, &box.upper}) {
    for (const double c : *p) put(text, static_cast<float>(std::isfinite(c) ? c : 0.0));
  }
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t v : t) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double size = box.upper[k] - box.lower[k];
        const double share = size > 0 ? (mesh.vertices[v][k] - box.lower[k]) / size : 0;
        put(text, static_cast<std::uint16_t>(std::lround(65535 * share)));
      }
    }
  }
  return text;
}

std::string layer_png(const std::string& path, std::int64_t layer) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (file < 0) return {};
  const auto read = [&](void* to, std::size_t bytes, std::uint64_t from) {
    return ::pread(file, to, bytes, static_cast<off_t>(from)) == static_cast<ssize_t>(bytes);
  };
  std::string png;
  char head[kLayersHead];
  std::uint32_t layers = 0;
  std::uint64_t ends[2] = {};
  if (read(head, sizeof head, 0) && std::memcmp(head, "SCL1", 4) == 0) {
    std::memcpy(&layers, head + 4, sizeof layers);
    constexpr std::uint64_t most = 64 << 20;
    if (layer >= 0 && layer < layers &&
        read(ends, sizeof ends, kLayersHead + 8 * static_cast<std::uint64_t>(layer)) &&
        ends[1] > ends[0] && ends[1] - ends[0] < most) {
      png.resize(ends[1] - ends[0]);
      if (!read(png.data(), png.size(), ends[0])) png.clear();
    }
  }
  ::close(file);
  return png;
}

void write_plate(const PlateJob& job, const ExecutionContext& context) {
  const Printer printer = load_display(job.printer);
  const StackReader stack(job.stack, job.folder, context, {0, 0, job.layer_um});
  if (!stack.info().layer_heights_um.empty()) {
    throw InputError(job.stack, "",
                     "has layers of different heights, which are not drawn; expected layers of one "
                     "height");
  }
  TriangleMesh mesh;
  nlohmann::ordered_json defects = nlohmann::ordered_json::array();
  nlohmann::ordered_json parts = nlohmann::ordered_json::array();
  std::size_t triangles = 0;
  std::vector<cli::PlacedPart> placed;
  if (!job.meshes.parts.empty()) placed = cli::placed_parts(job.meshes, printer, context);
  for (const cli::PlacedPart& part : placed) triangles += part.on_plate.triangles.size();
  for (const cli::PlacedPart& part : placed) {
    const std::string name = std::filesystem::path(part.path).filename().string();
    for (const std::string& note : part.notes) defects.push_back(name + ": " + note);
    if (part.report.defects.any()) defects.push_back(name + ": " + describe(part.report.defects));
    // Each part has its share of what is shown.
    const double share = static_cast<double>(part.on_plate.triangles.size()) /
                         static_cast<double>(std::max<std::size_t>(1, triangles));
    const TriangleMesh solid = shown_of(part.on_plate);
    const TriangleMesh shown =
        triangles <= kMostShownTriangles
            ? solid
            : simplified(solid, std::max<std::size_t>(
                                    500, static_cast<std::size_t>(
                                             share * static_cast<double>(kMostShownTriangles))));
    const Box box = box_of(part.on_plate);
    parts.push_back({{"name", name},
                     {"from", mesh.triangles.size()},
                     {"to", mesh.triangles.size() + shown.triangles.size()},
                     {"x_mm", 0.5 * (box.lower[0] + box.upper[0])},
                     {"y_mm", 0.5 * (box.lower[1] + box.upper[1])},
                     {"quarter_turns", part.quarter_turns}});
    append(mesh, shown);
  }
  const bool cells = placed.empty();
  if (cells) {
    // Lattices have many faces: larger cells then.
    for (int most = 96; most >= 8; most = most * 3 / 4) {
      mesh = cell_faces(stack, most);
      if (mesh.triangles.size() <= kMostShownTriangles) break;
    }
  }
  const Grid& grid = stack.grid();
  const PixelBox box = stack.bounds();
  const Box size = box_of(mesh);
  const int step =
      std::max(1, (std::max(box.width(), box.height()) + kMostLayerPixels - 1) / kMostLayerPixels);
  const Grid plate = plate_grid(printer);
  const StackInfo& info = stack.info();
  nlohmann::ordered_json json;
  json["from"] = cells ? "slices" : "mesh";
  json["triangles"] = triangles;
  json["shown_triangles"] = mesh.triangles.size();
  json["lower_mm"] = mesh.triangles.empty() ? Point3{} : size.lower;
  json["upper_mm"] = mesh.triangles.empty() ? Point3{} : size.upper;
  json["plate_mm"] = {plate.width_px * plate.pixel_x_um * 1e-3,
                      plate.height_px * plate.pixel_y_um * 1e-3};
  json["travel_mm"] = printer.travel_mm > 0 ? nlohmann::ordered_json(printer.travel_mm) : nullptr;
  json["layers"] = grid.layers;
  json["layer_um"] = grid.layer_um;
  json["pixel_um"] = {grid.pixel_x_um, grid.pixel_y_um};
  json["box_px"] = {box.x0, box.y0, box.x1, box.y1};
  json["pixels_joined"] = step;
  json["volume_ml"] = info.part_volume_mm3 * 1e-3;
  json["defects"] = defects;
  json["parts"] = parts;
  cli::write_text_file(job.folder + "/plate.bin", triangles_file(mesh));
  cli::write_text_file(job.folder + "/layers.bin", layers_file(stack, box, step, context));
  cli::write_text_file(job.folder + "/plate.json", json.dump(1) + "\n");
}

}  // namespace slicecorr::farm::detail
