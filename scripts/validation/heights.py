# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Heights of cured resin: roofs, films, working curves."""
import math

from draw import Panel, Picture
from page import Section, Table, figure, signed
from reckon import (BadInput, disagree, fit_jacobs, gel_time_um, groups_of, jacobs_um, least, mean, read_table, rms, student_t)
from tried import tried

LAWS = ("jacobs", "gel-time", "bleaching")


class Height:
    """One measured height and what it was exposed to; light is 0 where only the dose is known."""

    def __init__(self, row):
        self.um = row.above_zero("cured_height_um")
        self.light = row.above_zero("intensity_mw_cm2") if row.get("intensity_mw_cm2") else 0.0
        self.time = row.above_zero("exposure_s") if row.get("exposure_s") else 0.0
        dose = row.above_zero("dose_mj_cm2") if row.get("dose_mj_cm2") else 0.0
        if not (dose or (self.light and self.time)):
            raise BadInput(f"{row.path}: line {row.line}: expected dose_mj_cm2, or intensity_mw_cm2 and exposure_s")
        self.dose = self.light * self.time if self.light and self.time else dose
        self.bar = row.optional("sigma_um", 0.0)
        role = row.get("role", "fit").lower() or "fit"
        if role not in ("fit", "validation"):
            raise BadInput(f"{row.path}: line {row.line}: role: is '{role[:40]}'; expected fit or validation")
        self.fit = role == "fit"


class Fit:
    """A law as `resinctl fit` finds it, and heights as `resinctl predict` tells them."""

    def __init__(self, programs, law, heights, name):
        self.programs, self.law = programs, law
        with_light = all(h.light for h in heights)
        head = "intensity_mw_cm2,exposure_s,cured_height_um\n" if with_light else "dose_mj_cm2,cured_height_um\n"
        lines = [f"{h.light!r},{h.time!r},{h.um!r}\n" if with_light else f"{h.dose!r},{h.um!r}\n" for h in heights]
        data = programs.write(f"{name}-{law}.csv", head + "".join(lines))
        self.resin = programs.work / f"{name}-{law}.toml"
        self.resin.unlink(missing_ok=True)
        self.found = programs.json("resinctl", "fit", data, "--model", law, "-o", self.resin)
        self.sigma = self.found["sigma_um"]
        self.freedom = len(heights) - self.found["free_parameters"]
        self.values = {n: p["value"] for n, p in self.found["parameters"].items()}
        if law == "jacobs":
            h, dc = fit_jacobs([(x.dose, x.um) for x in heights])
            disagree("absorbance height", h, self.values["h_um"], 1e-6 * h)
            disagree("dose of gel", dc, self.values["dc_mj_cm2"], 1e-6 * dc)

    def um(self, height):
        """The law in closed form; NaN where it has none."""
        v = self.values
        if self.law == "jacobs":
            return jacobs_um(v["h_um"], v["dc_mj_cm2"], height.dose)
        if self.law == "gel-time":
            return gel_time_um(v["h_um"], v["gel_a_mj_cm2"], v["gel_b_sqrt_mw_cm2_s"], height.light, height.time)
        return math.nan

    def told_um(self, height):
        """What `resinctl predict` tells of this exposure, held against the closed form."""
        light, time = (height.light, height.time) if height.light else (1.0, height.dose)
        told = self.programs.json("resinctl", "predict", "--resin", self.resin, "--blue-mw-cm2", repr(light), "--exposure-s",
                                  repr(time))["cured_height_um"]
        ours = self.um(height)
        # The resin file has six digits of each figure.
        if ours == ours and ours > 0:
            disagree(f"height after {time} s", ours, told, 1e-3 + 3e-4 * abs(ours))
        return told

    def band_um(self, dose):
        """Half of the band that holds 95 % of single measured heights: parameters and scatter (Jacobs' law)."""
        (a, b), (_, d) = self.found["covariance"]["matrix"]
        by_h, by_dc = math.log(dose / self.values["dc_mj_cm2"]), -self.values["h_um"] / self.values["dc_mj_cm2"]
        spread = a * by_h * by_h + 2 * b * by_h * by_dc + d * by_dc * by_dc + self.sigma ** 2
        return student_t(self.freedom) * math.sqrt(spread)


def fit_or_none(programs, law, heights, name):
    """Nothing where heights can't tell a law's parameters apart, which `resinctl fit` says with exit code 2."""
    try:
        return Fit(programs, law, heights, name)
    except BadInput:
        if law == "jacobs":
            raise
        return None


def errors_left_out(heights):
    """Of Jacobs' law: each setting of dose predicted by a fit to all the others."""
    errors = []
    for one in heights:
        h, dc = fit_jacobs([(x.dose, x.um) for x in heights if x.dose != one.dose])
        errors.append(jacobs_um(h, dc, one.dose) - one.um)
    return errors


def delayed(heights):
    """Jacobs' law of a time that begins late: the delay of the least squares, and its height at a dose."""
    light = heights[0].dose / heights[0].time
    first = min(h.time for h in heights)

    def law(delay):
        h, dc = fit_jacobs([((x.time - delay) * light, x.um) for x in heights])
        return lambda time: jacobs_um(h, dc, max(time - delay, 1e-9) * light)

    at = least(lambda d: sum((law(d)(x.time) - x.um) ** 2 for x in heights), 0, 0.98 * first)
    return at, law(at)


def compare(programs, heights, name):
    """Fit, left out, lower doses predict upper ones, fitted rows predict the others: errors are predicted - measured."""
    fitted = sorted((h for h in heights if h.fit), key=lambda h: h.dose)
    others = [h for h in heights if not h.fit]
    doses = sorted({h.dose for h in fitted})
    if len(doses) < 4:
        raise BadInput(f"{name}: has {len(doses)} different doses to fit to; expected 4 or more")
    middle = doses[(len(doses) + 1) // 2 - 1]
    lower, upper = [h for h in fitted if h.dose <= middle], [h for h in fitted if h.dose > middle]
    result = {"n": len(fitted), "others": len(others)}
    first = Fit(programs, "jacobs", fitted, name)
    left = first.found.get("left_out")
    if left:
        told = {law["model"]: law for law in left["laws"]}
        disagree("heights left out, rms", rms(errors_left_out(fitted)), told["jacobs"]["left_out_rmse_um"], 1e-6 * (1 + rms(errors_left_out(fitted))))
        result["trust"] = left["trust"]
    fits = {}
    if all(h.light for h in fitted) and len({h.light for h in fitted}) == 1 and len(lower) > 3:
        fit_errors = [delayed(fitted)[1](h.time) - h.um for h in fitted]
        late = [delayed(lower)[1](h.time) - h.um for h in upper]
        result["delay"] = {"delay_s": delayed(fitted)[0], "fit_rms_um": rms(fit_errors), "upper_rms_um": rms(late)}
    for law in LAWS:
        if left and law not in told:
            continue
        if not left and law != "jacobs":
            continue
        if law == "bleaching":
            # Four parameters often can't be told of so few heights; what it predicts is in the fit's comparison.
            result[law] = {"left_out_rms_um": told[law]["left_out_rmse_um"]}
            continue
        one = fits[law] = first if law == "jacobs" else fit_or_none(programs, law, fitted, name)
        if one is None:
            del fits[law]
            result[law] = {"left_out_rms_um": told[law]["left_out_rmse_um"]}
            continue
        r = result[law] = {"fit_rms_um": one.found["rmse_um"], **{k: one.values[k] for k in one.values}}
        r["left_out_rms_um"] = told[law]["left_out_rmse_um"] if left else rms(errors_left_out(fitted))
        low = fit_or_none(programs, law, lower, name + "-lower") if len(lower) > one.found["free_parameters"] else None
        if low:
            errors = [low.um(h) - h.um for h in upper]
            r["upper_rms_um"], r["upper_bias_um"] = rms(errors), mean(errors)
            if law == "jacobs" and low.freedom > 0:
                result["upper_in_band"] = sum(abs(e) <= low.band_um(h.dose) for e, h in zip(errors, upper))
                result["upper"] = len(upper)
        if others:
            errors = [one.told_um(h) - h.um for h in others]
            r["others_rms_um"], r["others_bias_um"] = rms(errors), mean(errors)
            if law == "jacobs":
                result["others_in_band"] = sum(abs(e) <= one.band_um(h.dose) for e, h in zip(errors, others))
    return result, fits


def drawn(title, heights, fits):
    low, high = min(h.dose for h in heights), max(h.dose for h in heights)
    doses = [low * (high / low) ** (k / 60) for k in range(61)]
    panel = Panel(title, "dose at the window, mJ/cm²", "cured height, um", log_x=high > 4 * low)
    one = fits["jacobs"]
    at = [(d, jacobs_um(one.values["h_um"], one.values["dc_mj_cm2"], d)) for d in doses]
    panel.band([(d, z - one.band_um(d), z + one.band_um(d)) for d, z in at], "95 % of single heights, by the fit")
    panel.line(at, "Jacobs' law, fitted to the full points")
    lights = {h.light for h in heights}
    if "gel-time" in fits and len(lights) == 1 and lights != {0.0}:
        light = next(iter(lights))
        v = fits["gel-time"].values
        panel.line([(d, gel_time_um(v["h_um"], v["gel_a_mj_cm2"], v["gel_b_sqrt_mw_cm2_s"], light, d / light)) for d in doses],
                   "gel-time law, fitted to the same", 1, dashed=True)
    panel.dots([(h.dose, h.um, h.bar) for h in heights if h.fit], "measured, fitted to")
    panel.dots([(h.dose, h.um, h.bar) for h in heights if not h.fit], "measured, predicted", 1, hollow=True)
    return panel


def rows_of(name, result):
    def error(r, key):
        return f"{figure(r[key + '_rms_um'])} ({signed(r[key + '_bias_um'])})" if key + "_rms_um" in r else "-"
    for law in LAWS:
        if law not in result:
            continue
        r = result[law]
        trusted = ", trusted" if result.get("trust") == law else ""
        yield [name, result["n"], law + trusted, figure(r.get("h_um")), figure(r.get("fit_rms_um")), figure(r["left_out_rms_um"]), error(r, "upper"),
               f"{error(r, 'others')}, {result['others']} heights" if "others_rms_um" in r else "-"]


HEAD = ["resin", "heights", "law", "h, um", "fit, rms um", "left out, rms um", "upper doses from lower: rms (bias) um", "others: rms (bias) um"]


def section(programs, key, title, path, texts, name_of=lambda n: n):
    """Heights of one file, by resin."""
    heads, rows = read_table(path)
    if "cured_height_um" not in heads:
        raise BadInput(f"{path}: header: expected a column cured_height_um")
    table, panels, figures = Table(HEAD, []), [], {}
    pooled = {law: {"left": [], "upper": []} for law in LAWS}
    for k, (name, group) in enumerate(groups_of(rows, "resin").items()):
        heights = [Height(r) for r in group]
        result, fits = compare(programs, heights, f"{key}-{k}")
        label = name_of(name) or "all"
        table.rows += rows_of(label, result)
        panels.append(drawn(label, heights, fits))
        figures[label] = result
        for law in LAWS:
            if law in result:
                pooled[law]["left"] += [result[law]["left_out_rms_um"]] * result["n"]
                if all("upper_rms_um" in result.get(one, {}) for one in ("jacobs", "gel-time")) and law != "bleaching":
                    pooled[law]["upper"].append(result[law]["upper_rms_um"])
    for law in LAWS:
        if pooled[law]["left"]:
            figures.setdefault("pooled", {})[law] = {"left_out_rms_um": rms(pooled[law]["left"])}
            if pooled[law]["upper"]:
                figures["pooled"][law]["upper_rms_um_where_both_fit"] = rms(pooled[law]["upper"])
    picture = Picture(key, f"{title}: measured heights over dose, with the fitted law and its band", panels[:8])
    return Section(key, title, tables=[table], pictures=[picture], figures=figures, **texts)


def held_against_file(programs, path, options):
    """Nothing fitted: what `resinctl predict` tells of a resin's file."""
    table, errors = Table(["mJ/cm²", "measured, um", f"told by {options.resin}, um", "off, um"], []), []
    for r in read_table(path)[1]:
        h = Height(r)
        light, time = (h.light, h.time) if h.light else (1.0, h.dose)
        told = programs.json("resinctl", "predict", "--resin", options.resin, "--blue-mw-cm2", repr(light), "--exposure-s", repr(time))["cured_height_um"]
        # Below gel there is no height.
        errors.append((told or 0.0) - h.um)
        table.rows.append([figure(h.dose, 4), figure(h.um), figure(told or 0.0), f"{errors[-1]:+.1f}"])
    return table, {"rms_um": rms(errors), "bias_um": mean(errors), "n": len(errors)}


def lab(programs, path, options):
    texts = dict(source=str(path), known="light, times or doses, and heights, as the file tells them",
                 fitted="each law, to the rows whose role is fit (all, where no role is given)",
                 predicted="each dose by a fit to all other doses; the upper doses by a fit to the lower ones; rows whose role is validation",
                 proves="how far a height is off that this resin was not measured at, on this printer, on that day",
                 proves_not="what another day, printer or bottle adds, unless rows of another print have the role validation")
    s = section(programs, "heights", "Cured heights", path, texts)
    s.notes += band_note(s.figures)
    if options.resin:
        table, figures = held_against_file(programs, path, options)
        s.tables.append(table)
        s.figures["file"] = figures
        s.notes.append(f"With {options.resin} as its file stands, nothing fitted: rms {figure(figures['rms_um'])} um, bias {signed(figures['bias_um'])} um.")
    return s


def band_note(figures):
    inside = sum(r.get("others_in_band", 0) for n, r in figures.items() if n not in ("pooled", "file"))
    others = sum(r["others"] for n, r in figures.items() if n not in ("pooled", "file"))
    upper_in = sum(r.get("upper_in_band", 0) for n, r in figures.items() if n not in ("pooled", "file"))
    upper = sum(r.get("upper", 0) for n, r in figures.items() if n not in ("pooled", "file"))
    notes = []
    if upper:
        notes.append(f"The band of a fit to the lower doses holds {upper_in} of {upper} upper heights; it should hold 95 %.")
    if others:
        notes.append(f"The band of the fit holds {inside} of {others} heights that were not fitted.")
    return notes


def roofs(programs, data):
    texts = dict(
        source="B. Liertz, 2025, [openSLAice](https://github.com/bennibuild/mmft-openSLAice) (MIT), on an Anycubic Photon Mono 4 Ultra, "
               "microscope, four readings a roof",
        known="light at the film (1.938 mW/cm² at 400 nm), times, layers of 50 um; roofs of one layer over a void, exposed once",
        fitted="absorbance height and dose of gel, to print A of each resin",
        predicted="each roof by the others; the longer exposures by the shorter ones; print B, made apart, by print A",
        proves="a roof on a printer whose resin was measured there, that day, is predicted to some um, and the lines of three or "
               "four parameters predict left-out roofs no better, or little",
        proves_not="exponent of intensity (one intensity), channels under a roof of many layers, other days: the author left out roofs that "
                   "failed, and print B is there for one resin")
    s = section(programs, "roofs", "Roofs of one layer on an LCD printer", data / "01_openslaice_membranes.csv", texts)
    s.notes += band_note(s.figures)
    trusted = [r.get("trust") for n, r in s.figures.items() if n != "pooled"]
    s.notes.append(f"`resinctl fit` trusts Jacobs' law for {trusted.count('jacobs')} of {len(trusted)} resins"
                   + "".join(f", {law} for {trusted.count(law)}" for law in LAWS[1:] if law in trusted)
                   + ". Rms of all roofs left out, um: " + ", ".join(f"{law} {figure(r['left_out_rms_um'])}" for law, r in s.figures["pooled"].items()) + ".")
    late = [(n, r["delay"]["upper_rms_um"], r["jacobs"]["upper_rms_um"]) for n, r in s.figures.items() if "delay" in r]
    s.notes.append("A delay (light that begins to count some time after it is on) was tried, too. It is not built in, because it predicts longer "
                   "exposures no better, or far worse; rms um, and that of Jacobs' law: "
                   + "; ".join(f"{n} {figure(a, 2)} ({figure(b, 2)})" for n, a, b in late) + ".")
    table, s.figures["tried"] = tried(roof_times(data / "01_openslaice_membranes.csv"))
    s.tables.append(table)
    first, *more = s.figures["tried"].values()
    first, *more = s.figures["tried"].values()
    low, high = (f(r["left_out_rms_um"] for r in more) for f in (min, max))
    least = min(s.figures["tried"].values(), key=lambda r: r["left_out_rms_um"])
    apart = first["left_out_rms_um"] ** 2 - least["left_out_rms_um"] ** 2
    s.notes.append("Oxygen, as a threshold or by diffusion, and a delay that all resins share were tried with as many parameters as Jacobs' law has. "
                   f"None is built in: left-out roofs come out {figure(low, 2)} to {figure(high, 2)} um off in place of {figure(first['left_out_rms_um'], 2)} "
                   f"(mean squares differ by {figure(apart, 2)} um² at most, and are known to {figure(least['left_out_squares_error'], 2)} um²), and the "
                   f"other print by {figure(min(r['others_rms_um'] for r in more))} to {figure(max(r['others_rms_um'] for r in more))} um in place of "
                   f"{figure(first['others_rms_um'])}. Of oxygen, 1e-10 to 1e-9 m²/s and shares of 0.5 and 0.8 were tried; the table has the pair that "
                   "predicted best; the others differ as little, but for 1e-9 m²/s through the window, which is far off for short exposures.")
    s.notes.append("Light that spreads can't bend these curves: it takes the same share of the light from the middle of a roof of 1 mm at each exposure, so "
                   f"the dose of gel takes it up. To be worth a um it would have to spread by 190 um (standard deviation; {figure(100 * lost_in_the_middle(1000, 190), 1)} % "
                   "of the light), eleven pixels of this printer.")
    return s


def roof_times(path):
    """Times and heights of each resin: those to fit in order of times, and those of the other print."""
    groups = []
    for rows in groups_of(read_table(path)[1], "resin").values():
        points = [(r.above_zero("exposure_s"), r.above_zero("cured_height_um"), r["role"] == "fit") for r in rows]
        groups.append((sorted((t, um) for t, um, fit in points if fit), [(t, um) for t, um, fit in points if not fit]))
    return groups


def lost_in_the_middle(width_um, sigma_um):
    """Share of its light that the middle of a long strip loses to the dark beside it."""
    return math.erfc(width_um / 2 / sigma_um / math.sqrt(2))


def working_curve(programs, data):
    texts = dict(
        source="DA-2 with 0.7 % PPO, read from a figure of github.com/pcl-hub/DLP_model_v1.2 (no licence; facts)",
        known="doses; the light is not stated, and doses fall on two series, so probably two intensities are mixed",
        fitted="absorbance height and dose of gel",
        predicted="each dose by the others; the six higher doses by the seven lower ones; all by the authors' own 550 um and 5.6 mJ/cm²",
        proves="Jacobs' law goes on from a quarter to one and a half millimetre with errors of some per cent",
        proves_not="heights of roofs: these are thick films on glass")
    path = data / "10_da2_working_curve.csv"
    s = section(programs, "working-curve", "A working curve of thick films", path, texts, lambda n: n or "DA-2")
    points = [(r.above_zero("dose_mj_cm2"), r.above_zero("cured_height_um")) for r in read_table(path)[1]]
    errors = [jacobs_um(550, 5.6, dose) - um for dose, um in points]
    s.figures["authors"] = {"rms_um": rms(errors), "bias_um": mean(errors)}
    s.notes += band_note({k: v for k, v in s.figures.items() if k != "authors"})
    s.notes.append(f"The authors' own parameters, nothing fitted: rms {figure(rms(errors))} um, bias {signed(mean(errors))} um, over all 13 heights.")
    return s
