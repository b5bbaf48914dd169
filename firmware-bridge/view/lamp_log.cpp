// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What lamps gave of what was asked of them, as the table that `correct --lamp-log` reads.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "slicecorr/bridge/view.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Rows of the table, about: what is measured is noisy from frame to frame, and lamps fade slowly.
constexpr std::size_t kRows = 200;
/// Of less than this share of full light little can be told.
constexpr double kLeastAsked = 0.02;

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Of some frames that follow each other.
struct Block {
  int frame = 0;
  std::vector<double> blue, uv;
};

}  // namespace

LampLog lamp_log(const PrintRecord& record) {
  const auto wrong = [&](const char* what) { throw InputError(record.folder, "", what); };
  if (record.frames.empty()) wrong("has no frame that was shown; expected the record of a print");
  if (record.facts_known && record.facts.dry_run)
    wrong("is of a print without light; expected one with it");
  if (record.facts_known && record.facts.turns()) {
    wrong("is of a vial that turns, whose frames are no slices; expected a print of slices");
  }
  double most_uv = 0;
  for (const FrameRow& row : record.frames) {
    if (std::isfinite(row.uv_mw_cm2)) most_uv = std::max(most_uv, row.uv_mw_cm2);
  }
  const std::size_t together = (record.frames.size() + kRows - 1) / kRows;
  std::vector<Block> blocks;
  for (std::size_t i = 0; i < record.frames.size(); ++i) {
    const FrameRow& row = record.frames[i];
    if (i % together == 0) blocks.push_back({row.frame, {}, {}});
    const auto take = [](double asked, double measured, double least, std::vector<double>& shares) {
      if (asked >= least && asked > 0 && measured > 0) shares.push_back(measured / asked);
    };
    take(row.blue_share, row.blue_measured, kLeastAsked, blocks.back().blue);
    take(row.uv_mw_cm2, row.uv_measured, kLeastAsked * most_uv, blocks.back().uv);
  }
  const auto measured = [&](std::vector<double> Block::*shares) {
    return std::any_of(blocks.begin(), blocks.end(),
                       [&](const Block& b) { return !(b.*shares).empty(); });
  };
  const bool uv = measured(&Block::uv);
  if (!measured(&Block::blue)) {
    wrong("has no light that the machine measured; expected a machine that tells blue_measured");
  }
  LampLog log;
  log.csv = uv ? "slice,lamp_share,uv_lamp_share\n" : "slice,lamp_share\n";
  double blue_now = 1, uv_now = 1;
  /// A block without light keeps what was before; the first rows take what comes first.
  const auto first = [&](std::vector<double> Block::*shares) {
    for (Block& b : blocks) {
      if (!(b.*shares).empty()) return median(b.*shares);
    }
    return 1.0;
  };
  blue_now = first(&Block::blue);
  if (uv) uv_now = first(&Block::uv);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    Block& b = blocks[i];
    if (!b.blue.empty()) blue_now = median(b.blue);
    if (!b.uv.empty()) uv_now = median(b.uv);
    log.greatest = std::max({log.greatest, blue_now, uv ? uv_now : 0.0});
    const int slice = i == 0 ? 0 : b.frame;
    log.csv += fmt::format("{},{:.4f}", slice, std::min(1.0, blue_now));
    if (uv) log.csv += fmt::format(",{:.4f}", std::min(1.0, uv_now));
    log.csv += "\n";
  }
  log.rows = blocks.size();
  log.frames_a_row = together;
  return log;
}

}  // namespace slicecorr::bridge
