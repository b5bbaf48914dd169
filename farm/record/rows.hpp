// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file rows.hpp
/// Rows of the database to values: one list of columns and one reader for each kind.
#pragma once

#include <string>
#include <vector>

#include "record/database.hpp"
#include "slicecorr/farm/job.hpp"
#include "slicecorr/farm/settings.hpp"

namespace slicecorr::farm::detail {

/// "SELECT ... FROM jobs j ..." up to where conditions begin.
extern const std::string kSelectJobs;
Job read_job(const Rows& row);
/// Of the six columns of `tomo_results` from `first` on; none where there is no row.
std::optional<TomoFigures> read_tomo_figures(const Rows& row, int first);
/// Columns that it reads.
inline constexpr int kTomoColumns = 6;
/// The same of light_s and print_s.
std::optional<StackTime> read_stack_time(const Rows& r, int first);
inline constexpr int kTimeColumns = 2;
/// Outcome and words of what a print comes to.
std::optional<ResultVerdict> read_verdict(const Rows& r, int first);

extern const std::string kSelectAttempts;
Attempt read_attempt(const Rows& row);

FarmSettings read_settings(Database& db);

std::string list_json(const std::vector<std::string>& list);
/// Of a column of a row. Throw `InputError` naming the record where its bytes were changed.
std::vector<std::string> parse_list(const Rows& row, int column);
std::string files_json(const std::vector<ResultFile>& files);
std::vector<ResultFile> parse_files(const Rows& row, int column);

}  // namespace slicecorr::farm::detail
