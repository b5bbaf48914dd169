// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "correct/coupled_solver.hpp"

namespace slicecorr::detail {

void PatchSolver::set_level(std::size_t at, int level) {
  if (level != levels_[at]) {
    shown_changed_ = true;
    levels_[at] = static_cast<std::uint8_t>(level);
    if (!task_.first) altered_.push_back(at);
  }
  const float shine = shine_of(levels_[at], at);
  if (shine == shine_[at]) return;
  shine_more(at, shine - shine_[at]);
  shine_[at] = shine;
}

void PatchSolver::round_to_levels() {
  if (plan_.hands_on) return hand_on();
  const LevelTable& table = plan_.columns.levels;
  for (const std::size_t at : touched_) {
    marked_[at] ^= kTouched;
    const double phi = phi_at(at, shine_[at]);
    const auto [below, above] = table.around(phi);
    set_level(at, table.phi(above) - phi < phi - table.phi(below) ? above : below);
  }
  // Features are not left under their dose by rounding.
  const float room = static_cast<float>(plan_.margin / plan_.b_of(slice()));
  for (const std::size_t at : touched_) {
    if (here_[at] != 255 || light_[at] >= raw_lo_[at] - room || levels_[at] >= plan_.top) continue;
    if (raw_lo_[at] >= shine_of(255, at)) continue;
    set_level(at, levels_[at] + 1);
  }
}

bool PatchSolver::lacks_own(std::size_t first, const float* seen) const {
  if (plan_.joint <= 0) return false;
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = y * place().stride;
    for (std::size_t k = from; k < from + kSquare; ++k) {
      if (seen[k] < least_own(first + k)) return true;
    }
  }
  return false;
}

void PatchSolver::hold() {
  if (plan_.joint <= 0) return;
  const LevelTable& table = plan_.columns.levels;
  const std::size_t stride = place().stride;
  const auto tap = [&](int x, int y) {
    return plan_.near_taps[static_cast<std::size_t>((plan_.near_y + y) * plan_.near_width +
                                                    plan_.near_x + x)];
  };
  const auto raise = [&](std::size_t at, float more) {
    if (!(marked_[at] & kMayChange) || here_[at] != 255 || levels_[at] >= plan_.top) return false;
    const float shine = std::min(shine_[at] + more, shine_of(255, at));
    const int level = table.at_least(phi_at(at, static_cast<double>(shine) * (1 - 1e-6)));
    if (level <= levels_[at]) return false;
    wake_around(at);
    check_on(square_of(at), slice());
    set_level(at, level);
    return true;
  };
  constexpr int passes = 12, alone = 4;
  bool any = true;
  for (int pass = 0; pass < passes && any; ++pass) {
    any = false;
    for (const int k : aimed_) {
      for (std::size_t y = 0; y < kSquare; ++y) {
        const std::size_t from = first_of(k) + y * stride;
        for (std::size_t at = from; at < from + kSquare; ++at) {
          const float least = least_own(at);
          if (least <= 0) continue;
          const float wanted =
              plan_.m == 1 ? least : std::pow(least, static_cast<float>(1 / plan_.m));
          const float lacks = wanted * (1 + 1e-5F) - light_[at];
          if (lacks <= 0) continue;
          if (raise(at, lacks / tap(0, 0))) {
            any = true;
            continue;
          }
          if (pass < alone) continue;
          for (int j = -1; j <= 1; ++j) {
            for (int i = -1; i <= 1; ++i) {
              const std::size_t beside =
                  at + static_cast<std::size_t>(i) + stride * static_cast<std::size_t>(j);
              if (i != 0 || j != 0)
                any = raise(beside, lacks / (8 * std::max(tap(i, j), 0.01F))) || any;
            }
          }
        }
      }
    }
    if (!any && pass < alone) {
      pass = alone - 1;
      any = true;
    }
  }
}

void PatchSolver::hand_on() {
  const LevelTable& table = plan_.columns.levels;
  const auto phi_of = [&](double shine, std::size_t at) {
    return phi_at(at, std::max(shine, 0.0));
  };
  // Row by row, every second row of the display from its end.
  std::sort(touched_.begin(), touched_.end(), [&](std::size_t l, std::size_t r) {
    const Pixel p = place().pixel(l), q = place().pixel(r);
    if (p.y != q.y) return p.y < q.y;
    return p.y % 2 == 0 ? p.x < q.x : p.x > q.x;
  });
  const std::size_t stride = place().stride;
  const std::size_t beside[] = {1, stride - 1, stride, stride + 1};
  const auto weight = [&](std::size_t step) {
    const bool x = step != stride, y = step != 1;
    return plan_.near_taps[static_cast<std::size_t>(
        (plan_.near_y + (y ? 1 : 0)) * plan_.near_width + plan_.near_x + (x ? 1 : 0))];
  };
  const auto each_beside = [&](std::size_t at, const auto& each) {
    for (const std::size_t step : beside) {
      each(at + step, weight(step));
      each(at - step, weight(step));
    }
  };
  const float own =
      plan_.near_taps[static_cast<std::size_t>(plan_.near_y * plan_.near_width + plan_.near_x)];
  for (const std::size_t at : touched_) {
    const bool feature = here_[at] == 255;
    const float wanted = shine_[at];
    float aimed = wanted - credit_[at], least = shine_of(0, at);
    credit_[at] = 0;
    if (feature) {
      // Not so dark that it, or a pixel beside it that is decided, has less than it needs.
      const auto needs = [&](std::size_t k, float w) {
        const float lacks = std::min(raw_lo_[k], shine_of(255, k)) - light_[k];
        least = std::max(least, wanted + (k == at ? lacks : std::min(0.0F, lacks)) / w);
      };
      needs(at, own);
      each_beside(at, [&](std::size_t k, float w) {
        if (here_[k] == 255 && !(marked_[k] & kTouched)) needs(k, w);
      });
    }
    marked_[at] ^= kTouched;
    const double phi = phi_of(aimed, at);
    const auto [below, above] = table.around(phi);
    int level = table.phi(above) - phi < phi - table.phi(below) ? above : below;
    if (feature && shine_of(static_cast<std::uint8_t>(level), at) < least) {
      level = table.at_least(phi_of(std::min(least, shine_of(255, at)), at));
    }
    set_level(at, level);
    const float surplus = shine_[at] - aimed;
    if (!feature || surplus <= 0) continue;
    float all = 0;
    const auto takes = [&](std::size_t k) {
      return here_[k] == 255 && (marked_[k] & kTouched) != 0;
    };
    each_beside(at, [&](std::size_t k, float w) { all += takes(k) ? w : 0; });
    if (all <= 0) continue;
    each_beside(at, [&](std::size_t k, float w) {
      if (takes(k)) credit_[k] += surplus * w / all;
    });
  }
}

}  // namespace slicecorr::detail
