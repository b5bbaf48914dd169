// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The picture of the workers: a row for each, a bar for each attempt.

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "slicecorr/farm/morning.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"
#include "views/moment_text.hpp"
#include "views/time_axis.hpp"

namespace slicecorr::farm {

namespace {

constexpr double kWidth = 1100, kLeft = 150, kRight = 16, kLane = 26, kTop = 44;
constexpr double kInner = kWidth - kLeft - kRight;

struct KindRow {
  const char* style;
  const char* words;
};
/// In the order of `MorningReport::BarKind`.
constexpr std::array<KindRow, 5> kKinds{{{"done", "done"},
                                         {"running", "runs"},
                                         {"again", "ended, tried again"},
                                         {"failed", "failed"},
                                         {"cancelled", "cancelled"}}};

// Literal colours, as in the charts. Bars that are not done differ by their edge as well.
constexpr const char* kStyle =
    ".slc-time{max-width:100%;height:auto}.slc-time .ground{fill:#fff}.slc-time "
    "text{font-family:system-ui,sans-serif;font-size:15px;fill:#1b1f24}.slc-time "
    ".tick{fill:#4a545e}.slc-time .grid{stroke:#d5dae0}.slc-time .row{fill:#f1f3f5}.slc-time "
    ".done{fill:#00805f}.slc-time .running{fill:#8ab4f8;stroke:#0b57d0;stroke-dasharray:4 "
    "3}.slc-time .again{fill:#f0b429;stroke:#7a5600}.slc-time "
    ".failed{fill:#d63031;stroke:#7d0f12;stroke-width:2}.slc-time "
    ".cancelled{fill:#b0b6bc;stroke:#4a545e}@media screen and "
    "(prefers-color-scheme:dark){.slc-time .ground{fill:#1d2126}.slc-time "
    "text{fill:#e6e9ec}.slc-time .tick{fill:#b4bdc6}.slc-time .grid{stroke:#343a41}.slc-time "
    ".row{fill:#262b31}.slc-time .done{fill:#2aa884}.slc-time "
    ".running{fill:#31486b;stroke:#8ab4f8}.slc-time .again{stroke:#ffe08a}.slc-time "
    ".failed{fill:#ef5350;stroke:#ffb3b1}.slc-time .cancelled{fill:#7d8894;stroke:#c4ccd4}}";

}  // namespace

std::string timeline_svg(const MorningReport& r) {
  const int lanes = static_cast<int>(r.lanes.size());
  const double height = kTop + std::max(1, lanes) * kLane + 34;
  const double span = static_cast<double>(r.until_ms - r.from_ms);
  const auto x = [&](std::int64_t ms) {
    return kLeft + std::clamp(static_cast<double>(ms - r.from_ms) / span, 0.0, 1.0) * kInner;
  };
  page::Markup body;
  double at = kLeft;
  std::array<bool, kKinds.size()> used{};
  for (const auto& bar : r.bars) used[static_cast<std::size_t>(bar.kind)] = true;
  for (std::size_t i = 0; i < kKinds.size(); ++i) {
    if (!used[i]) continue;
    body += page::markup(
        R"(<rect class="{}" x="{:.0f}" y="12" width="22" height="14"/><text x="{:.0f}" y="25">{}</text>)",
        kKinds[i].style, at, at + 30, kKinds[i].words);
    at += 52 + 8.6 * static_cast<double>(std::string_view(kKinds[i].words).size());
  }
  for (int i = 0; i < lanes; ++i) {
    const double y = kTop + i * kLane;
    if (i % 2 == 0) {
      body += page::markup(R"(<rect class="row" x="{}" y="{}" width="{}" height="{}"/>)", kLeft, y,
                           kInner, kLane);
    }
    body += page::markup(R"(<text x="{}" y="{}" text-anchor="end">{}</text>)", kLeft - 8, y + 18.5,
                         text::clipped(text::printable(r.lanes[static_cast<std::size_t>(i)]), 17));
  }
  const double bottom = kTop + std::max(1, lanes) * kLane;
  for (const auto& tick : detail::time_ticks(r.from_ms, r.until_ms, 12)) {
    body += page::markup(
        R"(<path class="grid" d="M{0:.1f} {1}V{2}"/><text class="tick" x="{0:.1f}" y="{3}" text-anchor="middle">{4}</text>)",
        x(tick.ms), lanes == 0 ? bottom - 4 : kTop, bottom, bottom + 20, tick.label);
  }
  for (const auto& bar : r.bars) {
    const double from = x(bar.start_ms), to = x(bar.end_ms);
    // Nothing is too short to be seen.
    body += page::markup(
        R"(<rect class="{}" x="{:.1f}" y="{}" width="{:.1f}" height="{}" rx="1.5"><title>{}</title></rect>)",
        kKinds[static_cast<std::size_t>(bar.kind)].style, from, kTop + bar.lane * kLane + 4,
        std::max(1.2, to - from - 0.6), kLane - 8, text::printable(bar.words));
  }
  if (lanes == 0) {
    body += page::markup(R"(<text x="{}" y="{}">no worker ran in this time</text>)", kLeft,
                         kTop + 18.5);
  }
  return fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" class="slc-time" viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="Workers from {2} to {3}: {4} attempts"><style>{5}</style><rect class="ground" width="{0}" height="{1}"/>{6}</svg>)",
      kWidth, height, local_time_text(r.from_ms), local_time_text(r.until_ms), r.attempts, kStyle,
      body.html());
}

}  // namespace slicecorr::farm
