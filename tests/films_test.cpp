// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Squares that cure as films: what the images show, and the files, forms and sheets of it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <numeric>
#include <set>
#include <sstream>

#include "print_file_fixture.hpp"
#include "program_fixture.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/films_part.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Printer display_of(int width_px, int height_px, double pixel_um = 50) {
  Printer p;
  p.name = "dark";
  p.width_px = width_px;
  p.height_px = height_px;
  p.pixel_x_um = p.pixel_y_um = pixel_um;
  return p;
}

FileGreys all_greys() {
  FileGreys all;
  std::iota(all.begin(), all.end(), std::uint8_t{0});
  return all;
}

/// By how much each pixel of the plate is lit over all images: value times images.
struct Lit {
  std::vector<int> images, value;
};
Lit lit_by(const FilmsPart& part, int rows_at_once) {
  const Grid& g = part.grid();
  Lit lit;
  lit.images.assign(static_cast<std::size_t>(g.width_px) * static_cast<std::size_t>(g.height_px),
                    0);
  lit.value = lit.images;
  for (int y = 0; y < g.height_px; y += rows_at_once) {
    const PixelBox band{0, y, g.width_px, std::min(y + rows_at_once, g.height_px)};
    int images = 0;
    part.read_band(band, [&](int n, const std::uint8_t* rows) {
      EXPECT_EQ(n, images++);
      if (!rows) return;
      const auto first = static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width_px);
      const auto count =
          static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
      for (std::size_t i = 0; i < count; ++i) {
        if (rows[i] == 0) continue;
        ++lit.images[first + i];
        lit.value[first + i] = rows[i];
      }
    });
    EXPECT_EQ(images, g.layers);
  }
  return lit;
}

TEST(FilmsPart, ASquareIsLitInTheFirstImages) {
  const FilmsPart part(display_of(1200, 900), all_greys(), {.layer_um = 50, .image_s = 2});
  EXPECT_EQ(part.grid().layers, FilmsPart::kImages);
  EXPECT_EQ(part.image_s(), std::vector<double>(16, 2));
  const Lit lit = lit_by(part, 32);
  EXPECT_EQ(lit_by(part, 900).images, lit.images);
  // Each pixel that is lit belongs to one square and gets what that says; the rest stays dark.
  std::vector<int> left = lit.images;
  std::set<std::vector<bool>> numbers;
  const int width = part.grid().width_px;
  for (const FilmSquare& s : part.squares()) {
    int cut = 0;
    std::vector<bool> pattern;
    for (int y = s.box.y0; y < s.box.y1; ++y) {
      for (int x = s.box.x0; x < s.box.x1; ++x) {
        const auto at = static_cast<std::size_t>(y * width + x);
        pattern.push_back(left[at] == 0);
        cut += left[at] == 0;
        if (left[at] == 0) continue;
        EXPECT_EQ(left[at], s.images);
        EXPECT_EQ(lit.value[at], s.level);
        left[at] = 0;
        // Calipers measure the middle: numbers leave it whole.
        EXPECT_FALSE(pattern.back());
      }
    }
    EXPECT_GT(cut, 20);
    EXPECT_LT(cut, s.box.width() * s.box.height() / 8);
    const int middle = (s.box.y0 + s.box.y1) / 2 * width + (s.box.x0 + s.box.x1) / 2;
    EXPECT_EQ(lit.images[static_cast<std::size_t>(middle)], s.images);
    EXPECT_TRUE(numbers.insert(pattern).second) << "two squares have one number";
  }
  EXPECT_EQ(std::accumulate(left.begin(), left.end(), 0), 0);
}

TEST(FilmsPart, TellsTimesAndLevelsApart) {
  const FilmsPart part(display_of(1600, 1200), all_greys(), {.image_s = 0.5});
  std::map<int, std::multiset<double>> times;
  for (const FilmSquare& s : part.squares()) times[s.level].insert(part.exposure_s(s));
  ASSERT_EQ(times.size(), 9u);
  EXPECT_EQ(times[255], (std::multiset<double>{0.5, 1, 2, 4, 8, 8, 8, 8}));
  for (const auto& [level, all] : times) {
    if (level < 255) {
      EXPECT_EQ(all, (std::multiset<double>{4, 8})) << level;
    }
  }
}

// What a file would change is not shown.
TEST(FilmsPart, ShowsLevelsThatTheFileHolds) {
  for (const auto& codec :
       {detail::ctb_code(8, 8, 0), detail::pw0_code(8, 8, false), detail::lgs_code(8, 8),
        detail::bit_sets_code(8, 8, 4, false), detail::bit_sets_code(8, 8, 1, false)}) {
    const FileGreys& held = codec->shown();
    const FilmsPart part(display_of(1600, 1200), held, {});
    for (const FilmSquare& s : part.squares()) {
      EXPECT_EQ(held[static_cast<std::size_t>(s.level)], s.level);
    }
    EXPECT_EQ(part.squares().size(), 8u + 2u * static_cast<unsigned>(part.greys()));
  }
  const auto black_and_white = detail::bit_sets_code(8, 8, 1, false);
  EXPECT_EQ(FilmsPart(display_of(1600, 1200), black_and_white->shown(), {}).greys(), 0);
  FileGreys no_full = all_greys();
  no_full[255] = 254;
  EXPECT_THAT(refusal([&] { FilmsPart(display_of(1600, 1200), no_full, {}); }),
              HasSubstr("black and full light"));
}

TEST(FilmsPart, WhatHasNoRoomIsRefused) {
  EXPECT_THAT(refusal([] { FilmsPart(display_of(160, 120), all_greys(), {}); }),
              AllOf(HasSubstr("8.0 x 6.0 mm"), HasSubstr("24 squares of at least 2 mm")));
  // Squares of 2 mm that are four pixels wide have no room for a number.
  EXPECT_THAT(refusal([] { FilmsPart(display_of(120, 90, 500), all_greys(), {}); }),
              HasSubstr("20 pixels"));
  EXPECT_THROW(FilmsPart(display_of(1600, 1200), all_greys(), {.layer_um = 0}), InputError);
  EXPECT_THROW(FilmsPart(display_of(1600, 1200), all_greys(), {.image_s = 0}), InputError);
}

TEST(FilmsPart, EveryKnownPrinterHasRoom) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(SLICECORR_PRINTERS_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    const Printer printer = load_display(entry.path().string());
    if (light_is_measured(printer)) continue;
    SCOPED_TRACE(printer.name);
    ++count;
    const FilmsPart part(printer, all_greys(), {});
    const Grid plate = plate_grid(printer);
    for (const FilmSquare& s : part.squares()) {
      EXPECT_GE(s.box.x0, 0);
      EXPECT_GE(s.box.y0, 0);
      EXPECT_LE(s.box.x1, plate.width_px);
      EXPECT_LE(s.box.y1, plate.height_px);
      EXPECT_GT(s.box.width() * plate.pixel_x_um, 5.9e3);
    }
  }
  EXPECT_GE(count, 37);
}

// ---- programs ---------------------------------------------------------------------------------

class FilmsProgram : public ProgramFixture {
 protected:
  std::string text_of(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  /// What the file shows at the middle of each square, summed over its images, is what the table says.
  void shows_its_table(const std::string& file) const {
    const StackReader stack(folder_ / file, folder_.path());
    const StackInfo& info = stack.info();
    EXPECT_EQ(info.bottom_layers == 0 || info.bottom_exposure_s == info.exposure_s, true);
    EXPECT_TRUE(info.layer_exposure_s.empty());
    EXPECT_TRUE(info.light_share.empty());
    const std::string form = std::filesystem::path(file).replace_extension(".csv").string();
    const auto table = read_form(folder_ / form);
    ASSERT_TRUE(table);
    std::multiset<std::pair<double, double>> said, shown;
    for (std::size_t i = 0; i < table->rows.size(); ++i) {
      said.insert({*table->number(i, "level", 0, 255), *table->number(i, "exposure_s", 0, 1e6)});
    }
    // Squares as they lie in the file, however it is turned: a pixel without the same on its left and
    // above it begins one, but for the numbers, which are smaller than half a square.
    const Grid& g = stack.grid();
    std::vector<int> images(static_cast<std::size_t>(g.width_px) *
                            static_cast<std::size_t>(g.height_px));
    Bytes value(images.size());
    stack.read_band({0, 0, g.width_px, g.height_px}, [&](int, const std::uint8_t* rows) {
      for (std::size_t i = 0; rows && i < value.size(); ++i) {
        images[i] += rows[i] > 0;
        value[i] = std::max(value[i], rows[i]);
      }
    });
    const auto width = static_cast<std::size_t>(g.width_px);
    const auto side = static_cast<std::size_t>(2e3 / g.pixel_x_um);
    std::vector<bool> seen(value.size());
    for (std::size_t i = 0; i + 1 < value.size(); ++i) {
      if (seen[i] || value[i] == 0) continue;
      // All that hangs together is one square.
      std::vector<std::size_t> open{i};
      std::size_t count = 0;
      seen[i] = true;
      while (!open.empty()) {
        const std::size_t at = open.back();
        open.pop_back();
        ++count;
        EXPECT_EQ(value[at], value[i]);
        EXPECT_EQ(images[at], images[i]);
        for (const std::size_t next : {at - 1, at + 1, at - width, at + width}) {
          if (next >= value.size() || seen[next] || value[next] == 0) continue;
          seen[next] = true;
          open.push_back(next);
        }
      }
      // What is within a letter is small, and of no square of its own.
      if (count < side * side) continue;
      shown.insert({level_of_pixel(value[i], 256), images[i] * info.exposure_s});
    }
    EXPECT_EQ(shown, said);
  }
};

TEST_F(FilmsProgram, NewFilesShowWhatTheTableSays) {
  write("dark.toml",
        "name = \"dark\"\n[display]\nwidth_px = 700\nheight_px = 500\npixel_um = 50.0\nmirror = "
        "\"x\"\n[blue]\ncalibration = \"to be measured\"\n");
  for (const char* name : {"films.goo", "films.ctb", "films.uvj", "films.sl1"}) {
    SCOPED_TRACE(name);
    good({"testpart", "films", "--printer", "dark.toml", "-o", name, "--exposure-s", "1.5"});
    shows_its_table(name);
    const std::string page = text_of("films.html");
    for (const char* words :
         {"<b>16 images</b>", "<b>1.5 s</b>", "Peel", "Blot", "<td>24</td>",
          "resinctl calibrate films.csv --printer dark.toml -o my-dark.toml --resin-out "
          "my-resin.toml"}) {
      EXPECT_THAT(page, HasSubstr(words));
    }
    EXPECT_THAT(page, testing::Not(HasSubstr("http")));
    std::filesystem::remove(folder_ / "films.csv");
  }
  // What was measured is not written over.
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.goo"});
  write("films.csv", text_of("films.csv") + "25,255,32,99\n");
  bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "films.goo"},
      {"films.csv", "not written over"});
  bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "f.goo", "--exposure-s", "0"},
      {"--exposure-s"});
  for (const auto& [time, words] :
       {std::pair("0.0123", "expected 0.012 s"), std::pair("0.0001", "expected 0.001 s"),
        std::pair("90000", "at most 86400 s")}) {
    bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "f.goo", "--exposure-s", time},
        {words});
  }
  bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "f.lgs"}, {"template"});
  bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "f.goo", "--resin", "figure-2-2"},
      {"--resin"});
}

// An option of other kinds is no option of this one, whichever it is: nothing that was asked for is dropped.
TEST_F(FilmsProgram, OptionsOfOtherKindsAreRefused) {
  const std::vector<std::string> kinds = {"spread", "comb",      "lift-comb",  "staircase",
                                          "wedge",  "dead-zone", "flat-field", "levels",
                                          "films",  "f",         "grid",       "dose-combs"};
  const std::map<std::string, std::set<std::string>> of = {
      {"--resin=egg-resin", {"staircase", "wedge", "flat-field", "dose-combs"}},
      {"--other-wavelength", {"staircase", "wedge", "flat-field", "dose-combs"}},
      {"--speed-mm-h=100", {"dose-combs"}},
      {"--height-um=100", {"spread"}},
      {"--uv-mw-cm2=5", {"dead-zone"}},
      {"--exposure-s=3", {"dead-zone", "levels", "films", "f", "grid"}},
      {"--picture=q.png", {"spread", "f"}},
      {"--form=q.csv",
       {"spread", "comb", "lift-comb", "staircase", "wedge", "dead-zone", "flat-field", "levels",
        "films", "grid", "dose-combs"}}};
  // No printer: what an option is of is looked at before.
  for (const std::string& kind : kinds) {
    for (const auto& [option, some] : of) {
      SCOPED_TRACE(kind + " " + option);
      const RunResult r = call({"testpart", kind, "--printer", "nobody", "-o", "x.uvj", option});
      EXPECT_EQ(r.exit_code, 2);
      const std::string name = option.substr(0, option.find('='));
      EXPECT_THAT(r.err, some.contains(kind)
                             ? HasSubstr("no printer 'nobody'")
                             : HasSubstr(name + ": a part '" + kind + "' does not take it"));
    }
  }
}

TEST_F(FilmsProgram, FormatsThatThePrinterDoesNotReadAreRefused) {
  const auto printer = [&](const std::string& reads) {
    write("dark.toml",
          "name = \"dark\"\n" + reads +
              "[display]\nwidth_px = 700\nheight_px = 500\npixel_um = 50.0\nmirror = \"x\"\n"
              "[blue]\ncalibration = \"to be measured\"\n");
  };
  printer("reads = [\".ctb\", \".prz\"]\n");
  for (const char* kind : {"films", "levels", "f"}) {
    bad(2, {"testpart", kind, "--printer", "dark.toml", "-o", "x.goo"},
        {"x.goo", "the format goo", "reads .ctb, .prz"});
    EXPECT_FALSE(std::filesystem::exists(folder_ / "x.html"));
  }
  // UVJ is converted; another name of a format that it reads does.
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.uvj"});
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.prz"});
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.dat", "--format", "goo"});
  bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "films.dat", "--format", "sl1"},
      {"the format sl1"});
  printer("");
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.goo"});
  for (const char* wrong :
       {"reads = \".ctb\"\n", "reads = []\n", "reads = [\"ctb\"]\n", "reads = [5]\n"}) {
    printer(wrong);
    bad(2, {"testpart", "films", "--printer", "dark.toml", "-o", "films.ctb"},
        {"dark.toml", "reads"});
  }
}

// Heights of a file whose settings stay are kept: test parts take them, and others are refused.
TEST_F(FilmsProgram, HeightsAreThoseOfTheTemplate) {
  write("dark.toml",
        "name = \"dark\"\n[display]\nwidth_px = 700\nheight_px = 500\npixel_um = 50.0\nmirror = "
        "\"x\"\n[blue]\ncalibration = \"to be measured\"\n");
  good({"testpart", "films", "--printer", "dark.toml", "-o", "old.goo", "--layer-um", "30"});
  good({"testpart", "films", "--printer", "dark.toml", "-o", "films.goo", "--template", "old.goo"});
  EXPECT_EQ(StackReader::read_info(folder_ / "films.goo").grid.layer_um, 30);
  for (const char* kind : {"films", "levels", "f", "spread"}) {
    SCOPED_TRACE(kind);
    bad(2,
        {"testpart", kind, "--printer", "dark.toml", "-o", "x.goo", "--template", "old.goo",
         "--layer-um", "50"},
        {"old.goo", "layer 0 is 30 um high, that of the part 50 um"});
    EXPECT_FALSE(std::filesystem::exists(folder_ / "x.goo"));
  }
  good({"testpart", "levels", "--printer", "dark.toml", "-o", "new.uvj"});
  EXPECT_EQ(StackReader::read_info(folder_ / "new.uvj").grid.layer_um, 50);
}

TEST_F(FilmsProgram, FilesOfRealSlicersKeepAllButTheirLayers) {
  if (const std::string why = lacks(real_file("slices/binary")); !why.empty()) GTEST_SKIP() << why;
  const std::vector<std::pair<const char*, const char*>> pairs = {
      {"longer-orange-10", "uv3dp_microsupports3.lgs"},
      {"anycubic-photon", "pfe_smilie.v1.photon"},
      {"elegoo-mars", "mariner_pyramid.v3.ctb"},
      {"anycubic-photon-mono", "msla_photon_mono.v515.pwmo.gz"},
      {"elegoo-saturn", "msla_saturn.v4.ctb"},
      {"creality-halot-one-plus", "msla_halot_one_plus.v3.cxdlp.gz"},
      {"elegoo-mars-4-max", "msla_mars4max.goo.gz"}};
  // The first of them are small.
  const std::size_t count = by_night() ? pairs.size() : 3;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string file = pairs[i].second;
    const std::string printer = fmt::format("{}/{}.toml", SLICECORR_PRINTERS_DIR, pairs[i].first);
    SCOPED_TRACE(printer);
    std::string path = folder_ / file;
    if (path.ends_with(".gz")) path.resize(path.size() - 3);
    write_file(path, real_print_file(file));
    const std::string out = "films" + std::filesystem::path(path).extension().string();
    good({"testpart", "films", "--printer", printer, "-o", out, "--template", path});
    shows_its_table(out);
    for (const char* ending : {".csv", ".html"}) {
      std::filesystem::remove(folder_ / ("films" + std::string(ending)));
    }
  }
}

}  // namespace
}  // namespace slicecorr::test
