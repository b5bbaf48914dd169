// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a model part of a 3MF says of geometry, as it says it.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mesh/package_3mf.hpp"

namespace slicecorr::detail {

/// Triangles that a 3MF may have, those of beams and repeated parts counted.
inline constexpr std::size_t kMost3mfTriangles = 100'000'000;

/// Row vectors, as in the file: p' = (p, 1) * m, with the fourth column left out.
struct Transform3mf {
  std::array<Point3, 4> rows{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};

  Point3 apply(const Point3& p) const {
    Point3 result;
    for (std::size_t c = 0; c < 3; ++c) {
      result[c] = p[0] * rows[0][c] + p[1] * rows[1][c] + p[2] * rows[2][c] + rows[3][c];
    }
    return result;
  }
  double determinant() const {
    const auto& [a, b, c, shift] = rows;
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  /// Whether slices stay slices, and keep their heights.
  bool planar() const {
    return rows[0][2] == 0 && rows[1][2] == 0 && rows[2][0] == 0 && rows[2][1] == 0 &&
           rows[2][2] == 1;
  }
};

/// First `inner`, then `outer`.
Transform3mf combine(const Transform3mf& inner, const Transform3mf& outer);

enum class Cap3mf : std::uint8_t { sphere, hemisphere, butt };

/// Struts between vertices of the mesh that they belong to.
struct Lattice3mf {
  struct Beam {
    std::uint32_t v1, v2;
    double r1, r2;
    Cap3mf cap1, cap2;
  };
  struct Ball {
    std::uint32_t vertex;
    double radius;
  };
  enum class Clipping : std::uint8_t { none, inside, outside };
  enum class Balls : std::uint8_t { none, mixed, all };
  double least_length = 0, radius = 0;
  Cap3mf cap = Cap3mf::sphere;
  Balls ball_mode = Balls::none;
  std::optional<double> ball_radius;
  Clipping clipping = Clipping::none;
  std::uint32_t clipping_mesh = 0;  ///< an object's id, where it is clipped
  std::vector<Beam> beams;
  std::vector<Ball> balls;
};

/// What an object is made of besides itself.
struct Component3mf {
  std::uint32_t object = 0;
  std::string path;  ///< another model part; empty: this one
  Transform3mf transform;
  std::size_t line = 0;
};

enum class Type3mf : std::uint8_t { model, solid_support, support, surface, other };

struct Object3mf {
  std::uint32_t id = 0;
  std::size_t line = 0;
  Type3mf type = Type3mf::model;
  std::vector<Point3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::optional<Lattice3mf> lattice;
  std::vector<Component3mf> components;
  std::uint32_t slices = 0;  ///< the id of its slices; 0: none
  std::string slices_path;   ///< the model part that they are in; empty: this one
  bool coarse_mesh = false;  ///< the mesh does nothing but stand in for the slices
};

struct Item3mf {
  Component3mf object;
  bool printable = true;
};

/// Slices on top of each other: each fills its contours from the one below it up to its own top.
struct Slices3mf {
  struct Slice {
    double top = 0;
    std::vector<std::array<double, 2>> points;
    /// Indices of points, each contour's without its beginning again.
    std::vector<std::vector<std::uint32_t>> contours;
    bool open = false;  ///< one of its contours does not close
    std::size_t line = 0;
  };
  struct Reference {
    std::uint32_t id;
    std::string path;
    std::size_t line;
  };
  double bottom = 0;
  std::size_t line = 0;
  std::vector<Slice> slices;
  std::vector<Reference> references;  ///< in place of own slices
};

struct Model3mf {
  double unit_mm = 1;
  std::map<std::uint32_t, Object3mf> objects;
  std::map<std::uint32_t, Slices3mf> slices;
  std::vector<Item3mf> items;
  /// Elements of extensions that are not read and not required: a line for each extension.
  std::vector<std::string> notes;
};

/// Reads a model part, with all checks that need no other part. Throws `InputError`.
Model3mf read_model_3mf(const Package3mf& package, const std::string& part,
                        const std::string& path);

}  // namespace slicecorr::detail
