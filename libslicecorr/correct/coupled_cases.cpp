// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_cases.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "correct/coverage.hpp"

namespace slicecorr::detail {

namespace {

/// Doses of a patch, all of it awake.
class CaseField : public PatchField<double> {
 public:
  using PatchField::Change;
  using PatchField::PatchField;

  void step(int n, const std::vector<Change>& changes) {
    begin(n);
    show(changes);
    lower_ = dose_;
    for (const int k : watched()) {
      const std::size_t first = first_of(k);
      const double* const seen = seen_light(k);
      step_square(dose_.data() + first, seen + first, below() + first, place().stride,
                  plan_.gain(n), plan_.kept(n));
    }
    middle_ = {plan_.middle_below(n), plan_.middle_norm(n)};
  }
  double upper(std::size_t at) const { return dose_[at]; }
  double lower(std::size_t at) const { return lower_[at]; }
  double middle(std::size_t at) const { return middle_.of(dose_[at], lower_[at]); }

 private:
  std::vector<double> lower_;
  MiddleRule middle_{0, 1};
};

class CaseJudge {
 public:
  CaseJudge(const CasePlans& plans, const PixelBox& box, const PatchSources& sources)
      : slices_(plans.as_said.slices),
        merged_(plans.as_said.columns.merge_one_slice_gaps),
        box_(box),
        as_said_(plans.as_said, box),
        weak_(plans.weak, box),
        strong_(plans.strong, box),
        levels_(as_said_.place(), as_said_.place().shown, sources.levels),
        coverage_(as_said_.place(), box, sources.coverage),
        columns_(pixels_of(box)) {
    for (Column& c : columns_) c.bottom = slices_;
  }
  std::vector<CaseTrouble> run() {
    for (int n = slices_; n-- > 0;) look(n);
    std::size_t i = 0;
    for (int y = box_.y0; y < box_.y1; ++y) {
      for (int x = box_.x0; x < box_.x1; ++x) close(columns_[i++], {x, y}, 0);
    }
    return std::move(troubles_);
  }

 private:
  enum class Kind : std::uint8_t { gap, run, grey };
  struct Column {
    Kind kind = Kind::gap;
    bool run_below = false;
    int bottom = 0, slice = -1;
    double extreme = 0;  ///< of the case, at nodes
    double extreme_as_said = 0;
    double nearest = 0, as_said = 0;  ///< of the voxel that may be asked for more
  };
  static Kind kind_of(std::uint8_t cover) {
    return cover == 0 ? Kind::gap : cover == kFull ? Kind::run : Kind::grey;
  }
  void look(int n) {
    changes_.clear();
    levels_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
      changes_.push_back({at, is});
    });
    for (CaseField* const field : {&as_said_, &weak_, &strong_}) field->step(n, changes_);
    coverage_.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    std::size_t i = 0;
    for (int y = box_.y0; y < box_.y1; ++y) {
      for (int x = box_.x0; x < box_.x1; ++x, ++i) {
        look(n, {x, y}, columns_[i]);
      }
    }
  }
  void look(int n, const Pixel& p, Column& c) {
    const std::size_t at = as_said_.place().at(p.x, p.y);
    const Kind kind = kind_of(coverage_[at]);
    if (kind != c.kind) {
      close(c, p, n + 1);
      const bool below = kind == Kind::gap && c.kind == Kind::run;
      const double none = kind == Kind::run ? 0.0 : std::numeric_limits<double>::infinity();
      c = {kind, below, n + 1, -1, none, none, none, none};
    }
    if (kind == Kind::run) {
      c.extreme = std::max({c.extreme, weak_.lower(at), weak_.upper(at)});
      c.extreme_as_said = std::max({c.extreme_as_said, as_said_.lower(at), as_said_.upper(at)});
      if (weak_.upper(at) > c.nearest) {
        c.nearest = weak_.upper(at);
        c.as_said = as_said_.upper(at);
        c.slice = n;
      }
    } else if (kind == Kind::gap) {
      c.extreme = std::min({c.extreme, strong_.lower(at), strong_.upper(at)});
      c.extreme_as_said = std::min({c.extreme_as_said, as_said_.lower(at), as_said_.upper(at)});
      if (strong_.middle(at) < c.nearest) {
        c.nearest = strong_.middle(at);
        c.as_said = as_said_.middle(at);
        c.slice = n;
      }
    }
  }
  void close(const Column& c, const Pixel& p, int top) {
    const bool feature = c.kind == Kind::run && c.extreme < 1;
    const bool meant = merged_ && c.bottom - top == 1;
    const bool gap = c.kind == Kind::gap && c.run_below && c.extreme >= 1 && !meant;
    if (!feature && !gap) return;
    troubles_.push_back({c.slice, p.x, p.y, gap, c.nearest, c.as_said, top, c.bottom,
                         gap == (c.extreme_as_said >= 1)});
  }

  int slices_;
  bool merged_;  ///< gaps of one slice are to fill
  PixelBox box_;
  CaseField as_said_, weak_, strong_;
  PatchBytes levels_, coverage_;
  std::vector<Column> columns_;
  std::vector<CaseField::Change> changes_;
  std::vector<CaseTrouble> troubles_;
};

}  // namespace

std::uint8_t aim_byte(double dose, bool gap) {
  const double steps = (dose - 1) * 200;
  const double whole = gap ? std::floor(steps) : std::ceil(steps);
  return static_cast<std::uint8_t>(2 * std::clamp(whole + 64, 1.0, 127.0));
}

std::vector<CaseTrouble> judge_cases(const CasePlans& plans, const PixelBox& box,
                                     const PatchSources& sources) {
  return CaseJudge(plans, box, sources).run();
}

}  // namespace slicecorr::detail
