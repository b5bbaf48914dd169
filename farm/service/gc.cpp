// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "engine/slurm_tasks.hpp"
#include "record/database.hpp"
#include "service/commit.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/store.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;

namespace {

std::int64_t size_of(const std::string& path) {
  std::error_code error;
  std::int64_t bytes = 0;
  if (fs::is_regular_file(path, error))
    return static_cast<std::int64_t>(fs::file_size(path, error));
  for (auto it = fs::recursive_directory_iterator(path, error);
       !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    std::error_code size_error;
    if (it->is_regular_file(size_error)) {
      bytes += static_cast<std::int64_t>(it->file_size(size_error));
    }
  }
  return bytes;
}

/// Collects inputs, but only while no submission is at work: what a submission has stored comes
/// into the record with its jobs.
void collect_inputs(const FarmFolder& folder, Queue& queue, const GcOptions& options,
                    GcTotals& totals) {
  const auto lock = InputLock::alone(folder);
  totals.inputs_in_use = !lock;
  if (!lock) return;
  const auto collect = [&](const std::string& path) {
    ++totals.inputs;
    totals.bytes += size_of(path);
    std::error_code error;
    if (!options.dry_run) fs::remove(path, error);
  };
  for (const std::string& file : queue.unneeded_inputs()) {
    if (!options.dry_run) queue.forget_input(file);
    collect(folder.input(file));
  }
  for (const std::string& path : detail::stray_inputs(folder, queue)) collect(path);
}

}  // namespace

std::vector<std::string> detail::stray_inputs(const FarmFolder& folder, Queue& queue) {
  std::vector<std::string> list;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder.store + "/inputs", error), end;
       !error && it != end; it.increment(error)) {
    std::error_code no_file;
    if (!it->is_regular_file(no_file)) continue;
    // Copies that were not finished have temporary names, which are in no record.
    if (!queue.knows_input(it->path().filename().string())) list.push_back(it->path());
  }
  return list;
}

std::vector<std::string> detail::ended_attempt_folders(const FarmFolder& folder, Queue& queue) {
  std::vector<std::string> list;
  std::error_code error;
  for (fs::directory_iterator it(folder.store + "/attempts", error), end; !error && it != end;
       it.increment(error)) {
    if (!queue.attempt_is_open(it->path().filename().string())) list.push_back(it->path());
  }
  return list;
}

std::vector<std::string> detail::stray_scans(const FarmFolder& folder, Queue& queue) {
  // A scan that is being measured lies in its folder before the record knows it.
  constexpr auto grace = std::chrono::hours(24);
  std::vector<std::string> list;
  std::error_code error;
  const auto now = fs::file_time_type::clock::now();
  for (fs::directory_iterator it(folder.root + "/scans", error), end; !error && it != end;
       it.increment(error)) {
    std::error_code no_time;
    const auto changed = fs::last_write_time(it->path(), no_time);
    if (no_time || now - changed < grace) continue;
    if (!queue.knows_scan(it->path().filename().string())) list.push_back(it->path());
  }
  return list;
}

GcTotals collect_garbage(const FarmFolder& folder, Queue& queue, const GcOptions& options) {
  GcTotals totals;
  const std::int64_t now = system_clock().wall_ms();
  const auto results = queue.results_by_age();
  std::int64_t kept = 0;
  for (const auto& r : results) kept += r.bytes;
  const bool by_age = options.older_than_days >= 0, by_size = options.max_mb >= 0;
  for (const auto& r : results) {
    if (r.needed) continue;
    const bool old =
        by_age && static_cast<double>(now - r.used_ms) >= options.older_than_days * 86'400'000.0;
    const bool too_much = by_size && kept > options.max_mb << 20;
    if (!old && !too_much) continue;
    kept -= r.bytes;
    ++totals.results;
    totals.bytes += r.bytes;
    if (options.dry_run) continue;
    // The record goes first: an entry without a record is just garbage, but a record without an
    // entry would promise a result that is not there.
    queue.forget_result(r.key, "");
    remove_from_cache(folder, r.key);
  }
  collect_inputs(folder, queue, options, totals);
  // Folders of attempts and batches that have ended, and results that a service was killed in the
  // middle of.
  std::vector<std::string> leftovers = detail::ended_attempt_folders(folder, queue);
  for (std::string& path : detail::ended_batch_folders(
           folder.store, [&](const std::string& token) { return queue.attempt_is_open(token); })) {
    leftovers.push_back(std::move(path));
  }
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder.store + "/cache", error), end;
       !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (it.depth() != 1 || !name.starts_with(".")) continue;
    it.disable_recursion_pending();
    const std::string token = name.substr(name.rfind('.') + 1);
    if (!queue.attempt_is_open(token)) leftovers.push_back(it->path());
  }
  for (std::string& path : detail::stray_scans(folder, queue)) leftovers.push_back(std::move(path));
  for (const std::string& path : leftovers) {
    ++totals.leftovers;
    totals.bytes += size_of(path);
    if (!options.dry_run) fs::remove_all(path, error);
  }
  if (!options.dry_run && totals.results + totals.inputs + totals.leftovers > 0) {
    queue.add_event(
        "gc", fmt::format("{} results, {} inputs, {} leftovers, {}", totals.results, totals.inputs,
                          totals.leftovers, text::bytes(static_cast<double>(totals.bytes))));
  }
  return totals;
}

}  // namespace slicecorr::farm
