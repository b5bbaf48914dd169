// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What pages tell owners of LCD and DLP printers runs as typed, in one folder with the files that the
// page names: print-files, slicer-plugin, sharing; calibrate_program_test.cpp has calipers.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "ladder.hpp"
#include "page_commands.hpp"
#include "real_files.hpp"
#include "run_program.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/process.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// 640 x 480 pixels of 100 mW/cm²: small, and bright enough for any resin of the pages.
constexpr const char* kMyPrinter =
    "name = \"my-printer\"\n[display]\nwidth_px = 640\nheight_px = 480\npixel_um = 50.0\n[blue]\n"
    "wavelength_nm = 405\ncalibration = [[0, 0.1], [255, 100.0]]\n[stage]\ntravel_mm = 100\n";

class DocsLcd : public ::testing::Test {
 protected:
  DocsLcd() {
    options_.folder = folder_.path();
    options_.environment = {{"HOME", folder_.path()},
                            {"XDG_CONFIG_HOME", ""},
                            {"SLICECORR_DB", ""},
                            {"SLIC3R_PP_OUTPUT_NAME", ""},
                            {"PATH", folder_ / "bin:" SLICECORR_BIN_DIR ":" SLICECORR_SOURCE_DIR
                                               "/slicer-plugin/uvtools:/usr/bin:/bin"}};
    fs::create_directories(folder_ / ".config/slicecorr");
    fs::create_directories(folder_ / "bin");
    // A rail, a rung and a rail.
    TriangleMesh part;
    add_box(part, {-2, -1, 0}, {-1, 1, 0.5});
    add_box(part, {1, -1, 0}, {2, 1, 0.5});
    add_box(part, {-1, -1, 0.3}, {1, 1, 0.4});
    write_stl(folder_ / "part.stl", part);
  }

  void put(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
  }
  std::string text(const std::string& name) const { return to_text(read_file(folder_ / name)); }
  bool there(const std::string& name) const { return fs::exists(folder_ / name); }
  static std::string page(const std::string& name) {
    return to_text(read_file(SLICECORR_SOURCE_DIR "/docs/" + name));
  }
  /// "my-printer" and "my-resin", as a user has them.
  void put_mine() const {
    put(".config/slicecorr/my-printer.toml", kMyPrinter);
    const std::string resin = to_text(read_file(SLICECORR_DB_DIR "/liqcreate-strong-x-405nm.toml"));
    put(".config/slicecorr/my-resin.toml",
        "name = \"my-resin\"\n" + resin.substr(resin.find('\n') + 1));
  }
  RunResult shell(const std::string& line) const {
    RunResult r = run_program({"/bin/sh", "-c", line}, options_);
    EXPECT_EQ(r.exit_code, 0) << line << "\n" << r.out << r.err;
    return r;
  }
  /// Every command of the page as it stands; `before` prepares what one needs.
  std::size_t run_page(const std::string& name,
                       const std::function<void(const std::string&)>& before) const {
    const auto commands = our_commands(SLICECORR_SOURCE_DIR "/docs/" + name);
    for (const std::string& command : commands) {
      before(command);
      shell(command);
    }
    return commands.size();
  }
  /// Fills the last column of a table in, row by row, from the cells before it.
  void fill_in(const std::string& name,
               const std::function<double(const std::vector<double>&)>& value) const {
    std::istringstream lines(text(name));
    std::string filled;
    for (std::string line; std::getline(lines, line);) {
      if (!line.empty() && line.back() == ',') {
        std::vector<double> cells;
        std::istringstream row(line);
        for (std::string cell; std::getline(row, cell, ',');) cells.push_back(std::stod(cell));
        line += fmt::format("{:.4f}", value(cells));
      }
      filled += line + "\n";
    }
    put(name, filled);
  }
  /// The part as a slicer exports it for a printer: with its times and profiles, without our record.
  void exported(const std::string& name, const std::string& printer, const char* exposure_s) const {
    shell("slicecorr slice part.stl -o ours.sl1 --layer-um 50 --printer " + printer);
    Entries entries = unzip(folder_ / "ours.sl1");
    std::erase_if(entries, [](const auto& entry) { return entry.first == "slicecorr.json"; });
    for (auto& [entry, data] : entries) {
      if (entry != "config.ini") continue;
      std::string ini = to_text(data);
      const auto set = [&](const std::string& key, const std::string& value) {
        const std::size_t at = ini.find(key + " = ");
        ASSERT_NE(at, std::string::npos) << key;
        ini.replace(at, ini.find('\n', at) - at, key + " = " + value);
      };
      set("expTime", exposure_s);
      set("expTimeFirst", exposure_s);
      set("materialName", "Liqcreate Strong-X @0.05");
      set("printerProfile", "Original Prusa SL1S SPEED");
      data = to_bytes(ini);
    }
    make_zip(folder_ / name, entries, true);
  }

  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(DocsLcd, PrintFiles) {
  const std::string lgs = real_file("slices/binary/uv3dp_microsupports3.lgs");
  SLICECORR_NEEDS_FILE(lgs);
  fs::copy_file(lgs, folder_ / "from-the-slicer.lgs");
  put_mine();
  shell("slicecorr slice part.stl -o part.sl1 --printer my-printer --layer-um 50");
  const std::size_t commands = run_page("print-files.md", [&](const std::string& command) {
    if (!command.starts_with("resinctl import")) return;
    // A display of gamma 2.2 that gives 3 mW/cm².
    fill_in("levels.csv", [](const auto& row) { return 3 * std::pow(row.at(0) / 255, 2.2); });
  });
  EXPECT_EQ(commands, 12U);
  EXPECT_EQ(load_printer(folder_ / ".config/slicecorr/my-elegoo-mars-4-max.toml")
                .calibration.back()
                .intensity_mw_cm2,
            3);
  for (const char* made :
       {"corrected.goo", "part.lgs", "f.html", "part.goo.orig", "levels.html", "corrected.ctb"}) {
    EXPECT_TRUE(there(made)) << made;
  }
  // In a sentence: any plain file of the printer's slicer.
  const std::string with_template = "slicecorr convert part.sl1 -o part.ctb --template old.ctb";
  EXPECT_THAT(page("print-files.md"), HasSubstr("`" + with_template + "`"));
  fs::rename(folder_ / "part.ctb", folder_ / "old.ctb");
  shell(with_template);
  EXPECT_THAT(shell("slicecorr info part.ctb").out, HasSubstr("ctb"));
}

// The page and the printers' files say the same of what they read.
TEST_F(DocsLcd, EndingsOfFilesAreThoseOfThePrinters) {
  std::istringstream lines(page("print-files.md"));
  int printers = 0;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t name_end = line.find("` |");
    if (!line.starts_with("| `") || name_end == std::string::npos) continue;
    const std::string path =
        fmt::format("{}/{}.toml", SLICECORR_PRINTERS_DIR, line.substr(3, name_end - 3));
    if (!fs::exists(path)) continue;
    std::vector<std::string> cells, endings;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, '|');) cells.push_back(cell);
    std::istringstream words(cells.at(4));
    for (std::string word; words >> word;) {
      if (word.front() == '.') endings.push_back(word);
    }
    EXPECT_EQ(endings_read_by(path), endings) << line;
    ++printers;
  }
  EXPECT_EQ(printers, 37);
}

TEST_F(DocsLcd, SlicerPlugin) {
  put_mine();
  // It takes the arguments of UVtools; its files are all the same one under other names.
  put("bin/UVtoolsCmd",
      "#!/bin/sh\ncase $1 in convert) cp \"$2\" \"$4\" ;; copy-parameters) test -s \"$3\" ;; *) exit 1 "
      ";; esac\n");
  fs::permissions(folder_ / "bin/UVtoolsCmd", fs::perms::owner_all);
  const std::string text = page("slicer-plugin.md");
  const std::size_t begin = text.find("    [default]"), end = text.find("\n\n| key |");
  ASSERT_LT(begin, end);
  put(".config/slicecorr/post.toml", text.substr(begin, end - begin));

  exported("export.sl1", "prusa-sl1s", "8");
  exported("small.sl1", "my-printer", "1");
  shell("slicecorr convert small.sl1 -o small.uvj && mv small.uvj part.ctb");
  const auto slice_anew = [&](const char* to) {
    fs::copy_file(folder_ / "export.sl1", folder_ / to, fs::copy_options::overwrite_existing);
  };
  fs::create_directories(folder_ / "slices");

  std::size_t watched = 0;
  for (const std::string& command : our_commands(SLICECORR_SOURCE_DIR "/docs/slicer-plugin.md")) {
    if (command.find("install-watch") != std::string::npos) {
      // 4 where no systemd of the user answers; all is written nevertheless.
      const RunResult r = run_program({"/bin/sh", "-c", command}, options_);
      EXPECT_TRUE(r.exit_code == 0 || r.exit_code == 4) << command << "\n" << r.err;
      continue;
    }
    if (command.find("--watch") == std::string::npos) {
      slice_anew("part.sl1");
      shell(command);
      continue;
    }
    // It watches until it is told to stop, and ends with 130 then.
    ++watched;
    slice_anew("slices/part.sl1");
    fs::remove(folder_ / "slices.log");
    RunOptions options = options_;
    options.signal = SIGTERM;
    options.signal_when = [&](const std::string&, const std::string& err) {
      const std::string told = there("slices.log") ? this->text("slices.log") : err;
      return told.find("corrected ") != std::string::npos;
    };
    const RunResult r = run_program({"/bin/sh", "-c", "exec " + command}, options);
    EXPECT_EQ(r.exit_code, 130) << command << "\n" << r.err;
    EXPECT_EQ(read_file(folder_ / "slices/part.sl1.orig"), read_file(folder_ / "export.sl1"));
    EXPECT_NE(read_file(folder_ / "slices/part.sl1"), read_file(folder_ / "export.sl1"));
  }
  EXPECT_EQ(watched, 2U);
  EXPECT_TRUE(there("part.goo"));
  EXPECT_TRUE(there("part.ctb.orig"));
}

TEST_F(DocsLcd, Sharing) {
  const std::string text = page("sharing.md");
  shell("slicecorr testpart films --printer elegoo-mars-4-max -o films.goo");
  fill_in("films.csv", [](const auto& row) {
    return 150 * std::log10(std::pow(row.at(1) / 255, 2.2) * row.at(2) / 0.8);
  });
  const auto after_line = [&](const std::string& name, const std::string& begin,
                              const std::string& lines) {
    std::string toml = this->text(name);
    const std::size_t at = toml.find("\n", toml.find(begin));
    put(name, toml.insert(at + 1, lines));
  };
  const std::size_t commands = run_page("sharing.md", [&](const std::string& command) {
    if (command.find("--share my-resin.toml") == std::string::npos) return;
    // The page shows what is refused, line by line, and then the lines that are missing.
    const RunResult refused = run_program({"/bin/sh", "-c", command}, options_);
    EXPECT_EQ(refused.exit_code, 2);
    std::istringstream lines(refused.out);
    int told = 0;
    for (std::string line; std::getline(lines, line); ++told) {
      EXPECT_THAT(text, HasSubstr("    " + line.substr(line.find("my-resin.toml")) + "\n"));
    }
    EXPECT_EQ(told, 4) << refused.out;
    const auto block = [&](const std::string& begin, const std::string& end) {
      const std::size_t at = text.find(begin);
      std::string found = text.substr(at, text.find(end, at) - at) + "\n";
      for (std::size_t i = 0; (i = found.find("    ", i)) != std::string::npos;) found.erase(i, 4);
      return found;
    };
    after_line("my-resin.toml", "name = ", block("    maker = ", "\n\n"));
    after_line("my-resin.toml", "[cure]", block("    wavelength_nm = ", "\n\n"));
    const std::string year = block("    date = ", "\n\n");
    after_line("my-resin.toml", "[provenance]", year);
    after_line("my-mars.toml", "[provenance]", year);
  });
  EXPECT_EQ(commands, 4U);
  EXPECT_THAT(shell("slicecorr info films.goo").out, HasSubstr("goo"));
  EXPECT_EQ(load_resin(folder_ / "acme-tough-grey.toml").name, "acme-tough-grey");
  EXPECT_THAT(this->text("acme-tough-grey.toml"), ::testing::Not(HasSubstr("#")));
}

}  // namespace
}  // namespace slicecorr::test
