// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The commands of the README run as written; links in the documents lead somewhere; the level table
// is the one that the program prints.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "edge_pictures.hpp"
#include "ladder.hpp"
#include "page_commands.hpp"
#include "run_program.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/optics_fit.hpp"
#include "spread_lab.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;

const fs::path kSource = SLICECORR_SOURCE_DIR;
const fs::path kBin = SLICECORR_BIN_DIR;

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Of the loopback; free a moment ago.
int free_port() {
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof a;
  EXPECT_EQ(::bind(s, reinterpret_cast<const sockaddr*>(&a), size), 0);
  EXPECT_EQ(::getsockname(s, reinterpret_cast<sockaddr*>(&a), &size), 0);
  ::close(s);
  return ntohs(a.sin_port);
}

TEST(Docs, CommandsOfTheReadmeRun) {
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-docs-" + std::to_string(::getpid()));
  fs::create_directories(folder / "build");
  fs::create_directory_symlink(kBin, folder / "build" / "bin");
  // Rails and a rung: half the ladder.
  TriangleMesh part;
  test::add_box(part, {-2, -1, 0}, {-1, 1, 1.25});
  test::add_box(part, {1, -1, 0}, {2, 1, 1.25});
  test::add_box(part, {-1, -1, 0.55}, {1, 1, 1.05});
  test::write_stl((folder / "part.stl").string(), part);
  // The tables that pages name lie in the repository.
  fs::create_directory_symlink(kSource / "docs", folder / "docs");
  const int port = free_port();
  const auto commands = test::our_commands(kSource / "README.md");
  ASSERT_GE(commands.size(), 18U);
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()},
                         {"XDG_CONFIG_HOME", ""},
                         {"SLICECORR_DB", ""},
                         {"PATH", kBin.string() + ":/usr/bin:/bin"},
                         {"XDG_STATE_HOME", (folder / "state").string()}};
  for (std::string command : commands) {
    // Several of these tests may run at once.
    command = std::regex_replace(command, std::regex("\\bprinter-sim"),
                                 "$& --listen 127.0.0.1:" + std::to_string(port));
    command = std::regex_replace(command, std::regex("printbridge print"),
                                 "$& --modbus tcp:127.0.0.1:" + std::to_string(port));
    const auto result = test::run_program({"/bin/sh", "-c", command}, options);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  }
  for (const char* made : {"shown.uvj", "part.uvj", "part.html", "part.json", "target.uvj",
                           "section.svg", "corrected/part.uvj", "morning.html"}) {
    EXPECT_TRUE(fs::exists(folder / made)) << made;
  }
  fs::remove_all(folder);
}

// A lab whose light spreads by 40 um, and by 3 um² with each um of its resin.
TEST(Docs, CommandsOfSpreadFitsRun) {
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-spread-docs-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "my-printer.toml")
      << "name = \"my-printer\"\n[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n"
         "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n";
  std::ofstream(folder / "my-resin.toml")
      << "name = \"my-resin\"\n[cure]\nabsorbance_height_um = 2000.0\nabsorbance_base = 10\n"
         "gel_dose_mj_cm3 = 1100.0\n";
  const Resin resin = load_resin((folder / "my-resin.toml").string());
  const Kinetics kinetics = make_kinetics(resin, false, false);
  test::Lab lab;
  lab.scatter = 3;
  lab.height_e_um = kinetics.hb_um;
  lab.dose = dose_prime_at(kinetics, 100, 0, 0, 6) / kinetics.critical_dose_prime;
  const auto write = [&](const char* name, const std::vector<double>& heights) {
    std::ofstream table(folder / name);
    table << "kind,designed_um,printed_um,depth_um\n";
    for (const auto& w : test::measured(lab, 1, 5, 1, heights).widths) {
      table << fmt::format("{},{},{:.1f},{}\n", w.kind == resins::WidthKind::gap ? "gap" : "line",
                           w.designed_um, w.printed_um, w.depth_um);
    }
  };
  write("widths.csv", {0});
  write("heights.csv", {0, 300, 600});
  for (const auto& [name, depth] : {std::pair{"edge.png", 0.0}, {"deep.png", 600.0}}) {
    test::EdgePictureOptions o;
    o.width = 320;
    o.height = 64;
    o.sigma_px = std::sqrt(1600 + 3 * depth) / 2.5;
    o.noise = 0.01;
    test::write_edge_picture((folder / name).string(), o);
  }
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()}, {"XDG_CONFIG_HOME", ""}, {"SLICECORR_DB", ""}};
  std::istringstream lines(text_of(kSource / "docs" / "spread-fits.md"));
  int commands = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("    ", 0) != 0) continue;
    line.erase(0, line.find_first_not_of(' '));
    if (line.rfind("slicecorr ", 0) != 0 && line.rfind("resinctl ", 0) != 0) continue;
    ++commands;
    const std::string command = kBin.string() + "/" + line;
    const auto result = test::run_program({"/bin/sh", "-c", command}, options);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  }
  EXPECT_EQ(commands, 6);
  EXPECT_NEAR(load_printer((folder / "my-printer.toml").string()).spread.gaussians.at(0).sigma_um,
              40, 2);
  EXPECT_NEAR(load_resin((folder / "my-resin.toml").string()).scatter_um2_per_um, 3, 0.3);
  fs::remove_all(folder);
}

/// Fills in the last column of a table of a test part: plugs by Jacobs' law, edges as designed.
void fill_in(const fs::path& form, const Resin& resin) {
  const Kinetics k = make_kinetics(resin, false, false);
  std::istringstream lines(text_of(form));
  std::string text;
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    const bool numbers = cells.size() > 2 && std::isdigit(static_cast<unsigned char>(cells[2][0]));
    if (numbers && line.rfind("#", 0) != 0) {
      const bool edge = cells[1] == "upper" || cells[1] == "lower";
      // Of combs by critical dose the third column is that dose, in times the gel dose: teeth begin as designed at 2.5.
      const bool by_dose = edge && cells.size() > 3;
      const double early =
          by_dose && cells[1] == "upper" ? 600 * std::log(std::stod(cells[2]) / 2.5) : 0;
      line += fmt::format("{:.1f}",
                          edge ? std::stod(cells[by_dose ? 3 : 2]) - early
                               : cured_height_um(k, std::stod(cells[1]), std::stod(cells[2])));
    }
    text += line + "\n";
  }
  std::ofstream(form) << text;
}

TEST(Docs, CommandsOfTuningRun) {
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-tuning-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  for (const auto& [from, to] : {std::pair{"printers/dual-wavelength-dlp", "my-printer"},
                                 {"db/benchy-resin", "my-resin"},
                                 {"db/custom-resin-1", "my-fitted-resin"}}) {
    fs::copy_file(kSource / "resins" / (from + std::string(".toml")),
                  folder / (to + std::string(".toml")));
  }
  const Resin resin = load_resin((folder / "my-resin.toml").string());
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()}, {"XDG_CONFIG_HOME", ""}, {"SLICECORR_DB", ""}};
  std::istringstream lines(text_of(kSource / "docs" / "tuning.md"));
  int commands = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("    slicecorr ", 0) != 0 || line.find("KIND") != std::string::npos) continue;
    line.erase(0, line.find_first_not_of(' '));
    ++commands;
    if (line.rfind("slicecorr tune ", 0) == 0) {
      const std::string form = line.substr(15, line.find(' ', 15) - 15);
      fill_in(folder / form, resin);
    }
    const std::string command = kBin.string() + "/" + line;
    const auto result = test::run_program({"/bin/sh", "-c", command}, options);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  }
  EXPECT_EQ(commands, 10);
  // What was measured was no news.
  EXPECT_NEAR(load_resin((folder / "tuned-2.toml").string()).absorbance_height10_um,
              resin.absorbance_height10_um, 2);
  fs::remove_all(folder);
}

TEST(Docs, CommandsOfCalibrationRun) {
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-calibration-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  // Pins as a machine shows them that is a little off the printer's file.
  std::ofstream(folder / "my-printer.toml")
      << std::regex_replace(text_of(kSource / "resins" / "printers" / "webber-vial.toml"),
                            std::regex("name = \"webber-vial\""), "name = \"my-printer\"");
  Printer machine = load_printer((folder / "my-printer.toml").string());
  const double n = load_resin("webber-dudma-pegda").n;
  machine.optics->axis_right_px = 3.7;
  machine.optics->tilt_deg = 0.4;
  machine.optics->distance_mm = 101.2;
  {
    std::ofstream pins(folder / "pins.csv");
    pins << "angle_deg,radius_mm,pin_deg,z_mm,column_px,row_px\n";
    for (const auto& [radius, at] : {std::pair{4.0, 0.0}, {7.0, 140.0}}) {
      for (int angle = 0; angle < 360; angle += 30) {
        for (const double z : {2.0, 9.0, 16.0}) {
          const auto seen = resins::seen_at(
              machine, n, {.angle_deg = 1.0 * angle, .radius_mm = radius, .pin_deg = at, .z_mm = z},
              33, -9);
          pins << fmt::format("{},{},{},{},{:.2f},{:.2f}\n", angle, radius, at, z, seen.column,
                              seen.row);
        }
      }
    }
  }
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()}, {"XDG_CONFIG_HOME", ""}, {"SLICECORR_DB", ""}};
  std::istringstream lines(text_of(kSource / "docs" / "tomography-calibration.md"));
  int commands = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("    slicecorr ", 0) != 0 && line.rfind("    resinctl ", 0) != 0) continue;
    ++commands;
    const std::string command = kBin.string() + "/" + line.substr(4);
    const auto result = test::run_program({"/bin/sh", "-c", command}, options);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  }
  EXPECT_GE(commands, 3);
  for (const char* made :
       {"targets/focus.html", "targets/light-255.png", "pins.svg", "wobble.csv"}) {
    EXPECT_TRUE(fs::exists(folder / made)) << made;
  }
  const Printer found = load_printer((folder / "my-printer.toml").string());
  EXPECT_NEAR(found.optics->distance_mm, 101.2, 0.05);
  EXPECT_NEAR(found.optics->axis_right_px, 3.7, 0.01);
  EXPECT_NEAR(found.optics->tilt_deg, 0.4, 0.002);
  fs::remove_all(folder);
}

TEST(Docs, CommandsOfFlowRun) {
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-flow-docs-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  test::write_stl((folder / "part.stl").string(), test::ladder());
  std::ofstream(folder / "my-printer.toml")
      << "name = \"my-printer\"\nsuction_limit_pa = 20000\n"
         "[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n"
         "[blue]\ncalibration = [[0, 1.0], [255, 200.0]]\n"
         "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n";
  // Resin 2 of the dissertation's table 4.1, areal.
  std::ofstream(folder / "my-resin.toml")
      << "name = \"my-resin\"\nviscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n"
         "[cure]\nabsorbance_height_um = 408.0\nabsorbance_base = \"e\"\n"
         "critical_dose_mj_cm3 = 1600.0\n"
         "[inhibition]\nbeta = 0.8\nabsorbance_height_um = 38.0\nabsorbance_base = \"e\"\n";
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()}, {"XDG_CONFIG_HOME", ""}, {"SLICECORR_DB", ""}};
  const auto run = [&](const std::string& line) {
    const std::string command = kBin.string() + "/" + line;
    const auto result = test::run_program({"/bin/sh", "-c", command}, options);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  };
  run("slicecorr slice part.stl -o part.uvj --printer my-printer.toml --layer-um 50");
  run("slicecorr correct part.uvj -o even.uvj --printer my-printer.toml --resin my-resin.toml "
      "--speed-mm-h 300 --even-dead-zone blue");
  std::istringstream lines(text_of(kSource / "docs" / "flow.md"));
  int commands = 0;
  for (std::string line, more; std::getline(lines, line);) {
    if (line.rfind("    slicecorr ", 0) != 0) continue;
    while (line.back() == '\\' && std::getline(lines, more)) {
      line.back() = ' ';
      line += more;
    }
    ++commands;
    run(line.substr(4));
  }
  EXPECT_EQ(commands, 7);
  for (const char* made : {"flow.html", "flow.json", "speeds.csv"}) {
    EXPECT_TRUE(fs::exists(folder / made)) << made;
  }
  fs::remove_all(folder);
}

TEST(Docs, LinksLeadSomewhere) {
  std::vector<fs::path> documents = {kSource / "README.md", kSource / "CHANGELOG.md"};
  for (const auto& entry : fs::recursive_directory_iterator(kSource / "docs")) {
    if (entry.path().extension() == ".md") documents.push_back(entry.path());
  }
  ASSERT_GE(documents.size(), 5U);
  const std::regex link(R"(\]\(([^)#:]+)\))");
  int links = 0;
  for (const auto& document : documents) {
    const std::string text = text_of(document);
    for (std::sregex_iterator it(text.begin(), text.end(), link), end; it != end; ++it) {
      ++links;
      EXPECT_TRUE(fs::exists(document.parent_path() / (*it)[1].str()))
          << document << " links to " << (*it)[1];
    }
  }
  EXPECT_GT(links, 5);
}

// What these pages promise is tried by a test that is there.
TEST(Docs, TestsThatPagesNameAreThere) {
  std::set<std::string> tests;
  const std::regex test(R"(TEST(?:_F|_P)?\((\w+),\s*(\w+)\))");
  for (const auto& entry : fs::directory_iterator(kSource / "tests")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = text_of(entry.path());
    for (std::sregex_iterator it(text.begin(), text.end(), test), end; it != end; ++it) {
      tests.insert((*it)[1].str() + "." + (*it)[2].str());
    }
  }
  const std::regex named(R"(\b[A-Z][A-Za-z0-9]+\.[A-Z]\w+)");
  for (const char* page : {"safety.md", "threats.md"}) {
    const std::string text = text_of(kSource / "docs" / page);
    int count = 0;
    for (std::sregex_iterator it(text.begin(), text.end(), named), end; it != end; ++it, ++count) {
      EXPECT_TRUE(tests.contains(it->str())) << page << " names " << it->str();
    }
    EXPECT_GT(count, 30) << page;
  }
}

TEST(Docs, LibraryNamesNoOptionsOfPrograms) {
  // Its messages go to callers in C and C++, too. Printed sheets go to people with the programs.
  const std::regex option("^[^/\n]*\"[^\"\n]*--[a-z][^\n]*$");
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(kSource / "libslicecorr")) {
    const fs::path below = fs::relative(entry.path(), kSource / "libslicecorr");
    if (below.extension() != ".cpp" || *below.begin() == "programs" ||
        below.parent_path() == "support/http" || below == "measure/sheet_commands.cpp") {
      continue;
    }
    ++files;
    std::istringstream lines(text_of(entry.path()));
    const std::regex variable("var\\(--");  // of CSS
    for (std::string line; std::getline(lines, line);) {
      line = std::regex_replace(line, variable, "");
      EXPECT_FALSE(std::regex_search(line, option)) << below << ": " << line;
    }
  }
  EXPECT_GT(files, 50);
}

TEST(Docs, FeaturesAndSettingsAreThoseThatTheProgramPrints) {
  for (const std::string page : {"features", "settings"}) {
    const auto result = test::run_program({(kBin / "slicecorr").string(), page});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const std::string table = result.out.substr(result.out.find("\n\n") + 2);
    EXPECT_NE(text_of(kSource / "docs" / (page + ".md")).find("```\n" + table + "```\n"),
              std::string::npos)
        << table;
  }
}

// Who asks gets an answer for every feature, alone and with every other, in both modes.
TEST(Docs, EveryPairOfFeaturesHasAnAnswer) {
  const std::string program = (kBin / "slicecorr").string();
  const auto asked = test::run_program({program, "features", "--json", "-"});
  ASSERT_EQ(asked.exit_code, 0) << asked.err;
  EXPECT_EQ(test::run_program({program, "features", "--json"}).out, asked.out);
  const auto json = nlohmann::json::parse(asked.out);
  std::map<std::string, int> answers;
  std::map<std::array<std::string, 4>, std::string> of;
  for (const auto& row : json.at("rows")) {
    const std::string with = row.at("with").is_null() ? "" : row.at("with");
    EXPECT_EQ(row.at("words").get<std::string>().empty(), row.at("answer") == "counted");
    ++answers[row.at("answer")];
    of[{row.at("feature"), with, row.at("mode"), row.at("model")}] = row.at("answer");
  }
  EXPECT_EQ(of.size(), json.at("rows").size()) << "a row stands twice";
  EXPECT_EQ(answers.size(), 3U);
  for (const auto& [key, answer] : of) {
    if (!key[1].empty()) {
      EXPECT_EQ((of.at({key[1], key[0], key[2], key[3]})), answer) << key[0] << key[1];
    }
  }
  const std::string spread = "light that spreads ([blue] or [uv] spread, scatter)",
                    stay = "more light for slower slices (slice_lamps)",
                    uneven = "uneven light ([blue] flat_field)";
  EXPECT_EQ((of.at({stay, spread, "continuous", "kinetic"})), "counted");
  EXPECT_EQ((of.at({stay, "", "continuous", "kinetic"})), "counted");
  EXPECT_EQ((of.at({stay, "", "layerwise", "kinetic"})), "refused");
  EXPECT_EQ((of.at({stay, "", "continuous", "gel-time"})), "counted");
  EXPECT_EQ((of.at({spread, uneven, "continuous", "kinetic"})), "counted");
  EXPECT_EQ((of.at({spread, uneven, "continuous", "gel-time"})), "counted");
}

// A row of the table is an option of every program that corrects.
TEST(Docs, EverySettingIsAnOption) {
  const auto table = test::run_program({(kBin / "slicecorr").string(), "settings", "--json"});
  const auto settings = nlohmann::json::parse(table.out);
  EXPECT_GT(settings.size(), 30U);
  for (const std::vector<std::string>& program :
       std::vector<std::vector<std::string>>{{"slicecorr", "run"},
                                             {"slicecorr", "correct"},
                                             {"slicecorr", "plan"},
                                             {"slicecorr-post"},
                                             {"slicefarm", "submit"}}) {
    std::vector<std::string> command{(kBin / program[0]).string()};
    command.insert(command.end(), program.begin() + 1, program.end());
    command.emplace_back("--help");
    const std::string help = test::run_program(command).out;
    for (const auto& s : settings) {
      if (!s["is_option"].get<bool>()) continue;
      constexpr std::string_view kEnds = " \n[";
      std::string option = "--" + s["name"].get<std::string>();
      std::replace(option.begin(), option.end(), '_', '-');
      // A word that may be left out stands in brackets.
      const bool stands = std::any_of(kEnds.begin(), kEnds.end(), [&](char end) {
        return help.find(option + end) != help.npos;
      });
      EXPECT_TRUE(stands) << option << " of " << program.back();
    }
  }
}

TEST(Docs, LevelTablesAreThoseThatTheProgramPrints) {
  const auto program = kBin / "levels_table";
  if (!fs::exists(program)) GTEST_SKIP() << "built without benchmarks: no levels_table";
  const auto result = test::run_program({program.string()});
  ASSERT_EQ(result.exit_code, 0);
  // The page puts words between the tables, which are printed with an empty line between them.
  const std::string page = text_of(kSource / "docs" / "levels.md");
  int tables = 0;
  for (std::size_t at = 0; at < result.out.size(); ++tables) {
    const std::size_t end = std::min(result.out.find("\n\n", at), result.out.size() - 1);
    const std::string table = result.out.substr(at, end + 1 - at);
    EXPECT_NE(page.find(table), std::string::npos) << table;
    at = end + 2;
  }
  EXPECT_EQ(tables, 3);
}

}  // namespace
}  // namespace slicecorr
