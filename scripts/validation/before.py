# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What each set was told before anything was built for it, and what it is told now."""
from page import Table, figure


def span(values, unit, digits=2):
    low, high = min(values), max(values)
    return f"{figure(low, digits)} to {figure(high, digits)} {unit}"


def roofs(f):
    by_fit = [r for n, r in f.items() if n not in ("pooled", "tried")]
    tried = list(f["tried"].values())[1:]
    return (f"the same by Jacobs' law; {span([r['left_out_rms_um'] for r in f['pooled'].values()], 'um')} left out by the three laws that `resinctl fit` compares, "
            f"{span([r['left_out_rms_um'] for r in tried], 'um')} by four more that were tried; the other print {figure(by_fit[1]['jacobs']['others_rms_um'])} um")


def two_lights(f):
    def bias(name):
        return span([100 * a[name]["ln_time_bias"] for a in f.values()], "%")
    return f"the same by the law of the programs; {bias('oxygen first')} by the law that explains it, which is not built in"


def cylinders(f):
    return f"{f['right']} of {f['asked']} at rest, {f['right_in_time']} of {f['asked']} in time on rings of 50 um (3 on rings of 250), with the void of the one that printed"


# Set, what was told at first, what was built or found, what is told now of its figures.
SETS = (
    ("roofs", "fits leave 1.3 to 4.5 um, which law to trust is not told", "comparison of laws by what they predict; delays, a threshold and oxygen tried", roofs),
    ("working-curve", "31 um rms upward from the lower doses", "nothing",
     lambda f: f"the same, {figure(f['DA-2']['jacobs']['upper_rms_um'], 2)} um; its band holds {f['DA-2']['upper_in_band']} of {f['DA-2']['upper']}"),
    ("laboratories", "no band where a resin is another laboratory's", "the band, told in one line; `tune` begins from it", lambda f: f"a factor of {figure(f['Ec']['factor95'], 2)} of dose, {figure(f['Dp']['factor95'], 2)} of height"),
    ("channels", "no figure", "channels by the programs, layers of 0.3 to 1 height, as sliced and corrected",
     lambda f: f"{span([r['least'] for r in f['rows'] if r['dose'] == 5], 'heights')} at five gel doses as sliced, one layer corrected; measured 3.5 to 5.5"),
    ("bis-ema", "36 to 41 % too short", "`tune` with one time", lambda f: f"{span([100 * e for e in f['after_one_time_errors']], '%')} off after one time"),
    ("two-lights", "3 to 12 % too long in the mean", "what comes of oxygen is told apart", two_lights),
    ("oxygen", "exponents of a dead zone as measured, no size to hold against them", "nothing",
     lambda f: f"the same: light to the power {f['dead_zone_exponent']:.2f}, {figure(f['pure_oxygen_ratio'])} times in pure oxygen"),
    ("forces", "exponent of speed 1; a triangle 18 % too low", "windows that give way",
     lambda f: f"{span([s['rubber_exponent'] for s in f['speeds'].values()], 'over rubber')} where {span([s['exponent'] for s in f['speeds'].values()], 'was measured')}; a triangle stays 17 to 18 % too low"),
    ("cylinders", "2 of 3 at rest", "prints in time; suction that there can't be is told", cylinders),
    ("fins", "1 of 9 with level light, 3 printed; 9 of 9 with rays", "level light corrected in its plane, counted where fins stand",
     lambda f: f"{min(min(v[1:4]) for v in f['in plane'].values())} to {max(max(v[1:4]) for v in f['in plane'].values())} of 9 with level light, by the dose at which printing stops; 9 of 9 with rays"),
)


def before_and_after(sections):
    figures = {s.key: s.figures for s in sections}
    table = Table(["set", "told before", "built or found", "told now"], [])
    for key, before, built, now in SETS:
        if key in figures:
            title = next(s.title for s in sections if s.key == key)
            table.rows.append([title, before, built, now(figures[key])])
    return table
