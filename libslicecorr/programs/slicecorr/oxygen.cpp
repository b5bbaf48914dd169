// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "oxygen.hpp"

namespace slicecorr::cli {

void OxygenOptions::add_to(CLI::App& app) {
  auto* const flag = app.add_flag(
      "--even-oxygen", even,
      "Change the light of each slice so that oxygen is used up as if none diffused in its plane: small "
      "features and edges get more (layerwise; the resin file must have [chemistry])");
  app.add_option("--oxygen-margin", ask.margin,
                 "Share of its oxygen that what is not to gel keeps with --even-oxygen")
      ->check(number_in(0.001, 0.999))
      ->capture_default_str()
      ->needs(flag);
}

void tell_even_oxygen(const StackInfo& info, const ExecutionContext& context) {
  if (!oxygen_is_even(info)) return;
  context.tell(
      "the light of this stack evens out oxygen (--even-oxygen): figures count all of it as dose, and so "
      "more than cures where oxygen comes from beside");
}

}  // namespace slicecorr::cli
