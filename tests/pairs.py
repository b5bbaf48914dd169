# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of features, and triples, held against a print by small steps (brute_print.py), which shares no code with the programs.

    pairs.py FOLDER_OF_PROGRAMS [--quick] [--triples] [--rounds N] [--seed N] [--only A,B] [--keep FOLDER]

For each pair that `slicecorr features` allows a random part is corrected. verify, probe, section and simulate must tell
what the images print, voxel by voxel; both features must change the images. What is refused must be refused in
the words of the table, in each program that corrects; what is left out must be told. --quick looks at fewer columns and
leaves out whether both features change the images; --rounds takes so many parts for each.
"""

import argparse
import base64
import csv
import io
import itertools
import json
import math
import os
import pathlib
import random
import re
import struct
import subprocess
import sys
import tempfile
import zlib
from concurrent.futures import ThreadPoolExecutor

try:
    import numpy as np

    import brute_print
except ImportError as missing:  # the packages for tests bring it
    print(f"pairs: not run: {missing}")
    sys.exit(1 if os.environ.get("SLICECORR_REQUIRE_ALL") == "1" else 77)

WIDTH, HEIGHT, LAYERS = 12, 10, 26
PIXEL_UM, LAYER_UM = 50, 50
# Midpoints of steps miss (step / absorbance height)^2 / 24 of a dose: 4e-6 of blue light (16 steps of a layer of 50 um,
# 300 um), 1e-6 of UV light (256 steps, 37.8 um), more where the rate begins at its clamp, in one step: 7e-4 was the most
# with 64 steps, of light that is all but held off by UV light.
TOLERANCE = 5e-4
# Where another dose is wanted: columns of pixels, and the dose.
REGION, REGION_DOSE = (1, 5), 1.6
# Light that scatters (docs/spread.md): distances that share a kernel are off by 2e-3 of a dose beside a straight edge
# where light ends among them, by four times that of a pixel that stands alone, and a half more where light begins again
# among others. Layer by layer what scatters in half a
# layer, 25 um², is taken for what scatters in all of it: of such a pixel 0.02 (scatter_depth_test.cpp says how).
SCATTER_TOLERANCE, SCATTER_LAYERWISE = 1.2e-2, 2e-2
# Where light spreads UV light counts to 0.2 % (docs/spread.md): a dose is off by so much of what it were without.
UV_TOLERANCE = 2e-3

PRINTER = {
    "": {"name": "pairs"},
    "display": {"width_px": WIDTH, "height_px": HEIGHT, "pixel_um": PIXEL_UM, "bit_depth": 8},
    "blue": {"calibration": [[0, 1.0], [255, 100.0]]},
    "stage": {"max_speed_mm_h": 2000, "travel_mm": 100},
}
RESIN = {
    "": {"name": "pairs-resin"},
    "cure": {"model": "kinetic", "m": 0.95, "absorbance_height_um": 300.0, "absorbance_base": "e",
             "critical_dose_prime": 40.0, "dose_factor": 1.0},
    "inhibition": {"beta": 0.73, "absorbance_height_um": 37.8, "absorbance_base": "e"},
}


def toml(tables):
    text = ""
    for name, table in tables.items():
        if name:
            text += f"[{name}]\n"
        for key, value in table.items():
            text += f"{key} = {json.dumps(value)}\n"
    return text


def png(values):
    def chunk(kind, body):
        return len(body).to_bytes(4, "big") + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")
    height, width = values.shape
    raw = b"".join(b"\0" + bytes(row) for row in values.astype(np.uint8))
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")


def stl(boxes, place_um):
    """Boxes of (x0, x1, y0, y1) pixels and (z0, z1) layers, which are at these places."""
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = []
    for x0, x1, y0, y1, z0, z1 in boxes:
        p = [((x0, x1)[i & 1] * PIXEL_UM / 1000, (y0, y1)[i >> 1 & 1] * PIXEL_UM / 1000,
              place_um((z0, z1)[i >> 2]) / 1000) for i in range(8)]
        for a, b, c, d in faces:
            triangles += [(p[a], p[b], p[c]), (p[a], p[c], p[d])]
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(
        struct.pack("<12fH", 0, 0, 0, *(v for corner in t for v in corner), 0) for t in triangles)


class Lit:
    """A print: definitions, options, files, and the part."""

    def __init__(self, rng):
        self.seed = rng.random()
        self.printer = {k: dict(v) for k, v in PRINTER.items()}
        self.resin = {k: dict(v) for k, v in RESIN.items()}
        self.options = {"speed-mm-h": "450"}
        self.flat = self.uv_flat = None
        self.files = {}
        self.surface, self.fraction = "slices", 0.0
        self.left_alone = []
        self.uncertain = False
        self.heights_um = []

    def place_um(self, layers):
        """Where a place counted in layers is."""
        nodes = np.concatenate([[0.0], np.cumsum(self.heights_um or [LAYER_UM] * LAYERS)])
        return float(np.interp(layers, np.arange(len(nodes)), nodes))

    def boxes(self):
        """The part: two corners that hold it in the middle of the plate, and features and gaps of any height."""
        rng, f = random.Random(self.seed), self.fraction
        out = [(0, 1, 0, 1, 0, LAYERS), (WIDTH - 1, WIDTH, HEIGHT - 1, HEIGHT, 0, LAYERS - 4)]
        for x in range(1, WIDTH - 1, 2):
            for y in range(0, HEIGHT, 2):
                z = rng.choice((0, 0, rng.randint(2, 6)))
                while z < LAYERS - 6:
                    high = rng.randint(3, 9)
                    if z + high > LAYERS - 2:
                        break
                    low = 0 if z == 0 else z + f
                    out.append((x, x + 2, y, y + 2, low, z + high + f))
                    z += high + rng.randint(4, 8)
        # A place beside the part for what is left alone.
        if self.left_alone:
            out = [b for b in out if not (b[0] < 5 <= b[1] - 0 and b[2] < 4)]
        return out


def layerwise(p):
    p.options.pop("speed-mm-h", None)
    p.options.update({"mode": "layerwise", "exposure-s": "2.5", "lifts": "none"})
    # The window stands a layer away: light that passes it is spent on the layers behind.
    p.resin["cure"]["absorbance_height_um"] = 90.0


def lifts(p):
    under_uv = "uv-mw-cm2" in p.options
    layerwise(p)
    p.options["lifts"] = "each"
    if under_uv:
        # The net dose of each exposure is to hold.
        p.options["exposure-s"] = "5"


def exchange(p):
    lifts(p)
    p.options["lift-exchange"] = "0.4"


def uv_lamp(p, kind):
    p.printer["uv"] = dict(p.printer.get("uv", {}), kind=kind, calibration=[[0, 0.0], [255, 275.0]])


def uv_constant(p):
    uv_lamp(p, "flood")
    p.options["uv-mw-cm2"] = "60"


def uv_per_slice(p):
    uv_lamp(p, "flood")
    p.options.update({"dead-zone-um": "15", "uv-schedule": "per-slice"})


def uv_patterned(p):
    uv_lamp(p, "patterned")
    p.options.update({"dead-zone-um": "15", "uv-schedule": "patterned"})


def even_dead_zone(p):
    uv_lamp(p, "patterned")
    p.resin[""] = dict(p.resin[""], viscosity_pa_s=0.3, dose_diffusion_m2_s=1e-10)
    p.resin["cure"]["m"] = 1.0  # flowing resin is counted with an exponent of 1
    p.options.update({"even-dead-zone": "both", "gap-um": "60"})


def gel_time(p):
    height = p.resin["cure"]["absorbance_height_um"]
    p.resin["cure"] = {"model": "gel-time", "absorbance_height_um": height, "absorbance_base": "e",
                       "gel_a_mj_cm2": 20.0, "gel_b_sqrt_mw_cm2_s": 2.5, "dose_factor": 1.0}
    p.resin.pop("inhibition")


def bleaching(p):
    if p.resin["cure"]["model"] == "kinetic":
        p.resin["cure"]["m"] = 1.0  # another exponent does not go with it
    height = p.resin["cure"]["absorbance_height_um"]
    p.resin["bleaching"] = {"absorbance_height_um": 2.5 * height, "absorbance_base": "e", "dose_mj_cm2": 30.0}


def spread(p):
    p.printer["blue"]["spread"] = [[35.0, 1.0]]


def scatter(p):
    """The variance of light grows by so much with each um of its way. No row of the table: see SCATTERED."""
    p.resin["cure"]["scatter_um2_per_um"] = 1.0


def uneven_light(p):
    values = np.array([[255 - 6 * x - 4 * y for x in range(WIDTH)] for y in range(HEIGHT)])
    p.flat = values / 255
    p.files["flat.png"] = png(values)
    p.printer["display"]["flat_field"] = "flat.png"


def vat_depth(p):
    # So much that a tenth of the light goes out at its far side.
    p.printer.setdefault("vat", {})["depth_um"] = round(2.3 * p.resin["cure"]["absorbance_height_um"] / 50) * 50


def reflectance(p):
    p.printer.setdefault("vat", {})["platform_reflectance"] = 0.3


def lamps_stay(p):
    p.files["speeds.csv"] = b"slice,speed_mm_h\n0,300\n6,450\n14,350\n"
    p.options.update({"slice-speed-mm-h": "speeds.csv", "slice-lamps": "stay"})


def dim_light(p):
    p.files["light.csv"] = b"slice,light_share\n0,0.8\n"
    p.options["light-share"] = "light.csv"


def own_light(p):
    p.files["light.csv"] = b"slice,light_share\n0,1\n3,0.8\n12,0.9\n"
    p.options["light-share"] = "light.csv"


def own_heights(p):
    if p.options.get("mode") != "layerwise":
        layerwise(p)
    different_heights(p)


def different_heights(p):
    rows = ((0, 40), (5, 60), (11, 30), (16, 50))
    p.files["heights.csv"] = "".join(["slice,layer_um\n"] + [f"{n},{um}\n" for n, um in rows]).encode()
    p.heights_um = [[um for n, um in rows if n <= layer][-1] for layer in range(LAYERS)]


def edge_heights(p):
    p.surface, p.fraction = "mesh", 0.3
    p.options["surface"] = "mesh"


def left_alone(p):
    p.left_alone = [(5, 7, 1, 3, 0, 14)]
    p.options["leave-alone"] = "alone.stl"
    if "uv-mw-cm2" in p.options:
        # Its full light is not to cure to the window.
        p.options["uv-mw-cm2"] = "200" if "platform_reflectance" in p.printer.get("vat", {}) else "150"


def wanted_doses(p):
    p.files["region.stl"] = stl([(*REGION, 0, HEIGHT, 0, LAYERS)], p.place_um)
    p.options.update({"region": f"region.stl={REGION_DOSE}", "design": "part.stl"})


def capped_dose(p):
    p.options["omega-max"] = "1.3"


def robust(p):
    p.options.update({"uncertain": "ha=4%,dc=4%", "robust": None})
    if p.options.get("mode") == "layerwise" and p.options.get("lifts") == "none":
        # Else the window's side of each layer gels in spite of that.
        p.resin["cure"]["absorbance_height_um"] = 1200.0
        p.printer["blue"]["calibration"][0][1] = 0.05


def derivatives(p):
    if "uncertain" not in p.options:
        p.options["uncertain"] = "ha=4%,dc=4%"


def pulsed_grey(p):
    p.printer["blue"]["grey"] = "pulsed"
    if "uv-mw-cm2" in p.options:
        strong_uv(p)  # full light comes with each pulse


def strong_uv(p):
    """So much that full light leaves a dead zone where there is less of it, too, and print accordingly."""
    p.options["uv-mw-cm2"] = "200"
    if p.options.get("lifts") == "each":
        p.options["exposure-s"] = "6"  # as `lifts` does under UV light
    if "region" in p.options and "speed-mm-h" in p.options:
        p.options["speed-mm-h"] = "350"  # full light comes to the dose that is wanted


def uneven_uv(p):
    if "uv" not in p.printer:
        uv_constant(p)
        if p.options.get("lifts") == "each":
            p.options["exposure-s"] = "6"  # as `lifts` does under UV light
        if p.left_alone:
            p.options["uv-mw-cm2"] = "190"  # more than `left_alone` takes, for where it is dimmer
        if "region" in p.options and "speed-mm-h" in p.options:
            p.options["speed-mm-h"] = "350"  # full light comes to the dose that is wanted
        if p.printer["blue"].get("grey") == "pulsed":
            strong_uv(p)
    if "uv-mw-cm2" in p.options and "region" in p.options and "speed-mm-h" in p.options:
        p.options["speed-mm-h"] = "350"
    if "dead-zone-um" in p.options:
        p.options["dead-zone-um"] = "8"  # which the lamp holds where it gives least
    values = np.array([[255 - 3 * x - 5 * y for x in range(WIDTH)] for y in range(HEIGHT)])
    if p.heights_um or "platform_reflectance" in p.printer.get("vat", {}):
        # Slices have tables of their own: there is room for those of a few places.
        values = np.array([[255 - 20 * (x // 4) - 15 * (y // 5) for x in range(WIDTH)] for y in range(HEIGHT)])
    p.uv_flat = values / 255
    p.files["uv-flat.png"] = png(values)
    p.printer["uv"]["flat_field"] = "uv-flat.png"


def fading_uv(p):
    if "uv" not in p.printer:
        uv_constant(p)
        if p.options.get("lifts") == "each":
            p.options["exposure-s"] = "6"  # as `lifts` does under UV light
        if p.left_alone:
            p.options["uv-mw-cm2"] = "190"  # more than `left_alone` takes, for where less comes
        if p.printer["blue"].get("grey") == "pulsed":
            strong_uv(p)
    if "dead-zone-um" in p.options and "platform_reflectance" in p.printer.get("vat", {}):
        p.options["dead-zone-um"] = "6"  # which the lamp holds where most light comes back and least UV light comes
    if p.uv_flat is not None and "dead-zone-um" in p.options:
        p.options["dead-zone-um"] = "3"  # which the lamp holds where, and when, it gives least
    p.files["uv-log.csv"] = "slice,uv_lamp_share\n0,1\n5,0.9\n11,0.8\n".encode()
    p.options["uv-lamp-log"] = "uv-log.csv"


# In the order of the table, with the words of `slicecorr features` that begin their names.
FEATURES = {
    "layer by layer": layerwise,
    "constant UV light": uv_constant,
    "UV light per slice": uv_per_slice,
    "patterned UV light": uv_patterned,
    "an even dead zone": even_dead_zone,
    "a time to gel": gel_time,
    "a resin that bleaches": bleaching,
    "light that spreads": spread,
    "light that scatters": scatter,
    "uneven light": uneven_light,
    "resin that ends": vat_depth,
    "a platform that sends light back": reflectance,
    "layers that hold at each lift": lifts,
    "resin that lifts exchange": exchange,
    "more light for slower slices": lamps_stay,
    "light below full": dim_light,
    "layers that get different shares of the light": own_light,
    "layers of different heights": own_heights,
    "slices of different heights": different_heights,
    "edges of the mesh": edge_heights,
    "what is left alone": left_alone,
    "wanted doses": wanted_doses,
    "a capped dose": capped_dose,
    "a robust correction": robust,
    "how sure figures are": derivatives,
    "grey by pulses": pulsed_grey,
    "uneven UV light": uneven_uv,
    "a UV lamp that fades": fading_uv,
}
UV = {"constant UV light", "UV light per slice", "patterned UV light", "an even dead zone"}
SPREAD = {"light that spreads", "light that scatters"}
# Figures only: no image changes.
TELLS_ONLY = {"how sure figures are"}
# Heights have a feature for each mode.
LAYERWISE = {"layer by layer", "layers that hold at each lift", "resin that lifts exchange", "layers of different heights"}
HEIGHTS = {"layers of different heights", "slices of different heights"}
# Not one print: no word of the table is needed.
ELSEWHERE = [({mode, "more light for slower slices"}, "is for continuous exposure")
             for mode in sorted(LAYERWISE)] + [
    # Resin files have one or the other.
    ({"a time to gel", uv}, "has no [inhibition]") for uv in sorted(UV - {"an even dead zone"})] + [
    ({"a time to gel", "uneven UV light"}, "has no [inhibition]"),
    ({"a time to gel", "a UV lamp that fades"}, "has no [inhibition]"),
    ({"a time to gel", "a resin that bleaches"}, "whose dose is not its intensity times its time")] + [
    # With what light scatters is no row of the table.
    ({"light that scatters", other}, words) for other, words in sorted({
        **{uv: "UV light is on; expected one of both" for uv in UV},
        "uneven UV light": "UV light is on; expected one of both",
        "a UV lamp that fades": "UV light is on; expected one of both",
        "a time to gel": "scattered light of such resins does not add up from slice to slice",
        "a resin that bleaches": "scattered light of such resins does not add up from slice to slice",
        "a platform that sends light back": "which scatters on a longer way",
        "layers of different heights": "of which each would scatter by weights of its own",
        "slices of different heights": "of which each would scatter by weights of its own",
        "a robust correction": "where light scatters in the resin",
        "how sure figures are": "where light scatters in the resin"}.items())]


def one_print(features):
    """Whether these are not two kinds of one thing."""
    # Different shares are light below full, too.
    same = {"light below full", "layers that get different shares of the light"} <= features
    other_mode = "slices of different heights" in features and LAYERWISE & features
    return len(UV & features) < 2 and not same and not other_mode


def short(name):
    return next((f for f in FEATURES if name.startswith(f)), None)


class Table:
    def __init__(self, programs):
        told = json.loads(subprocess.run([programs / "slicecorr", "features", "--json"], check=True,
                                         capture_output=True, text=True).stdout)
        self.rows = told["not_together"]

    def verdicts(self, features):
        """Of all pairs among `features`: verdict and words, as the programs look: refusals first."""
        features = set(features)
        if "light that scatters" in features:
            features.add("light that spreads")
        if "resin that lifts exchange" in features:
            features.add("layers that hold at each lift")
        if LAYERWISE & features:
            features.add("layer by layer")
        if "layers that get different shares of the light" in features:
            features.add("light below full")
        if "uneven UV light" in features and not UV & features:
            features.add("constant UV light")
        # What comes of one intensity differs from slice to slice.
        if "a UV lamp that fades" in features and not (UV - {"constant UV light"}) & features:
            features.discard("constant UV light")
            features.add("UV light per slice")
        # It sets m to 1, for which pulses are like any light.
        if "a resin that bleaches" in features and not UV & features:
            features.discard("grey by pulses")
        found = [(r["verdict"], r["words"]) for r in self.rows
                 if short(r["a"]) in features and short(r["b"]) in features]
        return found


class Case:
    def __init__(self, programs, folder, features, seed, quick):
        self.programs, self.folder, self.features, self.quick = programs, folder, features, quick
        self.faults = []
        self.lit = self.make(features, seed)
        self.seed = seed

    @staticmethod
    def make(features, seed):
        lit = Lit(random.Random(seed))
        for f in FEATURES:
            if f in features:
                FEATURES[f](lit)
        if lit.options.get("lifts") == "each" and "dead-zone-um" in lit.options and len(features) > 2:
            # Dim light has a thicker dead zone, and is to hold each layer.
            lit.options.update({"dead-zone-um": "4", "exposure-s": "12"})
        if lit.options.get("lifts") == "each" and "uv-mw-cm2" in lit.options and len(features) > 2:
            lit.options["exposure-s"] = "8"
        if {"light that spreads", "patterned UV light"} <= set(features):
            # Patterns hold the light off that columns show, not what comes to them from beside.
            lit.options["window-cure"] = "allow"
        return lit

    def run(self, program, *arguments):
        return subprocess.run([str(self.programs / program), *map(str, arguments)], cwd=self.folder,
                              capture_output=True, text=True)

    def write(self, lit):
        for name, data in {"printer.toml": toml(lit.printer).encode(), "resin.toml": toml(lit.resin).encode(),
                           "part.stl": stl(lit.boxes(), lit.place_um), **lit.files}.items():
            (self.folder / name).write_bytes(data)
        if lit.left_alone:
            (self.folder / "alone.stl").write_bytes(stl(lit.left_alone, lit.place_um))

    def arguments(self, lit, without=()):
        out = ["--printer", "printer.toml", "--resin", "resin.toml"]
        for name, value in lit.options.items():
            if name not in without:
                out.append("--" + name if value is None else f"--{name}={value}")
        return out

    def target(self, lit, out="target.uvj"):
        r = self.run("slicecorr", "slice", "part.stl", "-o", out, "--printer", "printer.toml", *self.heights(lit),
                     "--antialias", "off", "--surface", lit.surface)
        assert r.returncode == 0, r.stderr
        self.sliced = r.stdout + " " + r.stderr

    @staticmethod
    def heights(lit):
        return ["--layers", "heights.csv"] if lit.heights_um else ["--layer-um", LAYER_UM]

    def correct(self, lit, out="stack.uvj"):
        return self.run("slicecorr", "correct", "target.uvj", "-o", out, *self.arguments(lit))

    def fault(self, text):
        self.faults.append(f"{' + '.join(sorted(self.features))} (seed {self.seed}): {text}")

    def check_refusal(self, words):
        expected = words.replace("{printer}", "pairs").replace("{resin}", "pairs-resin") if words else None
        submit = self.arguments(self.lit, ("region", "design", "slice-speed-mm-h", "light-share"))
        mesh = ["part.stl", *self.heights(self.lit), "--antialias", "off"]
        run_options = self.arguments(self.lit, ("design",))
        (self.folder / "farm").mkdir(exist_ok=True)
        tries = {"correct": self.correct(self.lit),
                 "run": self.run("slicecorr", "run", *mesh, "-o", "run.uvj", *run_options)}
        # These slice by themselves, in layers of one height.
        evenly = not self.lit.heights_um
        if evenly and not {"region", "leave-alone", "uncertain"} & set(self.lit.options):
            tries["compare"] = self.run("slicecorr", "compare", *mesh, *self.arguments(self.lit))
        # In place, as a slicer's archive; what only corrections by hand know, it is not asked.
        if not {"region", "leave-alone", "uncertain"} & set(self.lit.options):
            (self.folder / "posted.uvj").write_bytes((self.folder / "target.uvj").read_bytes())
            tries["slicecorr-post"] = self.run("slicecorr-post", "posted.uvj", *self.arguments(self.lit))
        if evenly and not {"region", "slice-speed-mm-h", "light-share"} & set(self.lit.options):
            tries["slicefarm submit"] = self.run("slicefarm", "submit", "--dir", "farm", "--dry-run", *mesh, *submit)
        for name, r in tries.items():
            if r.returncode != 2:
                self.fault(f"{name}: exit code {r.returncode} in place of 2: {r.stderr[-300:]}")
            elif expected and expected not in " ".join(r.stderr.split()):
                self.fault(f"{name} says '{r.stderr.strip()[-400:]}' in place of '{expected}'")

    def check(self, table):
        self.write(self.lit)
        self.target(self.lit)
        for together, words in ELSEWHERE:
            if together <= self.features:
                return "refused", self.check_refusal(words if len(self.features) == 2 else None)
        verdicts = table.verdicts(self.features)
        if "a robust correction" in self.features:
            verdicts += table.verdicts(self.features | {"how sure figures are"})
        verdicts = list(dict.fromkeys(verdicts))
        refused = [w for v, w in verdicts if v == "refused"] or [w for v, w in verdicts if "refused" in v]
        if refused:
            return "refused", self.check_refusal(refused[0] if len(refused) == 1 and len(self.features) == 2 else None)
        r = self.correct(self.lit)
        # What three of them bring is no row of the table, but refused by name as well.
        if r.returncode == 2 and len(self.features) > 2 and "expected" in r.stderr:
            return "refused", None
        if r.returncode != 0:
            self.fault(f"correct: exit code {r.returncode}: {r.stderr[-400:]}")
            return "counted", None
        # One reason is enough where there are several.
        told = " ".join((r.stderr + " " + self.sliced).split())
        for verdict in {v for v, _ in verdicts}:
            reasons = [w for v, w in verdicts if v == verdict]
            for feature in {w.split(":")[0] for w in reasons} if "left out" in verdict else {""}:
                if not any(w in told for w in reasons if w.startswith(feature)):
                    self.fault(f"correct does not tell '{reasons}': {r.stderr[-300:]}")
        if not self.quick:
            self.check_changes([w for v, w in verdicts if v == "left out, and told"],
                               "each column is corrected alone" in told or
                               [w for v, w in verdicts if "column by column" in v])
        self.left_out_cap = any("not capped" in w for _, w in verdicts)
        self.judge()
        return "counted", None

    def check_changes(self, left_out, alone):
        """Without either feature the images are others."""
        made = brute_print.read_images(self.folder / "stack.uvj")
        for f in self.features - TELLS_ONLY:
            if f == "layer by layer" and len(LAYERWISE & self.features) > 1:
                continue  # the other says so, too
            if left_out and f in ("edges of the mesh", "a capped dose"):
                continue
            if alone and f in ("light that spreads", "light that scatters"):
                continue
            if f == "resin that ends" and "resin that lifts exchange" in self.features:
                continue  # what comes from so far away has no part in the greatest dose
            if f == "a robust correction" and self.lit.options.get("lifts") == "each":
                continue  # what holds at each lift has a fifth of its dose to spare
            if f == "layers that hold at each lift" and "resin that lifts exchange" in self.features:
                continue  # the other says so, too
            if f == "constant UV light" and {"uneven UV light", "a UV lamp that fades"} & self.features:
                continue  # the other needs it
            if f == "a UV lamp that fades" and "UV light per slice" in self.features:
                continue  # so much more is asked of it that the same comes
            if f == "grey by pulses" and "a resin that bleaches" in self.features:
                continue  # it sets m to 1, for which pulses are like any light
            lit = self.make(self.features - {f}, self.seed)
            self.write(lit)
            self.target(lit)
            if self.correct(lit, "without.uvj").returncode != 0:
                continue
            other = brute_print.read_images(self.folder / "without.uvj")
            if made.shape == other.shape and (made == other).all():
                self.fault(f"'{f}' changes nothing")
        self.write(self.lit)
        self.target(self.lit)

    def judge(self):
        lit = self.lit
        brute = brute_print.Print(self.folder / "stack.uvj", lit.flat, uv_flat=lit.uv_flat)
        mids = 0.5 * (brute.nodes_um[1:] + brute.nodes_um[:-1])
        doses = brute.doses(mids)
        design = np.zeros(doses.shape, bool)
        target = brute_print.read_images(self.folder / "target.uvj")
        design[:len(target)] = target > 127
        alone = np.zeros(doses.shape, bool)
        for x0, x1, y0, y1, z0, z1 in lit.left_alone:
            alone[z0:z1, HEIGHT - y1:HEIGHT - y0, x0:x1] = True
        design &= ~alone
        sure = (np.abs(doses - 1) > self.room(brute, mids, doses)) & ~alone
        options = ["--leave-alone=alone.stl"] if lit.left_alone else []
        options += [f"--{name}={lit.options[name]}" for name in ("region", "design") if name in lit.options]
        r = self.run("slicecorr", "verify", "stack.uvj", "--target", "target.uvj", "--json", "-", *options)
        if r.returncode != 0:
            self.fault(f"verify: exit code {r.returncode}: {r.stderr[-300:]}")
            return
        told = json.loads(r.stdout)
        # What is left alone shines on, and where light spreads on its neighbours, too.
        shines = SPREAD & self.features and "what is left alone" in self.features
        if "a capped dose" in self.features and not self.left_out_cap and not shines:
            over = doses[design].max()
            # One step of levels more where the cap lies between two.
            if over > 1.35:
                self.fault(f"a dose of {over:.4f} is printed in spite of the cap of 1.3")
        for key, wrong in (("cure_through_voxels", ~design & (doses >= 1)), ("undercure_voxels", design & (doses < 1))):
            low, high = int((wrong & sure).sum()), int((wrong & sure).sum() + (~sure & ~alone).sum())
            if not low <= told[key] <= high:
                self.fault(f"verify: {key} {told[key]}, the images print {low} to {high}")
        if "region" in lit.options:
            self.check_regions(doses, design, self.room(brute, mids, doses), told.get("regions", []))
        if "how sure figures are" in self.features and not lit.left_alone:
            self.check_chances(brute, target, options)
        if self.lit.options.get("lifts") == "each" and "joints" not in told:
            self.fault("verify tells no joints")
        if brute.layerwise and "joints" in told:
            self.check_joints(brute, design, told["joints"])
        self.check_section(brute, 5)
        for x, y in ((3, 3),) if self.quick else ((3, 3), (WIDTH - 1, 0), (6, 8)):
            self.check_column(brute, x, y)

    def check_regions(self, doses, design, room, told):
        """Doses of the region's features, and of those outside of it, in the middle of voxels."""
        inside = np.zeros(design.shape, bool)
        inside[:, :, REGION[0]:REGION[1]] = True
        for wanted, where in ((REGION_DOSE, design & inside), (1, design & ~inside)):
            row = next((r for r in told if r["wanted"]["max"] == wanted), None)
            if row is None or row["voxels"] != where.sum():
                self.fault(f"verify: of doses {wanted:g} it tells {row}, the design has {where.sum()} voxels")
                continue
            figures = {"min": doses[where].min(), "mean": doses[where].mean(), "max": doses[where].max()}
            for key, true in figures.items():
                if abs(row["dose"][key] - true) > room[where].max():
                    self.fault(f"verify: dose {key} where {wanted:g} is wanted {row['dose'][key]}, the images give {true:.6g}")
            off = row["off"]
            worst = {"most_below": (wanted - doses[where]).max(), "most_above": (doses[where] - wanted).max()}
            for key, true in worst.items():
                if abs(off[key] - max(0.0, true)) > room[where].max():
                    self.fault(f"verify: {key} where {wanted:g} is wanted {off[key]}, the images give {true:.6g}")

    def check_chances(self, brute, target, options):
        """How many features are lost, and gaps filled, in the mean of prints whose height and dose are off."""
        sd = 0.04  # as `derivatives` has them, of both
        r = self.run("slicecorr", "verify", "stack.uvj", "--target", "target.uvj", "--json", "-",
                     "--uncertain=ha=4%,dc=4%", *options)
        if r.returncode != 0:
            self.fault(f"verify --uncertain: exit code {r.returncode}: {r.stderr[-300:]}")
            return
        told = json.loads(r.stdout)["uncertainty"]
        ends = np.concatenate([brute.nodes_um[:-1] + 1e-6, brute.nodes_um[1:] - 1e-6])

        def doses(times):
            """With the dose that gels held by area."""
            brute.he_um *= times
            brute.known = None
            found = np.maximum(brute.doses(ends), 1e-9)
            brute.he_um /= times
            brute.known = None
            return np.log(found)
        step = 0.005
        middle, slope = doses(1), (doses(math.exp(step)) - doses(math.exp(-step))) / (2 * step)
        sds = middle / (sd * np.sqrt(slope**2 + 1))
        lost = filled = doubtful = 0
        for y, x in np.ndindex(sds.shape[1:]):
            column = np.zeros(brute.layers, bool)
            column[:len(target)] = target[:, y, x] == 255
            n = 0
            while n < brute.layers:
                end = n
                while end < brute.layers and column[end] == column[n]:
                    end += 1
                own = np.concatenate([sds[n:end, y, x], sds[brute.layers + n:brute.layers + end, y, x]])
                if column[n] or end < brute.layers:
                    most = own.max() if column[n] else -own.min()
                    chance = 0.5 * math.erfc(most / math.sqrt(2))
                    doubtful += 1e-6 < chance < 1 - 1e-6
                    lost, filled = (lost + chance, filled) if column[n] else (lost, filled + chance)
                n = end
        for key, true in (("lost_features", lost), ("merged_features", filled)):
            # Doses to `TOLERANCE`, their derivatives to some thousandths: of 4 % a hundredth of a deviation or
            # two, and the density of the normal distribution is 0.4 at most.
            if abs(told[key]["expected"] - true) > 0.01 * doubtful + 1e-3:
                self.fault(f"verify: of {key} {told[key]['expected']} are expected, by the images {true:.5g}")

    def check_joints(self, brute, design, told):
        """What hangs on what when the platform lifts, by each exposure alone."""
        window, far = brute.own_doses()
        skins = np.exp(0.5 * brute.m * brute.heights_um / brute.he_um)
        least, loose, films, liquid_most = math.inf, 0, 0, 0
        for y, x in np.ndindex(design.shape[1:]):
            column, n = design[:, y, x], 0
            while n < len(column):
                if not column[n]:
                    n += 1
                    continue
                end = n
                while end < len(column) and column[end]:
                    end += 1
                liquid = 0
                if n > 0:
                    # The last layer of a feature of which none gels has nothing that it could stay liquid for.
                    while liquid < end - n - 1 and window[n + liquid, y, x] < 1:
                        liquid += 1
                    liquid_most = max(liquid_most, liquid)
                    n += liquid
                    film = n < end and (brute.films[n, y, x] if brute.films is not None
                                        else window[n, y, x] >= skins[n] * (1 - 1e-9))
                    films += film
                    loose += n < end and not film
                    n += 1
                for k in range(n, end):
                    # What is liquid between solid layers holds nothing, nor does the layer below it.
                    joint = 0 if k > 0 and window[k - 1, y, x] < 1 and column[k - 1] else far[k, y, x]
                    least = min(least, joint)
                    loose += joint < 1.2 * (1 - 1e-9)
                n = end
        expected = {"not_holding_voxels": int(loose), "films": int(films), "liquid_layers_max": liquid_most}
        slack = 0
        if "light that spreads" in self.features and brute.uv is not None:
            # Voxels whose doses lie so near to what counts.
            near = UV_TOLERANCE * brute.blue ** brute.m * brute.exposure_s / brute.dose
            close = (np.abs(far - 1.2) < near) | (np.abs(window - 1) < near)
            slack = int((close & design[:len(close)]).sum())
        for key, value in expected.items():
            if abs(told[key] - value) > slack:
                self.fault(f"verify: joints.{key} {told[key]}, the images say {value}")
        if abs(told["least"] - least) > TOLERANCE * least:
            self.fault(f"verify: joints.least {told['least']}, the images say {least:.6g}")

    def room(self, brute, heights_um, doses):
        """By how much a dose that is told may be off."""
        room = TOLERANCE * np.maximum(doses, 0.05)
        if brute.scatter:
            room = room + (SCATTER_TOLERANCE + brute.layerwise * SCATTER_LAYERWISE) * doses.max()
        if "light that spreads" in self.features and brute.uv is not None:
            room = room + UV_TOLERANCE * brute.doses(heights_um, uv=False)
        return room

    def check_section(self, brute, y):
        """Of the picture each colour is either of what prints or of what does not."""
        r = self.run("slicecorr", "section", "stack.uvj", "--target", "target.uvj", "--y", y, "-o", "section.svg")
        if r.returncode != 0:
            self.fault(f"section: exit code {r.returncode}: {r.stderr[-300:]}")
            return
        svg = (self.folder / "section.svg").read_text()
        picture = brute_print.read_png(base64.b64decode(re.findall(r"base64,([^\"]+)", svg)[1]))
        down, across = picture.shape[0] // brute.layers, picture.shape[1] // WIDTH
        seen = {}
        for row in range(brute.layers * down):
            # Edges go through a cell of the picture, along its height and, where light spreads, its width.
            places = [min(max(row + part, 0), brute.layers * down - 1e-6) / down
                      for part in (-0.5, 0.02, 0.5, 0.98, 1.5)]
            heights = np.interp(places, np.arange(brute.layers + 1), brute.nodes_um)
            near = brute.doses(heights)
            room = self.room(brute, heights, near)[:, y]
            near = near[:, y]
            for x in range(WIDTH):
                at = slice(max(x - 1, 0), x + 2) if SPREAD & self.features else slice(x, x + 1)
                if (near > 1 + room)[:, at].all() or (near < 1 - room)[:, at].all():
                    colour = tuple(picture[row, x * across])
                    seen.setdefault(colour, set()).add(bool(near[0, at].min() > 1))
        mixed = [c for c, prints in seen.items() if len(prints) > 1]
        if mixed or len(seen) < 2:
            self.fault(f"section: colours {mixed} of {len(seen)} are of what prints and of what does not")

    def check_column(self, brute, x, y):
        r = self.run("slicecorr", "probe", "stack.uvj", "--x", x, "--y", y)
        if r.returncode != 0:
            self.fault(f"probe: exit code {r.returncode}: {r.stderr[-300:]}")
            return
        rows = list(csv.DictReader(io.StringIO(r.stdout)))
        z = np.array([float(row["z_um"]) for row in rows])
        told = np.array([float(row["dose"]) for row in rows])
        self.compare(brute, f"probe at {x}, {y}", z + 1e-9, told, (y, x))
        if HEIGHTS & self.features:
            return  # not followed in time
        if brute.scatter:
            refused = self.run("slicecorr", "simulate", "stack.uvj", "--x", x, "--y", y, "-o", "column.svg")
            if refused.returncode != 2 or "scatter_um2_per_um" not in refused.stderr:
                self.fault(f"simulate: exit code {refused.returncode} in place of 2: {refused.stderr[-300:]}")
            return
        end_s = json.loads(self.run("slicecorr", "info", "stack.uvj", "--json", "-").stdout)["light_s"]
        end = self.run("slicecorr", "simulate", "stack.uvj", "--x", x, "--y", y, "--times-s", repr(end_s),
                       "--dose-csv", "dose.csv", "-o", "column.svg")
        if end.returncode != 0:
            self.fault(f"simulate: exit code {end.returncode}: {end.stderr[-300:]}")
            return
        rows = [row for row in csv.DictReader(io.StringIO((self.folder / "dose.csv").read_text()))]
        z = np.array([float(row["z_um"]) for row in rows])
        told = np.array([float(list(row.values())[-1]) for row in rows])
        # At nodes layer by layer the dose jumps.
        inside = z % LAYER_UM > 1
        self.compare(brute, f"simulate at {x}, {y}", z[inside], told[inside], (y, x))

    def compare(self, brute, what, z, told, pixel):
        doses = brute.doses(z)
        room = self.room(brute, z, doses)[(slice(None), *pixel)]
        true = doses[(slice(None), *pixel)]
        excess = np.abs(told - true) / room
        if excess.max() > 1:
            n = int(excess.argmax())
            self.fault(f"{what}: dose {told[n]:.6g} at {z[n]:g} um, the images give {true[n]:.6g}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--triples", action="store_true")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only")
    parser.add_argument("--keep", type=pathlib.Path)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    args.programs = args.programs.resolve()
    table = Table(args.programs)
    cases = [frozenset([f]) for f in FEATURES]
    for size in (2, 3) if args.triples else (2,):
        for c in itertools.combinations(FEATURES, size):
            if one_print(set(c)):
                cases.append(frozenset(c))
    if args.only:
        wanted = args.only.split(",")
        cases = [c for c in cases if len(c) == len(wanted) and all(any(w in f for f in c) for w in wanted)]

    def one(asked):
        features, seed = asked
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            if args.keep:
                folder = args.keep.resolve() / f"{seed}-" / "-".join(f.split()[0] + f.split()[-1] for f in sorted(features))
                folder.mkdir(parents=True, exist_ok=True)
            case = Case(args.programs, folder, features, seed, args.quick)
            try:
                verdict, _ = case.check(table)
            except Exception as e:  # told with the case in which it came up
                verdict = "failed"
                case.fault(f"{type(e).__name__}: {e}")
            return verdict, case.faults

    with ThreadPoolExecutor(args.threads) as pool:
        results = list(pool.map(one, [(c, args.seed + r) for r in range(args.rounds) for c in cases]))
    faults = [f for _, fs in results for f in fs]
    for f in faults:
        print(f)
    counts = {v: sum(r[0] == v for r in results) for v in ("counted", "refused", "failed")}
    print(f"{len(results)} cases: {counts['counted']} counted, {counts['refused']} refused; {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
