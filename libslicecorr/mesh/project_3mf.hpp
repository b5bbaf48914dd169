// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What slicers note beside the model of a project: which of its volumes are no parts.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "mesh/package_3mf.hpp"

namespace slicecorr::detail {

enum class Volume3mf : std::uint8_t { part, negative, modifier, blocker, enforcer };

struct Project3mf {
  /// Triangles of an object's mesh, the last one included (PrusaSlicer and its kin).
  struct Range {
    std::uint32_t first = 0, last = 0;
    Volume3mf volume = Volume3mf::part;
    std::size_t line = 0;
  };
  /// Components of an object by the object that they name (Bambu Studio and its kin).
  using Parts = std::map<std::uint32_t, Volume3mf>;

  std::string name;  ///< of the part that says so, for errors
  std::map<std::uint32_t, std::vector<Range>> ranges;
  std::map<std::uint32_t, Parts> parts;
};

/// Reads what there is; nothing is noted where there is none. Throws `InputError`.
Project3mf read_project_3mf(const Package3mf& package, const std::string& path);

}  // namespace slicecorr::detail
