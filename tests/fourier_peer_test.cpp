// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Transforms of planes against FFTW's, at the sizes of displays.
#include <fftw3.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <random>
#include <vector>

#include "fourier/fft.hpp"

namespace slicecorr::detail {
namespace {

using Complex = std::complex<double>;

std::vector<Complex> noise(std::size_t points) {
  std::mt19937 random(1);
  std::vector<Complex> plane(points);
  for (Complex& p : plane) {
    const double real = random() / 4294967296.0 - 0.5;
    p = {real, random() / 4294967296.0 - 0.5};
  }
  return plane;
}

template <class A, class B>
double relative_error(const std::vector<A>& a, const std::vector<B>& b) {
  double difference = 0, all = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference += std::norm(Complex(a[i]) - Complex(b[i]));
    all += std::norm(Complex(b[i]));
  }
  return std::sqrt(difference / all);
}

TEST(FourierPeer, PlanesAreThoseOfFftw) {
  // Displays, a prime, and one with a large prime factor.
  for (const auto& [rows, columns] :
       {std::pair<int, int>{1080, 1920}, {1024, 1280}, {127, 64}, {2 * 109, 270}}) {
    const std::size_t points = static_cast<std::size_t>(rows) * columns;
    std::vector<Complex> plane = noise(points), expected(points);
    fftw_plan plan = fftw_plan_dft_2d(rows, columns, reinterpret_cast<fftw_complex*>(plane.data()),
                                      reinterpret_cast<fftw_complex*>(expected.data()),
                                      FFTW_BACKWARD, FFTW_ESTIMATE);
    fftw_execute(plan);
    fftw_destroy_plan(plan);
    std::vector<std::complex<float>> single(plane.begin(), plane.end());
    PlaneFft<double>(rows, columns).transform({}, plane.data(), Way::backward, Scale::plain);
    PlaneFft<float>(rows, columns).transform({}, single.data(), Way::backward, Scale::plain);
    // As tests/fourier_test.cpp derives: epsilon pi sqrt(4 ln n), fivefold.
    const double steps = 5 * 3.15 * std::sqrt(1 + 4 * std::log(static_cast<double>(points)));
    EXPECT_LT(relative_error(plane, expected), steps * 2.3e-16) << columns << " x " << rows;
    EXPECT_LT(relative_error(single, expected), steps * 1.2e-7) << columns << " x " << rows;
  }
}

TEST(FourierPeer, CosinesAreThoseOfFftw) {
  const int rows = 180, columns = 322;
  const std::size_t points = static_cast<std::size_t>(rows) * columns;
  const std::vector<Complex> random = noise(points);
  std::vector<double> plane(points), expected(points);
  for (std::size_t i = 0; i < points; ++i) plane[i] = random[i].real();
  const std::vector<double> before = plane;
  fftw_plan plan = fftw_plan_r2r_2d(rows, columns, plane.data(), expected.data(), FFTW_REDFT10,
                                    FFTW_REDFT10, FFTW_ESTIMATE);
  fftw_execute(plan);
  fftw_destroy_plan(plan);
  // FFTW's are 2 sum x cos; orthonormal ones have sqrt(2 / n) for that 2, sqrt(1 / n) at 0.
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      expected[static_cast<std::size_t>(y) * columns + x] *=
          std::sqrt((y == 0 ? 0.25 : 0.5) / rows) * std::sqrt((x == 0 ? 0.25 : 0.5) / columns);
    }
  }
  plane = before;
  PlaneDct<double>(rows, columns).transform({}, plane.data(), Way::forward);
  EXPECT_LT(relative_error(plane, expected), 5e-15);
}

}  // namespace
}  // namespace slicecorr::detail
