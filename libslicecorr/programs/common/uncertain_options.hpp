// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// By how much the inputs of a print may be off, as programs are told.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "programs/common/program.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::cli {

struct UncertainOptions {
  std::string uncertain;  ///< empty: nothing was said
  bool robust = false;
  std::string map;  ///< where a map of how sure edges are goes (.png); empty: nowhere
  /// `correcting`: with `--robust`.
  void add_to(CLI::App& app, bool correcting);
  /// `--uncertain-map`, for what predicts.
  void add_map_to(CLI::App& app);
  /// Writes the map where one was asked for.
  void write_map(const Prediction& prediction, Console& console) const;
  /// The setup with what was said. `choices`: of printer and resin, whose file has the covariance of a
  /// fit. Throws `InputError` as `parse_uncertainty`.
  Setup put(Setup setup, const SetupChoices& choices) const;
};

}  // namespace slicecorr::cli
