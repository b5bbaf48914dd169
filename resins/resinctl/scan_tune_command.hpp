// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What `tune` does with tables and with scans alike, and what it does with scans.
#pragma once

#include <string>
#include <vector>

#include "programs/common/program.hpp"
#include "programs/common/tune_options.hpp"
#include "slicecorr/resins/tune.hpp"

namespace slicecorr::resinctl {

/// What each kind of part would tell next, in lines.
std::string next_text(const std::vector<resins::NextPart>& parts, double sigma_um);
/// Where the printer's file goes: beside the resin's unless said.
std::string printer_output_of(const cli::TuneOptions& a);

/// Tables of parts, with the light of what was printed.
struct MeasuredParts {
  std::vector<resins::MeasuredPart> parts;        ///< heights as they were before the resin shrank
  std::vector<resins::MeasuredPart> as_measured;  ///< by which what was counted is known again
  std::optional<Process> process;                 ///< of the last that was printed
  double layer_um = 50;                           ///< of the last
};
MeasuredParts measured_parts(const cli::TuneOptions& a, const Printer& printer, const Resin& resin,
                             const ExecutionContext& context);

/// What is known before anything was measured here.
resins::TunePrior known_before(const cli::TuneOptions& a, const std::string& resin_text,
                               const std::string& resin_path, const Printer& printer);

struct ResinToTune {
  std::string path, text;
  Resin before;
  std::string output;  ///< empty: is not written
};
struct PrinterToTune {
  std::string path;
  Printer renamed;     ///< before, by the name that it will have
  std::string output;  ///< empty: is not written
};
void write_tuned(const ResinToTune& resin, const PrinterToTune& printer,
                 const resins::TuneResult& told, cli::Console& console);

/// What scans of the stacks would tell, before there are any.
int forecast_scans_command(const cli::TuneOptions& a, const ExecutionContext& context);
int tune_by_scans_command(const cli::TuneOptions& a, const ExecutionContext& context,
                          cli::Console& console);

}  // namespace slicecorr::resinctl
