// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the wall of the C interface makes of each exception. Compiled in, because the shared library
// does not show it.
#include "c_api/guard.cpp"  // NOLINT(bugprone-suspicious-include)

#include <gtest/gtest.h>

#include <filesystem>

namespace slicecorr::c_api {
namespace {

template <class Thrown>
slicecorr_status status_of(const Thrown& thrown, std::string* own = nullptr) {
  return guarded(own, [&] { throw thrown; });
}

TEST(Guard, EveryExceptionHasItsCode) {
  EXPECT_EQ(status_of(InputError("a.uvj", "line 3", "wrong")), SLICECORR_BAD_INPUT);
  EXPECT_STREQ(slicecorr_error_text(), "a.uvj: line 3: wrong");
  EXPECT_EQ(status_of(InfeasibleError("too fast")), SLICECORR_INFEASIBLE);
  EXPECT_EQ(status_of(DeviceError("full")), SLICECORR_DEVICE);
  EXPECT_EQ(status_of(Cancelled()), SLICECORR_CANCELLED);
  EXPECT_EQ(status_of(Missed("too much")), SLICECORR_MISSED);
  EXPECT_EQ(status_of(BadCall("NULL")), SLICECORR_BAD_CALL);
  EXPECT_EQ(status_of(UnknownName("what?")), SLICECORR_UNKNOWN_NAME);
  EXPECT_EQ(status_of(std::filesystem::filesystem_error("gone", std::error_code())),
            SLICECORR_DEVICE);
  EXPECT_EQ(status_of(std::bad_alloc()), SLICECORR_DEVICE);
  EXPECT_STREQ(slicecorr_error_text(), "out of memory");
  EXPECT_EQ(status_of(std::logic_error("a defect")), SLICECORR_DEFECT);
  EXPECT_STREQ(slicecorr_error_text(), "a defect of the program: a defect");
  EXPECT_EQ(status_of(Error("a plain error")), SLICECORR_DEFECT);
  EXPECT_EQ(status_of(42), SLICECORR_DEFECT);
  EXPECT_EQ(guarded(nullptr, [] {}), SLICECORR_OK);
  EXPECT_STREQ(slicecorr_error_text(), "");
}

TEST(Guard, TextsGoToTheHandleToo) {
  std::string own;
  const std::string text(100000, 'x');
  EXPECT_EQ(status_of(InputError(text), &own), SLICECORR_BAD_INPUT);
  EXPECT_EQ(own, text);
  EXPECT_EQ(slicecorr_error_text(), text);
  EXPECT_EQ(guarded(&own, [] {}), SLICECORR_OK);
  EXPECT_EQ(own, "");
}

}  // namespace
}  // namespace slicecorr::c_api
