# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of roofs that were tried beside those of the programs, and are not built in: each predicts what it was not fitted to."""
import functools
import math

from page import Table, figure, signed
from reckon import deviation, fit_jacobs, mean, rms

# Cells of depth, in absorbance heights, and the longest time, in times to gel without diffusion.
CELLS, DEPTH, LONGEST = 160, 5.0, 14.0
# D t/h² of the tables, and 0.
SPREADS = [0.0] + [0.0025 * 2 ** k for k in range(9)]


@functools.lru_cache(None)
def fronts(share, spread, from_window):
    """Step of time, and the gelled height after each step; heights in h, times in the time that gels the window without diffusion.

    Oxygen takes light until it is used up, and diffuses in from the dark resin beyond (and from the window). Its store takes
    `share` of the dose of gel, light that finds none of it makes gel of the rest.
    """
    dx = DEPTH / CELLS
    dt = min(0.4 * dx * dx / spread, 0.01) if spread else 0.01
    light = [math.exp(-(i + 0.5) * dx) * dt for i in range(CELLS)]
    part, oxygen, gel, heights = spread * dt / dx / dx, [share] * CELLS, [0.0] * CELLS, [0.0]
    for _ in range(int(LONGEST / dt)):
        before = [2 * share - oxygen[0] if from_window else oxygen[0]] + oxygen[:-1]
        left = [o + part * (a - 2 * o + b) - i for o, a, b, i in zip(oxygen, before, oxygen[1:] + oxygen[-1:], light)]
        oxygen = [max(o, 0.0) for o in left]
        gel = [g - min(o, 0.0) for g, o in zip(gel, left)]
        heights.append(gelled(gel, 1 - share, dx))
    return dt, heights


def gelled(gel, enough, dx):
    """Height between the outermost places with enough, linear between cells."""
    has = [i for i, g in enumerate(gel) if g >= enough]
    if not has:
        return 0.0
    low, high = has[0], has[-1]
    top = (high + 0.5) * dx if high + 1 == len(gel) else (high + 0.5 + (gel[high] - enough) / (gel[high] - gel[high + 1])) * dx
    return top - (0.0 if low == 0 else (low + 0.5 - (gel[low] - enough) / (gel[low] - gel[low - 1])) * dx)


def front(time, share, spread, from_window):
    """Between the tables: linear in time, and in the logarithm of the spread."""
    def at(k):
        dt, heights = fronts(share, SPREADS[k], from_window)
        i = min(int(time / dt), len(heights) - 2)
        return heights[i] + (time / dt - i) * (heights[i + 1] - heights[i])
    if spread <= SPREADS[1]:
        return at(0) + (at(1) - at(0)) * spread / SPREADS[1]
    k = min(max(i for i, s in enumerate(SPREADS) if s <= spread), len(SPREADS) - 2)
    return at(k) + (at(k + 1) - at(k)) * math.log(spread / SPREADS[k]) / math.log(SPREADS[k + 1] / SPREADS[k])


def oxygen(share, d_m2_s, from_window):
    return lambda h, gel_s, t: h * front(t / gel_s, share, d_m2_s * 1e12 * gel_s / (h * h), from_window)


# Heights by h, um, the time to gel at the window, s, and the exposure, s. Each has the two parameters of Jacobs' law.
LAWS = (
    ("Jacobs' law", lambda h, gel_s, t: h * math.log(t / gel_s)),
    ("light counts 0.2 s late, with all resins", lambda h, gel_s, t: h * math.log(max(t - 0.2, 1e-6) / gel_s)),
    ("a tenth of the light at the window only makes up for oxygen that comes back", lambda h, gel_s, t: h * math.log(t / (gel_s + 0.1 * t))),
    ("oxygen diffuses in from the resin beyond (3e-10 m²/s), 0.8 of the dose", oxygen(0.8, 3e-10, False)),
    ("the same, and in through the window", oxygen(0.8, 3e-10, True)),
)


def fitted(law, points):
    """h and the time to gel of least squares (Levenberg-Marquardt, derivatives by differences)."""
    def off(q):
        return [law(math.exp(q[0]), math.exp(q[1]), t) - um for t, um in points]

    at, damp = [math.log(v) for v in fit_jacobs(points)], 1e-3
    errors = off(at)
    for _ in range(60):
        slopes = [[(b - a) / 1e-4 for a, b in zip(errors, off([v + 1e-4 * (i == k) for i, v in enumerate(at)]))] for k in range(2)]
        (a, b), d = [[sum(x * y for x, y in zip(slopes[0], s)) for s in slopes], sum(x * x for x in slopes[1])]
        u, v = (-sum(x * y for x, y in zip(s, errors)) for s in slopes)
        a, d = a * (1 + damp), d * (1 + damp)
        determinant = a * d - b * b
        if determinant == 0:
            break
        step = ((u * d - v * b) / determinant, (v * a - u * b) / determinant)
        new = off([at[0] + step[0], at[1] + step[1]])
        gain = sum(x * x for x in errors) - sum(x * x for x in new)
        if gain > 0:
            at, errors, damp = [at[0] + step[0], at[1] + step[1]], new, damp / 5
            if gain < 1e-10 * sum(x * x for x in errors):
                break
        elif damp > 1e8:
            break
        else:
            damp *= 5
    return math.exp(at[0]), math.exp(at[1])


def tried(groups):
    """Table and figures of all laws. A group is the fitted (s, um) of a resin, in order of times, and those of another print."""
    table = Table(["tried with two parameters", "left out, rms um", "longer exposures by shorter ones: rms (bias) um", "the other print: rms um"], [])
    figures = {}
    for name, law in LAWS:
        left, upper, others = [], [], []
        for points, other in groups:
            h, gel_s = fitted(law, points)
            others += [law(h, gel_s, t) - um for t, um in other]
            for t, um in points:
                left.append(law(*fitted(law, [p for p in points if p[0] != t]), t) - um)
            half = (len(points) + 1) // 2
            short = fitted(law, points[:half])
            upper += [law(*short, t) - um for t, um in points[half:]]
        figures[name] = {"left_out_rms_um": rms(left), "upper_rms_um": rms(upper), "upper_bias_um": mean(upper), "others_rms_um": rms(others),
                         "left_out_squares_error": deviation([e * e for e in left]) / math.sqrt(len(left))}
        table.rows.append([name, figure(rms(left)), f"{figure(rms(upper))} ({signed(mean(upper))})", figure(rms(others))])
    return table, figures
