// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What refusals of the programs name must work when it is typed back, as printed.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "run_program.hpp"
#include "stack_fixture.hpp"
#include "typed_back.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

class LimitsProgram : public ::testing::Test {
 protected:
  LimitsProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", SLICECORR_DB_DIR}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
  }
  void write(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
  }
  RunResult call(const std::vector<std::string>& command) const {
    std::vector<std::string> all = command;
    all[0] = SLICECORR_BIN_DIR "/" + all[0];
    return run_program(all, options_);
  }
  std::string printer(const std::string& full, const std::string& black,
                      const std::string& more = "") const {
    return "name = \"p\"\n[display]\nwidth_px = 16\nheight_px = 16\npixel_um = 50.0\n[blue]\n"
           "calibration = [[0, " +
           black + "], [255, " + full + "]]\n" + more;
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(LimitsProgram, NumbersTypedBackAreAccepted) {
  std::string stl = "solid b\n";
  const auto facet = [&](std::array<std::array<double, 3>, 3> t) {
    stl += "facet normal 0 0 0\nouter loop\n";
    for (const auto& v : t) stl += fmt::format("vertex {} {} {}\n", v[0], v[1], v[2]);
    stl += "endloop\nendfacet\n";
  };
  constexpr double s = 0.2, h = 1.0;
  const std::array<std::array<double, 3>, 8> c{{{-s, -s, 0},
                                                {s, -s, 0},
                                                {s, s, 0},
                                                {-s, s, 0},
                                                {-s, -s, h},
                                                {s, -s, h},
                                                {s, s, h},
                                                {-s, s, h}}};
  for (const auto& q : {std::array{0, 3, 2, 1}, std::array{4, 5, 6, 7}, std::array{0, 1, 5, 4},
                        std::array{1, 2, 6, 5}, std::array{2, 3, 7, 6}, std::array{3, 0, 4, 7}}) {
    const auto at = [&](int i) {
      return c[static_cast<std::size_t>(q[static_cast<std::size_t>(i)])];
    };
    facet({at(0), at(1), at(2)});
    facet({at(0), at(2), at(3)});
  }
  write("part.stl", stl + "endsolid b\n");
  const std::string uv = "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n";
  struct Tried {
    std::string resin, full, black, more;
    std::vector<std::string> options;
    std::string find, replace;  ///< the pattern and the option that follows it
  };
  const std::string n = kNumber;
  const std::vector<Tried> all{
      {"figure-2-2",
       "100.0",
       "1.0",
       "",
       {"--speed-mm-h", "7137"},
       "slower than " + n,
       "--speed-mm-h"},
      {"figure-2-2",
       "33.7",
       "0.91",
       "",
       {"--speed-mm-h", "3000"},
       "slower than " + n,
       "--speed-mm-h"},
      {"figure-2-2",
       "100.0",
       "1.337",
       "",
       {"--speed-mm-h", "30"},
       "faster than " + n,
       "--speed-mm-h"},
      {"cps-pr57-black",
       "11.3",
       "0.1",
       "",
       {"--speed-mm-h", "900"},
       "slower than " + n,
       "--speed-mm-h"},
      {"figure-2-2",
       "100.0",
       "1.0",
       "",
       {"--mode", "layerwise", "--ha-um", "110", "--exposure-s", "0.05"},
       "for at least " + n,
       "--exposure-s"},
      {"figure-2-2",
       "100.0",
       "1.0",
       "",
       {"--mode", "layerwise", "--ha-um", "110", "--exposure-s", "9"},
       "less than " + n,
       "--exposure-s"},
      {"custom-resin-1",
       "100.0",
       "0.5",
       uv,
       {"--uv-mw-cm2", "200", "--speed-mm-h", "900"},
       "slower than " + n,
       "--speed-mm-h"},
      {"custom-resin-1",
       "100.0",
       "0.5",
       uv,
       {"--uv-mw-cm2", "40", "--speed-mm-h", "150"},
       "or with " + n + " mW/cm² of UV",
       "--uv-mw-cm2"},
      {"custom-resin-1",
       "100.0",
       "0.5",
       uv,
       {"--uv-mw-cm2", "200", "--mode", "layerwise", "--exposure-s", "0.02"},
       "for at least " + n,
       "--exposure-s"},
  };
  int followed = 0;
  for (const Tried& t : all) {
    write("p.toml", printer(t.full, t.black, t.more));
    std::vector<std::string> command{"slicecorr", "run",        "part.stl", "-o",
                                     "out.uvj",   "--layer-um", "50",       "--printer",
                                     "p.toml",    "--resin",    t.resin};
    command.insert(command.end(), t.options.begin(), t.options.end());
    const RunResult refused = call(command);
    SCOPED_TRACE(testing::PrintToString(command) + refused.err);
    ASSERT_EQ(refused.exit_code, 3);
    const std::string number = text_in(refused.err, t.find);
    ASSERT_FALSE(number.empty());
    *(std::find(command.begin(), command.end(), t.replace) + 1) = number;
    const RunResult again = call(command);
    EXPECT_EQ(again.exit_code, 0) << number << ": " << again.err;
    ++followed;
  }
  EXPECT_EQ(followed, 9);
}

TEST_F(LimitsProgram, ResinctlNamesWhatWorks) {
  // A height in the dead zone: the UV light, and the height, that it names have an answer.
  std::vector<std::string> predict{"resinctl",      "predict", "--resin",     "custom-resin-1",
                                   "--blue-mw-cm2", "87.3",    "--uv-mw-cm2", "211",
                                   "--height-um",   "9"};
  const RunResult never = call(predict);
  ASSERT_EQ(never.exit_code, 3);
  auto command = predict;
  command[7] = text_in(never.err, "UV light below " + std::string(kNumber));
  EXPECT_EQ(call(command).exit_code, 0) << never.err;
  command = predict;
  command[9] = text_in(never.err, "dead zone of " + std::string(kNumber));
  EXPECT_EQ(call(command).exit_code, 0) << never.err;
  // A wish that no absorber meets: each way out alone.
  write("p.toml", printer("100.0", "1.0",
                          "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 150.0]]\n"));
  int followed = 0;
  for (const auto& [speed, tolerance, zone] :
       {std::array{"1000", "10", "90"}, std::array{"1500", "0.01", ""},
        std::array{"700", "5", "200"}}) {
    std::vector<std::string> wish{"resinctl",       "recommend", "--resin",      "custom-resin-1",
                                  "--printer",      "p.toml",    "--speed-mm-h", speed,
                                  "--tolerance-um", tolerance};
    if (*zone) wish.insert(wish.end(), {"--dead-zone-um", zone});
    const RunResult no = call(wish);
    SCOPED_TRACE(no.err);
    ASSERT_EQ(no.exit_code, 3);
    const std::vector<std::pair<std::string, std::size_t>> ways{
        {"a speed of " + std::string(kNumber), 7},
        {"edge by " + std::string(kNumber) + " um", 9},
        {"a dead zone of " + std::string(kNumber) + " um would do", 11}};
    for (const auto& [pattern, at] : ways) {
      const std::string number = text_in(no.err, pattern);
      if (number.empty() || at >= wish.size()) continue;
      auto follow = wish;
      follow[at] = number;
      const RunResult yes = call(follow);
      EXPECT_EQ(yes.exit_code, 0) << pattern << number << yes.err;
      ++followed;
    }
    if (const std::string lamp = text_in(no.err, "lamp of " + std::string(kNumber) + " mW");
        !lamp.empty()) {
      write("lamp.toml",
            printer("100.0", "1.0",
                    "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, " + lamp + "]]\n"));
      auto follow = wish;
      follow[5] = "lamp.toml";
      EXPECT_EQ(call(follow).exit_code, 0) << lamp;
      ++followed;
    }
  }
  EXPECT_GE(followed, 4);
}

}  // namespace
}  // namespace slicecorr::test
