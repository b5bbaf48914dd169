# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Channels, fins, oxygen, and how far laboratories are apart."""
import json
import math
import re

from draw import Panel, Picture
from page import Section, Table, figure
from programs import ROOT, box, write_stl
from reckon import BadInput, Disagrees, Line, disagree, least, mean, read_table, rms

# Heights of absorbance of the channel's resin, um, and layers over it: more would add less than a thousandth of the dose.
HEIGHT_UM, ROOF = 100.0, 8.0
EXCHANGED = {0: "nothing", 0.5: "half", 1: "all"}


def closed_channel(layer, far_edge_dose, exchange):
    """Depth below a roof of many layers that gels, in absorbance heights: layers in heights, doses in gel doses.

    Layer j of the roof leaves far_edge_dose a^j where the channel begins, a = e^-layer; a lift leaves 1 - exchange of it.
    """
    a, dose, most = math.exp(-layer), 0.0, 0.0
    for j in range(math.ceil(ROOF / layer)):
        dose = dose * (1 - exchange) + far_edge_dose * a ** j
        most = max(most, dose)
    return math.log(most)


class Channels:
    """Blocks with a channel, sliced and judged by the programs as printed, layer by layer."""

    def __init__(self, programs):
        self.programs = programs
        self.printer = programs.printer("channel-printer", 100.0)
        self.resin = programs.write("channel.toml", f"""name = "channel"
[cure]
model = "jacobs"
absorbance_height_um = {HEIGHT_UM}
absorbance_base = "e"
gel_dose_mj_cm2 = 10
""")

    def target(self, layer, open_layers):
        um = layer * HEIGHT_UM
        low, top, all_ = 4 * um / 1000, (4 + open_layers) * um / 1000, (4 + open_layers + math.ceil(ROOF / layer)) * um / 1000
        walls = [box((0, 0.2), (0, 0.3), (0, all_)), box((0.4, 0.6), (0, 0.3), (0, all_))]
        inside = [box((0.2, 0.4), (0, 0.3), (0, low)), box((0.2, 0.4), (0, 0.3), (top, all_))]
        part = write_stl(self.programs.work / "channel.stl", (t for b in walls + inside for t in b))
        stack = self.programs.work / "channel.uvj"
        self.programs.run("slicecorr", "slice", part, "-o", stack, "--printer", self.printer, "--layer-um", um)
        return stack

    def is_open(self, layer, open_layers, dose, exchange, correct=False):
        target = self.target(layer, open_layers)
        light = ["--printer", self.printer, "--resin", self.resin, "--mode", "layerwise", "--exposure-s", dose * math.exp(layer) * 10 / 100,
                 "--lift-exchange", exchange]
        if not correct:
            told = self.programs.json("slicecorr", "verify", target, "--target", target, *light)
        else:
            stack = self.programs.work / "channel-corrected.uvj"
            self.programs.run("slicecorr", "correct", target, "-o", stack, *light, expected=(0, 5))
            told = self.programs.json("slicecorr", "verify", stack, "--target", target)
        return told["merged_features"] == 0

    def least_open(self, layer, dose, exchange, correct=False):
        """Fewest layers of a channel that stays open, by halves: a higher one is open, too."""
        low, high = 0, max(2, math.ceil(6 / layer))
        if not self.is_open(layer, high, dose, exchange, correct):
            return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.is_open(layer, middle, dose, exchange, correct) else (middle, high)
        return high


def channels(programs, data):
    rows = [r for r in read_table(data / "13_numbers_from_abstracts.csv")[1] if r["source"].startswith("Gong")]
    measured = next(r["value"] for r in rows if r["quantity"] == "smallest height / ha")
    made, table, figures = Channels(programs), Table(["layer / ha", "dose at its far edge, gel doses", "lifts exchange", "least channel / ha", "closed form: depth that gels / ha", "corrected: least / ha"], []), []
    points = {}
    for layer in (0.3, 0.5, 1.0):
        for dose, exchange in ((1.2, 0), (5, 0), (5, 0.5), (5, 1)):
            count, depth = made.least_open(layer, dose, exchange), closed_channel(layer, dose, exchange)
            # A channel is open where it is higher than what gels below its roof.
            expected = math.floor(depth / layer) + 1
            disagree(f"layers of the least channel, layer {layer}, dose {dose}, exchange {exchange}", expected, count, 0)
            corrected = made.least_open(layer, dose, exchange, True) if dose == 5 else None
            figures.append({"layer": layer, "dose": dose, "exchange": exchange, "least": count * layer, "depth": depth,
                            "corrected": corrected * layer if corrected else None})
            points.setdefault((dose, exchange), []).append((layer, count * layer))
            table.rows.append([f"{layer:g}", f"{dose:g}", EXCHANGED[exchange], figure(count * layer), figure(depth),
                               figure(corrected * layer) if corrected else "-"])
    low, high = (float(v) for v in measured.split("-"))
    panel = Panel("least roofed channel", "layer, absorbance heights", "channel, absorbance heights")
    panel.band([(0.3, low, high), (1.0, low, high)], f"measured, {measured} (Gong 2015)", 1)
    for k, ((dose, exchange), at) in enumerate(points.items()):
        # Side by side, where they are equal.
        panel.dots([(layer + 0.012 * k, channel) for layer, channel in at], f"told: {dose:g} gel doses at each layer's far edge, lifts exchange {EXCHANGED[exchange]}", k)
    five = [f["least"] for f in figures if f["dose"] == 5 and f["exchange"] == 0]

    def left(height):
        """Per cent of the gel dose that resin at this depth below a roof got, of all layers."""
        shares = [100 * math.exp(f["depth"] - height) for f in figures if f["dose"] == 5 and f["exchange"] == 0]
        return f"{min(shares):.0f} to {max(shares):.0f}"

    return Section(
        "channels", "The least roofed channel",
        source="Gong et al., RSC Advances 5 (2015), doi:10.1039/C5RA23855B: figures of the abstract",
        known="nothing but the rule: heights are told in absorbance heights",
        fitted="nothing. Doses of 1.2 gel doses at a layer's far edge (just enough to hold) and of 5 (the dissertation's best) stand for what printers give",
        predicted="the lowest channel under a roof of 8 absorbance heights that stays open, layer by layer, as sliced and corrected",
        proves=f"that channels are limited by absorbance heights, not by layers: at five gel doses, with resin that lifts leave, "
               f"{figure(min(five))}{'' if min(five) == max(five) else ' to ' + figure(max(five))} absorbance heights for all layers, as sliced",
        proves_not=f"the measured {measured}: they are higher. Doses of {figure(math.exp(low) * (1 - math.exp(-0.3)), 2)} (layers of 0.3 heights) to "
                   f"{figure(math.exp(low) * (1 - math.exp(-1)), 2)} (of 1) at the far edge would explain the lower end. So would resin that thickens before it "
                   f"gels and is not washed out: at five gel doses from {left(low)} % of the gel dose on for {low:g} heights, from {left(high)} % on for {high:g}. "
                   "The abstract says neither doses nor how channels were washed, so nothing is built in. Where lifts exchange resin channels would be lower still",
        tables=[table], pictures=[Picture("channels", "Least channel over layer height, told and measured", [panel])], figures={"rows": figures, "measured": [low, high]})


def lab_channels(programs, path, _options):
    _, rows = read_table(path)
    made, errors = Channels(programs), []
    table = Table(["layer, um", "measured, um", "told, um", "off, um"], [])
    for r in rows:
        ha, layer = r.above_zero("absorbance_height_um"), r.above_zero("layer_um")
        dose, exchange = r.above_zero("far_edge_dose"), r.optional("lift_exchange", 0.0)
        if not 0 <= exchange <= 1:
            raise BadInput(f"{path}: line {r.line}: lift_exchange: expected a number from 0 to 1")
        if not 0.05 <= layer / ha <= 3:
            raise BadInput(f"{path}: line {r.line}: a layer of {layer / ha:g} absorbance heights; expected 0.05 to 3 (base e)")
        count = made.least_open(layer / ha, dose, exchange)
        if count is None:
            table.rows.append([f"{layer:g}", f"{r.above_zero('open_um'):g}", "above 6 absorbance heights", "-"])
            continue
        errors.append(count * layer - r.above_zero("open_um"))
        table.rows.append([f"{layer:g}", f"{r.above_zero('open_um'):g}", f"{count * layer:g}", f"{errors[-1]:+g}"])
    if not errors:
        raise BadInput(f"{path}: no channel of these could be told")
    return [Section("channels", "Least roofed channels", source=str(path), known="layers, absorbance heights, doses at the far edge of a layer",
                    fitted="nothing", predicted="the least channel that stays open, in whole layers",
                    proves="whether doses below a roof add up as told", proves_not="washing; light that spreads",
                    tables=[table], figures={"rms_um": rms(errors), "bias_um": mean(errors), "n": len(errors)})]


PLANE_HEADS = ("as designed", "as they stand", "the same as half of each fin gels", "as 95 % of each fin gels", "near the vial's axis")


def fins(_programs, data):
    """The figures of docs/tomography.md, which scripts/tomo-optics makes in some minutes."""
    rows = [r for r in read_table(data / "07_webber_prints.csv")[1] if "fins" in r["measure"]]
    text = (ROOT / "docs/tomography.md").read_text()
    told = {m[1].strip(): m[2] for m in re.finditer(r"^\|([^|]+)\|(?:[^|]*\|){4} (\d of 9) \|", text, re.M)}
    pairs = (("level light", "level light"), ("ray-corrected", "as it is"))
    table, figures = Table(["frames found for", "measured", "told"], []), {}
    for start, row_name in pairs:
        measured = next(r["value"] for r in rows if r["projections"].startswith(start))
        if row_name not in told:
            raise Disagrees(f"docs/tomography.md has no row '{row_name}' with fins")
        table.rows.append([start, measured, told[row_name]])
        figures[start] = {"measured": int(measured[0]), "told": int(told[row_name][0])}
    heads, plane = PLANE_HEADS, {}
    for m in re.finditer(r"^\| ((?:filtered back projection|OSMO)[^|]*) \|((?: \d \|){5})$", text, re.M):
        plane[m[1]] = [int(v) for v in re.findall(r"\d", m[2])]
    if len(plane) != 2:
        raise Disagrees(f"docs/tomography.md has {len(plane)} rows of light that is corrected in its plane; expected 2")
    second = Table(["level light corrected in its plane, found by", *heads], [[name, *(f"{v} of 9" for v in row)] for name, row in plane.items()])
    figures["in plane"] = plane
    panel = Panel("level light corrected in its plane", "how they are counted (column of the table)", "fins that are right")
    panel.line([(1, 3), (5, 3)], "measured, 3 of 9", 4, dashed=True)
    for k, (name, row) in enumerate(plane.items()):
        panel.dots([(1 + n + 0.06 * k, v) for n, v in enumerate(row)], f"told, {name}", k)
    like_his = [v for row in plane.values() for v in row[1:4]]
    return Section(
        "fins", "Fins in a vial, with level light and with rays",
        source="D. Webber et al., Optics Express 31 (2023), text (facts)",
        known="vial, throw, pixel, index; that level light was corrected in its plane and found by filtered back projection, and that printing stopped when "
              "all nine fins had formed. Neither dose nor how far fins reach from the axis is stated; 5 mm are taken",
        fitted="nothing; the threshold is that of the best Jaccard index, or the dose at which all nine fins have formed",
        predicted="which of nine fins print right (docs/tomography.md; scripts/tomo-optics reckons it anew in half an hour)",
        proves="light found for the rays that there are prints all nine, as measured. Level light has fins at 0.958 of their heights and smears them away from "
               "the axis: where they stand 3 of 9 are among what is told, and near the axis all nine are, as the paper's photograph shows",
        proves_not=f"that it is 3 and not another number: {min(like_his)} to {max(like_his)} are told, by the dose at which printing stops and by how light was found. "
                   "Looked for at the heights at which they are designed, one fin is right, with whichever level light",
        tables=[table, second], pictures=[Picture("fins", "Fins that are right by how they are counted, told and measured", [panel])], figures=figures)


def oxygen(programs, data):
    """Scaling of two laws of oxygen, by `resinctl chemistry`."""
    def told(light, *more):
        return programs.json("resinctl", "chemistry", "model-hydrogel", "--intensity-mw-cm2", repr(light), *more)

    lights = [0.4, 0.8, 1.2, 1.6]
    threshold = told(10.0, "--oxygen-supply-per-s", "0.001")["threshold_intensity_mw_cm2"] / 0.001
    supply = 0.2 / threshold
    table = Table(["law", "measured", "told"], [])
    points = [(i, 1 / told(i, "--oxygen-supply-per-s", repr(supply))["closed"]["t_inh_supplied_s"]) for i in lights]
    without = [(i, 1 / told(i)["closed"]["t_inh_s"]) for i in lights]
    supplied, still = Line(points), Line(without)
    at = -supplied.at / supplied.slope
    kelly = read_table(data / "08_kelly_inhibition.csv")[1]
    table.rows.append(["1/t over light, straight: R²", next(r["value"] for r in kelly if "R2" in r["quantity"]), f"{supplied.r2:.4f}"])
    table.rows.append(["where it meets 0, mW/cm²", next(r["value"] for r in kelly if "threshold" in r["quantity"]), f"{figure(at)} (threshold set to 0.2)"])
    table.rows.append(["the same without supply of oxygen", "-", figure(abs(still.at / still.slope), 1)])
    panel = Panel("inhibition", "light, mW/cm²", "1/t, 1/s")
    wide = [0.21 + 0.07 * n for n in range(20)]
    panel.line([(i, 1 / told(i, "--oxygen-supply-per-s", repr(supply))["closed"]["t_inh_supplied_s"]) for i in wide], "told, oxygen comes back")
    panel.line([(max(at, 0.0), 0.0), (1.6, supplied(1.6))], "straight line through 0.4 to 1.6 mW/cm²", 1, dashed=True)
    panel.dots([(0.2, 0.0)], "measured threshold", 4)
    zones = [(i, told(i)["dead_zone_um"]["even_light"]) for i in (1.0, 10.0, 100.0)]
    slope = Line([(math.log(i), math.log(z)) for i, z in zones]).slope
    disagree("exponent of the dead zone", -0.5, slope, 0.005)
    air = told(10.0)["dead_zone_um"]
    pure = told(10.0, "--wall-oxygen-mol-l", repr(5 * air["wall_oxygen_mol_l"]))["dead_zone_um"]["even_light"] / air["even_light"]
    table.rows.append(["exponent of light in a dead zone of oxygen (Tumbleston)", "-0.5", f"{slope:.3f}"])
    table.rows.append(["dead zone in pure oxygen to that in air", "about 2", f"{pure:.2f}"])
    return Section(
        "oxygen", "Oxygen: thresholds and dead zones",
        source="B. Kelly, thesis, Berkeley 2018; Tumbleston et al., Science 347 (2015): figures of the text (facts)",
        known="shapes of two laws", fitted="one rate of supply, so that the threshold is Kelly's 0.2 mW/cm²",
        predicted="1/t of inhibition over 0.4 to 1.6 mW/cm²; how a dead zone of oxygen goes with light and with oxygen",
        proves="exponents: a dead zone goes as one over the root of light and as the root of oxygen",
        proves_not="sizes: no row has a thickness in um that could be reckoned without the authors' constants. With oxygen that comes back 1/t "
                   "bends near its threshold, so that the line through 0.4 to 1.6 mW/cm² meets 0 at about half of it",
        tables=[table], pictures=[Picture("oxygen", "One over the time of inhibition over light, told with oxygen that comes back", [panel])],
        figures={"supplied_r2": supplied.r2, "threshold": at, "dead_zone_exponent": slope, "pure_oxygen_ratio": pure})


def laboratories(_programs, data):
    """How far published heights and doses of one resin are apart."""
    rows = read_table(data / "12_published_parameters_and_films.csv")[1]
    spread = {q: next(float(r["value"].rstrip("x")) for r in rows if r["quantity"] == q + " spread") for q in ("Dp", "Ec")}
    # The range of 24 normal values is 3.90 standard deviations in the mean.
    table, figures = Table(["figure", "highest over lowest of 24 laboratories", "standard deviation of its logarithm", "95 % within a factor of"], []), {}
    for q, words in (("Dp", "absorbance height (base e)"), ("Ec", "dose of gel")):
        sd = math.log(spread[q]) / 3.895
        figures[q] = {"ratio": spread[q], "sd_ln": sd, "factor95": math.exp(1.96 * sd)}
        table.rows.append([words, f"{spread[q]:g}", figure(sd, 2), figure(math.exp(1.96 * sd), 2)])
    return Section(
        "laboratories", "How far laboratories are apart",
        source="NIST interlaboratory study, Additive Manufacturing 2024 (PMC10986335), abstract: one resin, 24 laboratories",
        known="highest over lowest value", fitted="nothing; logarithms are taken to scatter normally",
        predicted="nothing: this is the yardstick of a resin from a database, which nobody measured on your printer",
        proves="a height or dose of another laboratory says the order of magnitude. A common way of measuring left 5 to 20 %",
        proves_not="how far a day, a bottle or a lamp of your own moves it",
        tables=[table], figures=figures)


def lab_lines(programs, path, _options):
    """Printed widths of lines and gaps: spread and dose from the rows to fit, widths of the others."""
    _, rows = read_table(path)
    fitted = [r for r in rows if (r.get("role") or "fit") == "fit"]
    others = [r for r in rows if (r.get("role") or "fit") != "fit"]
    head = "kind,designed_um,printed_um\n"
    table = head + "".join(f"{r['kind']},{r.above_zero('designed_um')!r},{r.number('printed_um', 0)!r}\n" for r in fitted)
    found = programs.json("resinctl", "fit-spread", programs.write("lines.csv", table))
    values = {n: p["value"] for n, p in found["parameters"].items()}
    sigma, dose, dark = values["sigma_um"], values["dose"], values.get("dark", 0.0) or 0.0

    def width(kind, designed):
        def light(x):
            inside = 0.5 * (math.erf((designed / 2 - x) / (sigma * math.sqrt(2))) + math.erf((designed / 2 + x) / (sigma * math.sqrt(2))))
            return dose * (dark + (1 - dark) * (inside if kind == "line" else 1 - inside))
        gelled = (lambda x: light(x) >= 1) if kind == "line" else (lambda x: light(x) < 1)
        if not gelled(0.0):
            return 0.0
        low, high = 0.0, designed / 2 + 8 * sigma
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if gelled(middle) else (low, middle)
        return 2 * low

    for r in found["residuals"]:
        disagree(f"width of a {r['kind']} of {r['designed_um']} um", width(r["kind"], r["designed_um"]), r["found_um"], 0.01)
    out, errors = Table(["", "drawn, um", "printed, um", "told, um", "off, um"], []), {"fit": [], "others": []}
    for r in rows:
        told, printed = width(r["kind"], r.above_zero("designed_um")), r.number("printed_um", 0)
        errors["fit" if r in fitted else "others"].append(told - printed)
        out.rows.append([r["kind"] + ("" if r in fitted else ", not fitted"), r["designed_um"], figure(printed), figure(told), f"{told - printed:+.1f}"])
    figures = {k: {"rms_um": rms(v), "bias_um": mean(v), "n": len(v)} for k, v in errors.items() if v}
    figures["sigma_um"], figures["dose"] = sigma, dose
    return [Section("lines", "Widths of lines and gaps", source=str(path), known="drawn and printed widths",
                    fitted="how far light spreads (one Gaussian) and the dose, to the rows whose role is fit",
                    predicted="widths of the other rows, in closed form", proves="whether one Gaussian and one dose tell widths",
                    proves_not="heights; shrinkage" + ("" if others else "; nothing was predicted: give some rows the role validation"),
                    tables=[out], figures=figures)]


def steady_dead_zones(path, rows):
    """Without a resin's file: the steady law, a straight line over the logarithm of the ratio, each setting by all others."""
    points = [(math.log(r.above_zero("uv_mw_cm2") / r.above_zero("blue_mw_cm2")), r.number("dead_zone_um", 0), (r.get("role") or "fit") == "fit")
              for r in rows]
    fitted = [(x, z) for x, z, fit in points if fit]
    if len({x for x, _ in fitted}) < 4:
        raise BadInput(f"{path}: has {len({x for x, _ in fitted})} ratios of lights to fit to; expected 4 or more, or --resin with a file to hold against them")
    all_ = Line(fitted)
    table, errors, others = Table(["blue, UV, mW/cm²", "measured, um", "fit, um", "left out, off, um"], []), [], []
    for r, (x, z, fit) in zip(rows, points):
        off = (Line([p for p in fitted if p[0] != x]) if fit else all_)(x) - z
        (errors if fit else others).append(off)
        table.rows.append([f"{r['blue_mw_cm2']}, {r['uv_mw_cm2']}" + ("" if fit else ", not fitted"), figure(z), figure(all_(x)), f"{off:+.1f}"])
    figures = {"length_um": all_.slope, "beta": math.exp(all_.at / all_.slope), "left_out_rms_um": rms(errors), "left_out_bias_um": mean(errors)}
    if others:
        figures["others"] = {"rms_um": rms(others), "bias_um": mean(others), "n": len(others)}
    panel = Panel("dead zones", "ln of UV over blue light", "dead zone, um")
    ends = [min(p[0] for p in points), max(p[0] for p in points)]
    panel.line([(x, all_(x)) for x in ends], "steady law, fitted to the full points")
    panel.dots([(x, z) for x, z, fit in points if fit], "measured, fitted to")
    panel.dots([(x, z) for x, z, fit in points if not fit], "measured, predicted", 1, hollow=True)
    return [Section("dead-zones", "Dead zones", source=str(path), known="lights",
                    fitted="the steady law z = L ln(beta Iuv/Ib), L and beta, to the rows whose role is fit",
                    predicted="each ratio of lights by all others; rows whose role is validation",
                    proves="whether a dead zone goes as the logarithm of the ratio, as it does once it is steady",
                    proves_not="dead zones that are not steady yet; the resin's own heights: --resin holds a file against the rows",
                    tables=[table], pictures=[Picture("dead-zones", "Dead zones over the ratio of lights, with the steady law", [panel])], figures=figures)]


def lab_dead_zones(programs, path, options):
    _, rows = read_table(path)
    if not options.resin:
        return steady_dead_zones(path, rows)
    table, errors = Table(["blue, UV, mW/cm²", "s", "measured, um", "told, um", "off, um"], []), []
    for r in rows:
        blue, uv, time = r.above_zero("blue_mw_cm2"), r.above_zero("uv_mw_cm2"), r.above_zero("exposure_s")
        measured = r.number("dead_zone_um", 0)
        told = json.loads(programs.run("resinctl", "predict", "--resin", options.resin, "--blue-mw-cm2", repr(blue), "--uv-mw-cm2", repr(uv),
                                       "--exposure-s", repr(time), "--json", "-"))["dead_zone_um"]["after_exposure"]
        if told is None:
            table.rows.append([f"{blue:g}, {uv:g}", f"{time:g}", figure(measured), "nothing gels", "-"])
            continue
        errors.append(told - measured)
        table.rows.append([f"{blue:g}, {uv:g}", f"{time:g}", figure(measured), figure(told), f"{told - measured:+.1f}"])
    if not errors:
        raise BadInput(f"{path}: nothing gels in any row by {options.resin}")
    return [Section("dead-zones", "Dead zones", source=str(path), known="lights and times", fitted=f"nothing: {options.resin} as its file stands",
                    predicted="the dead zone after each exposure", proves="whether the file's inhibition holds on this machine",
                    proves_not="dead zones of oxygen, of flow", tables=[table],
                    figures={"rms_um": rms(errors), "bias_um": mean(errors), "n": len(errors)})]
