/// By how much the inputs of a print may be off, as programs are told.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::cli {

struct UncertainOptions {
  std::string uncertain;  ///< empty: nothing was said
  bool robust = false;
  /// `correcting`: with `--robust`.
  void add_to(CLI::App& app, bool correcting);
  /// The setup with what was said. `choices`: of printer and resin, whose file has the covariance of a
  /// fit. Throws `InputError` as `parse_uncertainty`.
  Setup put(Setup setup, const SetupChoices& choices) const;
};

}  // namespace slicecorr::cli
