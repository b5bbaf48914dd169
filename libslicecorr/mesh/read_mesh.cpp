// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <numbers>

#include "mesh/half_edges.hpp"
#include "mesh/mesh_parts.hpp"
#include "mesh/unpacked.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/mesh_or_points.hpp"
#include "support/files/unpacked_limit.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr {
namespace detail {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{4} << 30;
/// What a thread reads at once.
constexpr std::uint64_t kReadBytes = std::uint64_t{4} << 20;

[[noreturn]] void throw_too_large(const std::string& path, std::uint64_t most) {
  throw InputError(path, "", "is larger than " + std::to_string(most >> 30) + " GiB");
}

class OpenFile {
 public:
  explicit OpenFile(const std::string& path) : path_(path) {
    file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file_ < 0) {
      throw InputError(path, "", std::string("can't be opened: ") + std::strerror(errno));
    }
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  ~OpenFile() { ::close(file_); }
  /// Returns how many bytes came: fewer where the file ends.
  std::uint64_t read(char* to, std::uint64_t size, std::uint64_t from) const {
    std::uint64_t done = 0;
    while (done < size) {
      const ssize_t got = ::pread(file_, to + done, size - done, static_cast<off_t>(from + done));
      if (got == 0) break;
      if (got > 0) {
        done += static_cast<std::uint64_t>(got);
      } else if (errno != EINTR) {
        throw InputError(path_, "", std::string("can't be read: ") + std::strerror(errno));
      }
    }
    return done;
  }

 private:
  const std::string& path_;
  int file_ = -1;
};

FileBytes unpack_gzip(const std::string& path) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose_r);
  if (!file) throw InputError(path, "", std::string("can't be opened: ") + std::strerror(errno));
  gzbuffer(file.get(), 1 << 18);
  std::error_code error;
  const std::uint64_t packed = std::filesystem::file_size(path, error);
  const std::uint64_t most = most_unpacked_bytes(error ? 0 : packed, kLargestRatio);
  FileBytes bytes;
  std::size_t size = 0;
  for (;;) {
    if (size == bytes.size()) bytes.resize(std::max<std::size_t>(1 << 20, 2 * size));
    const auto room = static_cast<unsigned>(std::min<std::size_t>(bytes.size() - size, 1 << 30));
    const int got = gzread(file.get(), bytes.data() + size, room);
    if (size == 0 && got > 0 && gzdirect(file.get())) {
      throw InputError(path, "", "is not gzip-compressed, though its name ends in .gz");
    }
    if (got > 0) size += static_cast<std::size_t>(got);
    if (size > kMostUnpackedBytes) throw_too_large(path, kMostUnpackedBytes);
    if (size > most) {
      throw InputError(path, "",
                       "unpacks to more than " + std::to_string(most) + " bytes, " +
                           std::to_string(kLargestRatio) + " times its size; expected a mesh");
    }
    // A file cut in the middle gives its beginning first and the error only at its end.
    int code = Z_OK;
    const std::string message = gzerror(file.get(), &code);
    if (got < 0 || (code != Z_OK && code != Z_STREAM_END)) {
      throw InputError(path, "", "can't be unpacked: " + message);
    }
    if (got == 0) break;
  }
  bytes.resize(size);
  return bytes;
}

struct Format {
  std::string extension;  // lower case, with its dot
  bool packed = false;
};

Format format_of(const std::string& path) {
  std::filesystem::path name = std::filesystem::path(path).filename();
  Format format{lower_case(name.extension().string()), false};
  if (format.extension == ".gz") {
    format = {lower_case(name.stem().extension().string()), true};
  }
  return format;
}

}  // namespace

FileBytes read_bytes(const std::string& path, const ExecutionContext& context) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path, "", "no such file");
  if (std::filesystem::is_directory(status)) {
    throw InputError(path, "", "is a directory, expected a mesh file");
  }
  // A pipe or a device might never end.
  if (!std::filesystem::is_regular_file(status))
    throw InputError(path, "", "is not a regular file");
  if (format_of(path).packed) return unpack_gzip(path);

  const OpenFile file(path);
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error) throw InputError(path, "", "can't be read: " + error.message());
  if (size > kMostBytes) throw_too_large(path, kMostBytes);
  FileBytes bytes;
  bytes.resize(size);
  std::atomic<std::uint64_t> came = 0;
  parallel_for(silent(context), "", (size + kReadBytes - 1) / kReadBytes, [&](std::size_t i) {
    const std::uint64_t from = i * kReadBytes;
    came += file.read(bytes.data() + from, std::min(kReadBytes, size - from), from);
  });
  if (came != size) {
    throw InputError(
        path, "",
        "can't be read: " + std::to_string(came) + " of " + std::to_string(size) + " bytes came");
  }
  return bytes;
}

}  // namespace detail

double detail::scale_to_mm(const Placement& placement, double file_unit_mm) {
  switch (placement.units) {
    case Units::automatic:
      return file_unit_mm * placement.scale;
    case Units::mm:
      return placement.scale;
    case Units::inch:
      return 25.4 * placement.scale;
    case Units::m:
      return 1000.0 * placement.scale;
  }
  throw InputError("unknown unit of length");
}

namespace {

void check(const Placement& placement) {
  if (!std::isfinite(placement.scale) || placement.scale <= 0) {
    throw InputError("placement: scale " + std::to_string(placement.scale) +
                     ", expected a number above 0");
  }
  for (const double degrees : placement.rotate_deg) {
    if (!std::isfinite(degrees)) {
      throw InputError("placement: rotation " + std::to_string(degrees) +
                       ", expected a finite number of degrees");
    }
  }
}

/// What a length becomes so that it shrinks to what it was.
Point3 enlarged_by(const Shrinkage& shrinkage) {
  return {1 / shrinkage.left(0), 1 / shrinkage.left(1), 1 / shrinkage.left(2)};
}

struct SineCosine {
  double sine, cosine;
};

// Exact for multiples of 90 degrees, so that boxes stay boxes.
SineCosine sine_cosine(double degrees) {
  const double rest = std::remainder(degrees, 360.0);  // exact, -180..180
  if (rest == 0) return {0, 1};
  if (rest == 90) return {1, 0};
  if (rest == -90) return {-1, 0};
  if (std::abs(rest) == 180) return {0, -1};
  const double radians = rest * (std::numbers::pi / 180.0);
  return {std::sin(radians), std::cos(radians)};
}

void place(TriangleMesh& mesh, const Placement& placement, double file_unit_mm,
           const std::string& path, const ExecutionContext& context) {
  const double factor = detail::scale_to_mm(placement, file_unit_mm);
  const auto turn_x = sine_cosine(placement.rotate_deg[0]);
  const auto turn_y = sine_cosine(placement.rotate_deg[1]);
  const auto turn_z = sine_cosine(placement.rotate_deg[2]);
  const Point3 larger = enlarged_by(placement.shrinkage);
  constexpr std::size_t chunk_vertices = 1 << 15;
  const std::size_t count = mesh.vertices.size();
  parallel_for(detail::silent(context), "", (count + chunk_vertices - 1) / chunk_vertices,
               [&](std::size_t chunk) {
                 const auto [sx, cx] = turn_x;
                 const auto [sy, cy] = turn_y;
                 const auto [sz, cz] = turn_z;
                 for (std::size_t i = chunk_vertices * chunk;
                      i < std::min(count, chunk_vertices * (chunk + 1)); ++i) {
                   Point3& point = mesh.vertices[i];
                   const Point3 p{point[0] * factor, point[1] * factor, point[2] * factor};
                   const Point3 a{p[0], cx * p[1] - sx * p[2], sx * p[1] + cx * p[2]};
                   const Point3 b{cy * a[0] + sy * a[2], a[1], cy * a[2] - sy * a[0]};
                   // Adding 0.0 turns -0.0 into 0.0.
                   point = {cz * b[0] - sz * b[1] + 0.0, sz * b[0] + cz * b[1] + 0.0, b[2] + 0.0};
                   if (placement.shrinkage.shrinks()) {
                     for (std::size_t k = 0; k < 3; ++k) point[k] *= larger[k];
                   }
                   detail::require_finite(point, path, "scaled vertex");
                 }
               });
}

}  // namespace

bool is_mesh_name(const std::string& path) {
  const detail::Format format = detail::format_of(path);
  const std::string& extension = format.extension;
  return extension == ".stl" || extension == ".obj" || extension == ".ply" || extension == ".off" ||
         extension == ".3mf";
}

namespace {

TriangleMesh read_file(const std::string& path, const Placement& placement, bool or_points,
                       const ExecutionContext& context, std::vector<std::string>* notes) {
  check(placement);
  const std::string extension = detail::format_of(path).extension;
  detail::FileBytes bytes = detail::read_bytes(path, context);
  if (bytes.size() == 0) throw InputError(path, "", "is empty");
  double file_unit_mm = 1.0;
  TriangleMesh mesh;
  std::vector<std::string> own_notes;
  if (extension == ".stl") {
    mesh = detail::read_stl(bytes.view(), path, context);
  } else if (extension == ".obj") {
    mesh = detail::read_obj(bytes.view(), path, own_notes, or_points);
  } else if (extension == ".ply") {
    mesh = detail::read_ply(bytes.view(), path, or_points);
  } else if (extension == ".off") {
    mesh = detail::read_off(bytes.view(), path);
  } else if (extension == ".3mf") {
    mesh = detail::read_3mf(bytes.view(), path, placement, file_unit_mm, own_notes);
  } else {
    throw InputError(path, "",
                     "unknown kind of file '" + extension +
                         "', expected .stl, .obj, .ply, .off or .3mf (also with .gz)");
  }
  bytes = {};
  for (const std::string& note : own_notes) context.tell(path + ": " + note);
  if (notes) notes->insert(notes->end(), own_notes.begin(), own_notes.end());
  place(mesh, placement, file_unit_mm, path, context);
  return mesh;
}

}  // namespace

TriangleMesh read_mesh(const std::string& path, const Placement& placement,
                       const ExecutionContext& context, std::vector<std::string>* notes) {
  return read_file(path, placement, false, context, notes);
}

TriangleMesh read_mesh_or_points(const std::string& path, const ExecutionContext& context,
                                 std::vector<std::string>* notes) {
  return read_file(path, {}, true, context, notes);
}

Units units_named(std::string_view name) {
  if (name == "mm") return Units::mm;
  if (name == "inch") return Units::inch;
  if (name == "m") return Units::m;
  return Units::automatic;
}

void widen_box(const TriangleMesh& mesh, Point3& low, Point3& high) {
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!mesh.adds(i)) continue;
    for (const std::uint32_t v : mesh.triangles[i]) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], mesh.vertices[v][k]);
        high[k] = std::max(high[k], mesh.vertices[v][k]);
      }
    }
  }
}

double fit_scale(const std::vector<std::string>& files, const Placement& placement,
                 double longest_mm) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  Point3 low{inf, inf, inf}, high{-inf, -inf, -inf};
  for (const std::string& path : files) {
    widen_box(read_mesh(path, placement), low, high);
  }
  const double longest = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
  if (!(longest > 0)) {
    throw InputError(files.empty() ? "" : files.front(), "", "has no size that could be scaled");
  }
  return longest_mm / longest;
}

}  // namespace slicecorr
