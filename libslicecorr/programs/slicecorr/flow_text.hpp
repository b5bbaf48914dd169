// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What `flow` found, for people and for programs.
#pragma once

#include <string>
#include <vector>

#include "flow_window_text.hpp"
#include "slicecorr/flow_suction.hpp"

namespace slicecorr::cli {

/// All that `flow` found out of a part.
struct FlowFindings {
  double layer_um = 0, pitch_um = 0;
  int columns = 0, rows = 0;  ///< of cells
  FlowPull pull;
  std::string gap_words;     ///< where the gap comes from
  std::string no_dose;       ///< why no dose is known; empty with light
  bool limit_given = false;  ///< by the printer
  int part_slices = 0;
  std::size_t masks = 0;  ///< that differ, of the slices that were looked at
  std::vector<SliceFlow> slices;
  PlatformFlow platform;
  std::vector<BlindVoid> blind;
  /// Doses in the middle of the slowest slice with inhibitor that lasts and that does not; 0: not known.
  double middle_lasting = 0, middle_fleeting = 0;
  std::vector<std::string> warnings;     ///< a sentence each
  std::optional<WindowFindings> window;  ///< nothing where it is rigid

  /// The slice with the least speed limit, the first of equal ones.
  const SliceFlow& slowest() const;
};

/// The slowest slices, worst first, apart from each other: neighbours are much alike.
std::vector<const SliceFlow*> slowest_apart(const FlowFindings& found, std::size_t most);
/// What the user should know, from the figures: a sentence each.
std::vector<std::string> flow_warnings(const FlowFindings& found);
std::string flow_table(const FlowFindings& found);
std::string flow_json(const FlowFindings& found);
/// Speeds of all slices: those that were not looked at have the lower one of their neighbours.
std::string flow_profile_csv(const FlowFindings& found);

}  // namespace slicecorr::cli
