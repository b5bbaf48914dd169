// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a solve that is stopped leaves in a file, to go on from.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::tomo::detail {

/// What the solve was asked for: a solve goes on only from a file of the same.
struct Fingerprint {
  std::uint64_t part = 0, insert = 0, machine = 0, options = 0;
  bool operator==(const Fingerprint&) const = default;
};

/// FNV-1a.
std::uint64_t hash_of(const void* data, std::size_t size,
                      std::uint64_t before = 0xcbf29ce484222325U);
/// Of all that decides what the solver does.
std::uint64_t hash_of(const SolveOptions& options);

/// Numbers are in the processor's order: such a file is for the machine that wrote it.
class CheckpointFile {
 public:
  /// An empty path: nothing is kept.
  CheckpointFile(std::string path, double every_s, const Fingerprint& fingerprint);

  /// Nothing when there is no file. Throws `InputError` for one that is damaged, or of another part,
  /// insert, printer, resin or options, naming which.
  std::optional<SolverState> read(const Shape& shape);
  /// For how many turns dose spread, solve by solve up to the one that is kept; none where it does
  /// not. What was read, or given.
  const std::vector<int>& passes() const { return passes_; }
  void of_passes(std::vector<int> turns) { passes_ = std::move(turns); }
  /// How often light had been looked for before, within less time.
  int attempt() const { return attempt_; }
  void of_attempt(int attempt) { attempt_ = attempt; }
  /// Writes the place under a temporary name and renames it, unless the last one is younger than
  /// `every_s`, or than 20 times what writing it took. Throws `DeviceError`.
  void keep(const SolverPlace& place);

 private:
  using Clock = std::chrono::steady_clock;
  std::string path_;
  Fingerprint fingerprint_;
  std::vector<int> passes_;
  int attempt_ = 0;
  Clock::duration every_;
  Clock::time_point not_before_;
};

}  // namespace slicecorr::tomo::detail
