// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/solid_rule.hpp"

#include <map>
#include <set>
#include <string>
#include <utility>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

SolidRule::SolidRule(const std::vector<TriangleMesh::Share>& shares) {
  std::set<std::uint32_t> cut, keeping;
  for (const TriangleMesh::Share& share : shares) {
    if (share.role != SolidRole::added) cut.insert(share.solid);
    if (share.role == SolidRole::kept_within) keeping.insert(share.solid);
  }
  std::map<std::uint32_t, std::uint32_t> solids;  // by number in the mesh
  std::map<std::pair<std::uint32_t, SolidRole>, Tag> tags;
  for (const TriangleMesh::Share& share : shares) {
    if (!cut.contains(share.solid)) {
      tag_of_share_.push_back(0);
      continue;
    }
    const auto solid = solids.emplace(share.solid, static_cast<std::uint32_t>(keeps_.size()));
    const bool keeps = keeping.contains(share.solid);
    if (solid.second) keeps_.push_back(keeps ? 1 : 0);
    const auto tag =
        tags.emplace(std::pair{share.solid, share.role}, static_cast<Tag>(whose_.size()));
    if (tag.second) {
      if (whose_.size() == kMostTags) {
        throw InputError("volumes are taken away from more than " + std::to_string(kMostTags / 2) +
                         " parts of a mesh; expected fewer");
      }
      whose_.push_back({solid.first->second, share.role, keeps || share.role != SolidRole::added});
    }
    tag_of_share_.push_back(tag.first->second);
  }
}

}  // namespace slicecorr::detail
