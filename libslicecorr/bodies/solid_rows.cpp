// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/solid_rows.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace slicecorr::detail {

SolidRows::SolidRows(int first, int rows, int step)
    : first_(first),
      step_(step),
      log2_step_(std::countr_zero(static_cast<unsigned>(step))),
      rows_(static_cast<std::size_t>(rows)),
      edges_(kEdges),
      buckets_(1) {}

SolidRows::Bucket& SolidRows::of_step(int step) {
  const auto ahead = static_cast<std::size_t>(std::max(step, now_) - now_);
  if (ahead >= buckets_.size()) {
    std::vector<Bucket> more(std::bit_ceil(ahead + 1));
    for (std::size_t k = 0; k < buckets_.size(); ++k) {
      const auto its = static_cast<std::size_t>(now_) + k;
      more[its & (more.size() - 1)] = std::move(buckets_[its & (buckets_.size() - 1)]);
    }
    buckets_ = std::move(more);
  }
  ++waiting_;
  return buckets_[(static_cast<std::size_t>(now_) + ahead) & (buckets_.size() - 1)];
}

void SolidRows::join(Label a, Label b, int n) {
  if (a == b) return;
  a = labels_.root(a);
  b = labels_.root(b);
  const int step = coming_step(n);
  if (a == b || labels_.unite_early(a, b, step)) return;
  // Two bodies that have not joined yet most often meet at many places.
  if (a > b) std::swap(a, b);
  Waits& last = edges_[(a * 31 + b) % kEdges];
  if (last.edge.a == a && last.edge.b == b && last.step <= step) return;
  last = {{a, b}, step};
  of_step(step).edges.push_back({a, b});
}

void SolidRows::grow(Label label, const GrowingBodies::Patch& patch, int n, int sign) {
  Bucket& bucket = at(n);
  (sign > 0 ? bucket.grows : bucket.ends).push_back({label, patch});
  // Of its first and last step it has only a part.
  if (const int before = n & (step_ - 1); before > 0) {
    of_step(step_of(n) + 1).sums.push_back({{label, patch}, -sign * before});
  }
}

void SolidRows::leave(const Labelled& run, int row) {
  const Label label = labels_.root(run.label);
  if (labels_.anchored(label)) return;
  const GrowingBodies::Patch patch{first_ + row, run.begin, run.end};
  const int gels = run.gels.of(slice_);
  if (!run.gels.is_at_once()) return grow(label, patch, gels, -1);
  // Voxels count from the step after the one in which they gel.
  of_step(step_of(gels) + 1).sums.push_back({{label, patch}, slice_ - run.from});
}

/// A row while it changes: the old one from left to right, the new one behind it.
class SolidRows::RowChange {
 public:
  RowChange(SolidRows& rows, int y)
      : rows_(rows), y_(y), old_(rows.rows_[static_cast<std::size_t>(y)]), next_(rows.next_) {
    next_.clear();
  }
  void change(const Change& c) {
    keep_until(c.begin);
    for (int x = c.begin; x < c.end;) {
      Labelled* const old = at_ < old_.size() && old_[at_].begin <= x ? &old_[at_] : nullptr;
      int end = c.end;
      if (at_ < old_.size()) end = std::min(end, old ? old->end : old_[at_].begin);
      const bool solid = (old != nullptr) != c.flips;
      const GelTime gels = c.timed ? c.gels : solid && old ? old->gels : GelTime();
      if (old && solid && gels == old->gels) {
        put(part(*old, x, end), false);
      } else {
        if (old) rows_.leave(part(*old, x, end), y_);
        if (solid) make(x, end, gels, old);
      }
      x = end;
      if (!old) continue;
      old->begin = end;
      at_ += old->begin == old->end;
    }
  }
  void finish() {
    keep_until(std::numeric_limits<int>::max());
    rows_.runs_ += next_.size();
    rows_.runs_ -= size_;
    old_.swap(next_);
  }

 private:
  static Labelled part(Labelled run, int begin, int end) {
    run.begin = begin;
    run.end = end;
    return run;
  }
  /// Old runs, and parts of them, that are not changed.
  void keep_until(int column) {
    std::size_t past = at_;
    while (past < old_.size() && old_[past].end <= column) ++past;
    if (past > at_) {
      put(old_[at_], false);
      using Step = Row::difference_type;
      next_.insert(next_.end(), old_.begin() + static_cast<Step>(at_ + 1),
                   old_.begin() + static_cast<Step>(past));
      last_made_ = last_made_ && past == at_ + 1;
      at_ = past;
    }
    if (at_ < old_.size() && old_[at_].begin < column) {
      put(part(old_[at_], old_[at_].begin, column), false);
      old_[at_].begin = column;
    }
  }
  void put(const Labelled& run, bool made) {
    if (!next_.empty() && next_.back().end == run.begin) {
      Labelled& last = next_.back();
      if (made || last_made_) {
        rows_.join(last.label, run.label, std::max(gels(last), gels(run)));
      }
      if (last.alike(run) || (last.gels == run.gels && hangs(last) && hangs(run))) {
        last.end = run.end;
        last.from = std::min(last.from, run.from);
        last_made_ = made;
        return;
      }
    }
    next_.push_back(run);
    last_made_ = made;
  }
  int gels(const Labelled& run) const { return run.gels.of(rows_.slice_); }
  /// Of what is anchored no sums are asked for, so it does not matter since when it is there.
  bool hangs(const Labelled& run) { return rows_.labels_.anchored(rows_.labels_.root(run.label)); }
  /// `below`: what was there in the slice before, or null.
  void make(int begin, int end, GelTime its, const Labelled* below) {
    const int n = rows_.slice_, gelled = its.of(n);
    Labelled made{begin, end, n, its};
    // What gels on or beside what has gelled is more of its body: most runs are. What gels on it has been
    // joined with what is beside it, or is as soon as that begins.
    const int in_step = rows_.step_of(gelled);
    const bool goes_on = below && rows_.step_of(below->gels.of(n - 1)) <= in_step;
    if (goes_on) {
      made.label = below->label;
    } else if (!next_.empty() && next_.back().end == begin &&
               rows_.step_of(gels(next_.back())) <= in_step) {
      made.label = next_.back().label;
    } else {
      const int begins = rows_.coming_step(gelled);
      made.label = rows_.labels_.add(begins, n == 0);
      rows_.new_.push_back({made.label, {n, rows_.first_ + y_, begin}, begins});
    }
    if (below && made.label != below->label) {
      rows_.join(made.label, below->label, std::max(gelled, below->gels.of(n - 1)));
    }
    if (!its.is_at_once() && !rows_.labels_.anchored(rows_.labels_.root(made.label))) {
      rows_.grow(made.label, {rows_.first_ + y_, begin, end}, gelled, 1);
    }
    if (!goes_on) rows_.made_.push_back({y_, made});
    put(made, !goes_on);
  }

  SolidRows& rows_;
  const int y_;
  Row& old_;
  Row& next_;
  const std::size_t size_ = old_.size();
  std::size_t at_ = 0;
  bool last_made_ = false;  ///< the last of the new ones, or its end
};

void SolidRows::change_row(int y, std::span<const Change> changes) {
  RowChange row(*this, y);
  for (const Change& c : changes) row.change(c);
  row.finish();
  upper_changed_ = upper_changed_ || y == 0;
  lower_changed_ = lower_changed_ || y + 1 == static_cast<int>(rows_.size());
}

void SolidRows::join_beside(std::span<const Made> made, int row) {
  if (row < 0 || row >= static_cast<int>(rows_.size())) return;
  const Row& beside = rows_[static_cast<std::size_t>(row)];
  auto at = beside.begin();
  for (const Made& m : made) {
    const auto before = [&](const Labelled& run) { return run.end <= m.run.begin; };
    // Most often it is one of the next.
    for (int k = 0; k < 4 && at != beside.end() && before(*at); ++k) ++at;
    if (at != beside.end() && before(*at)) at = std::partition_point(at, beside.end(), before);
    const int gels = m.run.gels.of(slice_);
    for (auto k = at; k != beside.end() && k->begin < m.run.end; ++k) {
      join(m.run.label, k->label, std::max(gels, k->gels.of(slice_)));
    }
  }
}

void SolidRows::keep_edging(int row, bool changed, std::vector<Edging>& to) const {
  if (!changed) return;
  Edging& its = to.emplace_back();
  its.slice = slice_;
  its.row = rows_[static_cast<std::size_t>(row)];
  for (const Made& m : made_) {
    if (m.row == row) its.made.push_back(m.run);
  }
}

void SolidRows::end_slice(int more) {
  for (std::size_t from = 0; from < made_.size();) {
    const int row = made_[from].row;
    std::size_t past = from;
    while (past < made_.size() && made_[past].row == row) ++past;
    const auto made = std::span<const Made>(made_).subspan(from, past - from);
    join_beside(made, row - 1);
    join_beside(made, row + 1);
    from = past;
  }
  keep_edging(0, std::exchange(upper_changed_, false), upper_);
  keep_edging(static_cast<int>(rows_.size()) - 1, std::exchange(lower_changed_, false), lower_);
  made_.clear();
  for (const Beginning& b : new_) {
    // What hangs on what is anchored is no body.
    const Label root = labels_.root(b.label);
    if (root == b.label || !labels_.anchored(root)) of_step(b.step).begins.push_back(b);
  }
  new_.clear();
  slice_ += 1 + more;
}

void SolidRows::gel_step(GrowingBodies& bodies) {
  const Bucket& now = of_step(now_);
  --waiting_;
  const auto body_of = [&](Label label) {
    const Label root = labels_.root(label);
    const Label body = labels_.body(root) = bodies.root(labels_.body(root));
    if (bodies.anchored(body)) labels_.set_anchored(root);
    return body;
  };
  for (const Sum& s : now.sums) {
    bodies.add(body_of(s.label), GrowingBodies::Volume::of(s.patch, s.slices));
  }
  for (const Total& t : now.totals) bodies.add(body_of(t.label), t.volume);
  for (const Beginning& b : now.begins) {
    const Label root = labels_.root(b.label);
    Label& body = labels_.body(root);
    if (body == SolidLabels::kNone) {
      body = bodies.begin(b.low, labels_.anchored(root));
    } else {
      bodies.lower(body, b.low);
    }
  }
  for (const Patched& p : now.grows) bodies.grow(body_of(p.label), p.patch, step_);
  for (const Patched& p : now.ends) bodies.grow(body_of(p.label), p.patch, -step_);
}

void SolidRows::join_step(GrowingBodies& bodies) {
  Bucket& now = of_step(now_);
  waiting_ -= now.size() + 1;
  for (const Edge& e : now.edges) {
    const Label a = labels_.root(e.a), b = labels_.root(e.b);
    if (a != b) labels_.unite(a, b, bodies.unite(labels_.body(a), labels_.body(b)));
  }
  // Not only cleared: many may wait for one step, and few for all others.
  now = {};
  ++now_;
}

void SolidRows::end() {
  for (std::size_t y = 0; y < rows_.size(); ++y) {
    for (const Labelled& run : rows_[y]) leave(run, static_cast<int>(y));
    rows_[y].clear();
  }
}

}  // namespace slicecorr::detail
