// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How calls of the C interface run: progress, cancelling, threads, kills, loading at run time, the
// examples and their document.
#include <signal.h>

#include <atomic>
#include <map>
#include <sstream>
#include <thread>

#include "c_abi.hpp"
#include "lattice.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "run_program.hpp"

namespace slicecorr::test {
namespace {

/// Notes what a job tells, and cancels it somewhere.
struct Watcher {
  std::string stop_stage;
  double stop_at = 2;  ///< fraction of that stage
  std::vector<std::pair<std::string, double>> told;
  std::atomic<int> inside{0};

  static int progress(void* user, const char* stage, double fraction) {
    auto& w = *static_cast<Watcher*>(user);
    EXPECT_EQ(w.inside++, 0) << "two callbacks at once";
    w.told.emplace_back(stage, fraction);
    --w.inside;
    return stage == w.stop_stage && fraction >= w.stop_at;
  }
};

class CAbiRun : public ::testing::Test {
 protected:
  CAbiRun() { write_ladder(target_path_, printer_); }

  const TemporaryFolder folder_;
  const std::string printer_ = printer_toml(96, 64);
  const std::string target_path_ = folder_ / "target.uvj";
};

void expect_rising(const std::vector<std::pair<std::string, double>>& told) {
  std::string stage;
  double last = 1;
  for (const auto& [name, fraction] : told) {
    EXPECT_GE(fraction, 0);
    EXPECT_LE(fraction, 1);
    // A stage begins with 0, after the one before it has ended.
    if (name != stage || (last == 1 && fraction == 0)) {
      EXPECT_EQ(fraction, 0) << name;
      EXPECT_EQ(last, 1) << stage;
    } else {
      EXPECT_GE(fraction, last) << name;
    }
    stage = name;
    last = fraction;
  }
  EXPECT_EQ(last, 1) << stage;
}

TEST_F(CAbiRun, ProgressRisesInEachStage) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const StackHandle stack = open_stack(target_path_);
  const JobHandle job(slicecorr_job_new());
  for (const int threads : {1, 4}) {
    ASSERT_EQ(slicecorr_job_set_threads(job.get(), threads), SLICECORR_OK);
    Watcher watcher;
    slicecorr_job_set_progress(job.get(), Watcher::progress, &watcher);
    const auto stages = [&] {
      std::vector<std::string> names;
      for (const auto& [name, fraction] : watcher.told) {
        if (fraction == 0) names.push_back(name);
      }
      expect_rising(watcher.told);
      watcher.told.clear();
      return names;
    };
    ASSERT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), job.get(),
                                nullptr, nullptr),
              SLICECORR_OK);
    EXPECT_EQ(stages(), (std::vector<std::string>{"read", "correct", "write"}));
    StackHandle corrected;
    FiguresHandle figures;
    ASSERT_EQ(slicecorr_correct_in_memory(stack.get(), setup.get(), job.get(), out(corrected),
                                          out(figures)),
              SLICECORR_OK);
    EXPECT_EQ(stages(), (std::vector<std::string>{"read", "correct", "predict"}));
    ASSERT_EQ(slicecorr_verify(corrected.get(), stack.get(), nullptr, job.get(), out(figures)),
              SLICECORR_OK);
    EXPECT_EQ(stages(), (std::vector<std::string>{"read", "predict"}));
  }
}

TEST_F(CAbiRun, CancellingLeavesNothingBehind) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const StackHandle stack = open_stack(target_path_);
  const std::string made = folder_ / "made.uvj";
  const Bytes old = to_bytes("what was there before");
  write_file(made, old);
  for (const auto& [stage, at] : std::vector<std::pair<std::string, double>>{
           {"read", 0}, {"correct", 0}, {"write", 0.3}, {"correct", 1}, {"write", 1}}) {
    SCOPED_TRACE(stage + " " + std::to_string(at));
    const JobHandle job(slicecorr_job_new());
    Watcher watcher;
    watcher.stop_stage = stage;
    watcher.stop_at = at;
    slicecorr_job_set_progress(job.get(), Watcher::progress, &watcher);
    FiguresHandle after, before;
    EXPECT_EQ(slicecorr_correct(stack.get(), setup.get(), made.c_str(), job.get(), out(after),
                                out(before)),
              SLICECORR_CANCELLED);
    EXPECT_STREQ(slicecorr_job_error_text(job.get()), "cancelled");
    EXPECT_EQ(after, nullptr);
    EXPECT_EQ(before, nullptr);
    EXPECT_EQ(read_file(made), old);
    EXPECT_EQ(folder_.count(), 2);
    // In place: the archive is as it was.
    const Bytes archive = read_file(target_path_);
    EXPECT_EQ(slicecorr_job_reset(job.get()), SLICECORR_OK);
    EXPECT_EQ(slicecorr_correct(stack.get(), setup.get(), target_path_.c_str(), job.get(), nullptr,
                                nullptr),
              SLICECORR_CANCELLED);
    EXPECT_EQ(read_file(target_path_), archive);
    EXPECT_EQ(folder_.count(), 2);
  }
  for (const char* stage : {"read", "correct", "predict"}) {
    for (const double at : {0.0, 1.0}) {
      const JobHandle job(slicecorr_job_new());
      Watcher watcher;
      watcher.stop_stage = stage;
      watcher.stop_at = at;
      slicecorr_job_set_progress(job.get(), Watcher::progress, &watcher);
      StackHandle corrected;
      FiguresHandle figures;
      EXPECT_EQ(slicecorr_correct_in_memory(stack.get(), setup.get(), job.get(), out(corrected),
                                            out(figures)),
                SLICECORR_CANCELLED)
          << stage << at;
      EXPECT_EQ(corrected, nullptr);
      EXPECT_EQ(figures, nullptr);
    }
  }
}

int cancel_in_source(void* user, int slice, uint8_t* pixels) {
  pixels[0] = 255;
  if (slice == 3) slicecorr_job_cancel(static_cast<slicecorr_job*>(user));
  return 0;
}
int count_slices(void* user, int, int, const uint8_t*) { return ++*static_cast<int*>(user) == 5; }
int throwing_source(void*, int, uint8_t*) { throw 42; }
int throwing_progress(void*, const char*, double) { throw std::runtime_error("not here"); }

TEST_F(CAbiRun, ACancelledJobStaysSoUntilItIsReset) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const StackHandle stack = open_stack(target_path_);
  const JobHandle job(slicecorr_job_new());
  FiguresHandle figures;
  slicecorr_job_cancel(job.get());
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(slicecorr_predict(stack.get(), setup.get(), job.get(), out(figures)),
              SLICECORR_CANCELLED);
  }
  EXPECT_EQ(slicecorr_job_reset(job.get()), SLICECORR_OK);
  EXPECT_EQ(slicecorr_predict(stack.get(), setup.get(), job.get(), out(figures)), SLICECORR_OK)
      << slicecorr_error_text();

  // From another thread, while the call runs: it has begun when it tells of its progress.
  struct Start {
    std::atomic<bool> begun{false}, cancelled{false};
  } start;
  slicecorr_job_set_progress(
      job.get(),
      [](void* user, const char*, double) {
        auto& s = *static_cast<Start*>(user);
        s.begun = true;
        s.begun.notify_all();
        s.cancelled.wait(false);
        return 0;
      },
      &start);
  std::thread other([&] {
    start.begun.wait(false);
    slicecorr_job_cancel(job.get());
    start.cancelled = true;
    start.cancelled.notify_all();
  });
  EXPECT_EQ(slicecorr_predict(stack.get(), setup.get(), job.get(), out(figures)),
            SLICECORR_CANCELLED);
  other.join();
}

TEST_F(CAbiRun, CallbacksOfSlicesCancelAndMayThrow) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const slicecorr_grid grid{sizeof grid, 96, 64, 10, 0, 50, 50, 50};
  const JobHandle job(slicecorr_job_new());
  int slices = 0;
  EXPECT_EQ(slicecorr_correct_slices(&grid, cancel_in_source, job.get(), setup.get(), job.get(),
                                     count_slices, &slices, nullptr),
            SLICECORR_CANCELLED);
  EXPECT_EQ(slices, 0);
  EXPECT_EQ(slicecorr_correct_slices(&grid, cancel_in_source, nullptr, setup.get(), nullptr,
                                     count_slices, &slices, nullptr),
            SLICECORR_CANCELLED);
  EXPECT_EQ(slices, 5);
  EXPECT_EQ(slicecorr_correct_slices(&grid, throwing_source, nullptr, setup.get(), nullptr,
                                     count_slices, &slices, nullptr),
            SLICECORR_BAD_CALL);
  EXPECT_STREQ(slicecorr_error_text(), "a callback threw an exception");
  const StackHandle stack = open_stack(target_path_);
  slicecorr_job_reset(job.get());
  slicecorr_job_set_progress(job.get(), throwing_progress, nullptr);
  EXPECT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), job.get(),
                              nullptr, nullptr),
            SLICECORR_BAD_CALL);
  EXPECT_EQ(folder_.count(), 1);
}

TEST_F(CAbiRun, NoticesAreTold) {
  Settings settings = ladder_settings(printer_);
  settings[1].second = SLICECORR_DB_DIR "/custom-resin-1.toml";
  settings[2].second = "100";
  const SetupHandle setup = c_setup(settings);
  const StackHandle stack = open_stack(target_path_);
  const JobHandle job(slicecorr_job_new());
  std::string told;
  slicecorr_job_set_notice(
      job.get(), [](void* user, const char* text) { *static_cast<std::string*>(user) += text; },
      &told);
  ASSERT_EQ(slicecorr_check(stack.get(), setup.get(), job.get()), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_NE(told.find("counts as off: without uv_mw_cm2"), std::string::npos) << told;
}

TEST_F(CAbiRun, ThreadsWorkSideBySide) {
  const StackHandle shared = open_stack(target_path_);
  ASSERT_EQ(slicecorr_stack_load(shared.get(), nullptr), SLICECORR_OK);
  const SetupHandle shared_setup = c_setup(ladder_settings(printer_));
  const StackReader target(target_path_, folder_.path());
  const slicecorr::Setup setup = ladder_setup(printer_);
  correct_stack(target, setup, folder_ / "expected.uvj", {});
  const Bytes expected = read_file(folder_ / "expected.uvj");
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      const std::string path = folder_ / ("made" + std::to_string(i) + ".uvj");
      const StackHandle own = open_stack(target_path_);
      const SetupHandle own_setup = c_setup(ladder_settings(printer_));
      const JobHandle job(slicecorr_job_new());
      slicecorr_job_set_threads(job.get(), 2);
      for (int round = 0; round < 3; ++round) {
        const bool use_shared = (i + round) % 2 == 0;
        EXPECT_EQ(slicecorr_correct(use_shared ? shared.get() : own.get(),
                                    use_shared ? shared_setup.get() : own_setup.get(), path.c_str(),
                                    job.get(), nullptr, nullptr),
                  SLICECORR_OK)
            << slicecorr_error_text();
        EXPECT_EQ(read_file(path), expected);
        // Errors stay in their thread.
        slicecorr_stack* none = nullptr;
        const std::string missing = "/no/such/" + std::to_string(i) + ".uvj";
        EXPECT_EQ(slicecorr_stack_open(missing.c_str(), &none), SLICECORR_BAD_INPUT);
        EXPECT_EQ(std::string(slicecorr_error_text()).rfind(missing, 0), 0U)
            << slicecorr_error_text();
      }
    });
  }
  for (std::thread& t : threads) t.join();
}

TEST(CAbiPrograms, KilledInPlaceLeavesTheOldArchiveOrTheNew) {
  const TemporaryFolder folder;
  const std::string printer = folder / "printer.toml", part = folder / "part.uvj";
  const std::string printer_text = printer_toml(320, 200);
  write_file(printer, to_bytes(printer_text));
  const MeshSlices slices(lattice(3, 2, 2, 4, 0.7), parse_printer(printer_text, "printer"),
                          SliceOptions{});
  write_target(slices, part);
  const Bytes old = read_file(part);
  const std::string resin = SLICECORR_DB_DIR "/figure-2-2.toml";
  const std::vector<std::string> command = {
      SLICECORR_C_EXAMPLE, part, part, printer, resin, "1000"};
  ASSERT_EQ(run_program(command).exit_code, 0);
  const Bytes corrected = read_file(part);
  ASSERT_NE(corrected, old);

  int killed = 0, kept = 0;
  std::vector<const char*> moments{"read 0 ", "correct 0 ", "write 0 ", "write 6", "write 100 "};
  if (by_night()) {
    moments.insert(moments.end(), {"read 100 ", "correct 100 ", "write 3", "write 9"});
  }
  for (const char* moment : moments) {
    write_file(part, old);
    RunOptions options;
    options.signal = SIGKILL;
    options.signal_when = [&](const std::string&, const std::string& err) {
      return err.find(moment) != std::string::npos;
    };
    const RunResult r = run_program(command, options);
    killed += r.exit_code == 128 + SIGKILL;
    const Bytes now = read_file(part);
    EXPECT_TRUE(now == old || now == corrected) << moment << now.size();
    kept += now == old;
  }
  EXPECT_GT(killed, 0);
  EXPECT_GT(kept, 0);
}

TEST(CAbiPrograms, CanBeLoadedAndUnloadedAgainAndAgain) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "the sanitizer's library must be loaded first";
  const TemporaryFolder folder;
  const std::string printer = folder / "printer.toml", target = folder / "target.uvj";
  write_file(printer, to_bytes(printer_toml(96, 64)));
  write_ladder(target, printer_toml(96, 64));
  const RunResult r = run_program({SLICECORR_DLOPEN_PROGRAM, SLICECORR_C_LIBRARY, target, printer,
                                   SLICECORR_DB_DIR "/figure-2-2.toml", "1000"});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(r.out, "done\n");
}

class CAbiExamples : public ::testing::Test {
 protected:
  CAbiExamples() {
    write_file(folder_ / "printer.toml", to_bytes(printer_toml(96, 64)));
    write_ladder(folder_ / "target.uvj", printer_toml(96, 64));
    const StackReader target(folder_ / "target.uvj", folder_.path());
    const slicecorr::Setup setup = ladder_setup(printer_toml(96, 64));
    error_um_ =
        correct_stack(target, setup, folder_ / "expected.uvj", {}).after.height_error_um.mean();
  }
  void expect_corrects(const std::vector<std::string>& program) {
    const auto call = [&](const std::string& resin) {
      std::vector<std::string> command = program;
      command.insert(command.end(), {folder_ / "target.uvj", folder_ / "made.uvj",
                                     folder_ / "printer.toml", resin, "1000"});
      RunOptions options;
      options.environment = {{"PYTHONPATH", SLICECORR_PYTHON_MODULES}};
      return run_program(command, options);
    };
    RunResult r = call(SLICECORR_DB_DIR "/figure-2-2.toml");
    EXPECT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(read_file(folder_ / "made.uvj"), read_file(folder_ / "expected.uvj"));
    char text[80];
    std::snprintf(text, sizeof text, "mean height error %.2f um", error_um_);
    EXPECT_EQ(r.out.rfind(text, 0), 0U) << r.out;
    r = call("no-such-resin");
    EXPECT_EQ(r.exit_code, SLICECORR_BAD_INPUT);
    EXPECT_NE(r.err.find("no resin 'no-such-resin'"), std::string::npos) << r.err;
  }

  const TemporaryFolder folder_;
  double error_um_ = 0;
};

TEST_F(CAbiExamples, TheOneInCRuns) { expect_corrects({SLICECORR_C_EXAMPLE}); }

TEST_F(CAbiExamples, TheOneInPythonRuns) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "the sanitizer's library must be loaded first";
  const std::string python = "/usr/bin/python3";
  if (!std::filesystem::exists(python)) GTEST_SKIP() << "no Python with ctypes";
  expect_corrects({python, SLICECORR_SOURCE_DIR "/libslicecorr/c_api/examples/correct.py"});
}

TEST_F(CAbiExamples, StandInTheDocumentAsTheyAre) {
  const std::string document = to_text(read_file(SLICECORR_SOURCE_DIR "/docs/c-api.md"));
  const std::string folder = SLICECORR_SOURCE_DIR "/libslicecorr/c_api/examples/";
  for (const auto& [name, language] :
       std::map<std::string, std::string>{{"correct.c", "c"}, {"correct.py", "python"}}) {
    const std::string text = to_text(read_file(folder + name));
    ASSERT_FALSE(text.empty()) << name;
    EXPECT_NE(document.find("```" + language + "\n" + text + "```\n"), std::string::npos) << name;
  }
}

TEST_F(CAbiExamples, TheOneInCIsShort) {
  std::istringstream text(
      to_text(read_file(SLICECORR_SOURCE_DIR "/libslicecorr/c_api/examples/correct.c")));
  int lines = 0;
  for (std::string line; std::getline(text, line);) {
    lines += !line.empty() && line.rfind("/*", 0) != 0;
  }
  EXPECT_GT(lines, 15);
  EXPECT_LE(lines, 30);
}

// An archive that PrusaSlicer wrote, corrected in place: what is not an image stays.
TEST(CAbiRealData, CorrectsAnArchiveOfASlicer) {
  const std::string archive = test::real_file("slices/sl1/layer_change.sl1");
  SLICECORR_NEEDS_FILE(archive);
  const TemporaryFolder folder;
  const std::string path = folder / "part.sl1";
  std::filesystem::copy_file(archive, path);
  const StackHandle stack = open_stack(path);
  ASSERT_NE(stack, nullptr);
  EXPECT_STREQ(slicecorr_stack_text(stack.get(), "format"), "sl1");
  EXPECT_STRNE(slicecorr_stack_text(stack.get(), "material_profile"), "");
  // Dark enough for the archive's own times: 0.1 s, and more in the first layers.
  std::string printer = printer_toml(1440, 2560, "47.25");
  printer.replace(printer.find("[0, 1.0]"), 8, "[0, 0.01]");
  const SetupHandle setup = c_setup({{"printer_toml", printer},
                                     {"resin", SLICECORR_DB_DIR "/figure-2-2.toml"},
                                     {"dc_mj_cm3", "50"},
                                     {"mode", "layerwise"}});
  FiguresHandle after, before;
  ASSERT_EQ(
      slicecorr_correct(stack.get(), setup.get(), path.c_str(), nullptr, out(after), out(before)),
      SLICECORR_OK)
      << slicecorr_error_text();
  slicecorr_summary a{}, b{};
  a.struct_size = b.struct_size = sizeof a;
  ASSERT_EQ(slicecorr_figures_summary(after.get(), &a), SLICECORR_OK);
  ASSERT_EQ(slicecorr_figures_summary(before.get(), &b), SLICECORR_OK);
  EXPECT_LE(a.mean_abs_height_error_um, b.mean_abs_height_error_um);
  EXPECT_LE(a.cure_through_voxels, b.cure_through_voxels);
  const StackHandle corrected = open_stack(path);
  ASSERT_NE(corrected, nullptr);
  EXPECT_STREQ(slicecorr_stack_text(corrected.get(), "kind"), "corrected");
  // The times are the archive's own, so its settings stay as they are.
  const Entries old = unzip(archive);
  Entries now = unzip(path);
  int kept = 0;
  for (const auto& [name, data] : old) {
    if (name.find("thumbnail") == std::string::npos && name != "prusaslicer.ini") continue;
    EXPECT_TRUE(entry(now, name) == data) << name;
    ++kept;
  }
  EXPECT_GE(kept, 2);
}

}  // namespace
}  // namespace slicecorr::test
