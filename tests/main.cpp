// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Runs the tests of an executable, tells which skipped and why, and fails for a skip where all
/// must run: SLICECORR_REQUIRE_ALL=1. The few that may skip even then are in tests/may_skip.txt.
/// A filter that no test matches fails, too.
/// SLICECORR_TEST_TIMES=FILE: what each test costs is appended to FILE.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace {

/// Patterns of reasons, as in tests/may_skip.txt: a line each, `#` begins a comment.
std::vector<std::string> permitted_reasons() {
  std::ifstream file(SLICECORR_SOURCE_DIR "/tests/may_skip.txt");
  std::vector<std::string> reasons;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty() && line[0] != '#') reasons.push_back(line);
  }
  return reasons;
}

class SkipJudge : public testing::EmptyTestEventListener {
 public:
  bool refused() const { return refused_; }

 private:
  void OnTestPartResult(const testing::TestPartResult& result) override {
    if (result.skipped()) reason_ = result.message();
  }
  void OnTestEnd(const testing::TestInfo& test) override {
    if (!test.result()->Skipped()) return;
    const bool fails = required_ && !permitted();
    std::printf("%s %s.%s: %s\n", fails ? "MUST NOT SKIP" : "skipped", test.test_suite_name(),
                test.name(), reason_.c_str());
    refused_ = refused_ || fails;
  }
  bool permitted() const {
    for (const std::string& r : reasons_) {
      if (reason_.find(r) != std::string::npos) return true;
    }
    return false;
  }

  const bool required_ = [] {
    const char* value = std::getenv("SLICECORR_REQUIRE_ALL");
    return value != nullptr && std::string(value) == "1";
  }();
  const std::vector<std::string> reasons_ = permitted_reasons();
  std::string reason_;
  bool refused_ = false;
};

/// Processor time of this process and of the programs it has waited for.
double processor_s() {
  double sum_s = 0;
  for (const int who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage used{};
    getrusage(who, &used);
    for (const timeval& t : {used.ru_utime, used.ru_stime}) {
      sum_s += static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    }
  }
  return sum_s;
}

/// A line per test: processor time and time by the clock in seconds, and the test's name; a line
/// per suite for what is set up for all its tests together.
class Times : public testing::EmptyTestEventListener {
 public:
  explicit Times(const char* path)
      : file_(open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666)) {}

 private:
  using Clock = std::chrono::steady_clock;

  void OnTestSuiteStart(const testing::TestSuite& /*suite*/) override { begin(); }
  void OnTestStart(const testing::TestInfo& test) override {
    const testing::TestSuite* suite = testing::UnitTest::GetInstance()->current_test_suite();
    if (suite != suite_) end(std::string(test.test_suite_name()) + " (set up)");
    suite_ = suite;
    begin();
  }
  void OnTestEnd(const testing::TestInfo& test) override {
    end(std::string(test.test_suite_name()) + "." + test.name());
  }

  void begin() {
    processor_s_ = processor_s();
    clock_ = Clock::now();
  }
  /// One write, so that lines of executables that run beside each other stay whole.
  void end(const std::string& name) const {
    const std::chrono::duration<double> passed = Clock::now() - clock_;
    char line[512];
    const int length = std::snprintf(line, sizeof line, "%9.3f %9.3f %s\n",
                                     processor_s() - processor_s_, passed.count(), name.c_str());
    const auto size = std::min(static_cast<std::size_t>(length), sizeof line - 1);
    if (write(file_, line, size) < 0) std::perror("SLICECORR_TEST_TIMES");
  }

  const int file_;
  const testing::TestSuite* suite_ = nullptr;
  double processor_s_ = 0;
  Clock::time_point clock_;
};

}  // namespace

int main(int argc, char** argv) {
  // Hundreds of tests, each with images of its own: what one frees, the next takes, and the kernel
  // need not clear it anew. A third of the time of those that read archives.
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  testing::InitGoogleMock(&argc, argv);
  auto* judge = new SkipJudge;  // owned by the list
  testing::UnitTest::GetInstance()->listeners().Append(judge);
  if (const char* times = std::getenv("SLICECORR_TEST_TIMES")) {
    testing::UnitTest::GetInstance()->listeners().Append(new Times(times));
  }
  const int result = RUN_ALL_TESTS();
  if (result != 0 || GTEST_FLAG_GET(list_tests)) return result;
  if (testing::UnitTest::GetInstance()->test_to_run_count() == 0) {
    std::fprintf(stderr, "no test matches '%s'\n", GTEST_FLAG_GET(filter).c_str());
    return 1;
  }
  return judge->refused() ? 1 : 0;
}
