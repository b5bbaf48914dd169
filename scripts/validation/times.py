# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Times until resin gels, without and with inhibiting light."""
import math
import tomllib
import types

from draw import Panel, Picture
from page import Section, Table, figure, percent, signed
from programs import ROOT
from reckon import BadInput, Line, disagree, groups_of, least, mean, read_table, rms, student_t

# Within this factor lie the doses of gel of 95 % of laboratories (the set `laboratories`).
LABORATORIES = 8.5
GEL_TIME_RESIN = ROOT / "resins/db/bis-ema-tpo-gel-time.toml"


def window_time(programs, resin, light, uv=0.0):
    """Seconds until resin at the window gels, by `resinctl predict`; None where it never does."""
    uv_light = ["--uv-mw-cm2", repr(uv)] if uv else []
    told = programs.json("resinctl", "predict", "--resin", resin, "--blue-mw-cm2", repr(light), *uv_light, "--height-um", "1e-6")
    return told["window_time_s"] if uv else told["exposure_for_height_s"]


def off(told, measured):
    return told / measured - 1


# Two patterns of light: t = D'c / (Ib - beta Iuv)^m.
END_S = 2.0  # of the records
LABELS = {"subtraction": "(Ib - beta Iuv)^m, as the programs have it", "squares": "its squares, tried",
          "both inhibited": "A/(Ib - beta Iuv) + B/sqrt(Ib - beta Iuv), tried",
          "oxygen first": "A/Ib + B/sqrt(Ib - beta Iuv), tried"}


class TwoLights:
    """The law of subtraction, or the one of squares that was tried beside it (`power` 2)."""

    def __init__(self, cells, power):
        self.power = power
        alone = Line([(math.log(ini), math.log(t)) for ini, inh, t in cells if inh == 0 and t])
        self.m, self.dose = -alone.slope, math.exp(alone.at)
        # 95 % of single times lie within this factor of the law, by the scatter of the cells without inhibiting light.
        self.factor = math.exp(student_t(sum(1 for _, inh, t in cells if inh == 0 and t) - 2) * alone.sigma)
        row = [c for c in cells if c[0] == 20 and c[1] > 0]
        most = 20 / max(inh for _, inh, t in row if t)

        def misfit(beta):
            """Of times; of cells that did not cure by as much as they are told to cure before the end."""
            self.beta = beta
            return sum(math.log(self.time(ini, inh) / t) ** 2 if t else math.log(min(1.0, self.time(ini, inh) / END_S)) ** 2
                       for ini, inh, t in row)

        self.beta = least(misfit, 0, most * (1 - 1e-6))

    def time(self, ini, inh):
        rest = ini ** self.power - (self.beta * inh) ** self.power
        return self.dose / rest ** (self.m / self.power) if rest > 0 else math.inf


class OxygenFirst:
    """t = A/Ib + B/sqrt(Ib - beta Iuv): oxygen is used up by the curing light alone, inhibiting light slows what comes after it.

    A for all amplitudes and a B for each to the cells without inhibiting light, beta to the row of 20 % of all amplitudes. With
    `both` inhibiting light slows the first part, too."""

    def __init__(self, cells, both=False):
        self.both = both
        alone = [(k, ini, t) for k, of in enumerate(cells) for ini, inh, t in of if inh == 0 and t]

        def best(a):
            """B of each amplitude for this A, and what is left: relative errors."""
            b, left = [], 0.0
            for k in range(len(cells)):
                pairs = [(1 / math.sqrt(ini) / t, 1 - a / ini / t) for k_, ini, t in alone if k_ == k]
                b.append(sum(x * y for x, y in pairs) / sum(x * x for x, _ in pairs))
                left += sum((b[-1] * x - y) ** 2 for x, y in pairs)
            return b, left

        self.a = least(lambda a: best(a)[1], 0, min(ini * t for _, ini, t in alone))
        self.b, left = best(self.a)
        freedom = len(alone) - 1 - len(cells)
        self.factor = math.exp(student_t(freedom) * math.sqrt(left / freedom))
        row = [(k, inh, t) for k, of in enumerate(cells) for ini, inh, t in of if ini == 20 and inh > 0]

        def misfit(beta):
            self.beta = beta
            return sum(math.log(self.time(20, inh, k) / t) ** 2 if t else math.log(min(1.0, self.time(20, inh, k) / END_S)) ** 2 for k, inh, t in row)

        self.beta = least(misfit, 0, 20 / max(inh for _, inh, t in row if t) * (1 - 1e-6))

    def time(self, ini, inh, k):
        rest = ini - self.beta * inh
        return self.a / (rest if self.both else ini) + self.b[k] / math.sqrt(rest) if rest > 0 else math.inf

    def of(self, k):
        """The law of one amplitude."""
        return types.SimpleNamespace(m=None, beta=self.beta, factor=self.factor, time=lambda ini, inh: self.time(ini, inh, k))


def judge(law, cells):
    asked = [c for c in cells if c[0] not in (0, 20) and c[1] > 0]
    right, errors = 0, []
    for ini, inh, t in asked:
        told = law.time(ini, inh)
        right += (told <= END_S) == (t is not None)
        if t is not None and told < math.inf:
            errors.append(math.log(told / t))
    return {"right": right, "asked": len(asked), "ln_time_rms": rms(errors), "ln_time_bias": mean(errors), "m": law.m, "beta": law.beta,
            "band_factor": law.factor, "in_band": sum(abs(e) <= math.log(law.factor) for e in errors), "timed": len(errors)}


def two_lights(programs, data):
    _, rows = read_table(data / "02_pegda_dual_wavelength_times.csv")
    table = Table(["amplitude", "law", "m", "beta", "cells right, cured or not", "ln(time): rms", "bias", "within its band of 95 %"], [])
    panels, figures, checked = [], {}, 0
    amplitudes = (("time_a01_s", 0.1), ("time_a03_s", 0.3), ("time_a05_s", 0.5))
    of_all = [[(r.number("ini_percent"), r.number("inh_percent"), r.above_zero(column) if r[column] else None) for r in rows] for column, _ in amplitudes]
    oxygen_first, both = OxygenFirst(of_all), OxygenFirst(of_all, both=True)
    for k, (cells, (_, amplitude)) in enumerate(zip(of_all, amplitudes)):
        laws = {"subtraction": TwoLights(cells, 1), "squares": TwoLights(cells, 2), "both inhibited": both.of(k), "oxygen first": oxygen_first.of(k)}
        for name, law in laws.items():
            f = figures.setdefault(f"{amplitude:g}", {})[name] = judge(law, cells)
            if name == "oxygen first":
                f["a"], f["b"] = oxygen_first.a, oxygen_first.b[k]
            table.rows.append([f"{amplitude:g}", LABELS[name], figure(f["m"]), figure(f["beta"]), f"{f['right']} of {f['asked']}",
                               figure(f["ln_time_rms"], 2), figure(f["ln_time_bias"], 2), f"{f['in_band']} of {f['timed']}, a factor of {figure(f['band_factor'])}"])
        if amplitude == 0.3:
            checked = check_cells(programs, laws["subtraction"], cells)
        if amplitude != 0.1:
            panels.append(drawn_cells(amplitude, laws, cells))
    picture = Picture("two-lights", "Times to gel over inhibiting light, measured and told by the law", panels)
    worst = figures["0.3"]["subtraction"]

    def bias(name, pick):
        return pick(f[name]["ln_time_bias"] for f in figures.values())

    def right(name):
        return sum(f[name]["right"] for f in figures.values())

    def total(key):
        return sum(f["subtraction"][key] for f in figures.values())

    return Section(
        "two-lights", "Curing under pairs of lights",
        source="S. Klumpers, 2022, github.com/samuelhklumpers/mfi-photosynthetics (AGPL-3.0; facts): neat PEGDA, 11 x 11 pairs, one run each",
        known="both lights in per cent of the device's greatest; wavelengths, mW/cm² and thickness are not stated",
        fitted="dose and exponent m (or A, and B of each amplitude) to the ten cells without inhibiting light, beta to the row of 20 %",
        predicted="which of the other 90 cells cure within 2 s, and when",
        proves=f"the threshold is one straight line through the origin ({worst['right']} of {worst['asked']} cells right): inhibition subtracts",
        proves_not=f"times near the threshold by the law of the programs: they are {signed(100 * bias('subtraction', min))} to {signed(100 * bias('subtraction', max))} % "
                   "off in the mean, since weak inhibiting light delays less than is told, strong light more",
        tables=[table], pictures=[picture], figures=figures,
        notes=["What explains the times: oxygen is used up first, by the curing light alone, and only what comes after that is slowed. So inhibiting light "
               f"leaves A/Ib as it is. With fewer numbers fitted (5 in place of 9 for the three amplitudes) that law is {signed(100 * bias('oxygen first', min))} to "
               f"{signed(100 * bias('oxygen first', max))} % off in the mean, and tells {right('oxygen first')} of {3 * worst['asked']} cells right, the law of the programs "
               f"{right('subtraction')}. Where both parts are inhibited ({right('both inhibited')} cells right) the time to gel alone does not explain it. It is "
               "not built in: it rests on one set without mW/cm², and resins with a time to gel are not printed under inhibiting light here "
               "([gel-time.md](gel-time.md#what-it-does-not-do)). Where nothing gels, and where a dead zone comes to rest, are the same by both laws.",
               f"The band of the law of the programs, by the scatter of the cells without inhibiting light, holds {total('in_band')} of {total('timed')} times; "
               "it should hold 95 %.",
               f"{checked} cells were put to `resinctl predict`, which tells the same times to 1e-4."])


def check_cells(programs, law, cells):
    resin = programs.write("two-lights.toml", f"""name = "two-lights"
[cure]
model = "kinetic"
m = {law.m!r}
absorbance_height_um = 100000.0
absorbance_base = "e"
critical_dose_prime = {law.dose!r}
dose_factor = 5.0
[inhibition]
beta = {law.beta!r}
absorbance_height_um = 50000.0
absorbance_base = "e"
""")
    some = [c for c in cells if c[0] in (30, 60, 100) and c[1] in (10, 50, 80)]
    for ini, inh, _ in some:
        told, ours = window_time(programs, resin, ini, inh), law.time(ini, inh)
        if told is None or ours == math.inf:
            disagree(f"whether {ini}, {inh} gels", float(ours == math.inf), float(told is None), 0)
        else:
            disagree(f"time of {ini}, {inh}", ours, told, 1e-4 * ours)
    return len(some)


def drawn_cells(amplitude, laws, cells):
    panel = Panel(f"amplitude {amplitude:g}", "inhibiting light, % of the greatest", "time, s", log_y=True)
    for k, ini in enumerate((30, 60, 100)):
        panel.dots([(inh, t) for i, inh, t in cells if i == ini and t], f"measured, curing light {ini} %", k)
        steps = [100 * n / 200 for n in range(201)]
        for name, law in laws.items():
            points = [(x, law.time(ini, x)) for x in steps if law.time(ini, x) <= 2.5]
            if name == "subtraction":
                panel.band([(x, t / law.factor, t * law.factor) for x, t in points], "its band, 95 % of single times" if k == 0 else "", k)
            if name in ("subtraction", "oxygen first"):
                panel.line(points, LABELS[name] if k == 0 else "", k, dashed=name == "oxygen first")
    return panel


# Times at several intensities, without inhibiting light.


def fit_times(programs, times, name):
    table = "intensity_mw_cm2,time_s\n" + "".join(f"{i!r},{t!r}\n" for i, t in times)
    return programs.json("resinctl", "fit", programs.write(name + ".csv", table), "--model", "gel-time")


def one_time(times, told, light):
    """Scale from the times at one intensity, and what it leaves at the others."""
    scale = math.exp(mean([math.log(t / told[i]) for i, t in times if i == light]))
    return scale, [off(scale * told[i], t) for i, t in times if i != light]


def tuned_by_one_time(programs, times):
    """The shipped resin after `resinctl tune` with times at one intensity."""
    table = programs.write("one-time.csv", "intensity_mw_cm2,time_s\n" + "".join(f"{i!r},{t!r}\n" for i, t in times))
    tuned = programs.work / "bis-ema-here.toml"
    programs.run("resinctl", "tune", table, "--printer", programs.printer("any-printer", 10.0), "--resin", GEL_TIME_RESIN, "-o", tuned)
    return tuned


def bis_ema(programs, data):
    _, rows = read_table(data / "03_bisema_times_to_conversion.csv")
    at = [r for r in rows if r.number("conversion_percent") == 15]
    held = [(r.above_zero("intensity_mw_cm2"), r.above_zero("time_s")) for r in at if r["role"] == "held-out"]
    used = [(r.above_zero("intensity_mw_cm2"), r.above_zero("time_s")) for r in at if r["role"] != "held-out"]
    told = {i: window_time(programs, GEL_TIME_RESIN, i) for i in sorted({i for i, _ in held})}
    errors = [off(told[i], t) for i, t in held]
    tuned = tuned_by_one_time(programs, [(i, t) for i, t in held if i == 0.2])
    table = Table(["mW/cm²", "measured, s", "told by the shipped resin, s", "off", "after one time at 0.2 mW/cm², s", "off"], [])
    scale, rest = one_time(held, told, 0.2)
    for i in told:
        disagree(f"time at {i} mW/cm² after tuning", scale * told[i], window_time(programs, tuned, i), 1e-4 * told[i])
    for i, t in held:
        scaled = scale * told[i]
        table.rows.append([f"{i:g}", figure(t, 4), figure(told[i], 4), percent(off(told[i], t)), figure(scaled, 4),
                           "(used)" if i == 0.2 else percent(off(scaled, t))])
    left = fit_times(programs, used, "bis-ema").get("left_out")
    figures = {"absolute_errors": errors, "scale": scale, "after_one_time_errors": rest}
    second = Table(["mW/cm², left out", "measured, s", "A/i + B/sqrt(i), off", "one power, off"], [])
    if left:
        figures["left_out"] = {"gel_time": left["errors"], "power": left["power_errors"]}
        for (i, t), e, p in zip(used, left["errors"], left["power_errors"]):
            second.rows.append([f"{i:g}", figure(t, 4), percent(e), percent(p)])
    ratio = told[0.05] / told[0.2]
    measured = mean([t for i, t in held if i == 0.05]) / mean([t for i, t in held if i == 0.2])
    figures["ratio"] = {"told": ratio, "measured": measured}
    lights = [0.01 * (1.2 / 0.01) ** (k / 60) for k in range(61)]
    cure = tomllib.loads(GEL_TIME_RESIN.read_text())["cure"]
    a, b = cure["gel_a_mj_cm2"], cure["gel_b_sqrt_mw_cm2_s"]
    for i, t in told.items():
        disagree(f"time at {i} mW/cm²", a / i + b / math.sqrt(i), t, 1e-4 * t)
    panel = Panel("time to 15 % conversion", "light, mW/cm²", "time, s", log_x=True, log_y=True)
    panel.band([(i, (a / i + b / math.sqrt(i)) / LABORATORIES, (a / i + b / math.sqrt(i)) * LABORATORIES) for i in lights],
               f"a factor of {LABORATORIES:g}, as doses of 95 % of laboratories")
    panel.line([(i, a / i + b / math.sqrt(i)) for i in lights], "the shipped resin")
    panel.line([(i, scale * (a / i + b / math.sqrt(i))) for i in lights], f"the same, times {scale:.2f} (one time at 0.2 mW/cm²)", 1, dashed=True)
    panel.dots(used, "first experiment: the resin was fitted to it")
    panel.dots([(i, t, 6 if i == 0.05 else 4) for i, t in held], "second experiment, with its sampling step", 1, hollow=True)
    return Section(
        "bis-ema", "Times to conversion, in a second experiment",
        source="github.com/pcl-hub/DLP_GRIN (no licence; facts): Bis-EMA with TPO, infrared, two intensities, two runs each",
        known="nominal light; thickness and contact with air are not stated, and sampling makes times sure to 6 and 4 s",
        fitted="nothing: the resin is shipped as bis-ema-tpo-gel-time, fitted to the first experiment. Then one scale, to the times at 0.2 mW/cm²",
        predicted="times to 15 % conversion at 0.05 and 0.2 mW/cm²; in the first experiment each intensity by the three others",
        proves=f"the law: times stand as {figure(ratio)} to 1 for a quarter of the light, {figure(measured)} measured, and it predicts intensities "
               "that it was not fitted to better than one power does",
        proves_not=f"absolute times of another experiment: they are off by {percent(max(errors))} to {percent(min(errors))}. One time measured where "
                   "you print mends most of it",
        tables=[table] + ([second] if left else []), pictures=[Picture("bis-ema", "Times over light: both experiments and the shipped resin", [panel])],
        figures=figures)


def lab(programs, path, options):
    _, rows = read_table(path)
    sections = []
    for k, (name, group) in enumerate(groups_of(rows, "resin").items()):
        times = [(r.above_zero("intensity_mw_cm2"), r.above_zero("time_s")) for r in group]
        if len({i for i, _ in times}) < 2:
            raise BadInput(f"{path}: has times at one intensity; expected two or more")
        sections.append(lab_times(programs, path, options, (name, k, times)))
    return sections


def lab_times(programs, path, options, group):
    name, k, times = group
    found = fit_times(programs, times, f"times-{k}")
    told = {p["intensity_mw_cm2"]: p["predicted_s"] for p in found["points"]}
    left = found.get("left_out")
    table = Table(["mW/cm²", "measured, s", "fit, off", "left out, off", "one power, left out, off"], [])
    for n, (i, t) in enumerate(times):
        table.rows.append([f"{i:g}", figure(t, 4), percent(off(told[i], t)), percent(left["errors"][n]) if left else "-",
                           percent(left["power_errors"][n]) if left else "-"])
    figures = {"rms_error": found["rms_error"], "left_out_rms_error": left["rms_error"] if left else None}
    tables = [table]
    if options.resin:
        by_file = {i: window_time(programs, options.resin, i) for i in told}
        errors = [off(by_file[i], t) for i, t in times]
        light = sorted(told)[len(told) // 2]
        scale, rest = one_time(times, by_file, light)
        tables.append(Table(["mW/cm²", "measured, s", f"told by {options.resin}, s", "off"],
                            [[f"{i:g}", figure(t, 4), figure(by_file[i], 4), percent(off(by_file[i], t))] for i, t in times]))
        figures["file"] = {"rms_error": rms(errors), "bias": mean(errors), "scale": scale, "after_one_time_rms_error": rms(rest)}
    panel = Panel(name or "times", "light, mW/cm²", "time, s", log_x=True, log_y=True)
    a, b = (found["parameters"][n]["value"] for n in ("gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s"))
    low, high = min(told), max(told)
    panel.line([(i, a / i + b / math.sqrt(i)) for i in (low * (high / low) ** (n / 60) for n in range(61))], "A/i + B/sqrt(i), fitted to all")
    panel.dots(times, "measured")
    return Section(f"times-{k}", f"Times to gel{': ' + name if name else ''}", source=str(path), known="light and times, as the file tells them",
                   fitted="A and B of A/i + B/sqrt(i), to all times",
                   predicted="each intensity by a fit to all others; with --resin, all times by the resin's file, and by one time of yours",
                   proves="how far the time is off at an intensity that was not measured", proves_not="times in another setting",
                   tables=tables, pictures=[Picture(f"times-{k}", "Times over light, with the fitted law", [panel])], figures=figures)
