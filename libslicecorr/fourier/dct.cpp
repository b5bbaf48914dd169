// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <array>
#include <cmath>
#include <numbers>

#include "fourier/fft.hpp"
#include "fourier/line_fft.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

/// Lines that a thread takes at once; even, because two of them are one complex line.
constexpr std::size_t kLines = 16;

/// Cosine transforms of two lines at once, as the real and the imaginary part of one Fourier
/// transform of their length (J. Makhoul, "A fast cosine transform in one and two dimensions", IEEE
/// Trans. Acoust. Speech Signal Process. 28, 1980): even places in order, then odd ones backwards.
template <class Real>
class LineDct {
 public:
  using Complex = std::complex<Real>;

  explicit LineDct(std::size_t n)
      : n_(n),
        constant_(static_cast<Real>(std::sqrt(0.25 / static_cast<double>(n)))),
        wave_(static_cast<Real>(std::sqrt(0.5 / static_cast<double>(n)))),
        fft_{Line(n, Way::forward), Line(n, Way::backward)} {
    turn_.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
      turn_[k] = Complex(std::polar(
          1.0, -std::numbers::pi * static_cast<double>(k) / (2.0 * static_cast<double>(n))));
    }
    in_.resize(n);
    out_.resize(n);
  }

  void forward(Real* a, Real* b) {
    for (std::size_t i = 0; i < n_; ++i) {
      const std::size_t x = place(i);
      in_[i] = {a[x], b[x]};
    }
    fft_[0].transform(in_.data(), out_.data());
    for (std::size_t k = 0; k < n_; ++k) {
      const Complex z = out_[k], mirrored = std::conj(out_[(n_ - k) % n_]);
      const Complex of_a = (z + mirrored) * turn_[k], of_b = (z - mirrored) * turn_[k];
      a[k] = of_a.real() * scale(k);
      b[k] = of_b.imag() * scale(k);
    }
  }

  void backward(Real* a, Real* b) {
    for (std::size_t k = 0; k < n_; ++k) {
      const std::size_t m = n_ - k;
      const Real norm = scale(k), other = k == 0 ? 0 : scale(m);
      const Complex of_a(a[k] * norm, k == 0 ? 0 : -a[m] * other);
      const Complex of_b(b[k] * norm, k == 0 ? 0 : -b[m] * other);
      in_[k] = std::conj(turn_[k]) * (of_a + Complex(-of_b.imag(), of_b.real()));
      // A constant is one mode, the others are two, of k and n - k.
      if (k == 0) in_[k] *= Real(2);
    }
    fft_[1].transform(in_.data(), out_.data());
    for (std::size_t i = 0; i < n_; ++i) {
      const std::size_t x = place(i);
      a[x] = out_[i].real();
      b[x] = out_[i].imag();
    }
  }

 private:
  using Line = LineFft<Real>;

  std::size_t place(std::size_t i) const { return 2 * i < n_ ? 2 * i : 2 * (n_ - i) - 1; }
  /// Half of the orthonormal factor, because sums above are twice what they should be.
  Real scale(std::size_t k) const { return k == 0 ? constant_ : wave_; }

  std::size_t n_;
  Real constant_, wave_;
  std::array<Line, 2> fft_;
  std::vector<Complex> turn_, in_, out_;
};

template <class Real>
void do_line(LineDct<Real>& line, Real* a, Real* b, Way way) {
  if (way == Way::forward) {
    line.forward(a, b);
  } else {
    line.backward(a, b);
  }
}

}  // namespace

template <class Real>
struct PlaneDct<Real>::Lines {
  LineDct<Real> rows, columns;
};

template <class Real>
PlaneDct<Real>::PlaneDct(std::size_t rows, std::size_t columns) : rows_(rows), columns_(columns) {
  if (rows < 1 || columns < 1) throw InputError("a plane without points has no cosine transform");
  lines_.reset(new Lines{LineDct<Real>(columns), LineDct<Real>(rows)});
}
template <class Real>
PlaneDct<Real>::~PlaneDct() = default;
template <class Real>
PlaneDct<Real>::PlaneDct(PlaneDct&&) noexcept = default;
template <class Real>
PlaneDct<Real>& PlaneDct<Real>::operator=(PlaneDct&&) noexcept = default;

template <class Real>
void PlaneDct<Real>::transform(const ExecutionContext& context, Real* plane, Way way) const {
  const ExecutionContext worth = silent(context, rows_ * columns_, kPointsAThread);
  const std::size_t row_blocks = (rows_ + kLines - 1) / kLines;
  parallel_for(worth, "", row_blocks, [&](std::size_t block) {
    LineDct<Real> line = lines_->rows;
    const std::size_t end = std::min(rows_, (block + 1) * kLines);
    std::vector<Real> nothing(columns_);
    for (std::size_t y = block * kLines; y < end; y += 2) {
      Real* first = plane + y * columns_;
      do_line(line, first, y + 1 < end ? first + columns_ : nothing.data(), way);
    }
  });
  const std::size_t column_blocks = (columns_ + kLines - 1) / kLines;
  parallel_for(worth, "", column_blocks, [&](std::size_t block) {
    LineDct<Real> line = lines_->columns;
    const std::size_t first = block * kLines, count = std::min(kLines, columns_ - first);
    // One more than there may be, so that the last has a partner.
    std::vector<Real> lines((count + 1) * rows_);
    for (std::size_t y = 0; y < rows_; ++y) {
      for (std::size_t i = 0; i < count; ++i)
        lines[i * rows_ + y] = plane[y * columns_ + first + i];
    }
    for (std::size_t i = 0; i < count; i += 2) {
      do_line(line, &lines[i * rows_], &lines[(i + 1) * rows_], way);
    }
    for (std::size_t y = 0; y < rows_; ++y) {
      for (std::size_t i = 0; i < count; ++i)
        plane[y * columns_ + first + i] = lines[i * rows_ + y];
    }
  });
}

template class PlaneDct<float>;
template class PlaneDct<double>;

}  // namespace slicecorr::detail
