/// Runs the tests of an executable, tells which skipped and why, and fails for a skip where all
/// must run: SLICECORR_REQUIRE_ALL=1. The few that may skip even then are in tests/may_skip.txt.
#include <gmock/gmock.h>

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

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  auto* judge = new SkipJudge;  // owned by the list
  testing::UnitTest::GetInstance()->listeners().Append(judge);
  const int result = RUN_ALL_TESTS();
  return result != 0 ? result : judge->refused() ? 1 : 0;
}
