// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/chart/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "support/text/escape.hpp"

namespace slicecorr::chart {

namespace {

constexpr double kWidth = 640, kLeft = 76, kRight = 20;
constexpr double kInner = kWidth - kLeft - kRight;
constexpr int kShapes = 6;

// Literal colours, no variables: programs that know little CSS show the light version. The six
// colours of series keep 4.5:1 against their ground and differ in lightness for the colour-blind.
constexpr const char* kStyle =
    ".slc-plot{max-width:100%;height:auto}.slc-plot .ground{fill:#fff}.slc-plot "
    "text{font-family:system-ui,sans-serif;font-size:16px;fill:#1b1f24}.slc-plot "
    ".head{font-size:19px;font-weight:600}.slc-plot .tick{fill:#4a545e}.slc-plot "
    ".halo{paint-order:stroke;stroke:#fff;stroke-width:4px;stroke-linejoin:round}.slc-plot "
    ".frame{fill:none;stroke:#80868c;stroke-width:1}.slc-plot "
    ".grid{stroke:#d5dae0;stroke-width:1}.slc-plot .minor{stroke:#eceff2;stroke-width:1}.slc-plot "
    ".fit{fill:none;stroke:#c2410c;stroke-width:2.5}.slc-plot "
    ".other{fill:none;stroke:#0b57d0;stroke-width:2.5;stroke-dasharray:8 5}.slc-plot "
    ".reference{fill:none;stroke:#4a545e;stroke-width:1.5;stroke-dasharray:6 4}.slc-plot "
    ".mark{fill:none;stroke:#4a545e;stroke-width:1.5;stroke-dasharray:2 3}.slc-plot "
    ".area-fit{fill:#c2410c;fill-opacity:.16}.slc-plot "
    ".area-other{fill:#0b57d0;fill-opacity:.16}.slc-plot .area-reference,.slc-plot "
    ".area-mark{fill:#4a545e;fill-opacity:.14}.slc-plot "
    ".ring{fill:none;stroke:#b3003c;stroke-width:2}.slc-plot "
    ".dot{fill:#1b1f24;stroke:#fff;stroke-width:1.5}.slc-plot "
    ".s0{stroke:#0b57d0;fill:#0b57d0}.slc-plot .s1{stroke:#9a3412;fill:#9a3412}.slc-plot "
    ".s2{stroke:#00694e;fill:#00694e}.slc-plot .s3{stroke:#8e3a80;fill:#8e3a80}.slc-plot "
    ".s4{stroke:#7a5600;fill:#7a5600}.slc-plot .s5{stroke:#1b1f24;fill:#1b1f24}.slc-plot "
    ".p{fill-opacity:.45;stroke-width:1.5}.slc-plot .open{fill-opacity:0}.slc-plot "
    ".l{fill:none;stroke-width:2}.slc-plot .a{stroke:none;fill-opacity:.14}"
    // The same on light and dark ground: from dark violet to yellow, told apart without colour,
    // too.
    ".slc-plot .step{stroke:none}.slc-plot .t0{fill:#7b3fa0}.slc-plot .t1{fill:#5a4fb0}.slc-plot "
    ".t2{fill:#3f6fb5}.slc-plot .t3{fill:#2b8f9c}.slc-plot .t4{fill:#2aa884}.slc-plot "
    ".t5{fill:#5cc163}.slc-plot .t6{fill:#a0da39}.slc-plot .t7{fill:#fde725}@media screen and "
    "(prefers-color-scheme:dark){.slc-plot .ground{fill:#1d2126}.slc-plot "
    "text{fill:#e6e9ec}.slc-plot .tick{fill:#b4bdc6}.slc-plot .halo{stroke:#1d2126}.slc-plot "
    ".frame{stroke:#7d8894}.slc-plot .grid{stroke:#343a41}.slc-plot "
    ".minor{stroke:#272c32}.slc-plot .fit{stroke:#fb923c}.slc-plot .other{stroke:#8ab4f8}.slc-plot "
    ".reference,.slc-plot .mark{stroke:#b4bdc6}.slc-plot "
    ".area-fit{fill:#fb923c;fill-opacity:.26}.slc-plot "
    ".area-other{fill:#8ab4f8;fill-opacity:.26}.slc-plot .area-reference,.slc-plot "
    ".area-mark{fill:#b4bdc6}.slc-plot .ring{stroke:#ff7a9c}.slc-plot "
    ".dot{fill:#e6e9ec;stroke:#1d2126}.slc-plot .s0{stroke:#8ab4f8;fill:#8ab4f8}.slc-plot "
    ".s1{stroke:#fdba8c;fill:#fdba8c}.slc-plot .s2{stroke:#5fd3a8;fill:#5fd3a8}.slc-plot "
    ".s3{stroke:#e3a0d6;fill:#e3a0d6}.slc-plot .s4{stroke:#e5c04b;fill:#e5c04b}.slc-plot "
    ".s5{stroke:#e6e9ec;fill:#e6e9ec}.slc-plot .l,.slc-plot .open{fill:none}.slc-plot "
    ".a{stroke:none}}";

/// A coordinate: two decimals, never "-0".
std::string coordinate(double v) {
  std::string s = fmt::format("{:.2f}", std::clamp(v, -1e5, 1e5));
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

std::string_view class_of(Style style) {
  switch (style) {
    case Style::fit:
      return "fit";
    case Style::other:
      return "other";
    case Style::reference:
      return "reference";
    case Style::mark:
      return "mark";
    case Style::series:
    case Style::step:
      return "l";
  }
  return "";
}

std::string line_class(Style style, int series) {
  return style == Style::series ? fmt::format("s{} l", series % kShapes)
                                : std::string(class_of(style));
}

std::string area_class(Style style, int series) {
  if (style == Style::step) return fmt::format("step t{}", series % kSteps);
  return style == Style::series ? fmt::format("s{} a", series % kShapes)
                                : fmt::format("area-{}", class_of(style));
}

/// A marker at (x, y): six shapes, filled; the next six series hollow.
std::string marker(double x, double y, int series, const std::string& words) {
  constexpr double r = 5;
  const auto at = [&](double dx, double dy) {
    return coordinate(x + dx) + " " + coordinate(y + dy);
  };
  std::string path;
  switch (series % kShapes) {
    case 0:  // circle, of two arcs
      path = fmt::format("M{0}A{2} {2} 0 1 0 {1}A{2} {2} 0 1 0 {0}Z", at(-r, 0), at(r, 0), r);
      break;
    case 1:
      path =
          fmt::format("M{}L{}L{}L{}Z", at(-4.5, -4.5), at(4.5, -4.5), at(4.5, 4.5), at(-4.5, 4.5));
      break;
    case 2:
      path = fmt::format("M{}L{}L{}Z", at(0, -6), at(5.5, 4.5), at(-5.5, 4.5));
      break;
    case 3:
      path = fmt::format("M{}L{}L{}L{}Z", at(0, -6.5), at(6.5, 0), at(0, 6.5), at(-6.5, 0));
      break;
    case 4:
      path = fmt::format("M{}L{}L{}Z", at(0, 6), at(5.5, -4.5), at(-5.5, -4.5));
      break;
    default:
      path = fmt::format("M{}L{}M{}L{}", at(-5, -5), at(5, 5), at(-5, 5), at(5, -5));
  }
  const bool open = series / kShapes % 2 == 1;
  const std::string title =
      words.empty() ? "" : fmt::format("<title>{}</title>", escape_markup(words));
  return fmt::format(R"(<path class="s{} p{}" d="{}"{})", series % kShapes, open ? " open" : "",
                     path, title.empty() ? "/>" : ">" + title + "</path>");
}

std::string bar_path(double x, double low, double high, int series) {
  return fmt::format(
      R"(<path class="s{0} l" d="M{2} {4}L{3} {4}M{1} {4}L{1} {5}M{2} {5}L{3} {5}"/>)",
      series % kShapes, coordinate(x), coordinate(x - 4), coordinate(x + 4), coordinate(low),
      coordinate(high));
}

std::string path_of(const std::vector<std::string>& pieces) {
  std::string d;
  for (const std::string& p : pieces) d += p;
  return d;
}

double round_step(double range, int most) {
  const double raw = range / std::max(1, most);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (power * factor >= raw * (1 - 1e-9)) return power * factor;
  }
  return power * 10;
}

std::string tick_label(double v) {
  if (v == 0) return "0";
  const double size = std::abs(v);
  if (size >= 1e5 || size < 1e-3) {
    static constexpr const char* kDigits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
    int power = static_cast<int>(std::floor(std::log10(size) + 1e-9));
    const double mantissa = v / std::pow(10.0, power);
    std::string s = std::abs(mantissa - 1) < 1e-9 ? "10" : fmt::format("{:.3g}·10", mantissa);
    if (power < 0) s += "⁻";
    power = std::abs(power);
    const std::string digits = std::to_string(power);
    for (const char c : digits) s += kDigits[c - '0'];
    return s;
  }
  return fmt::format("{:.6g}", v);
}

int length_of(std::string_view text) {
  return static_cast<int>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

}  // namespace

std::string figure(double value) {
  if (!std::isfinite(value)) return "-";
  const double size = std::abs(value);
  if (size >= 1000 && size < 1e6) return fmt::format("{:.0f}", value);
  return fmt::format("{:.4g}", value);
}

Axis axis_over(std::string title, bool logarithmic, const std::vector<double>& values,
               bool from_zero) {
  Axis axis{std::move(title), logarithmic, 0, 1};
  bool any = false;
  for (const double v : values) {
    if (!std::isfinite(v) || (logarithmic && v <= 0)) continue;
    axis.low = any ? std::min(axis.low, v) : v;
    axis.high = any ? std::max(axis.high, v) : v;
    any = true;
  }
  if (!any) {
    axis.low = logarithmic ? 1 : 0;
    axis.high = logarithmic ? 10 : 1;
  }
  if (logarithmic) {
    const double room = std::max(1.12, std::pow(axis.high / axis.low, 0.04));
    axis.low /= room;
    axis.high *= room;
    return axis;
  }
  double span = axis.high - axis.low;
  if (!(span > 0)) span = std::max(1e-9, std::abs(axis.high));
  const bool zero = from_zero && axis.low >= 0;
  axis.high += 0.07 * span;
  axis.low = zero ? 0 : axis.low - 0.07 * span;
  return axis;
}

std::vector<Tick> ticks_of(const Axis& axis, int most) {
  if (!axis.ticks.empty()) return axis.ticks;
  std::vector<Tick> ticks;
  if (!(axis.high > axis.low) || !std::isfinite(axis.high - axis.low)) return ticks;
  const double decades = axis.logarithmic ? std::log10(axis.high / axis.low) : 0;
  // Less than half a decade has no round powers in it: steps as on a linear axis.
  if (axis.logarithmic && decades >= 0.5) {
    const int first = static_cast<int>(std::floor(std::log10(axis.low)));
    const int last = static_cast<int>(std::ceil(std::log10(axis.high)));
    const int stride = std::max(1, static_cast<int>(std::ceil((last - first) / double(most))));
    for (int p = first; p <= last; ++p) {
      for (int digit = 1; digit < 10; ++digit) {
        const double v = digit * std::pow(10.0, p);
        if (v < axis.low * (1 - 1e-12) || v > axis.high * (1 + 1e-12)) continue;
        const bool power = digit == 1 && (p - first) % stride == 0;
        const bool between = (decades < 2.2 && (digit == 2 || digit == 5)) ||
                             (decades < 1.1 && (digit == 3 || digit == 4 || digit == 7));
        const bool crowded = stride > 1 && digit > 1;
        if (!crowded) ticks.push_back({v, power || between ? tick_label(v) : ""});
      }
    }
    return ticks;
  }
  const double step = round_step(axis.high - axis.low, most);
  const double minor = step / 5;
  const double first = std::ceil(axis.low / minor - 1e-9);
  for (double i = first; i * minor <= axis.high + 1e-9 * step; ++i) {
    const bool major = std::abs(std::remainder(i, 5)) < 0.5;
    // Rounded, so that 0.30000000000000004 is 0.3.
    const double v = major ? std::round(i / 5) * step : i * minor;
    ticks.push_back({v, major ? tick_label(std::abs(v) < 1e-9 * step ? 0 : v) : ""});
  }
  return ticks;
}

std::vector<std::string> wrapped(const std::string& text, int columns) {
  std::vector<std::string> lines;
  std::istringstream words(text);
  std::string line;
  for (std::string word; words >> word;) {
    if (!line.empty() && length_of(line) + 1 + length_of(word) > columns) {
      lines.push_back(line);
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
  }
  if (!line.empty()) lines.push_back(line);
  return lines;
}

Panel::Panel(Axis x, Axis y, double height, bool x_labels)
    : x_(std::move(x)), y_(std::move(y)), height_(height), x_labels_(x_labels) {}

double Panel::px(double x) const {
  const double t = x_.logarithmic ? std::log(x / x_.low) / std::log(x_.high / x_.low)
                                  : (x - x_.low) / (x_.high - x_.low);
  return t * kInner;
}

double Panel::py(double y) const {
  const double t = y_.logarithmic ? std::log(y / y_.low) / std::log(y_.high / y_.low)
                                  : (y - y_.low) / (y_.high - y_.low);
  return (y_.downwards ? t : 1 - t) * height_;
}

bool Panel::shows(Point p) const {
  return std::isfinite(p.x) && std::isfinite(p.y) && (!x_.logarithmic || p.x > 0) &&
         (!y_.logarithmic || p.y > 0);
}

void Panel::halo(double x, double y, const std::string& text, std::string_view anchor) {
  text_ += fmt::format(R"(<text class="halo" x="{}" y="{}" text-anchor="{}">{}</text>)",
                       coordinate(x), coordinate(y), anchor, escape_markup(text));
}

void Panel::line(const std::vector<Point>& points, Style style, int series) {
  std::string d;
  bool pen = false;
  for (const Point& p : points) {
    if (!shows(p)) {
      pen = false;
      continue;
    }
    d += fmt::format("{}{} {}", pen ? "L" : "M", coordinate(px(p.x)), coordinate(py(p.y)));
    pen = true;
  }
  if (!d.empty())
    body_ += fmt::format(R"(<path class="{}" d="{}"/>)", line_class(style, series), d);
}

void Panel::band(const std::vector<Point>& low, const std::vector<Point>& high, Style style,
                 int series) {
  std::string d;
  const std::size_t n = std::min(low.size(), high.size());
  for (std::size_t i = 0; i < n;) {
    if (!shows(low[i]) || !shows(high[i])) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < n && shows(low[end]) && shows(high[end])) ++end;
    std::vector<std::string> pieces;
    for (std::size_t k = i; k < end; ++k) {
      pieces.push_back(fmt::format("{}{} {}", k == i ? "M" : "L", coordinate(px(high[k].x)),
                                   coordinate(py(high[k].y))));
    }
    for (std::size_t k = end; k-- > i;) {
      pieces.push_back(fmt::format("L{} {}", coordinate(px(low[k].x)), coordinate(py(low[k].y))));
    }
    d += path_of(pieces) + "Z";
    i = end;
  }
  if (!d.empty())
    body_ += fmt::format(R"(<path class="{}" d="{}"/>)", area_class(style, series), d);
}

void Panel::bins(const std::vector<double>& counts, double most, int series) {
  const auto n = static_cast<double>(counts.size());
  std::vector<Point> low, high;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    for (const std::size_t edge : {i, i + 1}) {
      low.push_back({most * static_cast<double>(edge) / n, y_.low});
      high.push_back({low.back().x, std::max(counts[i], y_.low)});
    }
  }
  band(low, high, Style::series, series);
  line(high, Style::series, series);
}

void Panel::point(Point p, int series, const std::string& words) {
  if (shows(p)) body_ += marker(px(p.x), py(p.y), series, words);
}

void Panel::bar(Point p, int series, double error) {
  if (!(error > 0) || !shows({p.x, p.y - error}) || !shows({p.x, p.y + error})) return;
  const double x = px(p.x);
  body_ += bar_path(x, py(p.y - error), py(p.y + error), series);
}

void Panel::ring(Point p, const std::string& text) {
  if (!shows(p)) return;
  const double x = px(p.x), y = py(p.y);
  body_ +=
      fmt::format(R"(<circle class="ring" cx="{}" cy="{}" r="10"/>)", coordinate(x), coordinate(y));
  const bool left = x > kInner * 0.75;
  halo(left ? x - 14 : x + 14, std::clamp(y + 5, 14.0, height_ - 4), text, left ? "end" : "start");
}

void Panel::dot(Point p) {
  if (!shows(p)) return;
  body_ += fmt::format(R"(<circle class="dot" cx="{}" cy="{}" r="5"/>)", coordinate(px(p.x)),
                       coordinate(py(p.y)));
}

void Panel::vertical(double x, const std::string& text, int row) {
  if (!shows({x, y_.high})) return;
  const double at = px(x);
  if (at < 0 || at > kInner) return;
  body_ += fmt::format(R"(<path class="mark" d="M{0} 0L{0} {1}"/>)", coordinate(at),
                       coordinate(height_));
  const bool left = at > kInner * 0.55;
  halo(left ? at - 5 : at + 5, 18 + 20 * row, text, left ? "end" : "start");
}

void Panel::horizontal(double y, const std::string& text, bool below) {
  if (!shows({x_.high, y})) return;
  const double at = py(y);
  if (at < 0 || at > height_) return;
  body_ += fmt::format(R"(<path class="reference" d="M0 {0}L{1} {0}"/>)", coordinate(at),
                       coordinate(kInner));
  if (!text.empty()) halo(kInner - 6, below ? at + 17 : at - 6, text, "end");
}

void Panel::words(Point p, const std::string& text, double dx, double dy, std::string_view anchor) {
  if (!shows(p)) return;
  halo(px(p.x) + dx, std::clamp(py(p.y) + dy, 14.0, height_ - 4), text, anchor);
}

double Panel::full_height() const { return height_ + (x_labels_ ? 56 : 14); }

std::string Panel::svg(double top) const {
  std::string out =
      fmt::format(R"x(<g transform="translate({} {})">)x", coordinate(kLeft), coordinate(top));
  std::string lines, labels;
  const auto grid = [&](bool minor, const std::string& d) {
    lines += fmt::format(R"(<path class="{}" d="{}"/>)", minor ? "minor" : "grid", d);
  };
  const std::vector<Tick> x_ticks = ticks_of(x_, 7);
  const std::vector<Tick> y_ticks = ticks_of(y_, std::max(4, static_cast<int>(height_ / 45)));
  for (const bool minor : {true, false}) {
    for (const Tick& t : x_ticks) {
      if (t.label.empty() != minor) continue;
      grid(minor, fmt::format("M{0} 0L{0} {1}", coordinate(px(t.value)), coordinate(height_)));
    }
    for (const Tick& t : y_ticks) {
      if (t.label.empty() != minor) continue;
      grid(minor, fmt::format("M0 {0}L{1} {0}", coordinate(py(t.value)), coordinate(kInner)));
    }
  }
  if (x_labels_) {
    for (const Tick& t : x_ticks) {
      if (t.label.empty()) continue;
      labels += fmt::format(R"(<text class="tick" x="{}" y="{}" text-anchor="middle">{}</text>)",
                            coordinate(px(t.value)), coordinate(height_ + 20), t.label);
    }
    labels +=
        fmt::format(R"(<text x="{}" y="{}" text-anchor="middle">{}</text>)", coordinate(kInner / 2),
                    coordinate(height_ + 43), escape_markup(x_.title));
  }
  for (const Tick& t : y_ticks) {
    if (t.label.empty()) continue;
    labels += fmt::format(R"(<text class="tick" x="-8" y="{}" text-anchor="end">{}</text>)",
                          coordinate(py(t.value) + 5.5), t.label);
  }
  labels += fmt::format(
      R"x(<text transform="translate(-58 {}) rotate(-90)" text-anchor="middle">{}</text>)x",
      coordinate(height_ / 2), escape_markup(y_.title));
  out += lines;
  // A nested svg clips what lies outside of its viewport, without ids that could clash.
  out += fmt::format(R"(<svg width="{}" height="{}">{}</svg>)", coordinate(kInner),
                     coordinate(height_), body_);
  out += fmt::format(R"(<rect class="frame" width="{}" height="{}"/>)", coordinate(kInner),
                     coordinate(height_));
  return out + labels + text_ + "</g>";
}

Picture::Picture(std::string title, std::string words)
    : title_(std::move(title)), words_(std::move(words)) {}

void Picture::legend_point(int series, const std::string& text) {
  legend_.push_back({marker(12, -5, series, {}), text});
}

void Picture::legend_line(Style style, const std::string& text, int series) {
  legend_.push_back(
      {fmt::format(R"(<path class="{}" d="M0 -5L24 -5"/>)", line_class(style, series)), text});
}

void Picture::legend_band(Style style, const std::string& text, int series) {
  legend_.push_back(
      {fmt::format(R"(<path class="{}" d="M0 -12L24 -12L24 1L0 1Z"/>)", area_class(style, series)),
       text});
}

void Picture::legend_bar(const std::string& text) {
  legend_.push_back({bar_path(12, -13, 3, 5), text});
}

void Picture::legend_ring(const std::string& text) {
  legend_.push_back({R"(<circle class="ring" cx="12" cy="-5" r="8"/>)", text});
}

void Picture::note(const std::string& text) {
  for (std::string& line : wrapped(text, 78)) notes_.push_back(std::move(line));
}

std::string Picture::svg() const {
  std::string body;
  double y = 8;
  for (const std::string& line : wrapped(title_, 60)) {
    y += 23;
    body += fmt::format(R"(<text class="head" x="16" y="{}">{}</text>)", coordinate(y),
                        escape_markup(line));
  }
  double x = 16;
  if (!legend_.empty()) y += 28;
  for (const Entry& e : legend_) {
    // Letters of this size are about 8.8 wide on average in the wider fonts.
    const double width = 34 + 8.8 * length_of(e.text) + 16;
    if (x > 16 && x + width > kWidth) {
      x = 16;
      y += 24;
    }
    body += fmt::format(R"x(<g transform="translate({} {})">{}<text x="32">{}</text></g>)x",
                        coordinate(x), coordinate(y), e.key, escape_markup(e.text));
    x += width;
  }
  y += 18;
  for (const Panel& p : panels_) {
    body += p.svg(y);
    y += p.full_height();
  }
  if (!notes_.empty()) y += 4;
  for (const std::string& line : notes_) {
    y += 21;
    body += fmt::format(R"(<text x="16" y="{}">{}</text>)", coordinate(y - 5), escape_markup(line));
  }
  y += 8;
  return fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" class="slc-plot" viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="{2}"><style>{3}</style><rect class="ground" width="{0}" height="{1}"/>{4}</svg>)",
      coordinate(kWidth), coordinate(y), escape_markup(words_), kStyle, body);
}

}  // namespace slicecorr::chart
