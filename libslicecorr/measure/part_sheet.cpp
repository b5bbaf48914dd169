// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "measure/part_sheet.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "support/page/page_style.hpp"
#include "support/text/escape.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kPictureWidth = 720;

std::string list(const char* tag, const std::vector<std::string>& items) {
  std::string html = fmt::format("<{}>", tag);
  for (const std::string& item : items) html += "<li>" + item + "</li>";
  return html + fmt::format("</{}>", tag);
}

}  // namespace

std::string sheet_page(const PartSheet& s) {
  std::string html = fmt::format(
      "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\"><title>{0}</title><style>{1}"
      "pre{{overflow-x:auto;font-size:.9rem}}.blank td:last-child{{min-width:9rem;border:1px solid "
      "var(--line)}}.blank th{{font-weight:400}}li{{margin:.3em 0}}svg{{max-width:100%;height:auto}}"
      "svg text{{fill:var(--fg)}}.part{{fill:#4a78a8}}.plate{{fill:#11151a;stroke:var(--line)}}"
      ".place{{stroke:var(--fg)}}svg .on{{fill:#fff}}svg .off{{fill:#11151a}}@media print{{body{{"
      "font-size:12px;max-width:none}}pre{{white-space:pre-wrap}}tr,figure,li{{break-inside:avoid}}td,th{{padding:.12rem "
      ".6rem}}h2{{margin-top:1em}}*{{-webkit-print-color-adjust:exact;print-color-adjust:exact}}}}"
      "</style></head><body><main><h1>{0}</h1><p>{2}</p>",
      escape_markup(s.title), page_page_css, s.about);
  html += "<h2>You need</h2>" + list("ul", s.tools) + "<h2>Do this</h2>" + list("ol", s.steps);
  html += fmt::format("<figure>{}<figcaption>{}</figcaption></figure>", s.picture, s.caption);
  html += "<h2>Write down</h2><div class=\"scroll\"><table class=\"blank\"><thead><tr>";
  for (const std::string& head : s.heads) {
    html += "<th scope=\"col\">" + escape_markup(head) + "</th>";
  }
  html += "</tr></thead><tbody>";
  for (const auto& row : s.rows) {
    html += "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i) {
      html += fmt::format("<{0}>{1}</{2}>", i ? "td" : "th scope=\"row\"", escape_markup(row[i]),
                          i ? "td" : "th");
    }
    html += "<td></td></tr>";
  }
  html += fmt::format("</tbody></table></div><h2>Then</h2><p>{}</p><pre>", s.after);
  for (const std::string& command : s.commands) html += escape_markup(command) + "\n";
  return html + "</pre></main></body></html>\n";
}

std::string plate_picture(const Grid& grid, const std::vector<SheetBox>& boxes) {
  // Around all boxes, with an edge of dark: a plate is mostly empty.
  PixelBox all;
  for (const SheetBox& b : boxes) all = all.united(b.box);
  const double aspect = grid.pixel_y_um / grid.pixel_x_um;
  const double border = std::max(4.0, 0.06 * all.width());
  const double x0 = all.x0 - border, y0 = all.y0 - border / aspect;
  const double scale = kPictureWidth / (all.width() + 2 * border);
  const double height = (all.height() + 2 * border / aspect) * scale * aspect;
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" height=\"{1:.0f}\" role=\"img\" "
      "aria-label=\"the plate from above\"><rect class=\"plate\" x=\"0\" y=\"0\" width=\"{0:.0f}\" "
      "height=\"{1:.0f}\"/>",
      kPictureWidth, height);
  for (const SheetBox& b : boxes) {
    const double x = (b.box.x0 - x0) * scale, y = (b.box.y0 - y0) * scale * aspect;
    const double w = b.box.width() * scale, h = b.box.height() * scale * aspect;
    // Dim places are still to be seen on black.
    const auto blue = static_cast<int>(70 + 160 * std::clamp(b.light, 0.0, 1.0));
    svg += fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"rgb({},{},{})\" "
        "stroke=\"#111\" stroke-width=\".5\"/>",
        x, y, w, h, blue * 3 / 8, blue * 5 / 8, blue);
    if (b.words.empty()) continue;
    const double size = std::clamp(1.6 * w / static_cast<double>(b.words.size()), 6.0, 14.0);
    svg += fmt::format(
        "<text class=\"on\" text-anchor=\"middle\" x=\"{:.1f}\" y=\"{:.1f}\" "
        "font-size=\"{:.1f}\">{}</text>",
        x + w / 2, y + h / 2 + size / 3, size, escape_markup(b.words));
  }
  return svg + "</svg>";
}

}  // namespace slicecorr::detail
