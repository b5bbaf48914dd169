// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The table of settings: rows that hold for themselves, and what is made of them in the library.
#include "slicecorr/settings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using ::testing::HasSubstr;

TEST(Settings, RowsAreWhole) {
  std::set<std::string_view> names;
  for (const Setting& s : settings()) {
    EXPECT_TRUE(names.insert(s.name).second) << s.name;
    EXPECT_EQ(find_setting(s.name), &s);
    EXPECT_FALSE(s.text.empty()) << s.name;
    const bool text = std::holds_alternative<std::string SetupChoices::*>(s.chosen);
    EXPECT_TRUE(text || (s.words.empty() && !s.or_inf)) << s.name;
    EXPECT_EQ(std::holds_alternative<std::vector<double> SetupChoices::*>(s.chosen),
              !s.column.empty())
        << s.name;
    // What the block of a stack has is somewhere in `Process`.
    EXPECT_TRUE(s.block == BlockPart::none || s.process.index() != 0) << s.name;
    const std::string told = setting_text(ChoiceNames::options, s);
    EXPECT_EQ(told.find_first_of("{}"), std::string::npos) << told;
  }
  EXPECT_EQ(find_setting("no_such"), nullptr);
}

TEST(Settings, NamesInTexts) {
  const Setting& zone = *find_setting("dead_zone_um");
  EXPECT_THAT(setting_text(ChoiceNames::options, zone), HasSubstr("in place of --uv-mw-cm2"));
  EXPECT_THAT(setting_text(ChoiceNames::fields, zone), HasSubstr("in place of uv_mw_cm2"));
}

TEST(Settings, WhatTheyTakeIsWhatTheySay) {
  EXPECT_EQ(setting_takes(*find_setting("speed_mm_h")), "a number above 0");
  EXPECT_EQ(setting_takes(*find_setting("gap_shortfall")), "a number above 0 and at most 0.5");
  EXPECT_EQ(setting_takes(*find_setting("bottom_layers")), "a whole number from 0 to 1000000");
  EXPECT_EQ(setting_takes(*find_setting("platform_reflectance")), "a number from 0 to 1");
  EXPECT_EQ(setting_takes(*find_setting("omega_max")), "inf, or a number of at least 1");
  EXPECT_EQ(setting_takes(*find_setting("ramp")), "one of none, lamp-follows, outside");
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Setting& s : settings()) {
    EXPECT_FALSE(takes_number(s, nan)) << s.name;
    EXPECT_FALSE(takes_number(s, std::numeric_limits<double>::infinity())) << s.name;
    EXPECT_FALSE(takes_number(s, -1)) << s.name;
    for (const std::string_view word : s.words) EXPECT_TRUE(takes_text(s, word)) << s.name;
    EXPECT_EQ(takes_text(s, "no-such"), s.words.empty() && !s.or_inf) << s.name;
  }
  const Setting& cap = *find_setting("omega_max");
  for (const char* good : {"inf", "1", "2.5"}) EXPECT_TRUE(takes_text(cap, good)) << good;
  for (const char* bad : {"", "0.9", "1e400", "nan", "-inf", "infinity", "2x"}) {
    EXPECT_FALSE(takes_text(cap, bad)) << bad;
  }
}

/// What is not the default of a setting, and lies in its range.
void say(const Setting& s, SetupChoices& choices) {
  std::visit(
      [&](auto member) {
        auto& value = choices.*member;
        using Value = std::decay_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, std::string>) {
          const SetupChoices unset;
          value = s.or_inf ? "1.5" : s.words.empty() ? "name" : std::string(s.words.back());
          if (value == unset.*member) value = std::string(s.words.front());
        } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
          value = s.range.most < 3 ? Value{0.5, 0.25} : Value{3, 2};
        } else {
          value = static_cast<Value>(s.range.most < 3 ? 0.7 * s.range.most : 3);
        }
      },
      s.chosen);
}

TEST(Settings, EachIsSaidCheckedAndReachesTheProcess) {
  for (const Setting& s : settings()) {
    SetupChoices choices;
    EXPECT_FALSE(is_said(s, choices)) << s.name;
    say(s, choices);
    EXPECT_TRUE(is_said(s, choices)) << s.name;
    EXPECT_NO_THROW(check_choices(choices, ChoiceNames::fields)) << s.name;
    if (s.process.index() == 0) continue;
    Process process, unsaid;
    apply_choice(s, SetupChoices{}, unsaid);
    apply_choice(s, choices, process);
    EXPECT_FALSE(same_setting(s, process, unsaid)) << s.name;
    Process copy;
    copy_setting(s, process, copy);
    EXPECT_TRUE(copy == process) << s.name;
    // Nothing said brings the default back.
    apply_choice(s, SetupChoices{}, process);
    EXPECT_TRUE(process == unsaid) << s.name;
  }
}

TEST(Settings, OutOfRangeIsRefusedByName) {
  const auto refusal = [](SetupChoices choices, ChoiceNames names) -> std::string {
    try {
      check_choices(choices, names);
    } catch (const InputError& e) {
      return e.what();
    }
    return {};
  };
  SetupChoices choices;
  choices.gap_shortfall = 0.7;
  EXPECT_EQ(refusal(choices, ChoiceNames::options),
            "--gap-shortfall is 0.7; expected a number above 0 and at most 0.5");
  choices = {};
  choices.slice_speed_mm_h = {100, -1};
  EXPECT_EQ(refusal(choices, ChoiceNames::fields),
            "slice_speed_mm_h is -1; expected a number above 0");
  choices = {};
  choices.surface = "moon";
  EXPECT_EQ(refusal(choices, ChoiceNames::fields),
            "surface is 'moon'; expected one of slices, mesh");
}

}  // namespace
}  // namespace slicecorr
