// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/even_light.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "slicecorr/error.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr {

namespace {

bool same_bytes(const std::shared_ptr<const std::vector<std::uint8_t>>& a,
                const std::shared_ptr<const std::vector<std::uint8_t>>& b) {
  return a == b || (a && b && *a == *b);
}

}  // namespace

const char* name_of(EvenDeadZone even) {
  constexpr const char* names[] = {"off", "constant", "blue", "uv", "both"};
  return names[static_cast<std::size_t>(even)];
}

std::uint8_t EvenLight::least_blue() const { return *std::min_element(blue->begin(), blue->end()); }
std::uint8_t EvenLight::greatest_blue() const {
  return *std::max_element(blue->begin(), blue->end());
}

bool EvenLight::operator==(const EvenLight& o) const {
  return columns == o.columns && rows == o.rows && pitch_um == o.pitch_um && left_um == o.left_um &&
         top_um == o.top_um && gap_um == o.gap_um && slices == o.slices &&
         same_bytes(blue, o.blue) && same_bytes(uv, o.uv);
}

void check_even_light(const EvenLight& light, const std::string& source) {
  const auto wrong = [&](const char* key, const char* what) {
    throw InputError(source, std::string("even_light.") + key, what);
  };
  const auto cells = [&](int count) { return count >= 1 && count <= EvenLight::kMostCells; };
  if (!cells(light.columns)) wrong("columns", "expected 1 to 4096 cells");
  if (!cells(light.rows)) wrong("rows", "expected 1 to 4096 cells");
  const auto positive = [](double v) { return v > 0 && std::isfinite(v); };
  if (!positive(light.pitch_um)) wrong("pitch_um", "expected a number above 0");
  if (!positive(light.gap_um)) wrong("gap_um", "expected a number above 0");
  if (!std::isfinite(light.left_um)) wrong("left_um", "expected a number");
  if (!std::isfinite(light.top_um)) wrong("top_um", "expected a number");
  if (light.slices.empty() || light.slices.front() < 0 ||
      std::adjacent_find(light.slices.begin(), light.slices.end(), std::greater_equal<>()) !=
          light.slices.end()) {
    wrong("slices", "expected slices that rise");
  }
  const std::size_t values = light.cells() * light.slices.size();
  if (!light.blue || light.blue->size() != values) wrong("blue", "expected a byte for each cell");
  if (light.least_blue() == 0) wrong("blue", "expected light in every cell");
  if (light.uv && light.uv->size() != values) wrong("uv", "expected a byte for each cell");
}

void extend_outwards(std::span<double> values, std::span<const std::uint8_t> known, int columns,
                     int rows) {
  std::vector<std::uint8_t> done(known.begin(), known.end());
  const auto at = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(x);
  };
  struct Found {
    std::size_t cell;
    double value;
  };
  std::vector<Found> next;
  do {
    next.clear();
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        if (done[at(x, y)]) continue;
        double sum = 0;
        int count = 0;
        for (int v = std::max(0, y - 1); v <= std::min(rows - 1, y + 1); ++v) {
          for (int u = std::max(0, x - 1); u <= std::min(columns - 1, x + 1); ++u) {
            if (!done[at(u, v)]) continue;
            sum += values[at(u, v)];
            ++count;
          }
        }
        if (count > 0) next.push_back({at(x, y), sum / count});
      }
    }
    for (const Found& f : next) {
      values[f.cell] = f.value;
      done[f.cell] = 1;
    }
  } while (!next.empty());
}

std::vector<double> slowed(std::vector<double> values, std::span<const int> slices, double step) {
  // Never lower than asked: where light must rise faster than the lamp, it rises earlier.
  for (std::size_t i = values.size(); i-- > 1;) {
    values[i - 1] = std::max(values[i - 1], values[i] - step * (slices[i] - slices[i - 1]));
  }
  for (std::size_t i = 1; i < values.size(); ++i) {
    values[i] = std::max(values[i], values[i - 1] - step * (slices[i] - slices[i - 1]));
  }
  return values;
}

EvenPixels::EvenPixels(const EvenLight& light, const Grid& images)
    : light_(light), pixel_x_um_(images.pixel_x_um), pixel_y_um_(images.pixel_y_um) {}

EvenPixels::Between EvenPixels::between(double at, int cells) const {
  const double whole = std::floor(at);
  if (whole < 0) return {0, 0, 0};
  const auto first = static_cast<std::size_t>(std::min(whole, cells - 1.0));
  const auto last = static_cast<std::size_t>(cells - 1);
  if (first >= last) return {last, last, 0};
  return {first, first + 1, at - whole};
}

EvenPixels::Between EvenPixels::between_slices(int slice) const {
  const std::vector<int>& at = light_.slices;
  const auto after = std::upper_bound(at.begin(), at.end(), slice);
  if (after == at.begin()) return {0, 0, 0};
  const auto first = static_cast<std::size_t>(after - at.begin()) - 1;
  if (after == at.end()) return {first, first, 0};
  return {first, first + 1, static_cast<double>(slice - at[first]) / (*after - at[first])};
}

double EvenPixels::value(const std::vector<std::uint8_t>& bytes, std::size_t slice,
                         const Between& x, const Between& y) const {
  const std::uint8_t* const from = bytes.data() + slice * light_.cells();
  const auto width = static_cast<std::size_t>(light_.columns);
  const auto along = [&](std::size_t row) {
    const double a = from[row * width + x.first], b = from[row * width + x.second];
    return a + x.share * (b - a);
  };
  const double upper = along(y.first);
  return y.share == 0 ? upper : upper + y.share * (along(y.second) - upper);
}

void EvenPixels::blue_of(int x, int y, std::span<std::uint8_t> shares) const {
  const Between across =
      between(((x + 0.5) * pixel_x_um_ - light_.left_um) / light_.pitch_um - 0.5, light_.columns);
  const Between down =
      between(((y + 0.5) * pixel_y_um_ - light_.top_um) / light_.pitch_um - 0.5, light_.rows);
  const std::vector<int>& slices = light_.slices;
  const auto fill = [&](std::size_t from, std::size_t past, double share) {
    from = std::min(from, shares.size());
    past = std::min(std::max(past, from), shares.size());
    std::fill(shares.begin() + static_cast<std::ptrdiff_t>(from),
              shares.begin() + static_cast<std::ptrdiff_t>(past),
              static_cast<std::uint8_t>(std::lround(share)));
  };
  double here = value(*light_.blue, 0, across, down);
  fill(0, static_cast<std::size_t>(slices.front()), here);
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const auto first = static_cast<std::size_t>(slices[i]);
    if (i + 1 == slices.size()) {
      fill(first, shares.size(), here);
      break;
    }
    const auto past = static_cast<std::size_t>(slices[i + 1]);
    const double next = value(*light_.blue, i + 1, across, down);
    if (next == here) {
      fill(first, past, here);
    } else {
      for (std::size_t n = first; n < std::min(past, shares.size()); ++n) {
        const double share = static_cast<double>(n - first) / static_cast<double>(past - first);
        // NOLINTNEXTLINE(bugprone-incorrect-roundings): never below 0, and lround is a call.
        shares[n] = static_cast<std::uint8_t>(here + share * (next - here) + 0.5);
      }
    }
    here = next;
  }
}

void EvenPixels::uv_of_row(int slice, int x0, int y, std::span<double> shares) const {
  const Between z = between_slices(slice);
  const Between down =
      between(((y + 0.5) * pixel_y_um_ - light_.top_um) / light_.pitch_um - 0.5, light_.rows);
  for (std::size_t i = 0; i < shares.size(); ++i) {
    const double x = x0 + static_cast<double>(i) + 0.5;
    const Between across =
        between((x * pixel_x_um_ - light_.left_um) / light_.pitch_um - 0.5, light_.columns);
    const double first = value(*light_.uv, z.first, across, down);
    shares[i] = z.share == 0
                    ? first
                    : first + z.share * (value(*light_.uv, z.second, across, down) - first);
  }
}

}  // namespace slicecorr
