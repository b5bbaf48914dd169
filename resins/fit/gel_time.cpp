// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "fit/figure_text.hpp"
#include "fit/prepare.hpp"
#include "fit/statistics.hpp"
#include "measure/number_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/gel_time_fit.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "support/chart/chart.hpp"
#include "support/json/finite.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

using Json = nlohmann::ordered_json;
using slicecorr::detail::finite_or_null;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
/// Conversions that differ by less are the same.
constexpr double kSameConversion = 1e-9;

/// Which of our columns a header has.
struct Header {
  std::string intensity, time, conversion;
  std::vector<std::string> others;  ///< that follow from these
  bool heights = false;
};
Header header_of(const std::string& path) {
  Header h;
  for (const std::string& name : table_header(path)) {
    const std::string low = lower_case(name);
    if (low == "intensity_mw_cm2" || low == "irradiance_mw_cm2") h.intensity = name;
    if (low == "time_s") h.time = name;
    if (low == "conversion") h.conversion = name;
    if (low == "dose_mj_cm2") h.others.push_back(name);
    h.heights = h.heights || low == "cured_height_um" || low == "dead_zone_um";
  }
  return h;
}

void read_times(const std::string& path, std::optional<double> wanted, TimesToGel& into) {
  const Header h = header_of(path);
  const char* const expected = "intensity_mw_cm2,time_s (and conversion)";
  if (h.intensity.empty() || h.time.empty()) {
    throw InputError(path, "header", fmt::format("expected a header with {}", expected));
  }
  std::vector<std::string> passed_over;
  const auto source = static_cast<int>(into.sources.size());
  into.sources.push_back(path);
  std::vector<NumberColumn> columns{{h.intensity.c_str(), 1e-9, 1e9, true, false},
                                    {h.time.c_str(), 1e-9, 1e9, true, false}};
  for (const std::string& name : h.others) columns.push_back({name.c_str(), -1e300, 1e300});
  if (!h.conversion.empty()) columns.push_back({h.conversion.c_str(), 1e-6, 1, true, false});
  std::vector<std::pair<double, TimeToGel>> all;
  std::vector<double> conversions;
  read_number_table(
      path, columns, expected, "times",
      [&](int line, const std::string&, const std::vector<double>& v) {
        const double at = h.conversion.empty() ? 0.0 : v.back();
        all.push_back({at, {v[0], v[1], {source, line}}});
        conversions.push_back(at);
      },
      &passed_over);
  for (const std::string& name : passed_over) {
    into.warnings.push_back(
        fmt::format("{}: column '{}' is passed over", path, text::printable(name)));
  }
  std::sort(conversions.begin(), conversions.end());
  conversions.erase(std::unique(conversions.begin(), conversions.end(),
                                [](double a, double b) { return b - a < kSameConversion; }),
                    conversions.end());
  std::string there;
  for (const double c : conversions) there += fmt::format("{}{:g}", there.empty() ? "" : ", ", c);
  if (h.conversion.empty() && wanted) {
    throw InputError(path, "header", "has no column conversion, which was asked for");
  }
  if (!wanted && conversions.size() > 1) {
    throw InputError(
        path, "conversion",
        fmt::format("there are times to {} conversions ({}); expected --conversion with "
                    "that at which the resin gels",
                    conversions.size(), there));
  }
  const double at = wanted.value_or(conversions.front());
  std::size_t taken = 0;
  for (const auto& [conversion, time] : all) {
    if (std::abs(conversion - at) > kSameConversion) continue;
    into.times.push_back(time);
    ++taken;
  }
  if (taken == 0) {
    throw InputError(path, "conversion",
                     fmt::format("has no time to {:g}; expected one of {}", at, there));
  }
  if (source > 0 && std::abs(into.conversion - at) > kSameConversion) {
    throw InputError(
        path, "conversion",
        fmt::format("its times are to {:g}, those of the file before to {:g}; expected "
                    "the same",
                    at, into.conversion));
  }
  into.conversion = at;
}

/// Sums of the normal equations: relative residuals p A + q B - 1.
struct Sums {
  double pp = 0, pq = 0, qq = 0, p = 0, q = 0;

  explicit Sums(const std::vector<TimeToGel>& times) {
    for (const TimeToGel& t : times) {
      const double by_a = 1 / (t.intensity_mw_cm2 * t.time_s),
                   by_b = 1 / (std::sqrt(t.intensity_mw_cm2) * t.time_s);
      pp += by_a * by_a;
      pq += by_a * by_b;
      qq += by_b * by_b;
      p += by_a;
      q += by_b;
    }
  }
  double determinant() const { return pp * qq - pq * pq; }
  /// The sum of squares is convex: where a figure would be below 0, it is 0 in the best of what is
  /// allowed.
  GelTime best() const {
    const double a = (p * qq - q * pq) / determinant(), b = (q * pp - p * pq) / determinant();
    if (!(a > 0)) return {0.0, q / qq};
    if (!(b > 0)) return {p / pp, 0.0};
    return {a, b};
  }
};

/// The one power of intensity that is nearest, of ln t over ln i.
struct Power {
  double exponent = 0, mean_i = 0, mean_t = 0;

  explicit Power(const std::vector<TimeToGel>& times) {
    const double n = static_cast<double>(times.size());
    for (const TimeToGel& t : times) {
      mean_i += std::log(t.intensity_mw_cm2) / n;
      mean_t += std::log(t.time_s) / n;
    }
    double both = 0, square = 0;
    for (const TimeToGel& t : times) {
      const double off = std::log(t.intensity_mw_cm2) - mean_i;
      both += off * (std::log(t.time_s) - mean_t);
      square += off * off;
    }
    exponent = -both / square;
  }
  double time_s(double intensity_mw_cm2) const {
    return std::exp(mean_t - exponent * (std::log(intensity_mw_cm2) - mean_i));
  }
};

int intensities_of(const std::vector<TimeToGel>& times) {
  std::vector<double> ln_i;
  ln_i.reserve(times.size());
  for (const TimeToGel& t : times) ln_i.push_back(std::log(t.intensity_mw_cm2));
  return count_different(ln_i);
}

// The work grows with the square; more times than these are of a machine, and tell all by themselves.
constexpr std::size_t kMostTimesLeftOut = 2000;

/// Both laws at intensities that they were not fitted to, one at a time.
std::vector<GelTimeFit::LeftOutTime> times_left_out(const std::vector<TimeToGel>& times) {
  std::vector<GelTimeFit::LeftOutTime> all;
  if (times.size() > kMostTimesLeftOut) return all;
  for (const TimeToGel& left : times) {
    std::vector<TimeToGel> rest;
    for (const TimeToGel& t : times) {
      // Rounding of a product is no intensity of its own.
      if (std::abs(std::log(t.intensity_mw_cm2 / left.intensity_mw_cm2)) > 1e-9) rest.push_back(t);
    }
    if (intensities_of(rest) < 3) return {};
    all.push_back({gel_time_s(Sums(rest).best(), left.intensity_mw_cm2) / left.time_s - 1,
                   Power(rest).time_s(left.intensity_mw_cm2) / left.time_s - 1});
  }
  return all;
}

double rms_of(const std::vector<GelTimeFit::LeftOutTime>& all,
              double GelTimeFit::LeftOutTime::*error) {
  double sum = 0;
  for (const auto& one : all) sum += one.*error * (one.*error);
  return std::sqrt(sum / static_cast<double>(all.size()));
}

}  // namespace

bool is_table_of_times(const std::string& path) {
  const Header h = header_of(path);
  return !h.time.empty() && !h.heights;
}

TimesToGel read_times_to_gel(const std::vector<std::string>& paths,
                             std::optional<double> conversion) {
  TimesToGel times;
  check_given_once(paths);
  for (const std::string& path : paths) read_times(path, conversion, times);
  std::vector<std::vector<double>> rows;
  for (const TimeToGel& t : times.times) rows.push_back({t.intensity_mw_cm2, t.time_s});
  if (std::string words = repeats_in_words(std::move(rows)); !words.empty()) {
    times.warnings.push_back(std::move(words));
  }
  return times;
}

GelTimeFit fit_gel_time(const TimesToGel& data) {
  GelTimeFit fit;
  fit.sources = data.sources;
  fit.times = data.times;
  fit.conversion = data.conversion;
  const double n = static_cast<double>(data.times.size());
  const int different = intensities_of(data.times);
  if (different < 2) {
    throw InputError(
        fmt::format("{} times at {} intensities; expected two intensities or more, that "
                    "differ by a factor of 10 better",
                    data.times.size(), different));
  }
  const Sums s(data.times);
  const double determinant = s.determinant();
  const auto [a, b] = s.best();
  fit.a.at_bound = a == 0;
  fit.b.at_bound = b == 0;
  fit.a.value = a;
  fit.b.value = b;
  double squares = 0;
  for (const TimeToGel& t : data.times) {
    fit.predicted_s.push_back(gel_time_s({a, b}, t.intensity_mw_cm2));
    const double off = fit.predicted_s.back() / t.time_s - 1;
    squares += off * off;
    fit.worst_error = std::max(fit.worst_error, std::abs(off));
  }
  fit.rms_error = std::sqrt(squares / n);
  const bool one = fit.a.at_bound || fit.b.at_bound;
  const double freedom = n - (one ? 1 : 2);
  const double variance = freedom > 0 ? squares / freedom : kUnknown;
  const double t = freedom > 0 ? student_t_quantile(0.975, freedom) : kUnknown;
  const auto known = [&](GelTimeFit::Figure& f, double share) {
    f.stderr_ = f.at_bound ? kUnknown : std::sqrt(variance * share);
    f.ci95 = {f.value - t * f.stderr_, f.value + t * f.stderr_};
  };
  known(fit.a, one ? 1 / s.pp : s.qq / determinant);
  known(fit.b, one ? 1 / s.qq : s.pp / determinant);
  fit.covariance = one ? kUnknown : -variance * s.pq / determinant;

  const Power power(data.times);
  fit.exponent = power.exponent;
  for (const TimeToGel& t : data.times) {
    fit.exponent_error =
        std::max(fit.exponent_error, std::abs(power.time_s(t.intensity_mw_cm2) / t.time_s - 1));
  }
  fit.left_out = times_left_out(data.times);
  fit.warnings = data.warnings;
  const auto warn = [&](std::string text) { fit.warnings.push_back(std::move(text)); };
  if (fit.a.at_bound) {
    warn("A came out at 0: no inhibition is seen, and the kinetic law with m = 1/2 says the same");
  } else if (fit.b.at_bound) {
    warn("B came out at 0: time falls with intensity as in Jacobs' law, which says the same");
  } else {
    const auto unsure = [&](const char* name, const GelTimeFit::Figure& f) {
      if (std::isfinite(f.stderr_) && f.ci95[0] <= 0) {
        warn(fmt::format(
            "{} may be 0: its interval reaches there; times at {} intensities would tell", name,
            name[0] == 'A' ? "lower" : "higher"));
      }
    };
    unsure("A", fit.a);
    unsure("B", fit.b);
  }
  if (different == 2) warn("with two intensities nothing is left to see whether the law holds");
  return fit;
}

std::string GelTimeFit::to_json() const {
  Json j;
  j["model"] = "gel-time";
  for (const auto& [name, f, unit] :
       {std::tuple{"gel_a_mj_cm2", &a, "mJ/cm²"}, {"gel_b_sqrt_mw_cm2_s", &b, "sqrt(mW/cm²)·s"}}) {
    j["parameters"][name] = {{"value", finite_or_null(f->value)},
                             {"stderr", finite_or_null(f->stderr_)},
                             {"ci95", {finite_or_null(f->ci95[0]), finite_or_null(f->ci95[1])}},
                             {"unit", unit},
                             {"fixed", false},
                             {"at_bound", f->at_bound}};
  }
  j["n"] = times.size();
  if (conversion > 0) j["conversion"] = conversion;
  j["rms_error"] = finite_or_null(rms_error);
  j["worst_error"] = finite_or_null(worst_error);
  j["exponent"] = finite_or_null(exponent);
  j["exponent_worst_error"] = finite_or_null(exponent_error);
  if (!left_out.empty()) {
    Json& left = j["left_out"] = {{"rms_error", rms_of(left_out, &LeftOutTime::error)},
                                  {"power_rms_error", rms_of(left_out, &LeftOutTime::power_error)},
                                  {"errors", Json::array()},
                                  {"power_errors", Json::array()}};
    for (const LeftOutTime& one : left_out) {
      left["errors"].push_back(one.error);
      left["power_errors"].push_back(one.power_error);
    }
    left["trust"] = left["rms_error"] <= left["power_rms_error"] ? "gel-time" : "power";
  }
  j["outliers"] = Json::array();
  j["warnings"] = warnings;
  j["covariance"] = {{"names", {"gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s"}},
                     {"matrix",
                      {{finite_or_null(a.stderr_ * a.stderr_), finite_or_null(covariance)},
                       {finite_or_null(covariance), finite_or_null(b.stderr_ * b.stderr_)}}}};
  j["sources"] = sources;
  Json& points = j["points"] = Json::array();
  for (std::size_t k = 0; k < times.size(); ++k) {
    points.push_back({{"intensity_mw_cm2", times[k].intensity_mw_cm2},
                      {"time_s", times[k].time_s},
                      {"predicted_s", finite_or_null(predicted_s[k])},
                      {"source", times[k].origin.source},
                      {"line", times[k].origin.line}});
  }
  return j.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string GelTimeFit::to_text() const {
  std::string files;
  for (const std::string& s : sources) files += (files.empty() ? "" : ", ") + s;
  std::string text =
      fmt::format("gel-time fit of {} times from {}{}\n", times.size(), files,
                  conversion > 0 ? fmt::format(", to a conversion of {:g}", conversion) : "");
  const auto line = [&](const char* name, const Figure& f, const char* unit) {
    text += fmt::format("  {:<20} {:>10} {}", name, figure(f.value, f.stderr_), unit);
    text += f.at_bound ? "  (at its bound)\n"
            : std::isfinite(f.stderr_)
                ? fmt::format("  95 %: {} to {}, standard error {:.2g}\n",
                              figure(f.ci95[0], f.stderr_), figure(f.ci95[1], f.stderr_), f.stderr_)
                : "\n";
  };
  line("gel_a_mj_cm2", a, "mJ/cm²");
  line("gel_b_sqrt_mw_cm2_s", b, "sqrt(mW/cm²)·s");
  text += fmt::format(
      "Times to gel within {:.2g} % ({:.2g} % as a rule); the one power nearest to them, "
      "i^-{:.3f}, is off by up to {:.2g} %.\n",
      100 * worst_error, 100 * rms_error, exponent, 100 * exponent_error);
  if (!left_out.empty()) {
    const double ours = rms_of(left_out, &LeftOutTime::error),
                 of_power = rms_of(left_out, &LeftOutTime::power_error);
    text += fmt::format(
        "Intensities that were left out of the fit are predicted to {:.2g} % (rms), by one power to "
        "{:.2g} %: trust {}.\n",
        100 * ours, 100 * of_power, ours <= of_power ? "gel-time" : "the power");
  }
  for (const std::string& w : warnings) text += "Warning: " + w + "\n";
  text.pop_back();
  return text;
}

std::string GelTimeFit::to_svg(const std::string& name) const {
  using chart::Axis;
  using chart::Panel;
  using chart::Picture;
  using chart::Point;
  using chart::Style;
  double low = std::numeric_limits<double>::infinity(), high = 0, least = low, most = 0;
  for (const TimeToGel& t : times) {
    low = std::min(low, t.intensity_mw_cm2);
    high = std::max(high, t.intensity_mw_cm2);
    least = std::min(least, t.time_s);
    most = std::max(most, t.time_s);
  }
  const Axis x{"intensity, mW/cm²", true, low / 1.6, high * 1.6};
  std::vector<Point> line, by_a, by_b;
  for (int k = 0; k <= 200; ++k) {
    const double i = x.low * std::pow(x.high / x.low, k / 200.0);
    line.push_back({i, gel_time_s(gel_time(), i)});
    by_a.push_back({i, a.value / i});
    by_b.push_back({i, b.value / std::sqrt(i)});
  }
  Picture picture(
      fmt::format("{}{}time to gel, gel-time fit", name, name.empty() ? "" : ": "),
      "Measured times to gel over intensity, with the fit A/i + B/√i and its two parts.");
  picture.legend_line(Style::fit, "fit A/i + B/√i");
  picture.legend_line(Style::other, "A/i alone, B/√i alone");
  Panel panel(x, {"time, s", true, least / 2, most * 2}, 320);
  if (!a.at_bound) panel.line(by_a, Style::other);
  if (!b.at_bound) panel.line(by_b, Style::other);
  panel.line(line, Style::fit);
  for (const TimeToGel& t : times) panel.dot({t.intensity_mw_cm2, t.time_s});
  picture.add(panel);
  const double room = std::max(1.0, 130 * worst_error);
  Panel rest(x, {"fit over measured − 1, %", false, -room, room}, 150);
  rest.line({{x.low, 0}, {x.high, 0}}, Style::other);
  for (std::size_t k = 0; k < times.size(); ++k) {
    rest.dot({times[k].intensity_mw_cm2, 100 * (predicted_s[k] / times[k].time_s - 1)});
  }
  picture.add(rest);
  picture.note(
      fmt::format("A {} mJ/cm², B {} √(mW/cm²)·s; worst error {:.2g} %, that of the one power "
                  "nearest to the times, i^-{:.3f}, {:.2g} %.",
                  figure(a.value, a.stderr_), figure(b.value, b.stderr_), 100 * worst_error,
                  exponent, 100 * exponent_error));
  return picture.svg();
}

}  // namespace slicecorr::resins
