// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a window that gives way does under each slice of `flow`.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "programs/common/program.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/flow_window.hpp"

namespace slicecorr::cli {

/// Of each slice that was looked at, in their order.
struct WindowFindings {
  FlowWindow window;
  std::vector<WindowRest> rest;
  std::vector<WindowPull> pull;
  std::optional<double> snap_mm_h;  ///< of the slice that snaps first; nothing where none does
};

/// Adds the options that say what the window is.
void add_window_options(CLI::App& app, FlowWindow& window);
/// What options say of it, else what the printer's file does.
const FlowWindow& window_of(const FlowWindow& options, const Printer& printer);
/// In words.
std::string window_in_words(const FlowWindow& window);
/// Nothing where the window is rigid.
std::optional<WindowFindings> find_window(const FlowWindow& window,
                                          const std::vector<SliceFlow>& slices,
                                          const FlowPull& pull, const ExecutionContext& context);
/// What the user should know: a sentence each.
std::vector<std::string> window_warnings(const WindowFindings& found,
                                         const std::vector<SliceFlow>& slices);
/// Lines of the table.
std::string window_table(const WindowFindings& found, const std::vector<SliceFlow>& slices,
                         const FlowPull& pull);
nlohmann::ordered_json window_json(const WindowFindings& found);
/// Adds what is known of one slice.
void add_window_json(const WindowFindings& found, std::size_t slice, nlohmann::ordered_json& to);

}  // namespace slicecorr::cli
