// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "measure/part_sheet.hpp"

#include <algorithm>

namespace slicecorr::detail {

using namespace page;

std::string sheet_page(const PartSheet& s) {
  Page page(
      s.title,
      {"pre{overflow-x:auto;font-size:.9rem}.blank td:last-child{min-width:9rem;border:1px solid "
       "var(--line)}.blank th{font-weight:400}li{margin:.3em 0}svg{max-width:100%;height:auto}svg "
       "text{fill:var(--fg)}.part{fill:#4a78a8}.plate{fill:#11151a;stroke:var(--line)}"
       ".place{stroke:var(--fg)}svg .on{fill:#fff}svg .off{fill:#11151a}@media print{body{"
       "font-size:12px;max-width:none}pre{white-space:pre-wrap}tr,figure,li{break-inside:avoid}"
       "td,th{padding:.12rem .6rem}h2{margin-top:1em}"
       "*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}"});
  page += markup("<p>{}</p><h2>You need</h2><ul>{}</ul><h2>Do this</h2><ol>{}</ol>", s.about,
                 items(s.tools), items(s.steps));
  page += captioned(s.picture, s.caption);
  Table table("blank");
  for (const std::string& head : s.heads) table.column(head);
  for (const auto& row : s.rows) {
    table.row_of(row);
    table.cell("");
  }
  page += markup("<h2>Write down</h2>{}<h2>Then</h2><p>{}</p><pre>", table, s.after);
  for (const std::string& command : s.commands) page += command + "\n";
  page += markup("</pre>");
  return page.html() + "\n";
}

Markup plate_picture(const Grid& grid, const std::vector<SheetBox>& boxes) {
  // Around all boxes, with an edge of dark: a plate is mostly empty.
  PixelBox all;
  for (const SheetBox& b : boxes) all = all.united(b.box);
  const double aspect = grid.pixel_y_um / grid.pixel_x_um;
  const double border = std::max(4.0, 0.06 * all.width());
  const double x0 = all.x0 - border, y0 = all.y0 - border / aspect;
  constexpr double width = 720;
  const double scale = width / (all.width() + 2 * border);
  const double height = (all.height() + 2 * border / aspect) * scale * aspect;
  Markup svg = markup(
      R"(<svg viewBox="0 0 {0:.0f} {1:.0f}" width="{0:.0f}" height="{1:.0f}" role="img" aria-label="the plate from above"><rect class="plate" x="0" y="0" width="{0:.0f}" height="{1:.0f}"/>)",
      width, height);
  for (const SheetBox& b : boxes) {
    const double x = (b.box.x0 - x0) * scale, y = (b.box.y0 - y0) * scale * aspect;
    const double w = b.box.width() * scale, h = b.box.height() * scale * aspect;
    // Dim places are still to be seen on black.
    const auto blue = static_cast<int>(70 + 160 * std::clamp(b.light, 0.0, 1.0));
    svg += markup(
        R"x(<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" fill="rgb({},{},{})" stroke="#111" stroke-width=".5"/>)x",
        x, y, w, h, blue * 3 / 8, blue * 5 / 8, blue);
    if (b.words.empty()) continue;
    const double size = std::clamp(1.6 * w / static_cast<double>(b.words.size()), 6.0, 14.0);
    svg += markup(
        R"(<text class="on" text-anchor="middle" x="{:.1f}" y="{:.1f}" font-size="{:.1f}">{}</text>)",
        x + w / 2, y + h / 2 + size / 3, size, b.words);
  }
  return svg + markup("</svg>");
}

}  // namespace slicecorr::detail
