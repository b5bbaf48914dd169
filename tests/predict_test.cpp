// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The prediction against a second implementation that works from printed intervals, and by hand.
#include "slicecorr/predict.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "models.hpp"
#include "rounds.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;

struct Figures {
  std::vector<double> errors_um, contrasts, grey_errors;
  std::uint64_t target = 0, printed = 0, through = 0, under = 0, grey = 0, lost = 0, merged = 0,
                split = 0;
  double min_in = 1e300, min_through = 1e300, max_in = -1e300, max_out = -1e300;
};

/// The definitions read off the list of printed intervals of one column.
Figures figures_of(const CureModel& m, const std::vector<double>& phi,
                   const std::vector<std::uint8_t>& coverage) {
  Figures f;
  const int all = static_cast<int>(phi.size());
  const auto dose = node_doses(m, phi);
  // Printed intervals [begin, end] of zeta, from the platform down.
  std::vector<std::pair<double, double>> printed;
  for (int n = 0; n < all; ++n) {
    const auto k = static_cast<std::size_t>(n);
    const bool top = dose[k] >= 1, bottom = dose[k + 1] >= 1;
    if (!top && !bottom) continue;
    const double cross = n + 1 - (top != bottom ? m.crossing(phi[k], dose[k + 1]) : 0);
    const double begin = top ? n : cross, end = bottom ? n + 1 : cross;
    if (!printed.empty() && printed.back().second == begin) {
      printed.back().second = end;
    } else {
      printed.emplace_back(begin, end);
    }
  }
  const auto cover = [&](int n) {
    return n >= 0 && n < all ? coverage[static_cast<std::size_t>(n)] : 0;
  };
  const auto is_printed = [&](double z) {
    return std::any_of(printed.begin(), printed.end(),
                       [&](auto& p) { return p.first <= z && z <= p.second; });
  };
  bool gap_since = false;
  double least = 1e300;
  for (int n = 0; n < all;) {
    int end = n;
    while (end < all && (cover(end) == 255) == (cover(n) == 255) &&
           (cover(end) == 0) == (cover(n) == 0))
      ++end;
    if (cover(n) == 0) {
      gap_since = true;
      for (int k = n; k <= end; ++k) least = std::min(least, dose[static_cast<std::size_t>(k)]);
    }
    if (cover(n) == 255) {
      const double U = n, L = end;
      if (gap_since) {
        f.contrasts.push_back(std::max(0.0, 1 - least));
        f.merged += least >= 1;
      }
      gap_since = false;
      least = 1e300;
      bool any = false;
      for (int k = n; k <= end; ++k) any |= dose[static_cast<std::size_t>(k)] >= 1;
      f.lost += !any;
      for (int k = n; k <= end; ++k) {
        f.min_through = std::min(f.min_through, dose[static_cast<std::size_t>(k)]);
      }
      const auto pieces = std::count_if(printed.begin(), printed.end(),
                                        [&](const auto& p) { return p.first < L && p.second > U; });
      f.split += pieces > 1;
      if (n > 0 && cover(n - 1) == 0) {
        if (is_printed(U)) {
          int g = n;
          while (g > 0 && cover(g - 1) == 0) --g;
          double reach = U;
          for (auto& p : printed) {
            if (p.first <= U && U <= p.second) reach = p.first;
          }
          f.errors_um.push_back((U - std::max<double>(reach, g)) * m.layer_um);
        } else {
          double first = L;
          for (auto& p : printed) {
            if (p.second > U && p.first < L) first = std::min(first, p.first);
          }
          f.errors_um.push_back((first - U) * m.layer_um);
        }
      }
      if (cover(end) == 0) {  // also past the last slice: nothing is designed there
        if (is_printed(L)) {
          int g = end;
          while (g < all && cover(g) == 0) ++g;
          double reach = L;
          for (auto& p : printed) {
            if (p.first <= L && L <= p.second) reach = p.second;
          }
          f.errors_um.push_back((std::min<double>(reach, g) - L) * m.layer_um);
        } else {
          double first = U;
          for (auto& p : printed) {
            if (p.first < L && p.second > U) first = std::max(first, p.second);
          }
          f.errors_um.push_back((L - first) * m.layer_um);
        }
      }
    }
    n = end;
  }
  for (int n = 0; n < all; ++n) {
    const auto k = static_cast<std::size_t>(n);
    const double middle = m.middle(phi[k], dose[k + 1]);
    if (cover(n) == 255) {
      ++f.target;
      f.printed += middle >= 1;
      f.under += middle < 1;
      f.min_in = std::min(f.min_in, middle);
      f.max_in = std::max(f.max_in, middle);
    } else if (cover(n) == 0) {
      f.printed += middle >= 1;
      f.through += middle >= 1;
      f.max_out = std::max(f.max_out, middle);
    } else {
      ++f.grey;
      f.grey_errors.push_back(std::abs(middle - cover(n) / 255.0));
    }
  }
  return f;
}

double mean(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x;
  return v.empty() ? 0 : sum / static_cast<double>(v.size());
}

TEST(Predict, RandomColumnsAgreeWithTheIntervals) {
  std::mt19937 random(21);
  const CureModel m = figure_2_2();
  const PixelCurve curve = pixel_curve(m);
  std::uint64_t all_split = 0;
  for (int round = 0; round < test::rounds(400); ++round) {
    const std::size_t columns = 1 + random() % 70;
    const int all = 2 + static_cast<int>(random() % 60);
    const bool greys = random() % 2;
    std::vector<std::vector<std::uint8_t>> cover(columns), light(columns);
    for (std::size_t i = 0; i < columns; ++i) {
      const bool same = i && i % 8;  // neighbours alike, so that whole blocks take the fast way
      for (int n = 0; n < all; ++n) {
        const auto k = static_cast<std::size_t>(n);
        const bool keep = n && random() % 5;
        std::uint8_t c = random() % 2 ? 255 : 0,
                     p = static_cast<std::uint8_t>(random() % 3 ? (random() % 2) * 255 : random());
        if (greys && random() % 6 == 0) c = static_cast<std::uint8_t>(random());
        cover[i].push_back(same ? cover[i - 1][k] : keep ? cover[i][k - 1] : c);
        light[i].push_back(same ? light[i - 1][k] : keep ? light[i][k - 1] : p);
      }
    }
    const int shown = all - static_cast<int>(random() % 3);  // the light may go out before the end
    BandPredictor predictor(m, curve, all, columns);
    std::vector<std::uint8_t> c(columns), p(columns);
    for (int n = all; n-- > 0;) {
      for (std::size_t i = 0; i < columns; ++i) {
        c[i] = cover[i][static_cast<std::size_t>(n)];
        p[i] = light[i][static_cast<std::size_t>(n)];
      }
      predictor.add_slice(n, n < shown ? p.data() : nullptr, c.data());
    }
    const Prediction got = predictor.finish(0, 0, static_cast<int>(columns));
    Figures want;
    for (std::size_t i = 0; i < columns; ++i) {
      std::vector<double> phi;
      for (int n = 0; n < all; ++n) {
        phi.push_back(n < shown ? curve[light[i][static_cast<std::size_t>(n)]] : 0.0);
      }
      const Figures f = figures_of(m, phi, cover[i]);
      want.errors_um.insert(want.errors_um.end(), f.errors_um.begin(), f.errors_um.end());
      want.contrasts.insert(want.contrasts.end(), f.contrasts.begin(), f.contrasts.end());
      want.grey_errors.insert(want.grey_errors.end(), f.grey_errors.begin(), f.grey_errors.end());
      want.target += f.target;
      want.printed += f.printed;
      want.through += f.through;
      want.under += f.under;
      want.grey += f.grey;
      want.lost += f.lost;
      want.merged += f.merged;
      want.split += f.split;
      want.min_through = std::min(want.min_through, f.min_through);
      want.min_in = std::min(want.min_in, f.min_in);
      want.max_in = std::max(want.max_in, f.max_in);
      want.max_out = std::max(want.max_out, f.max_out);
    }
    SCOPED_TRACE(round);
    ASSERT_EQ(got.target_voxels, want.target);
    ASSERT_EQ(got.printed_voxels, want.printed);
    ASSERT_EQ(got.cure_through_voxels, want.through);
    ASSERT_EQ(got.undercure_voxels, want.under);
    ASSERT_EQ(got.grey_voxels, want.grey);
    ASSERT_EQ(got.lost_features, want.lost);
    ASSERT_EQ(got.merged_features, want.merged);
    ASSERT_EQ(got.split_features, want.split);
    all_split += want.split;
    ASSERT_EQ(got.gaps, want.contrasts.size());
    ASSERT_EQ(got.height_error_um.count(), want.errors_um.size());
    if (want.target) {
      ASSERT_EQ(got.min_dose_inside, want.min_in);
      ASSERT_EQ(got.min_inside_layers, want.min_through);
      ASSERT_EQ(got.max_dose_inside, want.max_in);
    }
    if (want.max_out > -1) {
      ASSERT_EQ(got.max_dose_outside, want.max_out);
    }
    if (!want.errors_um.empty()) {
      std::sort(want.errors_um.begin(), want.errors_um.end());
      // Sums are kept in units of 2^-20 um.
      ASSERT_NEAR(got.height_error_um.mean(), mean(want.errors_um), 1e-6);
      ASSERT_NEAR(got.height_error_um.greatest(), want.errors_um.back(), 1e-9);
      const auto rank =
          static_cast<std::size_t>(std::ceil(0.95 * static_cast<double>(want.errors_um.size()))) -
          1;
      ASSERT_NEAR(got.height_error_um.quantile(0.95), want.errors_um[rank],
                  0.0006 * want.errors_um[rank] + 1e-6);
    }
    if (!want.contrasts.empty()) {
      ASSERT_NEAR(got.gap_contrast.least(),
                  *std::min_element(want.contrasts.begin(), want.contrasts.end()), 1e-12);
    }
    if (!want.grey_errors.empty()) {
      ASSERT_NEAR(got.grey_dose_error.mean(), mean(want.grey_errors), 1e-6);
    }
  }
  EXPECT_GT(all_split, 20U);
}

TEST(Predict, AHairlineSplitsNothing) {
  // The dose of the second layer ends at 1 less `lack`, and rises again in the one above.
  const CureModel m = figure_2_2();
  PixelCurve curve{};
  const auto predict = [&](double lack) {
    curve[1] = 2.0 / m.one_minus_a;                         // the lowest: to 2
    curve[2] = (1.0 - lack - m.a * 2.0) / m.one_minus_a;    // falls to 1 - lack
    curve[3] = (1.5 - m.a * (1.0 - lack)) / m.one_minus_a;  // rises to 1.5
    const std::vector<std::uint8_t> pixels{3, 2, 1}, full{255, 255, 255};
    BandPredictor predictor(m, curve, 3, 1);
    for (std::size_t n = 3; n-- > 0;)
      predictor.add_slice(static_cast<int>(n), &pixels[n], &full[n]);
    return predictor.finish(0, 0, 1);
  };
  for (const double lack : {1e-12, 1e-9, 5e-7}) {
    EXPECT_EQ(predict(lack).split_features, 0U) << lack;
    EXPECT_EQ(predict(lack).runs, 1U);
  }
  for (const double lack : {2e-6, 1e-3, 0.2}) EXPECT_EQ(predict(lack).split_features, 1U) << lack;
  EXPECT_EQ(predict(-1e-9).split_features, 0U);
}

TEST(Predict, UncorrectedLadderOfFigure22) {
  const CureModel m = figure_2_2();
  const auto design = column(50, {{11, 20}, {31, 40}});
  const PixelCurve curve = pixel_curve(m);
  BandPredictor predictor(m, curve, 50, 1);
  for (int n = 50; n-- > 0;)
    predictor.add_slice(n, &design[static_cast<std::size_t>(n)],
                        &design[static_cast<std::size_t>(n)]);
  const Prediction p = predictor.finish(3, 4, 1);
  // One solid piece from the platform to 38.042 slices.
  EXPECT_EQ(p.cure_through_voxels, 21U);  // layers 0-10 and 21-30
  EXPECT_EQ(p.undercure_voxels, 3U);      // layers 38, 39, 40: mid-layer 38.5 is past the edge
  EXPECT_EQ(p.merged_features, 2U);
  EXPECT_EQ(p.lost_features, 0U);
  EXPECT_EQ(p.height_error_um.count(), 4U);
  EXPECT_NEAR(p.height_error_um.greatest(), 550.0, 1e-9);  // the gap above, all of it
  EXPECT_NEAR(p.greatest_shortfall_um, 2050 - 1902.1, 0.05);
  EXPECT_EQ(p.worst_x, 3);
  EXPECT_EQ(p.worst_y, 4);
}

TEST(Predict, WithoutHistogramsEverythingElseIsTheSame) {
  const CureModel m = figure_2_2();
  auto design = column(50, {{11, 20}, {31, 40}});
  design[25] = 100;
  const PixelCurve curve = pixel_curve(m);
  using Edge = std::tuple<std::size_t, int, bool, double>;
  const auto predicted = [&](bool histograms, std::vector<Edge>& edges) {
    BandPredictor predictor(m, curve, 50, 1);
    predictor.tell_edges([&](std::size_t column, int node, bool upper, double um) {
      edges.emplace_back(column, node, upper, um);
    });
    if (!histograms) predictor.keep_no_histograms();
    for (int n = 50; n-- > 0;) {
      const auto* pixel = &design[static_cast<std::size_t>(n)];
      predictor.add_slice(n, pixel, pixel);
    }
    return predictor.finish(3, 4, 1);
  };
  std::vector<Edge> edges, edges_without;
  const Prediction with = predicted(true, edges);
  Prediction without = predicted(false, edges_without);
  EXPECT_EQ(edges.size(), 4U);
  EXPECT_EQ(edges, edges_without);
  for (Histogram Prediction::*h :
       {&Prediction::height_error_um, &Prediction::gap_contrast, &Prediction::grey_dose_error}) {
    EXPECT_GT((with.*h).count(), 0U);
    EXPECT_EQ((without.*h).count(), 0U);
    without.*h = with.*h;
  }
  EXPECT_EQ(with.to_json(), without.to_json());
}

TEST(Predict, JsonHasTheKeysOfTheContractAndNullsWithoutSamples) {
  Prediction p;
  p.layers = 3;
  p.layer_um = 50;
  p.pixel_x_um = 50;
  p.pixel_y_um = 40;
  const auto j = nlohmann::json::parse(p.to_json());
  for (const char* key :
       {"layers", "layer_um", "pixel_um", "target_voxels", "printed_voxels", "cure_through_voxels",
        "undercure_voxels", "iou", "height_error_um", "lost_features", "merged_features", "dose",
        "gap_contrast", "grey_voxels", "grey_dose_error"}) {
    EXPECT_TRUE(j.contains(key)) << key;
  }
  EXPECT_TRUE(j["height_error_um"]["mean_abs"].is_null());
  EXPECT_TRUE(j["gap_contrast"]["min"].is_null());
  EXPECT_TRUE(j["dose"]["min_inside"].is_null());
  EXPECT_EQ(j["iou"], 1.0);
}

TEST(Histogram, QuantilesAndMeansOfKnownSamples) {
  Histogram h;
  for (int i = 1; i <= 1000; ++i) h.add(i);
  EXPECT_NEAR(h.quantile(0.95), 950, 0.5);
  EXPECT_NEAR(h.quantile(0.5), 500, 0.3);
  EXPECT_EQ(h.quantile(1), 1000);
  EXPECT_NEAR(h.mean(), 500.5, 1e-9);
  Histogram a, b, empty;
  for (int i = 1; i <= 1000; ++i) (i % 3 ? a : b).add(i);
  a.merge(b);
  a.merge(empty);
  EXPECT_EQ(a.quantile(0.95), h.quantile(0.95));
  EXPECT_EQ(a.mean(), h.mean());
  EXPECT_EQ(empty.quantile(0.5), 0);
  Histogram zeros;
  for (int i = 0; i < 10; ++i) zeros.add(0);
  EXPECT_EQ(zeros.quantile(0.95), 0);
}

TEST(Pixels, LevelsAndPixelsGoBackAndForth) {
  for (int bits = 1; bits <= 8; ++bits) {
    const int levels = 1 << bits;
    for (int l = 0; l < levels; ++l)
      ASSERT_EQ(level_of_pixel(pixel_of_level(l, levels), levels), l) << bits;
    EXPECT_EQ(pixel_of_level(levels - 1, levels), 255);
    EXPECT_EQ(level_of_pixel(255, levels), levels - 1);
  }
}

}  // namespace
}  // namespace slicecorr
