// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/page/html_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/chart/chart.hpp"

namespace slicecorr::page {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr const char* kHostile = "<b>\"R&D\"</b>\a";
constexpr const char* kEscaped = "&lt;b&gt;&quot;R&amp;D&quot;&lt;/b&gt;";

std::string html_of(const Markup& m) { return m.html(); }

TEST(HtmlPage, TextsAreEscapedHoweverTheyComeIn) {
  const std::string text = kHostile;
  const std::string_view view = text;
  EXPECT_EQ(html_of(kHostile), kEscaped);
  EXPECT_EQ(html_of(text), kEscaped);
  EXPECT_EQ(html_of(view), kEscaped);
  EXPECT_EQ(html_of("a < b"), "a &lt; b");
  EXPECT_EQ(
      markup("<p title=\"{}\">{} {} {}</p>", text, kHostile, view, "1 < 2").html(),
      "<p title=\"" + std::string(kEscaped) + "\">" + kEscaped + " " + kEscaped + " 1 &lt; 2</p>");
  Markup sum("<");
  sum += text;
  EXPECT_EQ((sum + ">").html(), "&lt;" + std::string(kEscaped) + "&gt;");
}

TEST(HtmlPage, OnlyMarkupIsLeftAsItIs) {
  const Markup bold = markup("<b>{}</b>", "x & y");
  EXPECT_EQ(bold.html(), "<b>x &amp; y</b>");
  EXPECT_EQ(markup("<p>{}</p>", bold).html(), "<p><b>x &amp; y</b></p>");
  EXPECT_EQ(markup("<p>{}</p>", Markup::raw("<i>&lt;</i>")).html(), "<p><i>&lt;</i></p>");
  // Once it is a text again it is one like others.
  EXPECT_EQ(markup("{}", bold.html()).html(), "&lt;b&gt;x &amp;amp; y&lt;/b&gt;");
}

TEST(HtmlPage, NumbersAreFormatted) {
  EXPECT_EQ(markup("{:.2f} {:03} {} {{}}", 1.005, 7, 9U).html(), "1.00 007 9 {}");
  EXPECT_EQ(markup("{1}{0}{1}", "<", 2).html(), "2&lt;2");
}

TEST(HtmlPage, ListsAndFigures) {
  EXPECT_EQ(items(std::vector<std::string>{"a<b", "c"}).html(), "<li>a&lt;b</li><li>c</li>");
  EXPECT_EQ(items(std::vector<Markup>{"<", markup("<b>c</b>")}).html(),
            "<li>&lt;</li><li><b>c</b></li>");
  EXPECT_EQ(captioned(markup("<img>"), "a < b").html(),
            "<figure><img><figcaption>a &lt; b</figcaption></figure>");
  chart::Picture picture("A < B", "a picture");
  const std::string svg = picture.svg();
  EXPECT_EQ(drawing(svg).html(),
            "<figure><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"Scrolls\">" +
                svg + "</div></figure>");
  EXPECT_EQ(drawing(svg, "R&D").html(),
            "<figure><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"Scrolls\">" +
                svg + "</div><figcaption>R&amp;D</figcaption></figure>");
}

TEST(HtmlPage, Tiles) {
  Tiles tiles;
  tiles.add("< 3 ms", markup("<b>late</b>"), "bad");
  tiles.add("R&D", "x");
  EXPECT_EQ(html_of(tiles),
            "<div class=\"tiles\"><div class=\"tile bad\"><b>&lt; 3 ms</b><span><b>late</b></span>"
            "</div><div class=\"tile \"><b>R&amp;D</b><span>x</span></div></div>");
}

TEST(HtmlPage, TablesEscapeHeadsAndCells) {
  Table table("figures");
  table.columns("R&D", "b");
  table.column("c", "words");
  table.row("<x>", 1.5, kHostile);
  table.begin("fault");
  table.head("y", "col");
  table.cell(markup("<b>{}</b>", 2), "bad");
  table.cell("z", {}, 3);
  table.row_of({"p<", "q>"});
  EXPECT_EQ(
      html_of(table),
      "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"Scrolls\"><table class=\"figures\"><thead><tr><th scope=\"col\">R&amp;D"
      "</th><th scope=\"col\">b</th><th scope=\"col\" class=\"words\">c</th></tr></thead>"
      "<tbody><tr><th scope=\"row\">&lt;x&gt;</th><td>1.5</td><td>" +
          std::string(kEscaped) +
          "</td></tr><tr class=\"fault\"><th scope=\"col\">y</th><td class=\"bad\"><b>2</b>"
          "</td><td colspan=\"3\">z</td></tr><tr><th scope=\"row\">p&lt;</th><td>q&gt;</td>"
          "</tr></tbody></table></div>");
}

TEST(HtmlPage, TablesThatScroll) {
  Table table({}, "a \"b\"", true);
  table.begin();
  table.cells(1, "<");
  EXPECT_EQ(html_of(table),
            "<div class=\"scroll tall\" tabindex=\"0\" role=\"region\" aria-label=\"a "
            "&quot;b&quot;\"><table><tbody><tr><td>1</td><td>&lt;</td></tr></tbody></table></div>");
  EXPECT_EQ(
      html_of(Table()),
      "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"Scrolls\"><table><tbody></tbody></table></div>");
}

TEST(HtmlPage, APageIsWhole) {
  Page page("R&D <1>", {page_tiles_css, ".mine{color:red}"});
  page += "a < b";
  page += markup("<p>c</p>");
  const std::string html = page.html();
  EXPECT_THAT(html, StartsWith("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">"));
  EXPECT_THAT(html,
              HasSubstr("<title>R&amp;D &lt;1&gt;</title><style>" + std::string(page_page_css) +
                        std::string(page_tiles_css) + ".mine{color:red}</style></head>"));
  EXPECT_THAT(html, EndsWith("<body><main><h1>R&amp;D &lt;1&gt;</h1>a &lt; b<p>c</p></main></body>"
                             "</html>"));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
}

TEST(HtmlPage, ScriptsComeLastAndTheirDataCannotEndThem) {
  Page page("t");
  page.scripts("data", R"x({"name":"</script><script>alert(1)"})x", {"let a;", "let b;"});
  page += markup("<p>later</p>");
  EXPECT_THAT(page.html(),
              EndsWith("<p>later</p></main><script type=\"application/json\" id=\"data\">"
                       R"x({"name":"\u003c/script>\u003cscript>alert(1)"})x"
                       "</script><script>let a;let b;</script></body></html>"));
}

}  // namespace
}  // namespace slicecorr::page
