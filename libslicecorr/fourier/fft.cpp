// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fourier/fft.hpp"

#include <fmt/format.h>

#include <array>

#include "fourier/line_fft.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

/// Rows that a thread takes at once: enough that copying the tables costs little.
constexpr std::size_t kRows = 16;
/// Columns at once: a cache line of float.
constexpr std::size_t kColumns = 8;

std::size_t blocks_of(std::size_t count, std::size_t size) { return (count + size - 1) / size; }

void check_size(std::size_t rows, std::size_t columns) {
  if (rows >= 1 && columns >= 1) return;
  throw InputError(fmt::format(
      "a plane of {} x {} has nothing to transform; expected 1 x 1 or more", columns, rows));
}

}  // namespace

template <class Real>
struct PlaneFft<Real>::Lines {
  // By way: forward, backward.
  std::array<LineFft<Real>, 2> rows, columns;
};

template <class Real>
PlaneFft<Real>::PlaneFft(std::size_t rows, std::size_t columns) : rows_(rows), columns_(columns) {
  check_size(rows, columns);
  using Line = LineFft<Real>;
  lines_.reset(new Lines{{Line(columns, Way::forward), Line(columns, Way::backward)},
                         {Line(rows, Way::forward), Line(rows, Way::backward)}});
}
template <class Real>
PlaneFft<Real>::~PlaneFft() = default;
template <class Real>
PlaneFft<Real>::PlaneFft(PlaneFft&&) noexcept = default;
template <class Real>
PlaneFft<Real>& PlaneFft<Real>::operator=(PlaneFft&&) noexcept = default;

template <class Real>
void PlaneFft<Real>::transform(const ExecutionContext& context, Complex* plane, Way way,
                               Scale scale) const {
  const double points = static_cast<double>(rows_) * static_cast<double>(columns_);
  along_rows(context, plane, way,
             scale == Scale::plain ? Real(1) : static_cast<Real>(1 / std::sqrt(points)));
  along_columns(context, plane, way, 1);
}

template <class Real>
void PlaneFft<Real>::along_rows(const ExecutionContext& context, Complex* plane, Way way,
                                Real factor, const std::uint8_t* wanted) const {
  const LineFft<Real>& table = lines_->rows[way == Way::backward];
  const ExecutionContext worth = silent(context, rows_ * columns_, kPointsAThread);
  parallel_for(worth, "", blocks_of(rows_, kRows), [&](std::size_t b) {
    LineFft<Real> line = table;
    std::vector<Complex> in(columns_);
    for (std::size_t y = b * kRows; y < std::min(rows_, (b + 1) * kRows); ++y) {
      if (wanted != nullptr && wanted[y] == 0) continue;
      Complex* row = plane + y * columns_;
      for (std::size_t x = 0; x < columns_; ++x) in[x] = row[x] * factor;
      line.transform(in.data(), row);
    }
  });
}

template <class Real>
void PlaneFft<Real>::along_columns(const ExecutionContext& context, Complex* plane, Way way,
                                   Real factor, const std::uint8_t* wanted) const {
  const LineFft<Real>& table = lines_->columns[way == Way::backward];
  const ExecutionContext worth = silent(context, rows_ * columns_, kPointsAThread);
  parallel_for(worth, "", blocks_of(columns_, kColumns), [&](std::size_t b) {
    const std::size_t first = b * kColumns, count = std::min(kColumns, columns_ - first);
    std::array<std::size_t, kColumns> those{};
    std::size_t n = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (wanted == nullptr || wanted[first + i] != 0) those[n++] = i;
    }
    if (n == 0) return;
    LineFft<Real> line = table;
    std::vector<Complex> in(n * rows_), out(n * rows_);
    for (std::size_t y = 0; y < rows_; ++y) {
      const Complex* from = plane + y * columns_ + first;
      for (std::size_t i = 0; i < n; ++i) in[i * rows_ + y] = from[those[i]] * factor;
    }
    for (std::size_t i = 0; i < n; ++i) line.transform(&in[i * rows_], &out[i * rows_]);
    for (std::size_t y = 0; y < rows_; ++y) {
      Complex* to = plane + y * columns_ + first;
      for (std::size_t i = 0; i < n; ++i) to[those[i]] = out[i * rows_ + y];
    }
  });
}

template class PlaneFft<float>;
template class PlaneFft<double>;

}  // namespace slicecorr::detail
