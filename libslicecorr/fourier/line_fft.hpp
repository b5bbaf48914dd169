// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Fourier transforms of single lines, by KissFFT.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <kissfft/kissfft.hh>
#include <numbers>
#include <optional>
#include <vector>

#include "fourier/fft.hpp"

namespace slicecorr::detail {

/// Points of a plane that make a thread worth while.
inline constexpr std::size_t kPointsAThread = 10000;

/// KissFFT takes as many steps per point as the sum of a length's prime factors. From this factor on
/// it is cheaper to transform twice at a friendly length (lines of 32 p: dearer with p = 23, less
/// than half with p = 31).
inline constexpr std::size_t kLargePrime = 29;

inline std::size_t largest_prime_factor(std::size_t n) {
  std::size_t largest = 1;
  for (std::size_t p = 2; p * p <= n; ++p) {
    while (n % p == 0) {
      largest = p;
      n /= p;
    }
  }
  return n > 1 ? n : largest;
}

/// The least length from `n` on with no prime factor above 5.
inline std::size_t friendly_length(std::size_t n) {
  while (largest_prime_factor(n) > 5) ++n;
  return n;
}

/// One length, one direction. A copy for each thread: KissFFT keeps scratch inside.
template <class Real>
class LineFft {
 public:
  using Complex = std::complex<Real>;

  LineFft(std::size_t n, Way way) : n_(n) {
    const bool backward = way == Way::backward;
    if (largest_prime_factor(n) < kLargePrime) {
      direct_.emplace(n, backward);
      return;
    }
    // Bluestein: k x = (k^2 + x^2 - (k - x)^2) / 2 makes the sum a convolution, of any length from
    // 2 n - 1 on.
    m_ = friendly_length(2 * n - 1);
    there_.emplace(m_, false);
    back_.emplace(m_, true);
    chirp_.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
      // k^2 modulo 2 n, so that the angle keeps its digits.
      const double angle =
          std::numbers::pi * static_cast<double>(k * k % (2 * n)) / static_cast<double>(n);
      chirp_[k] = Complex(std::polar(1.0, backward ? angle : -angle));
    }
    std::vector<Complex> kernel(m_);
    for (std::size_t k = 0; k < n; ++k) {
      kernel[k] = kernel[(m_ - k) % m_] = std::conj(chirp_[k]) / static_cast<Real>(m_);
    }
    spectrum_.resize(m_);
    there_->transform(kernel.data(), spectrum_.data());
    padded_.resize(m_);
    product_.resize(m_);
  }

  /// The bare sums; `in` and `out` apart.
  void transform(const Complex* in, Complex* out) {
    if (direct_) {
      direct_->transform(in, out);
      return;
    }
    std::fill(padded_.begin(), padded_.end(), Complex());
    for (std::size_t i = 0; i < n_; ++i) padded_[i] = in[i] * chirp_[i];
    there_->transform(padded_.data(), product_.data());
    for (std::size_t i = 0; i < m_; ++i) product_[i] *= spectrum_[i];
    back_->transform(product_.data(), padded_.data());
    for (std::size_t i = 0; i < n_; ++i) out[i] = padded_[i] * chirp_[i];
  }

 private:
  std::size_t n_, m_ = 0;
  std::optional<kissfft<Real>> direct_, there_, back_;
  std::vector<Complex> chirp_, spectrum_, padded_, product_;
};

}  // namespace slicecorr::detail
