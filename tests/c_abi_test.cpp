// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The C interface as a contract: header, symbols, codes, texts, NULL, structs, names.
#include "c_abi.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <regex>
#include <set>

#include "run_program.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::test {
namespace {

const std::string kHeader = SLICECORR_SOURCE_DIR "/libslicecorr/include/slicecorr.h";

std::set<std::string> declared_functions() {
  const std::string text = to_text(read_file(kHeader));
  const std::regex function(R"(SLICECORR_API [^;{]*?\b(slicecorr_\w+)\()");
  std::set<std::string> names;
  for (std::sregex_iterator it(text.begin(), text.end(), function), end; it != end; ++it) {
    names.insert((*it)[1]);
  }
  return names;
}

TEST(CAbi, HeaderIsC99AndCpp) {
  for (const std::vector<std::string>& language :
       {std::vector<std::string>{SLICECORR_C_COMPILER, "-std=c99", "-x", "c"},
        {SLICECORR_CXX_COMPILER, "-std=c++11", "-x", "c++"}}) {
    std::vector<std::string> command = language;
    command.insert(command.begin() + 1,
                   {"-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-fsyntax-only"});
    command.push_back(kHeader);
    const RunResult r = run_program(command);
    EXPECT_EQ(r.exit_code, 0) << language[1] << "\n" << r.err;
  }
}

TEST(CAbi, ShowsTheDeclaredFunctionsWithTheirVersionAndNothingElse) {
  const RunResult r = run_program({SLICECORR_NM, "-D", "--defined-only", SLICECORR_C_LIBRARY});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  std::istringstream lines(r.out);
  std::set<std::string> shown;
  const std::regex symbol(R"([0-9a-f]+ (\w) (\S+?)(@@SLICECORR_0\.1)?)");
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    ASSERT_TRUE(std::regex_match(line, match, symbol)) << line;
    if (match[1] == "A" && match[2] == "SLICECORR_0.1") continue;
    EXPECT_EQ(match[1], "T") << line;
    EXPECT_TRUE(match[3].matched) << line;
    shown.insert(match[2]);
  }
  EXPECT_GT(shown.size(), 30U);
  EXPECT_EQ(shown, declared_functions());
}

TEST(CAbi, SaysItsVersion) {
  EXPECT_STREQ(slicecorr_version(), version);
  EXPECT_EQ(slicecorr_abi_version(), SLICECORR_ABI_VERSION);
}

TEST(CAbi, CodesAreThoseOfThePrograms) {
  EXPECT_EQ(SLICECORR_OK, 0);
  EXPECT_EQ(SLICECORR_DEFECT, 1);
  EXPECT_EQ(SLICECORR_BAD_INPUT, 2);
  EXPECT_EQ(SLICECORR_INFEASIBLE, 3);
  EXPECT_EQ(SLICECORR_DEVICE, 4);
  EXPECT_EQ(SLICECORR_MISSED, 5);
  EXPECT_EQ(SLICECORR_CANCELLED, 130);
  std::set<std::string> texts;
  for (const int code : {0, 1, 2, 3, 4, 5, 130, 200, 201, 77}) {
    texts.insert(slicecorr_status_text(code));
  }
  EXPECT_EQ(texts.size(), 10U);
}

// Layouts are part of the interface: programs are built with them.
TEST(CAbi, StructsKeepTheirLayout) {
  EXPECT_EQ(sizeof(slicecorr_grid), sizeof(size_t) + 16 + 24);
  EXPECT_EQ(offsetof(slicecorr_grid, width_px), sizeof(size_t));
  EXPECT_EQ(offsetof(slicecorr_grid, pixel_x_um), sizeof(size_t) + 16);
  EXPECT_EQ(sizeof(slicecorr_summary), sizeof(size_t) + 6 * 8 + 4 * 8);
  EXPECT_EQ(offsetof(slicecorr_summary, target_voxels), sizeof(size_t));
  EXPECT_EQ(offsetof(slicecorr_summary, iou), sizeof(size_t) + 48);
}

TEST(CAbi, NothingIsFreedWithoutHarm) {
  slicecorr_setup_free(nullptr);
  slicecorr_job_free(nullptr);
  slicecorr_stack_free(nullptr);
  slicecorr_figures_free(nullptr);
  slicecorr_list_free(nullptr);
  slicecorr_job_cancel(nullptr);
  EXPECT_STREQ(slicecorr_setup_error_text(nullptr), "");
  EXPECT_STREQ(slicecorr_job_error_text(nullptr), "");
  EXPECT_EQ(slicecorr_stack_text(nullptr, "path"), nullptr);
  EXPECT_EQ(slicecorr_figures_json(nullptr), nullptr);
  EXPECT_EQ(slicecorr_list_count(nullptr), 0U);
  EXPECT_EQ(slicecorr_list_name(nullptr, 0), nullptr);
  EXPECT_EQ(slicecorr_list_text(nullptr, 0), nullptr);
}

int any_source(void*, int, uint8_t*) { return 0; }
int any_sink(void*, int, int, const uint8_t*) { return 0; }

TEST(CAbi, PlansAndSaysHowSureAPrintIs) {
  const TemporaryFolder folder;
  const std::string printer = printer_toml(96, 64), path = folder / "target.uvj";
  write_ladder(path, printer);
  const SetupHandle setup = c_setup(ladder_settings(printer));
  slicecorr_setup* const s = setup.get();
  StackHandle stack = open_stack(path);
  const auto set = [&](const char* name, const char* value) {
    EXPECT_EQ(slicecorr_setup_set_text(s, name, value), SLICECORR_OK) << slicecorr_error_text();
  };
  // How sure.
  set("uncertain", "ha=3%,dc=2%");
  FiguresHandle figures;
  ASSERT_EQ(slicecorr_predict(stack.get(), s, nullptr, out(figures)), SLICECORR_OK)
      << slicecorr_error_text();
  double value = 0;
  EXPECT_EQ(slicecorr_figures_number(figures.get(), "height_error_um.band95.0", &value),
            SLICECORR_OK)
      << slicecorr_error_text();
  set("uncertain", "ha=99%");
  EXPECT_EQ(slicecorr_predict(stack.get(), s, nullptr, out(figures)), SLICECORR_BAD_INPUT);
  set("uncertain", "");
  set("robust", "on");
  EXPECT_EQ(slicecorr_predict(stack.get(), s, nullptr, out(figures)), SLICECORR_BAD_INPUT);
  set("robust", "");
  // How fast.
  EXPECT_EQ(slicecorr_plan(stack.get(), s, nullptr, out(figures)), SLICECORR_BAD_INPUT);
  EXPECT_NE(std::string(slicecorr_error_text()).find("speed_mm_h"), std::string::npos);
  set("speed_mm_h", "");
  set("tolerance_um", "30");
  ASSERT_EQ(slicecorr_plan(stack.get(), s, nullptr, out(figures)), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(slicecorr_figures_number(figures.get(), "speed_mm_h", &value), SLICECORR_OK);
  EXPECT_GT(value, 1);
  EXPECT_EQ(slicecorr_figures_number(figures.get(), "curve.0.max_abs_um", &value), SLICECORR_OK)
      << slicecorr_error_text();
  slicecorr_summary summary{};
  summary.struct_size = sizeof summary;
  EXPECT_EQ(slicecorr_figures_summary(figures.get(), &summary), SLICECORR_BAD_CALL);
  set("gap_contrast", "0.9");
  EXPECT_EQ(slicecorr_plan(stack.get(), s, nullptr, out(figures)), SLICECORR_INFEASIBLE);
}

/// Calls with one argument missing at a time, the others as good as they can be.
TEST(CAbi, NullIsABadCallThatNamesTheArgument) {
  const TemporaryFolder folder;
  const std::string printer = printer_toml(96, 64), path = folder / "target.uvj";
  write_ladder(path, printer);
  const SetupHandle setup = c_setup(ladder_settings(printer));
  StackHandle stack = open_stack(path);
  const JobHandle job(slicecorr_job_new());
  FiguresHandle figures;
  ASSERT_EQ(slicecorr_predict(stack.get(), setup.get(), job.get(), out(figures)), SLICECORR_OK)
      << slicecorr_error_text();
  const slicecorr_grid grid{sizeof grid, 96, 64, 3, 0, 50, 50, 50};
  slicecorr_summary summary{};
  slicecorr_stack* new_stack = nullptr;
  slicecorr_figures* new_figures = nullptr;
  double value = 0;
  size_t count = 0;
  uint8_t pixels[96 * 64] = {};
  const std::string made = folder / "made.uvj";
  const auto bad = [](slicecorr_status status, const std::string& argument) {
    EXPECT_EQ(status, SLICECORR_BAD_CALL) << argument;
    EXPECT_EQ(slicecorr_error_text(), argument + " is NULL");
  };
  slicecorr_setup* const s = setup.get();
  slicecorr_stack* const t = stack.get();
  slicecorr_job* const j = job.get();

  bad(slicecorr_list_new(nullptr, nullptr), "list");
  slicecorr_list* list = nullptr;
  bad(slicecorr_list_new(nullptr, &list), "kind");
  bad(slicecorr_setup_set_text(nullptr, "resin", "x"), "setup");
  bad(slicecorr_setup_set_text(s, nullptr, "x"), "name");
  bad(slicecorr_setup_set_number(nullptr, "speed_mm_h", 1), "setup");
  bad(slicecorr_setup_set_number(s, nullptr, 1), "name");
  bad(slicecorr_setup_set_numbers(nullptr, "layer_exposure_s", &value, 1), "setup");
  bad(slicecorr_setup_set_numbers(s, nullptr, &value, 1), "name");
  bad(slicecorr_setup_set_numbers(s, "layer_exposure_s", nullptr, 1), "values");
  bad(slicecorr_job_set_threads(nullptr, 1), "job");
  bad(slicecorr_job_set_progress(nullptr, nullptr, nullptr), "job");
  bad(slicecorr_job_set_notice(nullptr, nullptr, nullptr), "job");
  bad(slicecorr_job_set_scratch_folder(nullptr, "/tmp"), "job");
  bad(slicecorr_job_reset(nullptr), "job");
  bad(slicecorr_stack_open(path.c_str(), nullptr), "stack");
  bad(slicecorr_stack_open(nullptr, &new_stack), "path");
  bad(slicecorr_stack_create(&grid, nullptr), "stack");
  bad(slicecorr_stack_create(nullptr, &new_stack), "grid");
  bad(slicecorr_stack_put(nullptr, 0, pixels, 96), "stack");
  bad(slicecorr_stack_get(nullptr, 0, pixels, 96), "stack");
  bad(slicecorr_stack_load(nullptr, j), "stack");
  bad(slicecorr_stack_set_number(nullptr, "layer_um", 50), "stack");
  bad(slicecorr_stack_set_number(t, nullptr, 50), "name");
  bad(slicecorr_stack_set_doses(nullptr, t, 2, nullptr), "target");
  bad(slicecorr_stack_number(nullptr, "layers", &value), "stack");
  bad(slicecorr_stack_number(t, nullptr, &value), "name");
  bad(slicecorr_stack_number(t, "layers", nullptr), "value");
  bad(slicecorr_stack_numbers(nullptr, "layer_exposure_s", &value, 1, &count), "stack");
  bad(slicecorr_stack_numbers(t, nullptr, &value, 1, &count), "name");
  bad(slicecorr_stack_numbers(t, "layer_exposure_s", nullptr, 1, &count), "values");
  bad(slicecorr_stack_numbers(t, "layer_exposure_s", &value, 1, nullptr), "count");
  EXPECT_EQ(slicecorr_stack_text(t, nullptr), nullptr);
  bad(slicecorr_figures_summary(nullptr, &summary), "figures");
  bad(slicecorr_figures_summary(figures.get(), nullptr), "summary");
  bad(slicecorr_figures_number(nullptr, "iou", &value), "figures");
  bad(slicecorr_figures_number(figures.get(), nullptr, &value), "name");
  bad(slicecorr_figures_number(figures.get(), "iou", nullptr), "value");
  bad(slicecorr_figures_require(nullptr, "iou", 1), "figures");
  bad(slicecorr_figures_require(figures.get(), nullptr, 1), "name");
  bad(slicecorr_check(nullptr, s, j), "target");
  bad(slicecorr_check(t, nullptr, j), "setup");
  bad(slicecorr_correct(nullptr, s, made.c_str(), j, nullptr, nullptr), "target");
  bad(slicecorr_correct(t, nullptr, made.c_str(), j, nullptr, nullptr), "setup");
  bad(slicecorr_correct(t, s, nullptr, j, nullptr, nullptr), "path");
  bad(slicecorr_correct_in_memory(nullptr, s, j, &new_stack, nullptr), "target");
  bad(slicecorr_correct_in_memory(t, nullptr, j, &new_stack, nullptr), "setup");
  bad(slicecorr_correct_in_memory(t, s, j, nullptr, nullptr), "corrected");
  bad(slicecorr_correct_slices(nullptr, any_source, nullptr, s, j, any_sink, nullptr, nullptr),
      "grid");
  bad(slicecorr_correct_slices(&grid, nullptr, nullptr, s, j, any_sink, nullptr, nullptr),
      "source");
  bad(slicecorr_correct_slices(&grid, any_source, nullptr, s, j, nullptr, nullptr, nullptr),
      "sink");
  bad(slicecorr_correct_slices(&grid, any_source, nullptr, nullptr, j, any_sink, nullptr, nullptr),
      "setup");
  bad(slicecorr_verify(nullptr, t, s, j, &new_figures), "stack");
  bad(slicecorr_verify(t, nullptr, s, j, &new_figures), "target");
  bad(slicecorr_verify(t, t, s, j, nullptr), "figures");
  bad(slicecorr_predict(nullptr, s, j, &new_figures), "target");
  bad(slicecorr_predict(t, nullptr, j, &new_figures), "setup");
  bad(slicecorr_predict(t, s, j, nullptr), "figures");
  bad(slicecorr_scan_compare(nullptr, t, s, j, &new_figures), "scan");
  bad(slicecorr_scan_compare("scan.stl", nullptr, s, j, &new_figures), "stack");
  bad(slicecorr_scan_compare("scan.stl", t, s, j, nullptr), "figures");
  const char* const scans[] = {"scan.stl", nullptr};
  bad(slicecorr_tune_scans(nullptr, 1, t, s, j, &new_figures), "scans");
  EXPECT_EQ(slicecorr_tune_scans(scans, 0, t, s, j, &new_figures), SLICECORR_BAD_CALL);
  bad(slicecorr_tune_scans(scans, 2, t, s, j, &new_figures), "scans");
  bad(slicecorr_tune_scans(scans, 1, nullptr, s, j, &new_figures), "stack");
  bad(slicecorr_tune_scans(scans, 1, t, nullptr, j, &new_figures), "setup");
  bad(slicecorr_tune_scans(scans, 1, t, s, j, nullptr), "figures");
  bad(slicecorr_plan(nullptr, s, j, &new_figures), "target");
  bad(slicecorr_plan(t, nullptr, j, &new_figures), "setup");
  bad(slicecorr_plan(t, s, j, nullptr), "figures");
  bad(slicecorr_convert(nullptr, made.c_str(), j), "stack");
  bad(slicecorr_convert(t, nullptr, j), "path");

  const StackHandle in_memory = [&] {
    StackHandle h;
    EXPECT_EQ(slicecorr_stack_create(&grid, out(h)), SLICECORR_OK);
    return h;
  }();
  bad(slicecorr_stack_put(in_memory.get(), 0, nullptr, 96), "pixels");
  bad(slicecorr_stack_get(in_memory.get(), 0, nullptr, 96), "pixels");
  EXPECT_EQ(new_stack, nullptr);
  EXPECT_EQ(new_figures, nullptr);
  EXPECT_EQ(folder.count(), 1);
}

TEST(CAbi, AFailureEmptiesOutputsAndKeepsItsTextPerHandle) {
  const SetupHandle setup(slicecorr_setup_new());
  const JobHandle job(slicecorr_job_new());
  EXPECT_EQ(slicecorr_setup_set_number(setup.get(), "speed_mm_h", -1), SLICECORR_BAD_INPUT);
  const std::string of_setup = slicecorr_setup_error_text(setup.get());
  EXPECT_EQ(of_setup, "speed_mm_h is -1; expected a number above 0");
  EXPECT_EQ(of_setup, slicecorr_error_text());
  EXPECT_EQ(slicecorr_job_set_threads(job.get(), -1), SLICECORR_BAD_INPUT);
  EXPECT_NE(std::string(slicecorr_job_error_text(job.get())).find("threads is -1"),
            std::string::npos);
  EXPECT_EQ(slicecorr_setup_error_text(setup.get()), of_setup);

  const JobHandle something(slicecorr_job_new());
  auto* stack = reinterpret_cast<slicecorr_stack*>(something.get());
  EXPECT_EQ(slicecorr_stack_open("/no/such/archive.uvj", &stack), SLICECORR_BAD_INPUT);
  EXPECT_EQ(stack, nullptr);
  EXPECT_NE(std::string(slicecorr_error_text()).find("/no/such/archive.uvj"), std::string::npos);

  // The next good call takes the texts back.
  EXPECT_EQ(slicecorr_setup_set_number(setup.get(), "speed_mm_h", 800), SLICECORR_OK);
  EXPECT_STREQ(slicecorr_setup_error_text(setup.get()), "");
  EXPECT_STREQ(slicecorr_error_text(), "");
}

TEST(CAbi, StructSizesDecide) {
  slicecorr_stack* made = nullptr;
  slicecorr_grid grid{sizeof grid, 96, 64, 3, 0, 50, 50, 50};
  for (const size_t size : {size_t{0}, sizeof grid - 1, std::numeric_limits<size_t>::max()}) {
    grid.struct_size = size;
    EXPECT_EQ(slicecorr_stack_create(&grid, &made), SLICECORR_BAD_CALL) << size;
    EXPECT_NE(std::string(slicecorr_error_text()).find("slicecorr_grid.struct_size"),
              std::string::npos);
  }
  // A program built with a later header: what it does not use is 0.
  struct Later {
    slicecorr_grid grid;
    double more[4];
  } later{{sizeof(Later), 96, 64, 3, 0, 50, 50, 50}, {}};
  StackHandle stack;
  EXPECT_EQ(slicecorr_stack_create(&later.grid, out(stack)), SLICECORR_OK)
      << slicecorr_error_text();
  later.more[3] = 1;
  EXPECT_EQ(slicecorr_stack_create(&later.grid, &made), SLICECORR_BAD_CALL);
  grid.struct_size = sizeof grid;
  grid.reserved = 1;
  EXPECT_EQ(slicecorr_stack_create(&grid, &made), SLICECORR_BAD_CALL);
  EXPECT_EQ(made, nullptr);
}

TEST(CAbi, SummariesFillWhatTheCallerHasRoomFor) {
  const TemporaryFolder folder;
  const std::string printer = printer_toml(96, 64);
  write_ladder(folder / "target.uvj", printer);
  const StackHandle stack = open_stack(folder / "target.uvj");
  const SetupHandle setup = c_setup(ladder_settings(printer));
  FiguresHandle figures;
  ASSERT_EQ(slicecorr_predict(stack.get(), setup.get(), nullptr, out(figures)), SLICECORR_OK);
  struct Later {
    slicecorr_summary summary;
    uint64_t more[2];
    uint64_t behind;
  } later;
  std::memset(&later, 0xAB, sizeof later);
  later.summary.struct_size = offsetof(Later, behind);
  ASSERT_EQ(slicecorr_figures_summary(figures.get(), &later.summary), SLICECORR_OK);
  EXPECT_EQ(later.summary.struct_size, offsetof(Later, behind));
  EXPECT_GT(later.summary.target_voxels, 0U);
  EXPECT_EQ(later.more[0], 0U);
  EXPECT_EQ(later.more[1], 0U);
  EXPECT_EQ(later.behind, 0xABABABABABABABABU);
  for (const size_t size : {size_t{0}, sizeof(slicecorr_summary) - 1, size_t{1} << 20}) {
    later.summary.struct_size = size;
    EXPECT_EQ(slicecorr_figures_summary(figures.get(), &later.summary), SLICECORR_BAD_CALL);
  }
}

TEST(CAbi, GridsOutOfRangeAreNamed) {
  const slicecorr_grid good{sizeof good, 96, 64, 3, 0, 50, 50, 50};
  const auto bad = [&](const char* name, auto change) {
    slicecorr_grid grid = good;
    change(grid);
    slicecorr_stack* made = nullptr;
    EXPECT_EQ(slicecorr_stack_create(&grid, &made), SLICECORR_BAD_INPUT) << name;
    EXPECT_EQ(std::string(slicecorr_error_text()).rfind(name, 0), 0U) << slicecorr_error_text();
    EXPECT_EQ(made, nullptr);
  };
  const double nan = std::nan("");
  bad("width_px", [](slicecorr_grid& g) { g.width_px = 0; });
  bad("width_px", [](slicecorr_grid& g) { g.width_px = 65537; });
  bad("height_px", [](slicecorr_grid& g) { g.height_px = -1; });
  bad("layers", [](slicecorr_grid& g) { g.layers = 1000001; });
  bad("pixel_x_um", [&](slicecorr_grid& g) { g.pixel_x_um = nan; });
  bad("pixel_y_um", [](slicecorr_grid& g) { g.pixel_y_um = 0; });
  bad("layer_um", [](slicecorr_grid& g) { g.layer_um = 1e9; });
}

TEST(CAbi, SettingsAreCheckedAndTakenBack) {
  const SetupHandle setup(slicecorr_setup_new());
  slicecorr_setup* const s = setup.get();
  const auto text = [&](const char* name, const char* value, slicecorr_status expected) {
    EXPECT_EQ(slicecorr_setup_set_text(s, name, value), expected)
        << name << " " << value << ": " << slicecorr_error_text();
  };
  const auto number = [&](const char* name, double value, slicecorr_status expected) {
    EXPECT_EQ(slicecorr_setup_set_number(s, name, value), expected)
        << name << " " << value << ": " << slicecorr_error_text();
  };
  text("no_such", "1", SLICECORR_UNKNOWN_NAME);
  EXPECT_NE(std::string(slicecorr_error_text()).find("speed_mm_h"), std::string::npos);
  number("speed-mm-h", 1, SLICECORR_UNKNOWN_NAME);
  text("speed_mm_h", "800.5", SLICECORR_OK);
  for (const char* wrong : {"800,5", "800 ", " 800", "8x", "0", "-3", "inf", "nan", "1e999"}) {
    text("speed_mm_h", wrong, SLICECORR_BAD_INPUT);
  }
  text("speed_mm_h", "", SLICECORR_OK);
  text("speed_mm_h", nullptr, SLICECORR_OK);
  number("speed_mm_h", std::nan(""), SLICECORR_OK);
  number("speed_mm_h", std::numeric_limits<double>::infinity(), SLICECORR_BAD_INPUT);
  number("bottom_layers", 3, SLICECORR_OK);
  number("bottom_layers", 0, SLICECORR_OK);
  number("bottom_layers", 2.5, SLICECORR_BAD_INPUT);
  number("bottom_layers", -1, SLICECORR_BAD_INPUT);
  number("bottom_layers", 1e7, SLICECORR_BAD_INPUT);
  text("omega_max", "inf", SLICECORR_OK);
  text("omega_max", "2.5", SLICECORR_OK);
  number("omega_max", std::numeric_limits<double>::infinity(), SLICECORR_OK);
  number("omega_max", 0.5, SLICECORR_BAD_INPUT);
  text("mode", "layerwise", SLICECORR_OK);
  text("mode", "Layerwise", SLICECORR_BAD_INPUT);
  EXPECT_STREQ(slicecorr_error_text(),
               "mode is 'Layerwise'; expected one of continuous, layerwise");
  number("mode", 1, SLICECORR_BAD_CALL);
  const double times[] = {8, 2.5};
  EXPECT_EQ(slicecorr_setup_set_numbers(s, "layer_exposure_s", times, 2), SLICECORR_OK);
  EXPECT_EQ(slicecorr_setup_set_numbers(s, "layer_exposure_s", nullptr, 0), SLICECORR_OK);
  EXPECT_EQ(slicecorr_setup_set_numbers(s, "speed_mm_h", times, 2), SLICECORR_BAD_CALL);
  const double wrong[] = {8, 0};
  EXPECT_EQ(slicecorr_setup_set_numbers(s, "layer_exposure_s", wrong, 2), SLICECORR_BAD_INPUT);
}

TEST(CAbi, ListsNameWhatThereIs) {
  const auto names = [](const char* kind) {
    ListHandle list;
    EXPECT_EQ(slicecorr_list_new(kind, out(list)), SLICECORR_OK) << slicecorr_error_text();
    std::set<std::string> found;
    for (size_t i = 0; i < slicecorr_list_count(list.get()); ++i) {
      found.insert(slicecorr_list_name(list.get(), i));
      EXPECT_NE(slicecorr_list_text(list.get(), i), nullptr);
    }
    EXPECT_EQ(slicecorr_list_name(list.get(), slicecorr_list_count(list.get())), nullptr);
    EXPECT_EQ(slicecorr_list_text(list.get(), SIZE_MAX), nullptr);
    return found;
  };
  EXPECT_EQ(names("printer").count("dual-wavelength-dlp"), 1U);
  EXPECT_EQ(names("resin").count("figure-2-2"), 1U);
  EXPECT_EQ(names("format").count("uvj"), 1U);
  for (const char* name :
       {"height_error_um.max_abs", "height_error_um.exchanged.mean_abs", "joints.least",
        "joints.not_holding_voxels", "joints.films", "joints.liquid_layers_max"}) {
    EXPECT_EQ(names("figure").count(name), 1U) << name;
  }
  EXPECT_EQ(names("property").count("layer_um"), 1U);
  slicecorr_list* list = nullptr;
  EXPECT_EQ(slicecorr_list_new("colours", &list), SLICECORR_UNKNOWN_NAME);
  EXPECT_EQ(list, nullptr);

  // Every setting can be set by its name, and stands in the header, or in the table that it names.
  const std::string text = to_text(read_file(kHeader)),
                    table =
                        to_text(read_file(std::string(SLICECORR_SOURCE_DIR) + "/docs/settings.md"));
  const SetupHandle setup(slicecorr_setup_new());
  for (const std::string& name : names("setting")) {
    EXPECT_EQ(slicecorr_setup_set_text(setup.get(), name.c_str(), nullptr), SLICECORR_OK) << name;
    EXPECT_NE((text + table).find(name), std::string::npos) << name;
  }
  for (const std::string& name : names("property")) {
    EXPECT_NE(text.find(name), std::string::npos) << name;
  }
}

TEST(CAbi, FiguresByNameAreThoseOfTheJson) {
  const TemporaryFolder folder;
  const std::string printer = printer_toml(96, 64);
  write_ladder(folder / "target.uvj", printer);
  const StackHandle stack = open_stack(folder / "target.uvj");
  const SetupHandle setup = c_setup(ladder_settings(printer));
  FiguresHandle figures;
  ASSERT_EQ(slicecorr_predict(stack.get(), setup.get(), nullptr, out(figures)), SLICECORR_OK);
  const StackReader target(folder / "target.uvj", folder.path());
  const Prediction expected = verify_stack(target, target, ladder_setup(printer));
  EXPECT_EQ(slicecorr_figures_json(figures.get()), expected.to_json());
  const auto number = [&](const char* name) {
    double value = -1;
    EXPECT_EQ(slicecorr_figures_number(figures.get(), name, &value), SLICECORR_OK) << name;
    return value;
  };
  EXPECT_EQ(number("cure_through_voxels"), static_cast<double>(expected.cure_through_voxels));
  EXPECT_EQ(number("height_error_um.max_abs"), expected.height_error_um.greatest());
  EXPECT_EQ(number("pixel_um"), 50);
  // A part without grey voxels has no grey dose error.
  EXPECT_EQ(expected.grey_voxels, 0U);
  EXPECT_TRUE(std::isnan(number("grey_dose_error.mean_abs")));
  double value = 0;
  EXPECT_EQ(slicecorr_figures_number(figures.get(), "height_error_um", &value),
            SLICECORR_UNKNOWN_NAME);
  slicecorr_summary s{};
  s.struct_size = sizeof s;
  ASSERT_EQ(slicecorr_figures_summary(figures.get(), &s), SLICECORR_OK);
  EXPECT_EQ(s.target_voxels, expected.target_voxels);
  EXPECT_EQ(s.printed_voxels, expected.printed_voxels);
  EXPECT_EQ(s.cure_through_voxels, expected.cure_through_voxels);
  EXPECT_EQ(s.undercure_voxels, expected.undercure_voxels);
  EXPECT_EQ(s.lost_features, expected.lost_features);
  EXPECT_EQ(s.merged_features, expected.merged_features);
  EXPECT_EQ(s.iou, expected.iou());
  EXPECT_EQ(s.mean_abs_height_error_um, expected.height_error_um.mean());
  EXPECT_EQ(s.p95_abs_height_error_um, expected.height_error_um.quantile(0.95));
  EXPECT_EQ(s.max_abs_height_error_um, expected.height_error_um.greatest());
}

}  // namespace
}  // namespace slicecorr::test
