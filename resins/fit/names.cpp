// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/error.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

std::string_view name_of(FitModel model) {
  switch (model) {
    case FitModel::jacobs:
      return "jacobs";
    case FitModel::kinetic:
      return "kinetic";
    case FitModel::gel_time:
      return "gel-time";
    case FitModel::dead_zone_steady:
      return "deadzone-steady";
    case FitModel::dead_zone_transient:
      return "deadzone-transient";
    case FitModel::joint:
      return "joint";
  }
  return "";
}

FitModel fit_model_named(const std::string& name) {
  for (const FitModel model :
       {FitModel::jacobs, FitModel::kinetic, FitModel::gel_time, FitModel::dead_zone_steady,
        FitModel::dead_zone_transient, FitModel::joint}) {
    if (name == name_of(model)) return model;
  }
  throw InputError(
      "'" + name +
      "' is no model; expected jacobs, kinetic, gel-time, deadzone-steady, deadzone-transient "
      "or joint");
}

}  // namespace slicecorr::resins
