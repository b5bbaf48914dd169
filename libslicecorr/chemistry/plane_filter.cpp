#include "chemistry/plane_filter.hpp"

#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/FFT>

#include "parallel/silent.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kPi = 3.14159265358979323846;
using Complex = std::complex<double>;

std::size_t index(int x, int y, int nx) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x);
}

/// Rows first, then columns, each in a line of its own.
void transform(std::vector<Complex>& waves, int nx, int ny, bool back,
               const ExecutionContext& context) {
  const auto line = [&](std::vector<Complex>& in, std::vector<Complex>& out, int n) {
    thread_local Eigen::FFT<double> fft;
    if (back) {
      fft.inv(out.data(), in.data(), n);
    } else {
      fft.fwd(out.data(), in.data(), n);
    }
  };
  parallel_for(context, "waves", static_cast<std::size_t>(ny), [&](std::size_t y) {
    std::vector<Complex> in(
        waves.begin() + static_cast<std::ptrdiff_t>(index(0, static_cast<int>(y), nx)),
        waves.begin() + static_cast<std::ptrdiff_t>(index(0, static_cast<int>(y) + 1, nx)));
    std::vector<Complex> out(in.size());
    line(in, out, nx);
    std::copy(out.begin(), out.end(),
              waves.begin() + static_cast<std::ptrdiff_t>(index(0, static_cast<int>(y), nx)));
  });
  parallel_for(context, "waves", static_cast<std::size_t>(nx), [&](std::size_t x) {
    std::vector<Complex> in(static_cast<std::size_t>(ny)), out(in.size());
    for (int y = 0; y < ny; ++y)
      in[static_cast<std::size_t>(y)] = waves[index(static_cast<int>(x), y, nx)];
    line(in, out, ny);
    for (int y = 0; y < ny; ++y)
      waves[index(static_cast<int>(x), y, nx)] = out[static_cast<std::size_t>(y)];
  });
}

}  // namespace

PlaneFilter::PlaneFilter(int width, int height, Sides sides)
    : width_(width),
      height_(height),
      walls_(sides == Sides::walls),
      nx_(walls_ ? 2 * width : width),
      ny_(walls_ ? 2 * height : height) {}

void PlaneFilter::set(const std::function<double(double, double)>& of) {
  factor_.resize(index(0, ny_, nx_));
  for (int y = 0; y < ny_; ++y) {
    const double ty = 2 * kPi * std::min(y, ny_ - y) / ny_;
    for (int x = 0; x < nx_; ++x) {
      factor_[index(x, y, nx_)] = of(2 * kPi * std::min(x, nx_ - x) / nx_, ty);
    }
  }
}

void PlaneFilter::apply(std::vector<double>& field, const ExecutionContext& context) {
  waves_.resize(factor_.size());
  for (int y = 0; y < ny_; ++y) {
    const int from_y = y < height_ ? y : ny_ - 1 - y;
    for (int x = 0; x < nx_; ++x) {
      const int from_x = x < width_ ? x : nx_ - 1 - x;
      waves_[index(x, y, nx_)] = field[index(from_x, from_y, width_)];
    }
  }
  const ExecutionContext quiet = silent(context);
  transform(waves_, nx_, ny_, false, quiet);
  for (std::size_t k = 0; k < waves_.size(); ++k) waves_[k] *= factor_[k];
  transform(waves_, nx_, ny_, true, quiet);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) field[index(x, y, width_)] = waves_[index(x, y, nx_)].real();
  }
}

}  // namespace slicecorr::detail
