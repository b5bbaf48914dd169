// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Fit of a tomographic printer's optics.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "fit/figure_text.hpp"
#include "fit/least_squares.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/optics_fit.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kRadians = std::numbers::pi / 180;

/// All that a fit may move.
struct State {
  Printer printer;
  double n = 1.5, pins_deg = 0, datum_mm = 0;
};

struct Known {
  const char* name;
  const char* unit;
  double step;  ///< for derivatives
  /// What else has to be measured where points leave it open.
  const char* advice;
  double& (*of)(State&);
};
const Known kKnown[] = {
    {"distance_mm", "mm", 1e-3,
     "pins far from the axis, at half of the inner radius and more, at angles all around: near the "
     "projector and far from it; or marks of several heights (z_mm, row_px)",
     [](State& s) -> double& { return s.printer.optics->distance_mm; }},
    {"axis_right_px", "px", 1e-3, "a pin at two angles half a turn apart",
     [](State& s) -> double& { return s.printer.optics->axis_right_px; }},
    {"axis_up_px", "px", 1e-3,
     "marks at several heights (z_mm, row_px), near the projector and far from it",
     [](State& s) -> double& { return s.printer.optics->axis_up_px; }},
    {"tilt_deg", "degrees", 1e-4, "columns in rows far apart: at the top and at the bottom",
     [](State& s) -> double& { return s.printer.optics->tilt_deg; }},
    {"outer_mm", "mm", 1e-4,
     "pins at several distances from the axis, close to the wall, too; or "
     "its radius with a calliper",
     [](State& s) -> double& { return s.printer.vial->outer_mm; }},
    {"inner_mm", "mm", 1e-4,
     "pins at several distances from the axis, close to the wall, too; or "
     "its radius with a calliper",
     [](State& s) -> double& { return s.printer.vial->inner_mm; }},
    {"n_wall", "", 1e-5, "pins at several distances from the axis, close to the wall, too",
     [](State& s) -> double& { return s.printer.vial->n_wall; }},
    {"n", "", 1e-5, "a pin at half of the inner radius or more, at angles all around",
     [](State& s) -> double& { return s.n; }},
    {"pin_deg", "degrees", 1e-4, "a pin away from the axis, at several angles",
     [](State& s) -> double& { return s.pins_deg; }},
    {"z_mm", "mm", 1e-4, "rows of marks", [](State& s) -> double& { return s.datum_mm; }},
};

const Known* known(const std::string& name) {
  for (const Known& k : kKnown) {
    if (name == k.name) return &k;
  }
  return nullptr;
}

bool holds(const State& s) {
  const Vial& v = *s.printer.vial;
  const Optics& o = *s.printer.optics;
  return v.inner_mm > 0 && !wrong_vial(v) && v.n_wall >= 1 && v.n_wall <= 3 && s.n >= 1 &&
         s.n <= 3 && std::abs(o.tilt_deg) <= 45 && !wrong_bath(s.printer) &&
         (o.kind == OpticsKind::telecentric ||
          (o.distance_mm > v.outside_mm() && o.distance_mm < 1e6));
}

/// How far a pixel's ray passes by a point, in the plane and in height, mm.
struct Miss {
  double flat = 0, high = 0;
};
std::optional<Miss> miss_of(const State& s, const OpticsPoint& p, double column, double row) {
  const Rotation& rotation = *s.printer.rotation;
  const AxisWobble wobble = wobble_at(rotation, p.angle_deg);
  const auto ray = ray_in_resin(*s.printer.vial, s.n,
                                chief_ray(s.printer, column - wobble.right_px, row + wobble.up_px));
  if (!ray) return std::nullopt;
  const double turned =
      (rotation.direction == TurnDirection::clockwise ? 1 : -1) * p.angle_deg * kRadians;
  const double at = (p.pin_deg + s.pins_deg) * kRadians - turned - ray->turn_rad;
  const double flat = std::sqrt(1 - ray->kz * ray->kz);
  const double z =
      ray->entry_z_mm + (p.radius_mm * std::sin(at) + 0.5 * ray->chord_mm * flat) * ray->kz / flat;
  return Miss{p.radius_mm * std::cos(at) - ray->t_mm, z - (p.z_mm + s.datum_mm)};
}

/// Newton's method from a place in the image.
SeenAt find_from(const State& s, const OpticsPoint& p, SeenAt at) {
  const bool marked = std::isfinite(p.z_mm);
  constexpr double step = 1e-3;
  const double pitch_mm = s.printer.pixel_x_um * 1e-3;
  const double far = s.printer.vial->outside_mm() / pitch_mm;
  for (int i = 0; i < 60; ++i) {
    const auto here = miss_of(s, p, at.column, at.row);
    const auto right = miss_of(s, p, at.column + step, at.row);
    if (!here || !right) return {kNone, kNone};
    double dc = 0, dr = 0;
    const double fc = (right->flat - here->flat) / step;
    if (marked) {
      const auto down = miss_of(s, p, at.column, at.row + step);
      if (!down) return {kNone, kNone};
      const double fr = (down->flat - here->flat) / step;
      const double hc = (right->high - here->high) / step, hr = (down->high - here->high) / step;
      const double det = fc * hr - fr * hc;
      dc = (-here->flat * hr + here->high * fr) / det;
      dr = (-here->high * fc + here->flat * hc) / det;
    } else {
      dc = -here->flat / fc;
    }
    if (!std::isfinite(dc) || !std::isfinite(dr)) return {kNone, kNone};
    // Near the wall rays turn fast: no step may leave the vial.
    double share = 1;
    while (share > 1e-6 && !miss_of(s, p, at.column + share * dc, at.row + share * dr)) share /= 2;
    dc = std::clamp(share * dc, -far, far);
    dr *= share;
    at.column += dc;
    at.row += dr;
    if (std::abs(dc) + std::abs(dr) < 1e-9) return at;
  }
  return {kNone, kNone};
}

SeenAt find(const State& s, const OpticsPoint& p) {
  const bool marked = std::isfinite(p.z_mm);
  const ImagePlace middle = image_place(s.printer, {0, 0});
  const bool rows = std::isfinite(p.row_px);
  // From where it was measured it is nearest; from the axis, where that leads nowhere.
  if (std::isfinite(p.column_px) || (marked && rows)) {
    const SeenAt seen = find_from(
        s, p,
        {std::isfinite(p.column_px) ? p.column_px : middle.column, rows ? p.row_px : middle.row});
    if (std::isfinite(seen.column)) return seen;
  }
  return find_from(s, p, {middle.column, rows && !marked ? p.row_px : middle.row});
}

/// A column or a row that was measured.
struct Observation {
  std::size_t point = 0;
  bool is_row = false;
};

class Model : public LeastSquares {
 public:
  Model(const OpticsPoints& points, State start)
      : points_(points.points), start_(std::move(start)) {}

  std::vector<const Known*> fitted;
  std::vector<Observation> observations;
  State& start() { return start_; }
  const State& start() const { return start_; }

  State at(const double* values) const {
    State s = start_;
    for (std::size_t i = 0; i < fitted.size(); ++i) fitted[i]->of(s) = values[i];
    return s;
  }
  std::vector<double> values() const {
    State s = start_;
    std::vector<double> all;
    for (const Known* k : fitted) all.push_back(k->of(s));
    return all;
  }
  std::size_t count() const override { return observations.size(); }
  std::size_t unknowns() const override { return fitted.size(); }
  double step(std::size_t unknown, double) const override { return fitted[unknown]->step; }
  /// Measured less found, over its scatter; false where the printer is none.
  bool residuals(const double* values, double* out) const override {
    const State s = at(values);
    if (!holds(s)) return false;
    std::size_t known_point = points_.size();
    SeenAt seen;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const OpticsPoint& p = points_[observations[i].point];
      if (observations[i].point != known_point) {
        seen = find(s, p);
        known_point = observations[i].point;
      }
      out[i] =
          (observations[i].is_row ? p.row_px - seen.row : p.column_px - seen.column) / p.sigma_px;
      if (!std::isfinite(out[i])) return false;
    }
    return true;
  }

 private:
  const std::vector<OpticsPoint>& points_;
  State start_;
};

/// From where the pins stand by a look around, as nobody knows it to begin with.
double solve(const Model& model, std::vector<double>& best, bool fine = true) {
  struct Start {
    double cost = 0;
    std::vector<double> values;
  };
  std::vector<Start> starts;
  const auto pins = std::find_if(model.fitted.begin(), model.fitted.end(), [](const Known* k) {
    return std::string_view(k->name) == "pin_deg";
  });
  for (int deg = 0; deg < 360; deg += 10) {
    Start start{0, model.values()};
    if (pins != model.fitted.end()) {
      start.values[static_cast<std::size_t>(pins - model.fitted.begin())] += deg;
    }
    start.cost = model.cost(start.values.data());
    // Pins may stand so that no light comes to them from there; any other place may do.
    if (std::isfinite(start.cost)) starts.push_back(std::move(start));
    if (pins == model.fitted.end()) break;
  }
  std::sort(starts.begin(), starts.end(),
            [](const Start& a, const Start& b) { return a.cost < b.cost; });
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < std::min<std::size_t>(3, starts.size()); ++i) {
    std::vector<double> values = starts[i].values;
    const double cost = minimise(model, values, 1e-4, 30);
    if (cost < least * (1 - 1e-6)) {
      least = cost;
      best = values;
    }
  }
  if (fine && std::isfinite(least)) least = minimise(model, best, kFine, 200);
  return least;
}

std::string names_of(const std::vector<const Known*>& all) {
  std::string text;
  for (const Known* k : all) text += (text.empty() ? "" : ", ") + std::string(k->name);
  return text;
}

/// Throws when some combination of what is fitted moves no point.
FitShape shape_at(const Model& model, const std::vector<double>& values,
                  const std::string& source) {
  FitShape shape = shape_of(model, values);
  if (!shape.holds) throw InputError(source, "", "the fit ended where no light comes to a pin");
  if (shape.open.empty()) return shape;
  std::vector<const Known*> open;
  std::string next;
  for (const std::size_t k : shape.open) {
    const Known* const one = model.fitted[k];
    open.push_back(one);
    if (next.find(one->advice) == std::string::npos) {
      next += fmt::format("\n  for {}: {}", one->name, one->advice);
    }
  }
  throw InputError(source, "",
                   fmt::format("these points can't tell {}{}; hold one with --fix, or measure{}",
                               names_of(open), open.size() > 1 ? " from each other" : "", next));
}

void check_names(const OpticsFitOptions& options) {
  const auto check = [](const std::string& name) {
    if (known(name)) return;
    std::vector<const Known*> all;
    for (const Known& k : kKnown) all.push_back(&k);
    throw InputError(fmt::format("'{}' is no parameter; expected one of {}", name, names_of(all)));
  };
  for (const auto& [name, value] : options.fixed) check(name);
  for (const auto& name : options.held) check(name);
  for (const auto& name : options.free) check(name);
}

/// Whether it is fitted when nothing else is said.
bool by_itself(const std::string& name, const State& s, const OpticsPoints& points) {
  const bool pinhole = s.printer.optics->kind == OpticsKind::pinhole;
  bool marks = false;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  bool away = false;
  for (const OpticsPoint& p : points.points) {
    marks = marks || (std::isfinite(p.z_mm) && std::isfinite(p.row_px));
    away = away || p.radius_mm > 0;
    if (!std::isfinite(p.column_px)) continue;
    const double row = std::isfinite(p.row_px) ? p.row_px : image_place(s.printer, {0, 0}).row;
    low = std::min(low, row);
    high = std::max(high, row);
  }
  if (name == "axis_right_px") return true;
  if (name == "pin_deg") return away;
  if (name == "distance_mm") return pinhole;
  if (name == "tilt_deg") return high - low > 0.1 * s.printer.height_px;
  if (name == "axis_up_px") return pinhole && marks;
  if (name == "z_mm") return marks;
  if (name == "n") return std::abs(s.printer.vial->n_outside - s.n) > 0.005;
  return false;
}

/// Throws where the points say that the stage turns the other way. A note where they can't tell.
void check_direction(const Model& model, double cost, const std::string& source,
                     std::vector<std::string>& notes) {
  Model other = model;
  Rotation& rotation = *other.start().printer.rotation;
  const char* const said = name_of(rotation.direction);
  rotation.direction = rotation.direction == TurnDirection::clockwise
                           ? TurnDirection::counterclockwise
                           : TurnDirection::clockwise;
  std::vector<double> values;
  const double turned = solve(other, values, false);
  const double n = static_cast<double>(model.observations.size());
  const double least = n * 1e-10;
  // As wide as Fisher's F is for chance alone.
  constexpr double clearly = 4;
  if (turned * clearly + least < cost) {
    throw InputError(
        source, "",
        fmt::format("the stage turns {}: points are {:.3g} pixels off then, and {:.3g} as the "
                    "printer file has it, {}; correct [rotation] direction, or give angles as the "
                    "stage turns",
                    name_of(rotation.direction), std::sqrt(turned / n), std::sqrt(cost / n), said));
  }
  if (turned < clearly * cost + least) {
    notes.emplace_back(
        "These points can't tell which way the stage turns; a second pin at another angle "
        "(pin_deg) can, and so can the target of directions.");
  }
}

/// Pixels by which points are off, beyond which nobody misread them: columns are told to half of one.
constexpr double kMisfitPx = 1;

/// Whether vial and lens explain the points. An axis that goes astray moves all points of an angle
/// alike, and that is left to the file of its wobble; what is off from point to point of an angle is not.
void judge_fit(OpticsFit& fit) {
  struct Sum {
    double sum = 0, squares = 0;
    int count = 0;
  };
  std::map<std::pair<double, bool>, Sum> by_angle;
  for (const OpticsResidual& r : fit.residuals) {
    const auto take = [&](bool row, double off, bool out) {
      if (!std::isfinite(off) || out) return;
      Sum& s = by_angle[{r.angle_deg, row}];
      s.sum += off;
      s.squares += off * off;
      ++s.count;
    };
    take(false, r.column_px, r.column_left_out);
    take(true, r.row_px, r.row_left_out);
  }
  double squares = 0;
  int freedom = 0;
  for (const auto& [angle, s] : by_angle) {
    squares += s.squares - s.sum * s.sum / s.count;
    freedom += s.count - 1;
  }
  const char* const next =
      fit.printer.bath
          ? "look at window_mm, n and wall_mm in [bath], and at radius_mm and pin_deg of the pins"
          : "look at radius_mm and pin_deg of the pins; a bath behind a flat window needs [bath]";
  if (freedom > 0) {
    fit.apart_px = std::sqrt(std::max(0.0, squares) / freedom);
    fit.fits = fit.apart_px <= kMisfitPx;
    if (fit.fits) return;
    fit.notes.push_back(
        fmt::format("This vial and lens do not fit: points of one angle are {:.2g} pixels off from "
                    "each other; expected {:g} or less. What was found is not to be used; {}.",
                    fit.apart_px, kMisfitPx, next));
  } else if (fit.rms_px > kMisfitPx) {
    fit.notes.push_back(fmt::format(
        "Points are {:.2g} pixels off, and one at each angle can't tell an axis that goes "
        "astray from a vial and lens that do not fit; measure two pins or marks at each "
        "angle, and {}.",
        fit.rms_px, next));
  }
}

}  // namespace

SeenAt seen_at(const Printer& printer, double n, const OpticsPoint& point, double pins_deg,
               double datum_mm) {
  require_tomographic(printer);
  const State s{printer, n, pins_deg, datum_mm};
  return holds(s) ? find(s, point) : SeenAt{kNone, kNone};
}

OpticsFit fit_optics(const OpticsPoints& points, const Printer& printer, double n,
                     const OpticsFitOptions& options) {
  require_tomographic(printer);
  check_names(options);
  const State before{printer, n, 0, 0};
  Model model(points, before);
  for (const auto& [name, value] : options.fixed) known(name)->of(model.start()) = value;
  if (!holds(model.start())) {
    throw InputError(printer.name, "",
                     "values held with --fix make no vial and lens; expected inner_mm < outer_mm < "
                     "distance_mm, indices of 1 to 3");
  }
  for (const OpticsPoint& p : points.points) {
    if (p.radius_mm >= model.start().printer.vial->inner_mm) {
      throw InputError(points.source, fmt::format("line {}", p.line),
                       fmt::format("the pin stands {:g} mm from the axis; expected one in the "
                                   "resin, within {:g} mm",
                                   p.radius_mm, model.start().printer.vial->inner_mm));
    }
  }
  for (const Known& k : kKnown) {
    if (options.fixed.count(k.name) || options.held.count(k.name)) continue;
    if (options.free.count(k.name) || by_itself(k.name, model.start(), points)) {
      model.fitted.push_back(&k);
    }
  }
  if (model.fitted.empty()) throw InputError("all parameters are held: there is nothing to fit");
  for (std::size_t i = 0; i < points.points.size(); ++i) {
    const OpticsPoint& p = points.points[i];
    if (std::isfinite(p.column_px)) model.observations.push_back({i, false});
    if (std::isfinite(p.row_px) && std::isfinite(p.z_mm)) model.observations.push_back({i, true});
  }
  const std::size_t all = model.observations.size();
  if (all <= model.fitted.size()) {
    std::string next;
    for (const Known* k : model.fitted) {
      if (next.find(k->advice) == std::string::npos) {
        next += fmt::format("\n  for {}: {}", k->name, k->advice);
      }
    }
    throw InputError(
        points.source, "",
        fmt::format("has {} measured columns and rows for {} parameters ({}); expected "
                    "at least {}, better three times as many. Measure{}",
                    all, model.fitted.size(), names_of(model.fitted), model.fitted.size() + 1,
                    next));
  }
  OpticsFit fit;
  fit.source = points.source;
  std::vector<std::vector<double>> rows;
  for (const OpticsPoint& p : points.points) {
    rows.push_back({p.angle_deg, p.radius_mm, p.pin_deg, p.z_mm, p.column_px, p.row_px});
  }
  if (const std::string words = repeats_in_words(std::move(rows)); !words.empty()) {
    fit.notes.push_back(words + ".");
  }
  std::vector<double> values;
  double cost = solve(model, values);
  if (!std::isfinite(cost)) {
    throw InputError(points.source, "",
                     "no light of this printer comes to these pins; expected another radius_mm, or "
                     "[vial] and [optics] nearer to the machine");
  }
  check_direction(model, cost, points.source, fit.notes);
  FitShape shape = shape_at(model, values, points.source);
  std::vector<Observation> left_out;
  while (!options.keep_outliers) {
    const auto worst = outlier_of(shape, model.fitted.size());
    if (!worst) break;
    left_out.push_back(model.observations[*worst]);
    if (5 * left_out.size() > all || all - left_out.size() <= model.fitted.size() + 1) {
      throw InputError(
          points.source, fmt::format("line {}", points.points[left_out.front().point].line),
          fmt::format("more than a fifth of the points do not belong to the others, this one the "
                      "least; expected points of one vial and pins that stand still, or "
                      "--keep-outliers to count them all"));
    }
    model.observations.erase(model.observations.begin() + static_cast<std::ptrdiff_t>(*worst));
    cost = minimise(model, values, kFine, 200);
    shape = shape_at(model, values, points.source);
  }
  State found = model.at(values.data());
  found.pins_deg -= 360 * std::floor(found.pins_deg / 360);
  fit.printer = found.printer;
  fit.n = found.n;
  fit.measurements = static_cast<int>(model.observations.size());
  fit.freedom = fit.measurements - static_cast<int>(model.fitted.size());
  const double variance = cost / fit.freedom;
  const double quantile = student_t_quantile(0.975, fit.freedom);
  for (const Known& k : kKnown) {
    OpticsParameter p;
    p.name = k.name;
    p.unit = k.unit;
    State was = before, is = found;
    p.before = k.of(was);
    p.value = k.of(is);
    const auto at = std::find(model.fitted.begin(), model.fitted.end(), &k);
    if (at != model.fitted.end()) {
      const auto i = static_cast<Eigen::Index>(at - model.fitted.begin());
      p.fitted = true;
      p.standard_error = std::sqrt(variance * shape.unscaled(i, i));
      p.ci95 = {p.value - quantile * p.standard_error, p.value + quantile * p.standard_error};
    }
    fit.parameters.push_back(p);
  }
  double squares = 0;
  std::size_t counted = 0;
  for (std::size_t i = 0; i < points.points.size(); ++i) {
    const OpticsPoint& p = points.points[i];
    const SeenAt seen = find(found, p);
    OpticsResidual r{p.line,
                     p.angle_deg,
                     p.radius_mm,
                     p.pin_deg,
                     p.column_px - seen.column,
                     std::isfinite(p.z_mm) ? p.row_px - seen.row : kNone,
                     false,
                     false};
    for (const Observation& o : left_out) {
      if (o.point == i) (o.is_row ? r.row_left_out : r.column_left_out) = true;
    }
    for (const auto& [off, out] :
         {std::pair{r.column_px, r.column_left_out}, {r.row_px, r.row_left_out}}) {
      if (!std::isfinite(off) || out) continue;
      squares += off * off;
      ++counted;
    }
    fit.residuals.push_back(r);
  }
  fit.rms_px = counted ? std::sqrt(squares / static_cast<double>(counted)) : 0;
  for (const Observation& o : left_out) {
    const OpticsResidual& r = fit.residuals[o.point];
    fit.notes.push_back(
        fmt::format("Line {} does not belong to the others and is left out: its {} "
                    "is {:.2f} pixels off.",
                    r.line, o.is_row ? "row" : "column", o.is_row ? r.row_px : r.column_px));
  }
  if (found.printer.optics->kind == OpticsKind::pinhole) {
    const OpticsParameter& l = fit.parameter("distance_mm");
    if (l.fitted && l.ci95[1] - l.ci95[0] > 0.1 * l.value) {
      fit.notes.push_back(fmt::format("The distance is known to {:.0f} % only; measure {}.",
                                      50 * (l.ci95[1] - l.ci95[0]) / l.value,
                                      known("distance_mm")->advice));
    }
  }
  judge_fit(fit);
  return fit;
}

}  // namespace slicecorr::resins
