// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file words.hpp
/// Jobs with a text in their name or inputs, found by the record's lists of three letters.
#pragma once

#include <optional>
#include <string>

#include "record/database.hpp"

namespace slicecorr::farm::detail {

/// A query for numbers of jobs, with `value` in the place of each @.
struct FewJobs {
  std::string sql, value;
};

/// Gives all jobs that have `text` in their name or inputs, and some that do not; none where so many jobs have its
/// letters that to look at all is as quick, or where it is no UTF-8.
std::optional<FewJobs> few_with(Database& db, const std::string& text);

}  // namespace slicecorr::farm::detail
