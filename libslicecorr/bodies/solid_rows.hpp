// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of what is solid, joined by faces, in space and in time: voxels gel in their own slice or some
/// slices after it. Changes of rows are given slice by slice, and join in the order in which they gel.
/// Rows lie in strips, which threads follow side by side (solid_strips.hpp).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bodies/growing_bodies.hpp"
#include "bodies/solid_labels.hpp"

namespace slicecorr::detail {

/// When the voxels of a column gel: each so many slices after its own, or all in one slice.
class GelTime {
 public:
  GelTime() = default;
  static GelTime after(int slices) { return GelTime(slices); }
  static GelTime at_once(int slice) { return GelTime(-1 - slice); }
  bool is_at_once() const { return value_ < 0; }
  /// The slice in which the voxel of `slice` gels.
  int of(int slice) const { return value_ < 0 ? -1 - value_ : slice + value_; }
  bool operator==(const GelTime&) const = default;

 private:
  explicit GelTime(int value) : value_(value) {}
  std::int32_t value_ = 0;
};

/// A strip. Its functions but those of a step may be called beside those of others.
class SolidRows {
 public:
  using Label = SolidLabels::Label;
  /// Of a run as long as its voxels go on. Those of its columns in the slices between gel one after the
  /// other, or at once, and hang on each other. The body of its label has begun when the run gels.
  struct Labelled {
    std::int32_t begin = 0, end = 0;
    std::int32_t from = 0;  ///< slice of its first voxels
    GelTime gels;
    Label label = SolidLabels::kNone;
    /// Whether a run beside it goes on as it does.
    bool alike(const Labelled& beside) const {
      return end == beside.begin && gels == beside.gels &&
             (from == beside.from || !gels.is_at_once());
    }
  };
  using Row = std::vector<Labelled>;
  /// The strip's first or last row in a slice in which it changes.
  struct Edging {
    int slice = 0;
    Row row, made;  ///< `made`: of it, what does not gel on what gelled before it
  };
  /// Columns [begin, end) of a row that are otherwise from the slice at hand on.
  struct Change {
    int begin = 0, end = 0;
    bool flips = false;  ///< what was solid is not, and the other way round
    bool timed =
        false;  ///< `gels` is said; else what was solid gels as before, what was not in its slice
    GelTime gels;
  };
  /// Rows [first, first + rows). Bodies hang on what comes before slice 0. `step`: see BodyAsk.
  SolidRows(int first, int rows, int step);

  /// Of row `first` + y, from left to right, apart from each other; at most once a row and slice.
  void change_row(int y, std::span<const Change> changes);
  void end_slice(int more);
  /// After the last slice: what has not gelled yet does so before anything is judged.
  void end();

  /// Makes room where much waits: what waits for the same step and has become one body is put together, and
  /// what is no news any more goes. No figure depends on it.
  void make_room();

  SolidLabels& labels() { return labels_; }
  /// Places that have labels: runs and what waits.
  std::size_t labelled() const { return runs_ + waiting_; }
  bool waits() const { return waiting_ > 0; }
  /// What gels in the step at hand, of which all slices have ended.
  void gel_step(GrowingBodies& bodies);
  /// What joins in it, once all strips have told what gels.
  void join_step(GrowingBodies& bodies);
  /// Passes steps in which nothing happens.
  void skip(int steps) { now_ += steps; }
  std::vector<Edging>& upper() { return upper_; }
  std::vector<Edging>& lower() { return lower_; }
  template <class Keep>
  void keep_labels(const Keep& keep) {
    for (Row& row : rows_) {
      for (Labelled& run : row) keep(run.label);
    }
    for (Bucket& bucket : buckets_) {
      for (Sum& s : bucket.sums) keep(s.label);
      for (Total& t : bucket.totals) keep(t.label);
      for (Beginning& b : bucket.begins) keep(b.label);
      for (Patched& p : bucket.grows) keep(p.label);
      for (Patched& p : bucket.ends) keep(p.label);
      for (Edge& e : bucket.edges) {
        keep(e.a);
        keep(e.b);
      }
    }
    edges_.assign(kEdges, {});
  }

 private:
  /// A run of the slice at hand that does not gel on what gelled before it.
  struct Made {
    int row = 0;
    Labelled run;
  };
  struct Patched {
    Label label;
    GrowingBodies::Patch patch;
  };
  struct Beginning {
    Label label;
    FirstVoxel low;
    int step;
  };
  struct Sum : Patched {
    int slices;
  };
  /// Of many sums.
  struct Total {
    Label label;
    GrowingBodies::Volume volume;
  };
  struct Edge {
    Label a = SolidLabels::kNone, b = SolidLabels::kNone;
  };
  /// An edge, and the step for which it waits.
  struct Waits {
    Edge edge;
    int step = 0;
  };
  static constexpr std::size_t kEdges = 4096;
  /// What happens in a step.
  struct Bucket {
    std::vector<Sum> sums;  ///< what gelled in the step before, but for that of `grows` and `ends`
    std::vector<Total> totals;  ///< the same
    std::vector<Beginning> begins;
    std::vector<Patched> grows;  ///< runs that gel slice by slice from this step on
    std::vector<Patched> ends;   ///< those of which all has gelled
    std::vector<Edge> edges;     ///< of runs that share a face, which have both gelled now
    std::size_t size() const {
      return sums.size() + totals.size() + begins.size() + grows.size() + ends.size() +
             edges.size();
    }
  };
  class RowChange;
  class RoomMaker;

  int step_of(int n) const { return n >> log2_step_; }
  /// The step of slice n or, if that is past, the one at hand.
  int coming_step(int n) const { return std::max(step_of(n), now_); }
  /// Of the step of slice n, or that at hand; something is put into it.
  Bucket& at(int n) { return of_step(step_of(n)); }
  Bucket& of_step(int step);
  /// Two runs that share a face have both gelled in slice n.
  void join(Label a, Label b, int n);
  /// A run that gels slice by slice does so from slice n on (`sign` 1), or no more (-1).
  void grow(Label label, const GrowingBodies::Patch& patch, int n, int sign);
  /// Joins what is made in a row with a row beside it.
  void join_beside(std::span<const Made> made, int row);
  /// Columns of a run have no more voxels.
  void leave(const Labelled& run, int row);
  void keep_edging(int row, bool changed, std::vector<Edging>& to) const;

  const int first_;
  const int step_;  ///< slices, a power of two
  const int log2_step_;
  int slice_ = 0;  ///< the one at hand
  int now_ = 0;    ///< step at hand
  SolidLabels labels_;
  std::vector<Row> rows_;
  bool upper_changed_ = false, lower_changed_ = false;
  std::vector<Edging> upper_, lower_;
  Row next_;
  std::vector<Made> made_;
  std::vector<Beginning> new_;  ///< labels of the slice at hand
  std::vector<Waits> edges_;    ///< some that wait, to find those that are there
  std::size_t runs_ = 0;
  std::vector<Bucket> buckets_;  ///< of steps from the one at hand on, a power of two of them
  std::size_t waiting_ = 0;      ///< in buckets
  std::size_t kept_ = 0;         ///< of these, when room was made last
};

}  // namespace slicecorr::detail
