// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of text: what RFC 4180 says, and where the project's files differ.
#include "support/text/csv.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using Cells = std::vector<std::string>;
using Fault = CsvRow::Fault;

std::vector<CsvRow> rows_of(const std::string& text, const CsvRules& rules = {}) {
  CsvReader reader = CsvReader::of_text(text, "t.csv", rules);
  std::vector<CsvRow> rows;
  for (CsvRow row; reader.next(row);) {
    EXPECT_EQ(reader.place(), "line " + std::to_string(row.line));
    rows.push_back(row);
  }
  return rows;
}

std::vector<Cells> cells_of(const std::string& text, const CsvRules& rules = {}) {
  std::vector<Cells> cells;
  for (const CsvRow& row : rows_of(text, rules)) {
    EXPECT_EQ(row.fault, Fault::none) << row.at_fault;
    cells.push_back(row.cells);
  }
  return cells;
}

// The examples of RFC 4180, section 2: line ends, the last line without one, quotes around cells
// and in them.
TEST(Csv, ExamplesOfTheRfc) {
  const Cells abc{"aaa", "bbb", "ccc"}, xyz{"zzz", "yyy", "xxx"};
  EXPECT_THAT(cells_of("aaa,bbb,ccc\r\nzzz,yyy,xxx\r\n"), ElementsAre(abc, xyz));
  EXPECT_THAT(cells_of("aaa,bbb,ccc\r\nzzz,yyy,xxx"), ElementsAre(abc, xyz));
  EXPECT_THAT(cells_of("\"aaa\",\"bbb\",\"ccc\"\r\nzzz,yyy,xxx"), ElementsAre(abc, xyz));
  EXPECT_THAT(cells_of("\"aaa\",\"b\"\"bb\",\"c,c\""), ElementsAre(Cells{"aaa", "b\"bb", "c,c"}));
  EXPECT_THAT(cells_of("\"aaa\",\"b\r\nbb\",\"ccc\"\r\nzzz,yyy,xxx", {.lines_in_quotes = true}),
              ElementsAre(Cells{"aaa", "b\r\nbb", "ccc"}, xyz));
}

TEST(Csv, LineEndsMarksBlanksAndComments) {
  for (const char* text : {"a,b\nc,d\n", "a,b\r\nc,d\r\n", "a,b\rc,d\r",
                           "\xEF\xBB\xBF"
                           "a,b\nc,d",
                           " a\t, b \n\t\n\nc,d", "# x, \"y\na,b\n  # z\nc,d\n#"}) {
    EXPECT_THAT(cells_of(text), ElementsAre(Cells{"a", "b"}, Cells{"c", "d"})) << text;
  }
  EXPECT_THAT(cells_of(""), IsEmpty());
  EXPECT_THAT(cells_of("a,\n,\n\"\"\n,b # c"),
              ElementsAre(Cells{"a", ""}, Cells{"", ""}, Cells{""}, Cells{"", "b # c"}));
}

TEST(Csv, LinesAreCountedAsEditorsDo) {
  const auto rows = rows_of("\r\n# c\r\na\r\n\"b\nb\",\"\n\"\nc\r\rd", {.lines_in_quotes = true});
  ASSERT_EQ(rows.size(), 4u);
  const int lines[] = {3, 4, 7, 9};
  for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i].line, lines[i]);
}

TEST(Csv, RulesOfFilesThatDiffer) {
  EXPECT_THAT(cells_of("1,2 # a, b\n# c\n3,\"4 # d\" # e", {.comments_behind_cells = true}),
              ElementsAre(Cells{"1", "2"}, Cells{"3", "4 # d"}));
  EXPECT_THAT(cells_of("5 \"per cent\",6\""), ElementsAre(Cells{"5 \"per cent\"", "6\""}));
  EXPECT_THAT(cells_of("5 \"per, cent\",\"6,\"7", {.quotes_inside_cells = true}),
              ElementsAre(Cells{"5 per, cent", "6,7"}));
  EXPECT_THAT(cells_of("a,b\n , ,\n\"\",\nc,d", {.skip_empty_rows = true}),
              ElementsAre(Cells{"a", "b"}, Cells{"", ""}, Cells{"c", "d"}));
}

TEST(Csv, FaultsAreToldWithWhatStandsThere) {
  struct {
    const char* text;
    CsvRules rules;
    Fault fault;
    const char* at_fault;
  } const cases[] = {
      {"a,\"b,c\nd", {}, Fault::open_quote, "b,c"},
      {"a,\"b\nc", {.lines_in_quotes = true}, Fault::open_quote, "b"},
      {"\"a\" b,c", {}, Fault::text_after_quote, "b,c"},
      {"\"a\"\"b\"c\"", {}, Fault::text_after_quote, "c\""},
      {"a\x01,b", {.control_bytes_are_faults = true}, Fault::control_byte, "\x01"},
      {"abcde", {.longest_line_bytes = 4}, Fault::long_line, ""},
  };
  for (const auto& c : cases) {
    const auto rows = rows_of(c.text, c.rules);
    ASSERT_FALSE(rows.empty()) << c.text;
    EXPECT_EQ(rows[0].fault, c.fault) << c.text;
    EXPECT_EQ(rows[0].at_fault, c.at_fault) << c.text;
  }
  EXPECT_EQ(rows_of("abcd\n", {.longest_line_bytes = 4})[0].fault, Fault::none);
  // The next row is read as if nothing had been.
  EXPECT_EQ(rows_of("\"a\nb,c")[1].cells, (Cells{"b", "c"}));
  EXPECT_EQ(rows_of("\"a\nb,c")[1].fault, Fault::none);
  for (const char* text : {"\xFF\xFE"
                           "a",
                           "\xFE\xFF"
                           "a",
                           "PK\x03\x04"}) {
    EXPECT_THROW(rows_of(text), InputError) << text;
  }
}

// Pieces of a file end anywhere: between CR and LF, in quotes, in the byte order mark's file.
TEST(Csv, FilesAreReadAsTextsAre) {
  std::string text = "\xEF\xBB\xBF";
  for (int n = 0; n < 60000; ++n) {
    text += std::to_string(n) + ",\"" + std::string(static_cast<std::size_t>(n % 7), 'x') +
            "\"\"\r\n\",z" +
            (n % 3 == 0   ? "\r\n"
             : n % 3 == 1 ? "\n"
                          : "\r");
  }
  ASSERT_GT(text.size(), std::size_t{3} << 18) << "more than three pieces";
  const std::string path = testing::TempDir() + "csv_test-" + std::to_string(::getpid()) + ".csv";
  std::ofstream(path, std::ios::binary) << text;
  const CsvRules rules{.lines_in_quotes = true};
  CsvReader file = CsvReader::of_file(path, rules), whole = CsvReader::of_text(text, path, rules);
  CsvRow a, b;
  int n = 0;
  while (file.next(a)) {
    ASSERT_TRUE(whole.next(b));
    ASSERT_EQ(a.cells, b.cells);
    ASSERT_EQ(a.line, b.line);
    ASSERT_EQ(a.cells, (Cells{std::to_string(n),
                              std::string(static_cast<std::size_t>(n % 7), 'x') + "\"", "z"}));
    ASSERT_EQ(a.line, 2 * n + 1);
    ++n;
  }
  EXPECT_FALSE(whole.next(b));
  EXPECT_EQ(n, 60000);
  std::filesystem::remove(path);
  EXPECT_THROW(CsvReader::of_file(path), InputError);
}

TEST(Csv, CellsThatAreWrittenAreRead) {
  for (const char* text : {"", "a", "a b", "a,b", "\"", "a\"\"b", "#a", "µ"}) {
    const auto rows = cells_of("x," + csv_cell(text));
    ASSERT_EQ(rows.size(), 1u);
    EXPECT_THAT(rows[0], ElementsAre("x", text));
  }
  EXPECT_EQ(csv_cell("a\nb"), "\"a b\"");
}

TEST(Csv, PiecesBetweenCommas) {
  EXPECT_THAT(comma_separated(""), ElementsAre(""));
  EXPECT_THAT(comma_separated(","), ElementsAre("", ""));
  EXPECT_THAT(comma_separated(" a,\"b,c\","), ElementsAre(" a", "\"b", "c\"", ""));
}

TEST(Csv, NumbersInText) {
  EXPECT_EQ(number_in_text(" +1.5e1\t"), 15);
  EXPECT_EQ(number_in_text("-0.25"), -0.25);
  for (const char* text : {"", "+", "1,5", "1 2", "0x10", "nan", "inf", "1e999", "1s"}) {
    EXPECT_EQ(number_in_text(text), std::nullopt) << text;
  }
}

}  // namespace
}  // namespace slicecorr
