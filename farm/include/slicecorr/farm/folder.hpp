// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file folder.hpp
/// The farm's folder. One folder is one farm:
///
///     farm.sqlite           the record; on a local disk
///     store/                may be on a file system that all nodes share (see `init_folder`):
///       inputs/ab/SHA.stl     copies of what was submitted, by content
///       attempts/TOKEN/       one per attempt: order.json, progress.json, log.txt, result.json,
///       out/ cache/ab/KEY/         results by key: stack.*, report.html, figures.json
///     logs/ID-N.txt         logs of attempts that have ended
///     results/ID/           outputs of jobs that named no folder
///     scans/TOKEN/          a scan of a print: file/NAME as it came, comparison.json, comparison.html
///
/// Plain values; all functions are thread-safe, and safe against other processes.
#pragma once

#include <string>

namespace slicecorr::farm {

struct FarmFolder {
  std::string root;   ///< absolute
  std::string store;  ///< absolute
  std::string database() const { return root + "/farm.sqlite"; }
  /// Paths of what belongs to the token of an attempt, the key of a result, the name of an input,
  /// and the id of a job with the number of its attempt.
  std::string attempt(const std::string& token) const { return store + "/attempts/" + token; }
  std::string cache_entry(const std::string& key) const;
  std::string input(const std::string& file) const;
  std::string log(long long job, int number) const;
  std::string results(long long job) const;
  std::string scan(const std::string& token) const { return root + "/scans/" + token; }
};

/// `$XDG_STATE_HOME/slicecorr/farm`, or `~/.local/state/slicecorr/farm`.
std::string default_farm_folder();

/// Makes what is missing. `store`: a folder on a file system that nodes share; empty: inside. An
/// existing farm keeps its store. Throws `DeviceError`; `InputError` when `root` is on a network
/// file system, where SQLite's locks can't be trusted.
FarmFolder open_folder(const std::string& root, const std::string& store = {});

}  // namespace slicecorr::farm
