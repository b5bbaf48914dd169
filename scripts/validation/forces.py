# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Forces that pull a part off its window, and cylinders that stuck or came off."""
import math

from draw import Panel, Picture
from page import Section, Table, figure
from programs import prism, write_stl
from reckon import BadInput, Line, disagree, groups_of, mean, read_table, rms

AREA_MM2, GAP_UM, VISCOSITY_PA_S, SPEED_MM_S = 314.0, 100.0, 0.2, 1.0
# As silicone has it; neither it nor the viscosity is stated of these measurements.
MODULUS_MPA = 2.0


def regular(corners, area):
    r = math.sqrt(2 * area / (corners * math.sin(2 * math.pi / corners)))
    return [(r * math.cos(2 * math.pi * k / corners), r * math.sin(2 * math.pi * k / corners)) for k in range(corners)]


class Pulled:
    """Prisms of equal area, pulled off by `slicecorr flow`."""

    def __init__(self, programs):
        self.programs = programs
        self.resin = programs.write("pull.toml", f"""name = "pull"
viscosity_pa_s = {VISCOSITY_PA_S}
[cure]
model = "jacobs"
absorbance_height_um = 100
absorbance_base = "e"
gel_dose_mj_cm2 = 10
""")
        self.printer = programs.printer("pull-printer", 100.0, (800, 800))
        self.parts = {name: write_stl(programs.work / f"{name}.stl", prism(regular(corners, AREA_MM2), 0.2))
                      for name, corners in (("cylinder", 256), ("hexagon", 6), ("triangle", 3))}

    def slice(self, shape, gap_um, *window, pitch_um=250):
        told = self.programs.json("slicecorr", "flow", self.parts[shape], "--layer-um", 100, "--printer", self.printer, "--resin",
                                  self.resin, "--speed-mm-h", 3600 * SPEED_MM_S, "--gap-um", gap_um, "--pitch-um", pitch_um, *window)
        return told["slices"][-1]


def rigid_forces(pulled):
    """Over a rigid window, held against closed forms."""
    forces = {shape: pulled.slice(shape, GAP_UM, pitch_um=125)["force_n"] for shape in pulled.parts}
    # Three times the torsion constant: area² / (2 pi) of a disc, sqrt(3) area² / 15 of an equilateral triangle.
    scale = 3 * VISCOSITY_PA_S * SPEED_MM_S * 1e-3 / (GAP_UM * 1e-6) ** 3 * (AREA_MM2 * 1e-6) ** 2
    for name, torsion in (("cylinder", 1 / (2 * math.pi)), ("triangle", math.sqrt(3) / 15)):
        # Cells of 125 um under 20 mm.
        disagree(f"force of the {name}", scale * torsion, forces[name], 0.005 * scale * torsion)
    return forces


def rubber_exponents(pulled, measured):
    """Over PDMS of so many mm: the gap at which the force at 1 mm/s is the measured one, and the exponent of speed there."""
    found = {}
    for thick, force in measured.items():
        window = ["--rubber-mm", thick, "--rubber-mpa", MODULUS_MPA]
        gap = 200.0
        for _ in range(4):
            at = pulled.slice("cylinder", f"{gap:.3f}", *window)["window"]
            # Over a window that is nearly stiff the force goes as 1/gap³.
            gap *= (at["pull_n"] / force) ** (1 / 3)
        triangle = pulled.slice("triangle", f"{gap:.3f}", *window)["window"]
        at = pulled.slice("cylinder", f"{gap:.3f}", *window)["window"]
        found[thick] = {"gap_um": gap, "force_n": at["pull_n"], "exponent": at["pull_exponent"], "triangle": triangle["pull_n"] / at["pull_n"]}
        disagree(f"force over {thick} mm of rubber", force, at["pull_n"], 0.01 * force)
    return found


def thicknesses(pulled, rows, gap_um):
    """Forces over PDMS of several thicknesses to that over 2 mm, and the gaps at the start that a rigid window would need for them."""
    measured = {r["pdms_mm"]: r.above_zero("force_n") for r in rows if r["series"] == "PDMS thickness"}
    told = {thick: pulled.slice("cylinder", f"{gap_um:.3f}", "--rubber-mm", thick, "--rubber-mpa", MODULUS_MPA)["window"]["pull_n"]
            for thick in measured if thick != "0"}
    rigid = pulled.slice("cylinder", f"{gap_um:.3f}")["force_n"]
    disagree("a rigid window pulls hardest", 1, float(rigid >= max(told.values())), 0)
    table, figures = Table(["window", "force to that over 2 mm, measured", "rubber", "gap to that over 2 mm that would explain it"], []), {}
    for thick, force in sorted(measured.items(), key=lambda item: float(item[0])):
        to, rubber = force / measured["2"], (told.get(thick, rigid)) / told["2"]
        # What rubber leaves over goes as 1/gap³.
        gap = (rubber / to) ** (1 / 3)
        figures[thick] = {"measured": to, "rubber": rubber, "gap": gap}
        table.rows.append([f"PDMS {thick} mm" if thick != "0" else "glass", figure(to), figure(rubber), figure(gap)])
    return table, figures


def power_of(points):
    """Exponent of force over speed, with its standard error."""
    return Line([(math.log(v), math.log(f)) for v, f in points])


def pdms(programs, data):
    _, rows = read_table(data / "05_pan2017_separation_force.csv")
    measured = {r["shape"]: r.above_zero("force_n") for r in rows if r["series"] == "shape"}
    pulled = Pulled(programs)
    forces = rigid_forces(pulled)
    rubber = rubber_exponents(pulled, {r["pdms_mm"]: r.above_zero("force_n") for r in rows if r["series"] == "speed" and r["speed_mm_s"] == "1.0"})
    shapes = Table(["shape, 314 mm²", "force to the disc's, measured", "rigid window", "off", "over 2 and 4 mm of rubber"], [])
    figures = {"shapes": {}, "speeds": {}}
    for name in ("hexagon", "triangle"):
        m, told = measured[name] / measured["cylinder"], forces[name] / forces["cylinder"]
        figures["shapes"][name] = {"measured": m, "rigid": told}
        soft = ", ".join(figure(r["triangle"]) for r in rubber.values()) if name == "triangle" else "-"
        shapes.rows.append([name, figure(m), figure(told), f"{100 * (told / m - 1):+.1f} %", soft])
    shapes.rows.append(["star", figure(measured["star"] / measured["cylinder"]), "its outline is not stated", "-", "-"])
    speeds = Table(["window", "exponent of speed, measured", "rigid", f"rubber of {MODULUS_MPA:g} MPa", "gap that gives the force at 1 mm/s",
                    "rigid, slowest speed predicts the others: rms, bias", "rubber's exponent, the same"], [])
    panel = Panel("force over speed", "speed, mm/s", "force, N", log_x=True, log_y=True)
    for k, thick in enumerate(("2", "4")):
        points = sorted((r.above_zero("speed_mm_s"), r.above_zero("force_n")) for r in rows if r["series"] == "speed" and r["pdms_mm"] == thick)
        line, soft = power_of(points), rubber[thick]
        v0, f0 = points[0]
        errors = [f0 * v / v0 / f - 1 for v, f in points[1:]]
        yielding = [f0 * (v / v0) ** soft["exponent"] / f - 1 for v, f in points[1:]]
        figures["speeds"][f"pdms_{thick}_mm"] = {"exponent": line.slope, "error": line.slope_error, "rigid_rms": rms(errors), "rigid_bias": mean(errors),
                                                "rubber_exponent": soft["exponent"], "rubber_rms": rms(yielding), "rubber_bias": mean(yielding),
                                                "gap_um": soft["gap_um"]}
        speeds.rows.append([f"PDMS {thick} mm", f"{line.slope:.2f} ± {line.slope_error:.2f}", "1", f"{soft['exponent']:.2f}", f"{soft['gap_um']:.0f} um",
                            f"{100 * rms(errors):.0f} %, {100 * mean(errors):+.0f} %", f"{100 * rms(yielding):.0f} %, {100 * mean(yielding):+.0f} %"])
        panel.dots([(v, f, f * line.sigma) for v, f in points], f"measured, PDMS {thick} mm; bars: their scatter about a power of speed", k)
        panel.line([(v, f0 * v / v0) for v in (points[0][0], points[-1][0])], "rigid window, from the slowest speed" if k == 0 else "", k, dashed=True)
        panel.line([(v, f0 * (v / v0) ** soft["exponent"]) for v in (points[0][0], points[-1][0])], "rubber, from the slowest speed" if k == 0 else "", k)
    by_thickness, figures["thickness"] = thicknesses(pulled, rows, rubber["2"]["gap_um"])
    return Section(
        "forces", "Forces that pull a layer off PDMS",
        source="Pan et al., Rapid Prototyping Journal 23 (2017) 353, as transcribed in github.com/umag/resinsim (facts; second hand)",
        known="areas, shapes, speeds, thickness of PDMS; viscosity and the gap at the start are not stated",
        fitted="nothing for the shapes; the force at the slowest speed for the others. Over rubber also the gap, to the force at 1 mm/s; "
               f"{MODULUS_MPA:g} MPa and {VISCOSITY_PA_S:g} Pa s are assumed, as silicone and resins have them",
        predicted="how forces of shapes of equal area stand to each other, and how force grows with speed",
        proves="order of shapes, and a hexagon's force to a per cent",
        proves_not="a rigid window tells a triangle too little force and too steep a growth with speed. Rubber yields too little to explain either: "
                   "thicker PDMS should be softer and was measured nearer to 1, and forces over thin PDMS and glass are far too large for it. Gaps at the start that "
                   "grow with PDMS, as oxygen that comes through it would leave them, would explain the sizes (the last table); nobody recorded them. "
                   "Sizes of forces can't be told without viscosity and gap",
        tables=[shapes, speeds, by_thickness], pictures=[Picture("forces", "Measured forces over speed, and what a rigid window would pull", [panel])],
        figures=figures)


def cylinders(programs, data):
    _, rows = read_table(data / "06_pritchard_print_outcomes.csv")
    resin = programs.resin("custom-resin-1", viscosity_pa_s=0.3, dose_diffusion_m2_s=1e-10)
    printer = programs.printer("cylinder-printer", 200.0, (800, 800))
    part = write_stl(programs.work / "disc.stl", prism(regular(256, math.pi * 100), 0.4))
    table = Table(["UV, blue, mW/cm²", "measured", "greatest dose at the window", "told", "in time: greatest dose at the window", "greatest suction, bar",
                   "told", "void"], [])
    figures, right, right_in_time, asked = [], 0, 0, 0
    for r in rows:
        blue, uv = r.above_zero("blue_mw_cm2"), r.above_zero("uv_mw_cm2")
        lights = f"{uv:g}, {blue:g}{'' if r['blue_pattern'] == 'uniform' else ' at most, ' + r['blue_pattern']}"
        if r["blue_pattern"] != "uniform":
            table.rows.append([lights, r["outcome"], "-", "not told: the pattern is not published", "-", "-", "-", "-"])
            continue
        told = programs.json("slicecorr", "flow", part, "--layer-um", 100, "--printer", printer, "--resin", resin, "--speed-mm-h",
                             r.above_zero("speed_mm_h"), "--uv-mw-cm2", uv, "--blue-mw-cm2", blue, "--pitch-um", 250, "--every", 3)
        last = told["slices"][-1]
        sticks, stuck = last["window_dose"] >= 1, "stuck" in r["outcome"]
        # From the first instant, 36 s long. Rings as fine as these: on 250 um 164 and 146 mW/cm² stick.
        print_ = programs.json("slicecorr", "flow", "--in-time", "--disc-radius-mm", 10, "--pitch-um", 50, "--slices", 60, "--printer",
                               printer, "--resin", resin, "--speed-mm-h", r.above_zero("speed_mm_h"), "--uv-mw-cm2", uv, "--blue-mw-cm2", blue)
        end, prints = print_["slices"][-1], print_["prints"]
        most = max(s["window_dose"] for s in print_["slices"])
        # Two slices on is the platform's start, which is not the light's doing.
        suction = max(slice_["suction_pa"] for slice_ in print_["slices"][2:]) * 1e-5
        asked, right, right_in_time = asked + 1, right + (sticks == stuck), right_in_time + (prints != stuck)
        figures.append({"blue_mw_cm2": blue, "window_dose": last["window_dose"], "sticks": sticks, "stuck": stuck, "prints_in_time": prints,
                        "window_dose_in_time": most, "suction_bar": suction, "void_share": end["void_share"],
                        "sticks_after_s": print_["sticks"]["seconds"] if print_["sticks"] else None,
                        "beyond_limit_after_s": print_["beyond_limit"]["seconds"] if print_["beyond_limit"] else None})
        ends = [f"{word} after {print_[key]['seconds']:.1f} s" for key, word in (("beyond_limit", "draws more than 1 bar"), ("sticks", "sticks")) if print_[key]]
        table.rows.append([lights, r["outcome"], figure(last["window_dose"]), "sticks" if sticks else "comes off", figure(most), figure(suction, 2),
                           ", ".join(ends) or "prints", f"{100 * end['void_share']:.0f} %"])
    panel = Panel("greatest dose at the window", "curing light, mW/cm²", "dose, gel doses", log_y=True)
    lights_ = sorted(f["blue_mw_cm2"] for f in figures)
    panel.line([(lights_[0], 1.0), (lights_[-1], 1.0)], "from here on resin sticks", 4, dashed=True)
    for k, (key, words) in enumerate((("window_dose", "told at rest"), ("window_dose_in_time", "told in time"))):
        panel.line(sorted((f["blue_mw_cm2"], f[key]) for f in figures), "", k)
        for stuck, outcome in ((True, "stuck"), (False, "printed")):
            panel.dots([(f["blue_mw_cm2"], f[key]) for f in figures if f["stuck"] == stuck], f"{words}, {outcome}", k, hollow=not stuck)
    return Section(
        "cylinders", "The dissertation's six cylinders",
        source="Z. D. Pritchard, dissertation, Michigan 2020, figure 4.5 and text (facts)",
        known="light, diameter, resin (shipped as custom-resin-1); speed is that of the chapter's model, 300 mm/h",
        fitted="nothing. Dose diffuses as the dissertation took it, 1e-10 m²/s",
        predicted="whether resin at the window gels, in a gap that no longer changes, and followed from the first instant (`flow --in-time`) with "
                  "the share of the section under which nothing has gelled",
        proves=f"{right} of {asked} even prints at rest and {right_in_time} in time. The dose at the window and suction rise with blue light, as prints "
               "stuck; in time the print at 130 comes off with a large void, as it did",
        proves_not="in time the two that stuck are told to print, if only by some per cent of the gel dose. That is within what is known of the resin: fits of such "
                   "experiments leave beta with a standard error of 0.1 of 0.73 ([fits.md](fits.md#do-the-intervals-hold-the-truth)). With one less 164 sticks after 10 s, 146 comes to 0.996, "
                   "with a suction at which resin cavitates, and 130 to 0.97, as they printed (rings of 70 um); with one more none comes near. So the set can't tell whether "
                   "anything is missing. Rings matter, too: on rings of 250 um 164 and 146 stick after 6 and 10 s and 130 comes to 0.98, as they printed; on rings of 100, 70 and 50 um "
                   "none sticks, but on 100 um the first two draw more than 1 bar. At rest the print at 130 is told to stick by a little. How the window gives way "
                   "is not published, nor is heat in the model",
        tables=[table], pictures=[Picture("cylinders", "Dose at the window over curing light, told at rest and in time; full points stuck", [panel])],
        figures={"prints": figures, "right": right, "right_in_time": right_in_time, "asked": asked})


def lab(_programs, path, _options):
    _, rows = read_table(path)
    table = Table(["series", "points", "exponent of speed", "rigid window", "slowest predicts others: rms"], [])
    panel, figures = Panel("force over speed", "speed, mm/s", "force, N", log_x=True, log_y=True), {}
    for k, (name, group) in enumerate(groups_of(rows, "series").items()):
        points = sorted((r.above_zero("speed_mm_s"), r.above_zero("force_n")) for r in group)
        if len({v for v, _ in points}) < 3:
            raise BadInput(f"{path}: series '{name}' has {len({v for v, _ in points})} speeds; expected three or more")
        line, (v0, f0) = power_of(points), points[0]
        errors = [f0 * v / v0 / f - 1 for v, f in points if v > v0]
        figures[name or "all"] = {"exponent": line.slope, "error": line.slope_error, "rigid_rms": rms(errors)}
        table.rows.append([name or "all", len(points), f"{line.slope:.2f} ± {line.slope_error:.2f}", "1", f"{100 * rms(errors):.0f} %"])
        panel.dots(points, f"measured{': ' + name if name else ''}", k)
        panel.line([(v, f0 * v / v0) for v in (v0, points[-1][0])], "rigid window, from the slowest speed" if k == 0 else "", k, dashed=True)
    return [Section("forces", "Forces over speed", source=str(path), known="speeds and forces", fitted="the slowest speed's force",
                    predicted="forces at the other speeds over a rigid window, where they grow as speed",
                    proves="how soft the window is: an exponent of 1 is a rigid one, 1/2 a soft arm, 1/4 to 1/2 a film",
                    proves_not="sizes of forces: they need viscosity and gap",
                    tables=[table], pictures=[Picture("forces", "Forces over speed", [panel])], figures=figures)]
