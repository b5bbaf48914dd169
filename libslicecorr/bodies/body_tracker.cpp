// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "bodies/body_listeners.hpp"
#include "bodies/joined_rows.hpp"
#include "bodies/necks.hpp"
#include "bodies/solid_strips.hpp"
#include "bodies/timed_rows.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr {

struct BodyTracker::Impl {
  Impl(const PixelBox& its_box, const Grid& its_grid, const ImageFrame& its_frame,
       const BodyAsk& its_ask)
      : box(its_box),
        grid(its_grid),
        frame(its_frame),
        ask(its_ask),
        solid_bodies(detail::Origin{box.x0, box.y0}, ask.time_step),
        void_bodies(detail::Origin{box.x0, box.y0}),
        rows(box) {
    if (ask.solids) {
      std::vector<int> ends;
      const int rows_each = ask.strip_rows > 0 ? ask.strip_rows : std::max(1, box.height());
      for (int y = 0; y < box.height(); y += rows_each) {
        ends.push_back(std::min(y + rows_each, box.height()));
      }
      solids.emplace(ends, ask.time_step, solid_bodies);
    }
    const double pixel_mm2 = grid.pixel_x_um * grid.pixel_y_um * 1e-6;
    if (ask.least_neck_mm2 > 0 && pixel_mm2 > 0) {
      // So many voxels have at least this area, whatever rounding did to it.
      necks.emplace(
          box.height(),
          static_cast<std::uint64_t>(std::ceil(ask.least_neck_mm2 / pixel_mm2 * (1 - 1e-9))),
          [this](const Neck& neck) {
            ++necks_in_all;
            largest_necks.add(neck);
          });
    }
    if (ask.voids && !box.empty()) open.emplace(box.height(), -1, box.width() + 1, void_bodies);
  }
  /// What is solid in a row changed: what is not, and necks.
  void set_flipped(int row);
  void end_slice(int more);

  const PixelBox box;
  const Grid grid;
  const ImageFrame frame;
  const BodyAsk ask;
  detail::SolidListener solid_bodies;
  detail::VoidListener void_bodies;
  detail::TimedRows rows;
  std::optional<detail::SolidStrips> solids;
  std::optional<detail::JoinedRows> open;
  std::optional<detail::NeckFinder> necks;
  std::uint64_t necks_in_all = 0;
  detail::Largest<Neck> largest_necks;
  int slices = 0, lit = 0;           ///< slices so far, and up to the last that has something solid
  std::size_t solid_ends = 0;        ///< of runs in all rows
  std::vector<std::size_t> ends_of;  ///< by row
  std::vector<Run> runs, between;
};

void BodyTracker::Impl::set_flipped(int row) {
  const detail::TimedRows::Ends& known = rows.solid(row);
  if (ends_of.empty()) ends_of.resize(static_cast<std::size_t>(box.height()), 0);
  std::size_t& ends = ends_of[static_cast<std::size_t>(row)];
  solid_ends = solid_ends - ends + known.size();
  ends = known.size();
  if (!open && !necks) return;
  runs.clear();
  between.clear();
  int at = -1;
  for (std::size_t k = 0; k < known.size(); k += 2) {
    runs.push_back({known[k], known[k + 1]});
    if (known[k] > at) between.push_back({at, known[k]});
    at = known[k + 1];
  }
  between.push_back({at, box.width() + 1});
  if (necks) necks->set_row(row, runs);
  if (open) open->set_row(row, between);
}

void BodyTracker::Impl::end_slice(int more) {
  rows.end_slice(more,
                 [&](int row, std::span<const detail::SolidRows::Change> changes, bool flips) {
                   if (solids) solids->change_row(row, changes);
                   if (flips) set_flipped(row);
                 });
  slices += 1 + more;
  if (solid_ends > 0) lit = slices;
  if (solids) solids->end_slice(more);
  if (open) open->end_slice(more);
  if (necks) necks->end_slice(more);
}

BodyTracker::BodyTracker(const PixelBox& box, const Grid& grid, const ImageFrame& frame,
                         const BodyAsk& ask)
    : impl_(std::make_unique<Impl>(box, grid, frame, ask)) {}
BodyTracker::~BodyTracker() = default;
BodyTracker::BodyTracker(BodyTracker&&) noexcept = default;

void BodyTracker::set_row(int y, std::span<const Run> runs) { impl_->rows.set_row(y, runs); }
void BodyTracker::flip_row(int y, std::span<const Run> runs) { impl_->rows.flip_row(y, runs); }
void BodyTracker::set_delays(int y, std::span<const Run> runs) { impl_->rows.set_delays(y, runs); }
void BodyTracker::end_slice(int more) { impl_->end_slice(more); }

Bodies BodyTracker::finish() {
  Impl& t = *impl_;
  if (t.ask.time_step > 1) t.solid_bodies.set_slices(t.slices);
  if (t.solids) t.solids->finish();
  if (t.open) t.open->finish();
  Bodies found;
  found.grid = t.grid;
  found.frame = t.frame;
  found.time_step = t.ask.time_step;
  if (t.solids) t.solid_bodies.put(found);
  t.void_bodies.put(found);
  if (t.necks) {
    found.least_neck_mm2 = t.ask.least_neck_mm2;
    t.necks->finish();
    found.necks_in_all = t.necks_in_all;
    found.widest = t.necks->widest();
    found.necks = t.largest_necks.take();
    for (Neck& neck : found.necks) {
      neck.column += t.box.x0;
      neck.row += t.box.y0;
    }
  }
  // Black slices after the last body are no more of the print.
  for (Cup& c : found.cups) {
    if (c.end == CupEnd::opened && c.past == t.lit) c.end = CupEnd::print_ends;
  }
  const auto move = [&](auto& list) {
    for (auto& f : list) {
      f.x += t.box.x0;
      f.y += t.box.y0;
    }
  };
  move(found.islands);
  move(found.sealed_cavities);
  move(found.cups);
  return found;
}

}  // namespace slicecorr
