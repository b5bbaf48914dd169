// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "chemistry/reaction_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include "chemistry/reaction_kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace slicecorr::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Doubles = hn::CappedTag<double, kCellBlock / 2>;
using Vector = hn::Vec<Doubles>;

/// Two vectors at once: what one waits for, divisions and roots above all, the other fills.
struct V {
  Vector a, b;
};
struct M {
  hn::Mask<Doubles> a, b;
};

V constant(double x) { return {hn::Set(Doubles(), x), hn::Set(Doubles(), x)}; }
V add(V x, V y) { return {hn::Add(x.a, y.a), hn::Add(x.b, y.b)}; }
V sub(V x, V y) { return {hn::Sub(x.a, y.a), hn::Sub(x.b, y.b)}; }
V mul(V x, V y) { return {hn::Mul(x.a, y.a), hn::Mul(x.b, y.b)}; }
V div(V x, V y) { return {hn::Div(x.a, y.a), hn::Div(x.b, y.b)}; }
V root_of(V x) { return {hn::Sqrt(x.a), hn::Sqrt(x.b)}; }
V least_of(V x, V y) { return {hn::Min(x.a, y.a), hn::Min(x.b, y.b)}; }
V most_of(V x, V y) { return {hn::Max(x.a, y.a), hn::Max(x.b, y.b)}; }
V size_of(V x) { return {hn::Abs(x.a), hn::Abs(x.b)}; }
M above(V x, V y) { return {hn::Gt(x.a, y.a), hn::Gt(x.b, y.b)}; }
M at_least(V x, V y) { return {hn::Ge(x.a, y.a), hn::Ge(x.b, y.b)}; }
M both(M x, M y) { return {hn::And(x.a, y.a), hn::And(x.b, y.b)}; }
bool none(M x) { return hn::AllFalse(Doubles(), hn::Or(x.a, x.b)); }
V pick(M m, V yes, V no) {
  return {hn::IfThenElse(m.a, yes.a, no.a), hn::IfThenElse(m.b, yes.b, no.b)};
}
V load(const double* from) {
  const Doubles d;
  return {hn::LoadU(d, from), hn::LoadU(d, from + hn::Lanes(d))};
}
void store(V x, double* to) {
  const Doubles d;
  hn::StoreU(x.a, d, to);
  hn::StoreU(x.b, d, to + hn::Lanes(d));
}
/// Nothing where there is next to nothing: numbers near the least a double holds are slow.
V settled(V x) { return pick(above(x, constant(1e-60)), x, constant(0)); }

struct State {
  V I, Ir, P0, P1, P2, P3, O, Q;
};

/// Constants of a step of backward Euler over h.
struct Rates {
  V a, hkp, ho, hq, two_hkt, supply, supplied, hkIO, hkI;
};
Rates rates_of(const ReactionStep& r, double h) {
  return {constant(1 / (h * r.kI)),
          constant(h * r.kp),
          constant(h * r.ktO),
          constant(h * r.ktQ),
          constant(2 * h * r.kt),
          constant(1 + h * r.supply_per_s),
          constant(h * r.supply_per_s * r.outside_mol_l),
          constant(h * r.kIO),
          constant(h * r.kI)};
}

/// Radicals that start chains, and with kIO those that oxygen takes.
struct Starts {
  V chains, taken;
};
template <bool kTaken>
Starts starts_of(const Rates& k, const State& y, V X) {
  const V grown = add(constant(1), mul(k.hkp, y.P1));
  if constexpr (!kTaken) {
    // s² - (P0 + X + a) s + P0 X = 0 with a = (1 + h kp P1)/(h kI). Radicals are few beside end groups:
    // with e = P0 X / (P0 + X + a)² the smaller root is a series in e, of Catalan's numbers.
    const V a = mul(grown, k.a);
    const V product = mul(y.P0, X), sum = add(add(y.P0, X), a);
    const V per_sum = div(constant(1), sum);
    const V first = mul(product, per_sum), e = mul(first, per_sum);
    V series = constant(42);
    for (const double c : {14.0, 5.0, 2.0, 1.0, 1.0}) series = add(mul(series, e), constant(c));
    V s = mul(first, series);
    const M many = above(e, constant(1e-3));
    if (!none(many)) {
      // The sum under the root has no difference of like numbers.
      const V b = sub(add(y.P0, a), X);
      const V root = root_of(add(mul(b, b), mul(constant(4), mul(a, X))));
      s = pick(many, div(add(product, product), add(sum, root)), s);
    }
    return {least_of(s, least_of(X, y.P0)), constant(0)};
  } else {
    // x (1 + h kI n(x) + h kIO o(x)) = X, n = P0 / (grown + h kI x), o = O / (c + h kIO x), O with what
    // comes from outside: concave and rising, so that Newton's method comes from below.
    const V c = add(k.supply, mul(k.ho, y.P1));
    const V O = most_of(add(y.O, k.supplied), constant(0));
    V x = div(X, add(constant(1), add(div(mul(k.hkI, y.P0), grown), div(mul(k.hkIO, O), c))));
    V chains = constant(0), taken = constant(0);
    for (int turn = 0; turn < 6; ++turn) {
      const V u = add(grown, mul(k.hkI, x)), w = add(c, mul(k.hkIO, x));
      const V per_u = div(constant(1), u), per_w = div(constant(1), w);
      const V kn = mul(mul(k.hkI, y.P0), per_u), ko = mul(mul(k.hkIO, O), per_w);
      chains = mul(kn, x);
      taken = mul(ko, x);
      const V f = sub(add(x, add(chains, taken)), X);
      const V slope = add(constant(1), add(mul(kn, mul(grown, per_u)), mul(ko, mul(c, per_w))));
      x = most_of(sub(x, div(f, slope)), constant(0));
    }
    // What is left over by rounding stays with the initiator's radicals.
    const V all = add(chains, taken);
    const V fit = pick(above(all, X), div(X, all), constant(1));
    return {mul(chains, fit), mul(taken, fit)};
  }
}

/// The root p of the step, from the guess `p`.
template <bool kInhibitor>
V chains_of(const Rates& k, V source, V O, V Q, V p) {
  const V zero = constant(0), one = constant(1);
  V low = zero;
  // Oxygen may be below 0 by rounding of what diffused: then it sets chains free.
  V high = add(source, most_of(zero, sub(zero, O)));
  p = least_of(most_of(p, zero), high);
  // A lane that is done stays as it is, so that its bits do not depend on its neighbours.
  M open = at_least(high, zero);
  for (int turn = 0; turn < 60; ++turn) {
    // F = (p + 2 h kt p² - source) u v + (h ktO p O) v + (h ktQ p Q) u with u and v the denominators.
    const V u = add(k.supply, mul(k.ho, p));
    const V kt_p = mul(k.two_hkt, p);
    const V g = sub(add(p, mul(kt_p, p)), source);
    const V dg = add(one, add(kt_p, kt_p));
    const V o = mul(k.ho, O);
    V F = add(mul(g, u), mul(o, p));
    V dF = add(add(mul(dg, u), mul(g, k.ho)), o);
    if constexpr (kInhibitor) {
      const V v = add(one, mul(k.hq, p));
      const V q = mul(k.hq, Q);
      const V dq = add(mul(u, q), mul(mul(k.ho, p), q));
      dF = add(add(mul(dF, v), mul(F, k.hq)), dq);
      F = add(mul(F, v), mul(mul(q, p), u));
    }
    const M too_high = above(F, zero);
    high = pick(too_high, p, high);
    low = pick(too_high, low, p);
    V next = sub(p, div(F, dF));
    const M inside = both(at_least(next, low), at_least(high, next));
    next = pick(inside, next, mul(constant(0.5), add(low, high)));
    // Newton's method doubles the digits: what moved by 1e-5 of itself is good to 1e-10 now, and
    // end groups, of which it is a hundred-thousandth, to rounding.
    const V moved = size_of(sub(next, p));
    p = pick(open, next, p);
    open = both(open, both(above(moved, mul(constant(1e-5), p)), above(high, low)));
    if (none(open)) break;
  }
  return p;
}

/// Backward Euler of all but the initiator, with X radicals of the initiator, those set free among them.
template <bool kInhibitor, bool kTaken>
State euler_of(const Rates& k, V X, const State& y, V guess) {
  State z = y;
  const Starts s = starts_of<kTaken>(k, y, X);
  z.Ir = most_of(sub(sub(X, s.chains), s.taken), constant(0));
  const V P0 = sub(y.P0, s.chains);
  const V O = add(sub(y.O, s.taken), k.supplied);
  const V p = chains_of<kInhibitor>(k, add(y.P1, s.chains), O, y.Q, guess);
  const V u = add(k.supply, mul(k.ho, p)), w = add(constant(1), mul(k.hkp, p));
  const V per = div(constant(1), mul(u, w));
  z.O = mul(O, mul(per, w));
  z.P0 = mul(P0, mul(per, u));
  V dead = mul(mul(k.ho, p), z.O);
  if constexpr (kInhibitor) {
    z.Q = div(y.Q, add(constant(1), mul(k.hq, p)));
    dead = add(dead, mul(mul(k.hq, p), z.Q));
  }
  z.P2 = add(y.P2, add(mul(mul(k.hkp, p), z.P0), mul(mul(k.two_hkt, p), p)));
  z.P3 = add(y.P3, dead);
  z.P1 = p;
  return z;
}
template <bool kInhibitor, bool kTaken>
State euler(const Rates& k, V broken, const State& y, V guess) {
  const V out = mul(y.I, broken);
  State z = euler_of<kInhibitor, kTaken>(k, add(y.Ir, add(out, out)), y, guess);
  z.I = sub(y.I, out);
  return z;
}

/// Undoes as much of the reactions of O, Q and Ir as puts them to 0 where they are below. Tells where
/// end groups of a kind are below 0.
template <bool kInhibitor>
M lifted(State& z) {
  const V zero = constant(0);
  const auto undo = [&](V& taken, V& back, V& product) {
    const V missing = most_of(zero, sub(zero, taken));
    taken = add(taken, missing);
    back = add(back, missing);
    product = sub(product, missing);
  };
  undo(z.O, z.P1, z.P3);
  if constexpr (kInhibitor) undo(z.Q, z.P1, z.P3);
  undo(z.Ir, z.P0, z.P1);
  return above(zero, least_of(least_of(z.P0, z.P1), least_of(z.P2, z.P3)));
}
/// All but the initiator from another state.
void replace(M where, const State& by, State& z) {
  z.Ir = pick(where, by.Ir, z.Ir);
  z.P0 = pick(where, by.P0, z.P0);
  z.P1 = pick(where, by.P1, z.P1);
  z.P2 = pick(where, by.P2, z.P2);
  z.P3 = pick(where, by.P3, z.P3);
  z.O = pick(where, by.O, z.O);
  z.Q = pick(where, by.Q, z.Q);
}
/// On the line from one state to another, `times` as far; Q only where there is some, I not at all.
template <bool kInhibitor>
State on_line(const State& from, const State& to, double times) {
  const V t = constant(times);
  const auto of = [&](V a, V b) { return add(a, mul(t, sub(b, a))); };
  State z = to;
  z.Ir = of(from.Ir, to.Ir);
  z.P0 = of(from.P0, to.P0);
  z.P1 = of(from.P1, to.P1);
  z.P2 = of(from.P2, to.P2);
  z.P3 = of(from.P3, to.P3);
  z.O = of(from.O, to.O);
  if constexpr (kInhibitor) z.Q = of(from.Q, to.Q);
  return z;
}

/// Twice the halves less the whole, with nothing below 0.
template <bool kInhibitor>
State second_order(const State& half, const State& whole) {
  State z = on_line<kInhibitor>(whole, half, 2);
  const M bad = lifted<kInhibitor>(z);
  if (!none(bad)) replace(bad, half, z);
  return z;
}

/// Two stages of backward Euler over gamma h each, gamma = 1 - sqrt(1/2): the second begins 1 / gamma - 1
/// times as far as the first has come. `broken` is the share of the initiator over all of h.
constexpr double kGamma = 0.2928932188134524, kBeyond = 2.414213562373095;
template <bool kInhibitor, bool kTaken>
State two_stages(const Rates& stage, const Rates& whole, V broken, const State& y) {
  const V out = mul(y.I, broken);
  const V set_free = mul(constant(2 * kGamma), out);
  const State one = euler_of<kInhibitor, kTaken>(stage, add(y.Ir, set_free), y, y.P1);
  State beyond = on_line<kInhibitor>(y, one, kBeyond);
  const M bad = lifted<kInhibitor>(beyond);
  State z = euler_of<kInhibitor, kTaken>(stage, add(beyond.Ir, set_free), beyond, beyond.P1);
  if (!none(bad)) {
    replace(bad, euler_of<kInhibitor, kTaken>(whole, add(y.Ir, add(out, out)), y, y.P1), z);
  }
  z.I = sub(y.I, out);
  return z;
}

template <bool kInhibitor, bool kTaken>
void react_as(const ReactionStep& r, const double* broken, const CellArrays& c, std::size_t count,
              double* gel_time, StepError* error) {
  const std::size_t lanes = 2 * hn::Lanes(Doubles());
  const Rates whole = rates_of(r, r.h), half = rates_of(r, r.h / 2),
              gamma = rates_of(r, kGamma * r.h);
  const bool rests = r.supply_per_s == 0;
  V worst = constant(0);
  for (std::size_t i = 0; i < count; i += lanes) {
    State y;
    const V g = load(broken + i);
    y.Ir = load(c.Ir + i);
    y.P1 = load(c.P1 + i);
    // In the dark nothing happens where nothing has begun.
    if (rests && none(above(add(g, add(y.Ir, y.P1)), constant(0)))) continue;
    y.I = load(c.I + i);
    y.P0 = load(c.P0 + i);
    y.P2 = load(c.P2 + i);
    y.P3 = load(c.P3 + i);
    y.O = load(c.O + i);
    y.Q = kInhibitor ? load(c.Q + i) : constant(0);
    const auto put = [&](const State& z) {
      store(z.I, c.I + i);
      store(settled(z.Ir), c.Ir + i);
      store(z.P0, c.P0 + i);
      store(settled(z.P1), c.P1 + i);
      store(z.P2, c.P2 + i);
      store(z.P3, c.P3 + i);
      store(settled(z.O), c.O + i);
      if constexpr (kInhibitor) store(settled(z.Q), c.Q + i);
      if (gel_time) {
        const V level = constant(r.gel_p0);
        const M now = both(above(y.P0, level), at_least(level, z.P0));
        if (!none(now)) {
          const V share = div(sub(y.P0, level), sub(y.P0, z.P0));
          const V at = add(constant(r.time), mul(constant(r.h), share));
          store(pick(now, at, load(gel_time + i)), gel_time + i);
        }
      }
    };
    const V twice = sub(add(g, g), mul(g, g));
    if (!error) {
      put(two_stages<kInhibitor, kTaken>(gamma, whole, twice, y));
      continue;
    }
    State two = euler<kInhibitor, kTaken>(half, g, y, y.P1);
    const V middle = two.P1;
    two = euler<kInhibitor, kTaken>(half, g, two, add(middle, sub(middle, y.P1)));
    const State one = euler<kInhibitor, kTaken>(whole, twice, y, two.P1);
    put(second_order<kInhibitor>(two, one));
    const V by_O = div(size_of(sub(two.O, one.O)), constant(error->scale_O));
    const V by_P = div(size_of(sub(two.P0, one.P0)), constant(error->scale_P));
    const V by_p = div(size_of(sub(two.P1, one.P1)), add(two.P1, constant(error->scale_p)));
    worst = most_of(worst, most_of(by_O, most_of(by_P, by_p)));
  }
  if (error) error->worst = hn::GetLane(hn::MaxOfLanes(Doubles(), hn::Max(worst.a, worst.b)));
}

void react_kernel(const ReactionStep& r, const double* broken, const CellArrays& c,
                  std::size_t count, double* gel_time, StepError* error) {
  const bool inhibitor = c.Q != nullptr;
  if (r.kIO > 0) {
    (inhibitor ? react_as<true, true> : react_as<false, true>)(r, broken, c, count, gel_time,
                                                               error);
  } else {
    (inhibitor ? react_as<true, false> : react_as<false, false>)(r, broken, c, count, gel_time,
                                                                 error);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slicecorr::detail {

HWY_EXPORT(react_kernel);

void react(const ReactionStep& step, const double* broken, const CellArrays& cells,
           std::size_t count, double* gel_time, StepError* error) {
  HWY_DYNAMIC_DISPATCH(react_kernel)(step, broken, cells, count, gel_time, error);
}

ReactionStep reaction_of(const Chemistry& c) {
  ReactionStep r;
  r.kI = c.initiation_l_mol_s;
  r.kp = c.propagation_l_mol_s;
  r.kt = c.termination_l_mol_s;
  r.ktO = c.oxygen_l_mol_s;
  r.kIO = c.initiator_oxygen_l_mol_s;
  r.ktQ = c.inhibitor_l_mol_s;
  r.gel_p0 = c.groups_mol_l * (1 - c.gel_conversion);
  return r;
}

}  // namespace slicecorr::detail

#endif  // HWY_ONCE
