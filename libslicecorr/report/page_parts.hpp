// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The pieces of the report's page.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/report.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::detail {

/// Height errors and gap contrasts, before and after.
page::Markup histograms(const ReportContent& content);
/// The lost and merged features with their places.
page::Markup feature_lists(const ReportContent& content);
/// Wanted doses beside those that print, by region, and pictures of both; empty where none are
/// wanted.
page::Markup dose_tables(const ReportContent& content);
/// Dose and dead zone in resin that flows, slice by slice, beside those with even light; empty where no
/// light was made for it.
page::Markup flow_charts(const ReportContent& content);
/// How sure the prediction is; empty where nobody asked.
page::Markup uncertainty_section(const ReportContent& content);
/// What hangs on nothing and what is trapped; empty where all is well.
page::Markup bodies_section(const Prediction& prediction);
/// The image row of the worst of it, for a section; -1: all is well.
int row_of_bodies(const Prediction& prediction);
page::Markup comparison_table(const ComparisonTable& comparison);

/// What the page's script reads: the volume and the model as JSON, arrays deflated in base 64. Made
/// coarser where it would be more than a few MB. `start`: the voxel shown first.
std::string page_data(const ReducedVolume& volume, const CureModel& model, const Grid& grid,
                      const std::array<int, 3>& start, const ExecutionContext& context);

}  // namespace slicecorr::detail
