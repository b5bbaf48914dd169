// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Fourier and cosine transforms of planes of any size, on all threads, with the same bits for any
/// number of them. KissFFT does the lines; here are planes, threads, scales, and lengths with large
/// prime factors.
#pragma once

#include <complex>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// The sign of the exponent: forward sum_x f(x) e^(-2 pi i k x / n), backward with e^(+...).
enum class Way { forward, backward };

/// `plain` is the bare sum, so that forward and backward give rows * columns times what there was;
/// `unitary` divides each by sqrt(rows * columns), which keeps the power.
enum class Scale { plain, unitary };

/// Transforms of planes of `rows` x `columns` complex numbers, row by row, in place. The origin is
/// element 0 on both sides, as everywhere but in optics. Immutable: any number of threads may use
/// one object at once. `Real` is float (relative error some 3e-7 RMS) or double (1e-15).
template <class Real>
class PlaneFft {
 public:
  using Complex = std::complex<Real>;

  /// @throws InputError unless both are 1 or more.
  PlaneFft(std::size_t rows, std::size_t columns);
  ~PlaneFft();
  PlaneFft(PlaneFft&&) noexcept;
  PlaneFft& operator=(PlaneFft&&) noexcept;

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }

  /// Both passes. @throws Cancelled.
  void transform(const ExecutionContext& context, Complex* plane, Way way, Scale scale) const;

  /// One pass alone, along rows or along columns, for planes that are dark in many of them: those
  /// whose entry of `wanted` is 0 stay as they are. Null means all. `factor` is multiplied in.
  void along_rows(const ExecutionContext& context, Complex* plane, Way way, Real factor,
                  const std::uint8_t* wanted = nullptr) const;
  void along_columns(const ExecutionContext& context, Complex* plane, Way way, Real factor,
                     const std::uint8_t* wanted = nullptr) const;

 private:
  struct Lines;
  std::size_t rows_, columns_;
  std::unique_ptr<Lines> lines_;
};

/// Cosine transforms of planes of `rows` x `columns` real numbers, in place, orthonormal: their
/// basis is cos(pi k (x + 1/2) / n), the modes of a plane through whose edges nothing flows.
/// `forward` is the DCT-II, `backward` its inverse, the DCT-III. Immutable as `PlaneFft` is.
template <class Real>
class PlaneDct {
 public:
  /// @throws InputError unless both are 1 or more.
  PlaneDct(std::size_t rows, std::size_t columns);
  ~PlaneDct();
  PlaneDct(PlaneDct&&) noexcept;
  PlaneDct& operator=(PlaneDct&&) noexcept;

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }

  /// @throws Cancelled.
  void transform(const ExecutionContext& context, Real* plane, Way way) const;

 private:
  struct Lines;
  std::size_t rows_, columns_;
  std::unique_ptr<Lines> lines_;
};

}  // namespace slicecorr::detail
