// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a 3MF says of colours and materials. Nothing prints of it; it is checked, so that a file is
/// sound or refused.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

class Properties3mf {
 public:
  enum class Kind { base, colours, texture, texture_places, composites, multiple, other };

  /// The kind of a group by the name of its element; nothing of geometry is one.
  static Kind kind_of(std::string_view element);
  /// The following return what is wrong, empty: nothing. `references`: ids that the group names.
  std::string add(std::uint32_t id, Kind kind, const std::vector<std::uint32_t>& references);
  std::string check_used(std::uint32_t id) const;

 private:
  std::map<std::uint32_t, Kind> kinds_;
};

}  // namespace slicecorr::detail
