// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <array>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

namespace {

constexpr std::array kKinds = std::to_array<FitModelKind>({
    {"jacobs", "Jacobs fit", true, false, true},
    {"kinetic", "Kinetic fit", true, false, false},
    {"gel-time", "Gel-time fit", true, false, false},
    {"bleaching", "Bleaching fit", true, false, true},
    {"deadzone-steady", "Dead zone, steady fit", false, true, false},
    {"deadzone-transient", "Dead zone, transient fit", false, true, false},
    {"joint", "Joint fit", true, true, false},
});

}  // namespace

std::span<const FitModelKind> fit_model_kinds() { return kKinds; }

const FitModelKind& kind_of(FitModel model) { return kKinds[static_cast<std::size_t>(model)]; }

std::vector<std::string> fit_model_names() {
  std::vector<std::string> names;
  names.reserve(kKinds.size());
  for (const FitModelKind& k : kKinds) names.emplace_back(k.name);
  return names;
}

std::string_view name_of(FitModel model) { return kind_of(model).name; }

FitModel fit_model_named(const std::string& name) {
  std::string known;
  for (std::size_t i = 0; i < kKinds.size(); ++i) {
    if (name == kKinds[i].name) return static_cast<FitModel>(i);
    known += (i == 0 ? "" : i + 1 == kKinds.size() ? " or " : ", ") + std::string(kKinds[i].name);
  }
  throw InputError(fmt::format("'{}' is no model; expected {}", name, known));
}

}  // namespace slicecorr::resins
