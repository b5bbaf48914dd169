// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The Python module on top of the C interface: tests/c_abi_python.py, a class of it at a time.
#include <gtest/gtest.h>

#include <filesystem>

#include "run_program.hpp"

namespace slicecorr::test {
namespace {

/// Debian's interpreter: the one that its packages python3-numpy and python3-scipy serve.
constexpr const char* kPython = "/usr/bin/python3";

void expect_passes(const std::string& name, const std::string& needed) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "the sanitizer's library must be loaded first";
  RunOptions options;
  options.environment = {{"PYTHONPATH", SLICECORR_PYTHON_MODULES},
                         {"SLICECORR_BIN", SLICECORR_BIN_DIR},
                         {"SLICECORR_SOURCE", SLICECORR_SOURCE_DIR}};
  const RunResult r = run_program(
      {kPython, "-W", "error", SLICECORR_SOURCE_DIR "/tests/c_abi_python.py", name}, options);
  const std::string missing = "no Python with " + needed;
  if (!std::filesystem::exists(kPython)) GTEST_SKIP() << missing;
  // Asked only where it did not pass: to import them takes as long as many a test.
  if (r.exit_code != 0 && run_program({kPython, "-c", "import " + needed}).exit_code != 0) {
    GTEST_SKIP() << missing;
  }
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  // That tests were found.
  EXPECT_NE(r.err.find("\nOK\n"), std::string::npos) << r.err;
  EXPECT_EQ(r.err.find("Ran 0 tests"), std::string::npos) << r.err;
}

TEST(CAbiPython, Operators) { expect_passes("Operators", "numpy"); }
TEST(CAbiPython, SciPyTakesTheOperators) { expect_passes("SciPy", "scipy"); }
TEST(CAbiPython, Jobs) { expect_passes("Jobs", "numpy"); }
TEST(CAbiPython, Archives) { expect_passes("Archives", "numpy"); }
TEST(CAbiPython, Scans) { expect_passes("Scans", "numpy"); }
TEST(CAbiPython, Module) { expect_passes("Module", "numpy"); }
TEST(CAbiPython, Documents) { expect_passes("Documents", "scipy"); }

}  // namespace
}  // namespace slicecorr::test
