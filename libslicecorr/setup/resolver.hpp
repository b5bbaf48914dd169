// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How a setup comes of what is chosen, and of what a stack says.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/misfit.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// One setup. What is chosen must outlive this. Functions throw `InputError`, and `MisfitError` where what is
/// chosen does not go together.
class Resolver {
 public:
  Resolver(const SetupChoices& choices, ChoiceNames names) : c_(choices), names_(names) {}
  Setup resolve(const StackInfo* info, const StackInfo* times) const;
  Printer chosen_printer() const;
  Resin chosen_resin() const;
  bool assumes() const { return !c_.assume.empty() && c_.assume != "none"; }
  void check_light(const Printer& printer, const Resin& resin, bool uv) const {
    check_same_light(printer, resin, uv, c_.other_wavelength == "take", o("other_wavelength"));
  }

 private:
  [[noreturn]] static void wrong(const std::string& message) { throw InputError(message); }
  [[noreturn]] static void misfit(std::vector<std::string> settings, const std::string& message) {
    throw MisfitError(std::move(settings), message);
  }
  Printer printer() const;
  Resin resin() const;
  ResinOverrides overrides() const;
  std::string o(std::string_view name) const { return setting_name(names_, name); }
  void resolve_exposure(Process& process, const StackInfo* times) const;
  void resolve_continuous(Process& process) const;
  void resolve_slice_speeds(Process& process) const;
  void resolve_layerwise(Process& process, const StackInfo* times) const;
  void resolve_layers(Process& process, const StackInfo* times, bool recorded) const;
  void resolve_lifts(Setup& setup, bool recorded) const;
  /// The setting that says how lifts go, where one does.
  const char* how_said() const {
    return c_.green_strength > 0 ? "green_strength" : c_.skin > 0 ? "skin" : "lift_exchange";
  }
  void resolve_uv(Setup& setup) const;
  /// Lamps follow the stage where a machine would else refuse the speed, and nothing is said of ramps.
  void resolve_ramp(Setup& setup) const;
  void resolve_even_dead_zone(Setup& setup) const;
  /// Those of `names` that are said.
  std::vector<std::string> said_of(std::initializer_list<std::string_view> names) const {
    std::vector<std::string> said;
    for (const std::string_view name : names) {
      if (is_said(*find_setting(name), c_)) said.emplace_back(name);
    }
    return said;
  }
  bool any_exposure() const {
    return c_.exposure_s > 0 || c_.bottom_exposure_s > 0 || c_.bottom_layers >= 0 ||
           c_.fade_layers >= 0;
  }

  const SetupChoices& c_;
  ChoiceNames names_;
};

}  // namespace slicecorr::detail
