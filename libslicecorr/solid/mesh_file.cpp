// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "solid/mesh_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <iterator>

#include "slicecorr/error.hpp"
#include "stack/container/zip_output.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {

static_assert(std::endian::native == std::endian::little, "STL and PLY are written as in memory");

namespace {

using Point = std::array<float, 3>;

struct Indexed {
  std::vector<Point> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Numbers of points by the bits of their places, in the order in which they come first: in one table, because a node of
/// its own for each of millions of points takes most of the time.
class PointNumbers {
 public:
  /// `expected`: how many points there will be about.
  PointNumbers(std::vector<Point>& points, std::uint64_t expected)
      : points_(points), slots_(std::bit_ceil(std::max<std::uint64_t>(1024, 2 * expected)), kNone) {
    points_.reserve(expected);
  }

  std::uint32_t number(const Point& p) {
    const std::uint64_t hash = hash_of(p);
    // Most corners were seen a moment ago.
    std::uint32_t& recent = recent_[hash >> 52];
    if (recent != kNone && same(points_[recent], p)) return recent;
    if (2 * points_.size() >= slots_.size()) widen();
    std::uint32_t& slot = slots_[place(p, hash)];
    if (slot == kNone) {
      slot = static_cast<std::uint32_t>(points_.size());
      points_.push_back(p);
    }
    return recent = slot;
  }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  static bool same(const Point& p, const Point& q) {
    using Bits = std::array<std::uint32_t, 3>;
    return std::bit_cast<Bits>(p) == std::bit_cast<Bits>(q);
  }
  static std::uint64_t hash_of(const Point& p) {
    std::uint64_t h = 0;
    for (const float v : p) {
      h = (h ^ std::bit_cast<std::uint32_t>(v)) * 0x9E3779B97F4A7C15ULL;
      h ^= h >> 29;
    }
    return h;
  }
  /// The slot of a point, or the free one where it belongs.
  std::size_t place(const Point& p, std::uint64_t hash) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = static_cast<std::size_t>(hash) & mask;
    while (slots_[at] != kNone && !same(points_[slots_[at]], p)) at = (at + 1) & mask;
    return at;
  }
  void widen() {
    std::fill(slots_.begin(), slots_.end(), kNone);
    slots_.resize(2 * slots_.size(), kNone);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      slots_[place(points_[i], hash_of(points_[i]))] = static_cast<std::uint32_t>(i);
    }
  }

  std::vector<Point>& points_;
  std::vector<std::uint32_t> slots_;  ///< a power of two, at most half of them taken
  std::vector<std::uint32_t> recent_ = std::vector<std::uint32_t>(4096, kNone);
};

Indexed indexed(const Triangles& triangles, std::uint64_t count) {
  Indexed mesh;
  mesh.triangles.reserve(count);
  // A closed surface has half as many corners as triangles.
  PointNumbers numbers(mesh.points, count / 2 + count / 16);
  triangles([&](const Triangle& t) {
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) corners[k] = numbers.number(t[k]);
    mesh.triangles.push_back(corners);
  });
  return mesh;
}

/// A file that appears under its name only when it is complete.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path) : path_(path) {
    struct stat status;
    if (::stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
      throw DeviceError(path + ": can't be written: is no ordinary file");
    }
    part_ = make_temporary(path);
    file_ = ::open(part_.c_str(), O_WRONLY | O_CLOEXEC);
    if (file_ < 0) throw DeviceError(errno_message(path, "can't be written"));
    buffer_.reserve(kBuffer);
  }
  ~OutputFile() {
    if (file_ >= 0) ::close(file_);
    if (!part_.empty()) ::unlink(part_.c_str());
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void put(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const char*>(data);
    buffer_.insert(buffer_.end(), bytes, bytes + size);
    if (buffer_.size() >= kBuffer) flush();
  }
  void finish() {
    flush();
    const int file = std::exchange(file_, -1);
    const bool synced = ::fsync(file) == 0;
    const int error = errno;
    if (::close(file) != 0 || !synced) fail(error);
    if (::rename(part_.c_str(), path_.c_str()) != 0) fail(errno);
    part_.clear();
    sync_folder(path_parts(path_).folder);
  }

 private:
  static constexpr std::size_t kBuffer = 1 << 20;
  [[noreturn]] void fail(int error) const {
    throw DeviceError(errno_message(path_, "can't be written", error));
  }
  void flush() {
    for (std::size_t done = 0; done < buffer_.size();) {
      const ssize_t n = ::write(file_, buffer_.data() + done, buffer_.size() - done);
      if (n > 0) {
        done += static_cast<std::size_t>(n);
      } else if (n == 0 || errno != EINTR) {
        fail(n == 0 ? ENOSPC : errno);
      }
    }
    buffer_.clear();
  }
  std::string path_, part_;
  int file_ = -1;
  std::vector<char> buffer_;
};

Point normal_of(const Triangle& t) {
  double u[3], v[3];
  for (std::size_t k = 0; k < 3; ++k) {
    u[k] = static_cast<double>(t[1][k]) - static_cast<double>(t[0][k]);
    v[k] = static_cast<double>(t[2][k]) - static_cast<double>(t[0][k]);
  }
  const double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                       u[0] * v[1] - u[1] * v[0]};
  const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
  if (!(length > 0)) return {};
  return {static_cast<float>(n[0] / length), static_cast<float>(n[1] / length),
          static_cast<float>(n[2] / length)};
}

void write_stl(const std::string& path, std::uint64_t count, const Triangles& triangles,
               const ExecutionContext& context) {
  OutputFile file(path);
  char header[84] = "binary STL of slicecorr: the surface of dose 1, mm, z from the platform";
  const auto number = static_cast<std::uint32_t>(count);
  std::memcpy(header + 80, &number, sizeof number);
  file.put(header, sizeof header);
  std::uint64_t done = 0;
  triangles([&](const Triangle& t) {
    char facet[50] = {};
    const Point normal = normal_of(t);
    std::memcpy(facet, normal.data(), sizeof normal);
    std::memcpy(facet + 12, t.data(), sizeof t);
    file.put(facet, sizeof facet);
    if ((++done & 0xFFFF) == 0) {
      context.check_cancelled();
      context.report("write", static_cast<double>(done) / static_cast<double>(count));
    }
  });
  file.finish();
}

void write_ply(const std::string& path, std::uint64_t count, const Triangles& triangles,
               const ExecutionContext& context) {
  OutputFile file(path);
  const Indexed mesh = indexed(triangles, count);
  context.check_cancelled();
  const std::string header = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment the surface of dose 1, mm, z from the "
      "platform\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement "
      "face {}\nproperty list uchar uint vertex_indices\nend_header\n",
      mesh.points.size(), mesh.triangles.size());
  file.put(header.data(), header.size());
  for (const Point& p : mesh.points) file.put(p.data(), sizeof p);
  for (const auto& t : mesh.triangles) {
    char face[13] = {3};
    std::memcpy(face + 1, t.data(), sizeof t);
    file.put(face, sizeof face);
  }
  file.finish();
}

void write_3mf(const std::string& path, std::uint64_t count, const Triangles& triangles,
               const ExecutionContext& context) {
  ZipOutput zip(path);
  const Indexed mesh = indexed(triangles, count);
  context.check_cancelled();
  const auto bytes = [](std::string_view text) {
    return std::vector<std::uint8_t>(text.begin(), text.end());
  };
  constexpr const char* xml = R"(<?xml version="1.0" encoding="UTF-8"?>)";
  zip.add(
      "[Content_Types].xml",
      bytes(fmt::format(
          R"({}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">)"
          R"(<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>)"
          R"(<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>)",
          xml)));
  zip.add(
      "_rels/.rels",
      bytes(fmt::format(
          R"({}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">)"
          R"(<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>)",
          xml)));
  std::vector<std::uint8_t> model = bytes(fmt::format(
      R"({}<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">)"
      R"(<resources><object id="1" type="model"><mesh><vertices>)",
      xml));
  const auto out = std::back_inserter(model);
  for (const Point& p : mesh.points) {
    fmt::format_to(out, R"(<vertex x="{}" y="{}" z="{}"/>)", p[0], p[1], p[2]);
  }
  fmt::format_to(out, "</vertices><triangles>");
  for (const auto& t : mesh.triangles) {
    fmt::format_to(out, R"(<triangle v1="{}" v2="{}" v3="{}"/>)", t[0], t[1], t[2]);
  }
  fmt::format_to(
      out,
      R"(</triangles></mesh></object></resources><build><item objectid="1"/></build></model>)");
  zip.add("3D/3dmodel.model", std::move(model));
  zip.finish(context, {});
}

}  // namespace

MeshFormat mesh_format(const std::string& path) {
  const auto ends = [&](std::string_view end) {
    return std::filesystem::path(path).extension() == end;
  };
  if (ends(".stl")) return MeshFormat::stl;
  if (ends(".ply")) return MeshFormat::ply;
  if (ends(".3mf")) return MeshFormat::three_mf;
  throw InputError(path, "", "expected an output that ends in .stl, .ply or .3mf");
}

void write_triangles(const std::string& path, MeshFormat format, std::uint64_t count,
                     const Triangles& triangles, const ExecutionContext& context) {
  if (count > 0x7fffffff) {
    throw InputError(path, "",
                     fmt::format("the surface has {} triangles, a mesh file holds at most {}; take "
                                 "fewer pixels (reduce)",
                                 count, 0x7fffffff));
  }
  switch (format) {
    case MeshFormat::stl:
      return write_stl(path, count, triangles, context);
    case MeshFormat::ply:
      return write_ply(path, count, triangles, context);
    case MeshFormat::three_mf:
      return write_3mf(path, count, triangles, context);
  }
}

TriangleMesh merge_corners(const Triangles& triangles, std::uint64_t count) {
  Indexed merged = indexed(triangles, count);
  TriangleMesh mesh;
  mesh.vertices.reserve(merged.points.size());
  for (const Point& p : merged.points) {
    mesh.vertices.push_back(
        {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
  }
  mesh.triangles = std::move(merged.triangles);
  return mesh;
}

}  // namespace slicecorr::detail
