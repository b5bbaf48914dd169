// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/beams_page.hpp
/// The page that shows what a few beams print.
///
/// Thread-safe; the same print gives the same bytes for any number of threads.
#pragma once

#include <string>

#include "slicecorr/tomo/beams_job.hpp"

namespace slicecorr::tomo {

/// A print with beams, judged.
struct BeamReport {
  const BeamJob& job;
  const Box<std::uint8_t>& part;  ///< of the whole vat
  const BeamPrint& print;
  const Box<float>& light;  ///< as shown
  const BeamFigures& figures;
  const std::string& why_not;  ///< empty where it can be printed
};

/// One self-contained HTML page: no network. Figures, the beams' images, light against target in
/// three planes, histograms, and with scripts the part in the round, with what gels when.
std::string beams_page(const BeamReport& report, const std::string& title,
                       const ExecutionContext& context = {});

}  // namespace slicecorr::tomo
