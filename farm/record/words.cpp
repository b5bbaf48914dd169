// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "record/words.hpp"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "support/text/utf8.hpp"

namespace slicecorr::farm::detail {

namespace {

/// So many jobs are looked at one by one in some 20 ms.
constexpr std::int64_t kFew = 10'000;
/// With so few there is no need to look for letters that are rarer.
constexpr std::int64_t kVeryFew = 500;
/// Threes of letters of a long text that are counted, and of them that are looked for.
constexpr std::size_t kMostCounted = 16, kMostAsked = 4;

/// The places where characters begin, and the end.
std::vector<std::size_t> places_of(const std::string& text) {
  std::vector<std::size_t> places;
  for (std::size_t at = 0; at < text.size();) {
    places.push_back(at);
    slicecorr::detail::next_character(text, at);
  }
  places.push_back(text.size());
  return places;
}

std::string quoted(const std::string& letters) {
  std::string text = "\"";
  for (const char c : letters) text += c == '"' ? "\"\"" : std::string(1, c);
  return text + '"';
}

/// Up to one more than a few.
std::int64_t count_few(Database& db, const char* sql, const std::string& value) {
  Rows rows = db.query(sql, value, kFew + 1);
  return rows.next() ? rows.integer(0) : 0;
}

std::optional<FewJobs> few_with_letters(Database& db, const std::string& text,
                                        const std::vector<std::size_t>& places) {
  const std::size_t threes = places.size() - 3, step = (threes + kMostCounted - 1) / kMostCounted;
  std::set<std::string> seen;
  std::vector<std::pair<std::int64_t, std::string>> rare;
  for (std::size_t i = 0; i < threes; i += step) {
    const std::string letters = quoted(text.substr(places[i], places[i + 3] - places[i]));
    if (!seen.insert(letters).second) continue;
    const std::int64_t jobs = count_few(db,
                                        "SELECT count(*) FROM (SELECT 1 FROM job_words "
                                        "WHERE job_words MATCH ?1 LIMIT ?2)",
                                        letters);
    if (jobs <= kFew) rare.emplace_back(jobs, letters);
    if (jobs <= kVeryFew) break;
  }
  if (rare.empty()) return std::nullopt;
  std::sort(rare.begin(), rare.end());
  FewJobs few{"SELECT rowid FROM job_words WHERE job_words MATCH @", rare[0].second};
  for (std::size_t i = 1; i < std::min(rare.size(), kMostAsked); ++i) {
    few.value += " AND " + rare[i].second;
  }
  return few;
}

}  // namespace

std::optional<FewJobs> few_with(Database& db, const std::string& text) {
  if (text.empty() || text.find('\0') != text.npos || !slicecorr::detail::is_utf8(text)) {
    return std::nullopt;
  }
  const std::vector<std::size_t> places = places_of(text);
  if (places.size() > 3) return few_with_letters(db, text, places);
  // One or two letters begin some of the threes.
  const std::string begin_with = "FROM job_letters WHERE term >= @ AND term < @ || char(1114111)";
  const std::int64_t jobs = count_few(db,
                                      "SELECT count(*) FROM (SELECT 1 FROM job_letters WHERE term "
                                      ">= ?1 AND term < ?1 || char(1114111) LIMIT ?2)",
                                      text);
  if (jobs > kFew) return std::nullopt;
  return FewJobs{"SELECT doc " + begin_with, text};
}

}  // namespace slicecorr::farm::detail
