// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables to fill in: what may be changed in them and what not.
#include "slicecorr/measuring_form.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "refusal.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using testing::AllOf;
using testing::HasSubstr;

MeasuringForm small_form() {
  MeasuringForm f;
  f.part = "comb";
  f.facts = {{"layer_um", "50"}, {"x_px", "12"}};
  f.columns = {"name", "designed_um", "measured_um"};
  f.known = 2;
  f.rows = {{"tooth, 1", "1000"}, {"b", "0.7"}};
  f.note = "fill in";
  return f;
}

class Forms : public testing::Test {
 protected:
  std::string put(const std::string& text) {
    test::write_file(folder_ / "form.csv", test::to_bytes(text));
    return folder_ / "form.csv";
  }
  std::string changed(const std::string& what, const std::string& to) {
    std::string text = form_text(small_form());
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return put(text.replace(at, what.size(), to));
  }
  test::TemporaryFolder folder_;
};

TEST_F(Forms, AreReadBack) {
  const auto form = read_form(changed("\"tooth, 1\",1000,", "\"tooth, 1\",1000,998.5"));
  ASSERT_TRUE(form);
  EXPECT_EQ(form->part, "comb");
  EXPECT_EQ(form->fact("layer_um", 1, 100), 50);
  EXPECT_EQ(form->cell(0, "name"), "tooth, 1");
  EXPECT_EQ(*form->number(0, "measured_um", 0, 1e6), 998.5);
  EXPECT_FALSE(form->number(1, "measured_um", 0, 1e6));
  EXPECT_EQ(form->cell(1, "nothing"), "");
}

// As spreadsheets write them: byte order mark, CRLF, commas to the right, 0.7 as 0.70, 1000 as 1E3.
TEST_F(Forms, SpreadsheetsMayWriteThem) {
  std::string text = "\xEF\xBB\xBF" + form_text(small_form());
  for (const auto& [from, to] :
       std::map<std::string, std::string>{{"\n", ",,\r\n"}, {"0.7", "0.70"}, {"1000", "1E3"}}) {
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
      text.replace(at, from.size(), to);
    }
  }
  const auto form = read_form(put(text));
  ASSERT_TRUE(form);
  EXPECT_EQ(form->rows.size(), 2U);
}

TEST_F(Forms, OtherTablesAreNone) {
  EXPECT_FALSE(read_form(put("intensity_mw_cm2,exposure_s,cured_height_um\n1,2,3\n")));
  expect_form_of(put("a,b\n1,2\n"), {"comb"});
}

TEST_F(Forms, WhatIsKnownMayNotBeChanged) {
  const auto says = [](const std::string& path) { return test::refusal([&] { read_form(path); }); };
  EXPECT_THAT(says(changed("1000", "1001")),
              AllOf(HasSubstr("form.csv"), HasSubstr("another part")));
  EXPECT_THAT(says(changed("layer_um,50", "layer_um,60")), HasSubstr("another part"));
  EXPECT_THAT(says(changed("testpart,comb", "testpart,staircase")), HasSubstr("another part"));
  EXPECT_THAT(says(changed("b,0.7,\n", "")), HasSubstr("another part"));
  EXPECT_THAT(says(changed(",hash,", ",hush,")), HasSubstr("missing"));
  EXPECT_THAT(says(changed("# slicecorr testpart,comb", "# slicecorr testpart;comb")),
              HasSubstr("semicolons"));
  EXPECT_THAT(says(put("# slicecorr testpart,comb,known,1,hash,0\nname\n")), HasSubstr("no rows"));
}

TEST_F(Forms, NumbersHaveBounds) {
  const auto form = read_form(changed("b,0.7,", "b,0.7,4 mm"));
  ASSERT_TRUE(form);
  EXPECT_THAT(test::refusal([&] { form->number(1, "measured_um", 0, 1e6); }),
              AllOf(HasSubstr("line 5, measured_um"), HasSubstr("'4 mm'")));
  EXPECT_THAT(test::refusal([&] { form->fact("y_px", 0, 1); }), HasSubstr("y_px"));
  EXPECT_THAT(test::refusal([&] { form->fact("layer_um", 0, 1); }), HasSubstr("0 to 1"));
}

TEST_F(Forms, OfOtherPartsNameTheirReader) {
  const std::string path = put(form_text(small_form()));
  expect_form_of(path, {"staircase", "comb"});
  EXPECT_THAT(test::refusal([&] { expect_form_of(path, {"spread"}); }),
              AllOf(HasSubstr("'comb'"), HasSubstr("slicecorr tune")));
}

}  // namespace
}  // namespace slicecorr
