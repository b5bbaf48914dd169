// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Transforms of planes against their sums, and against what must hold of them.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <vector>

#include "fourier/fft.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

template <class Real>
std::vector<std::complex<Real>> random_plane(std::size_t points, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::complex<Real>> plane(points);
  // Of the generator itself, so that the numbers are the same everywhere.
  const auto next = [&] { return static_cast<Real>(random() / 4294967296.0 - 0.5); };
  for (auto& p : plane) {
    const Real real = next();
    p = {real, next()};
  }
  return plane;
}

/// The transform of a line as its definition says, in long double.
template <class Real>
std::vector<std::complex<Real>> by_sum(const std::vector<std::complex<Real>>& in, int sign) {
  const std::size_t n = in.size();
  std::vector<std::complex<Real>> out(n);
  for (std::size_t k = 0; k < n; ++k) {
    std::complex<long double> sum = 0;
    for (std::size_t x = 0; x < n; ++x) {
      const long double angle = sign * 2 * std::numbers::pi_v<long double> * (k * x % n) / n;
      sum += std::complex<long double>(in[x]) * std::polar<long double>(1, angle);
    }
    out[k] = std::complex<Real>(sum);
  }
  return out;
}

/// RMS of the difference over RMS of `b`.
template <class T>
double relative_error(const std::vector<T>& a, const std::vector<T>& b) {
  double difference = 0, all = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference += std::norm(std::complex<double>(a[i]) - std::complex<double>(b[i]));
    all += std::norm(std::complex<double>(b[i]));
  }
  return std::sqrt(difference / all);
}

// Each step of a transform rounds to half a unit in the last place, and angles of KissFFT are
// rounded to within pi of them; some 4 ln n steps add up as a random walk. Bluestein's three
// transforms are of twice the length. Five of those is what nothing correct comes near, while one
// wrong factor is an error of the order of 1.
template <class Real>
double bound(std::size_t n) {
  return 5 * std::numeric_limits<Real>::epsilon() * std::numbers::pi *
         std::sqrt(1 + 4 * std::log(static_cast<double>(n)));
}

template <class Real>
class Transforms : public testing::Test {};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(Transforms, Reals);

TYPED_TEST(Transforms, LinesAreTheirSumsAtEveryLength) {
  std::vector<std::size_t> lengths;
  for (std::size_t n = 1; n <= 64; ++n) lengths.push_back(n);
  for (const std::size_t n : {97, 128, 2 * 53, 3 * 47, 211, 270, 480}) lengths.push_back(n);
  for (const std::size_t n : lengths) {
    for (const Way way : {Way::forward, Way::backward}) {
      const auto line = random_plane<TypeParam>(n, static_cast<unsigned>(n));
      const auto expected = by_sum(line, way == Way::forward ? -1 : 1);
      auto row = line, column = line;
      PlaneFft<TypeParam>(1, n).transform({}, row.data(), way, Scale::plain);
      PlaneFft<TypeParam>(n, 1).transform({}, column.data(), way, Scale::plain);
      EXPECT_LT(relative_error(row, expected), bound<TypeParam>(n)) << n;
      EXPECT_LT(relative_error(column, expected), bound<TypeParam>(n)) << n;
    }
  }
}

TYPED_TEST(Transforms, APlaneIsTheSumOverBothAxes) {
  const std::size_t rows = 21, columns = 34;
  const auto plane = random_plane<TypeParam>(rows * columns, 1);
  std::vector<std::complex<TypeParam>> expected(rows * columns);
  for (std::size_t ky = 0; ky < rows; ++ky) {
    for (std::size_t kx = 0; kx < columns; ++kx) {
      std::complex<double> sum = 0;
      for (std::size_t y = 0; y < rows; ++y) {
        for (std::size_t x = 0; x < columns; ++x) {
          const double turns = static_cast<double>(ky * y % rows) / rows +
                               static_cast<double>(kx * x % columns) / columns;
          sum += std::complex<double>(plane[y * columns + x]) *
                 std::polar(1.0, -2 * std::numbers::pi * turns);
        }
      }
      expected[ky * columns + kx] = std::complex<TypeParam>(sum);
    }
  }
  auto got = plane;
  PlaneFft<TypeParam>(rows, columns).transform({}, got.data(), Way::forward, Scale::plain);
  EXPECT_LT(relative_error(got, expected), bound<TypeParam>(rows * columns));
}

TYPED_TEST(Transforms, UnitaryOnesKeepThePowerAndComeBack) {
  for (const auto& [rows, columns] : {std::pair<std::size_t, std::size_t>{108, 192}, {59, 45}}) {
    const auto plane = random_plane<TypeParam>(rows * columns, 2);
    const PlaneFft<TypeParam> fft(rows, columns);
    auto got = plane;
    fft.transform({}, got.data(), Way::forward, Scale::unitary);
    double before = 0, after = 0;
    for (std::size_t i = 0; i < plane.size(); ++i) {
      before += std::norm(std::complex<double>(plane[i]));
      after += std::norm(std::complex<double>(got[i]));
    }
    EXPECT_NEAR(after / before, 1, 2 * bound<TypeParam>(rows * columns));
    fft.transform({}, got.data(), Way::backward, Scale::unitary);
    EXPECT_LT(relative_error(got, plane), 2 * bound<TypeParam>(rows * columns));
  }
}

TYPED_TEST(Transforms, LinesThatAreNotWantedStay) {
  const std::size_t rows = 40, columns = 37;
  const auto plane = random_plane<TypeParam>(rows * columns, 3);
  const PlaneFft<TypeParam> fft(rows, columns);
  std::vector<std::uint8_t> some_rows(rows), some_columns(columns);
  for (std::size_t y = 0; y < rows; ++y) some_rows[y] = y % 3 == 1;
  for (std::size_t x = 0; x < columns; ++x) some_columns[x] = x % 5 < 2;
  auto all = plane, some = plane;
  fft.along_rows({}, all.data(), Way::forward, TypeParam(0.5));
  fft.along_rows({}, some.data(), Way::forward, TypeParam(0.5), some_rows.data());
  for (std::size_t i = 0; i < plane.size(); ++i) {
    ASSERT_EQ(some[i], some_rows[i / columns] != 0 ? all[i] : plane[i]);
  }
  all = some = plane;
  fft.along_columns({}, all.data(), Way::backward, TypeParam(0.5));
  fft.along_columns({}, some.data(), Way::backward, TypeParam(0.5), some_columns.data());
  for (std::size_t i = 0; i < plane.size(); ++i) {
    ASSERT_EQ(some[i], some_columns[i % columns] != 0 ? all[i] : plane[i]);
  }
}

TYPED_TEST(Transforms, ThreadsDoNotChangeABit) {
  const std::size_t rows = 135, columns = 94;  // 94 = 2 * 47
  const PlaneFft<TypeParam> fft(rows, columns);
  const PlaneDct<TypeParam> dct(rows, columns);
  const auto plane = random_plane<TypeParam>(rows * columns, 4);
  std::vector<TypeParam> real(rows * columns);
  for (std::size_t i = 0; i < real.size(); ++i) real[i] = plane[i].real();
  auto fourier = plane;
  auto cosine = real;
  ExecutionContext one;
  one.threads = 1;
  fft.transform(one, fourier.data(), Way::forward, Scale::unitary);
  dct.transform(one, cosine.data(), Way::forward);
  for (const int threads : {2, 3, 8}) {
    ExecutionContext many;
    many.threads = threads;
    auto again = plane;
    auto real_again = real;
    fft.transform(many, again.data(), Way::forward, Scale::unitary);
    dct.transform(many, real_again.data(), Way::forward);
    EXPECT_EQ(again, fourier) << threads;
    EXPECT_EQ(real_again, cosine) << threads;
  }
}

TYPED_TEST(Transforms, CosinesAreTheirSumsAtEveryLength) {
  for (std::size_t n = 1; n <= 50; ++n) {
    const std::size_t rows = n, columns = n == 25 ? 94 : 51 - n;
    const auto random = random_plane<TypeParam>(rows * columns, static_cast<unsigned>(n));
    std::vector<TypeParam> plane(rows * columns);
    for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = random[i].real();
    const auto mode = [](std::size_t k, std::size_t x, std::size_t length) {
      const double l = static_cast<double>(length);
      return std::sqrt((k == 0 ? 1 : 2) / l) *
             std::cos(std::numbers::pi * static_cast<double>(k * (2 * x + 1) % (4 * length)) /
                      (2 * l));
    };
    std::vector<double> along(rows * columns);
    std::vector<TypeParam> expected(rows * columns);
    for (std::size_t y = 0; y < rows; ++y) {
      for (std::size_t k = 0; k < columns; ++k) {
        double sum = 0;
        for (std::size_t x = 0; x < columns; ++x)
          sum += plane[y * columns + x] * mode(k, x, columns);
        along[y * columns + k] = sum;
      }
    }
    for (std::size_t x = 0; x < columns; ++x) {
      for (std::size_t k = 0; k < rows; ++k) {
        double sum = 0;
        for (std::size_t y = 0; y < rows; ++y) sum += along[y * columns + x] * mode(k, y, rows);
        expected[k * columns + x] = static_cast<TypeParam>(sum);
      }
    }
    auto got = plane;
    const PlaneDct<TypeParam> dct(rows, columns);
    dct.transform({}, got.data(), Way::forward);
    EXPECT_LT(relative_error(got, expected), 2 * bound<TypeParam>(rows * columns)) << n;
    dct.transform({}, got.data(), Way::backward);
    EXPECT_LT(relative_error(got, plane), 3 * bound<TypeParam>(rows * columns)) << n;
  }
}

TEST(Transforms, RefuseNothingAndStopWhenAsked) {
  EXPECT_THROW(PlaneFft<float>(0, 4), InputError);
  EXPECT_THROW(PlaneFft<double>(4, 0), InputError);
  EXPECT_THROW(PlaneDct<float>(0, 1), InputError);
  const std::atomic<bool> cancel{true};
  ExecutionContext context;
  context.cancel = &cancel;
  std::vector<std::complex<float>> plane(64 * 64);
  EXPECT_THROW(PlaneFft<float>(64, 64).transform(context, plane.data(), Way::forward, Scale::plain),
               Cancelled);
}

}  // namespace
}  // namespace slicecorr::detail
