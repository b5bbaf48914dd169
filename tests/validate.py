#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Tests scripts/validate: its figures against the authors' own and sums made here, its page, tables of a lab, bad input.

Usage: validate.py SOURCE-FOLDER BIN-FOLDER [--all]     (--all: every set of docs/measured.md, which takes some seconds)
"""
import contextlib
import importlib.machinery
import importlib.util
import io
import json
import math
import os
import pathlib
import re
import stat
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

SOURCE, BIN = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
# What takes less than a second.
QUICK = ["roofs", "working-curve", "laboratories", "bis-ema", "two-lights", "oxygen", "fins"]
failures = []


def expect(what, truth):
    if not truth:
        failures.append(what)


def near(what, found, wanted, tolerance):
    expect(f"{what}: {found!r}, expected {wanted!r} within {tolerance}",
           isinstance(found, (int, float)) and math.isfinite(found) and abs(found - wanted) <= tolerance)


def validate(*arguments, code=0, programs=BIN, folder=None):
    done = subprocess.run([sys.executable, str(SOURCE / "scripts/validate"), "--bin", str(programs), *map(str, arguments)],
                          capture_output=True, text=True, cwd=folder or SOURCE, check=False)
    expect(f"validate {' '.join(map(str, arguments))}: exit code {done.returncode}, expected {code}: {done.stderr[-500:]}", done.returncode == code)
    return done


def load():
    loader = importlib.machinery.SourceFileLoader("validate_script", str(SOURCE / "scripts/validate"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("validate_script", loader))
    loader.exec_module(module)
    return module


def refused(script, *arguments):
    """What it says to input that it refuses, without another interpreter."""
    said, sys.argv = io.StringIO(), ["validate", "--bin", str(BIN), *map(str, arguments)]
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = script.main()
    expect(f"{arguments}: exit code {code}, expected 2: {said.getvalue()}", code == 2)
    return said.getvalue()


def straight(points):
    """Slope and intercept by the normal equations, as they stand."""
    n, sx, sy = len(points), sum(x for x, _ in points), sum(y for _, y in points)
    sxx, sxy = sum(x * x for x, _ in points), sum(x * y for x, y in points)
    slope = (n * sxy - sx * sy) / (n * sxx - sx * sx)
    return slope, (sy - slope * sx) / n


def roofs(figures):
    """The authors fitted h = ha ln(t / Tc) to the same roofs: their figures stand in the head of the file."""
    text = (SOURCE / "tests/data/measured/01_openslaice_membranes.csv").read_text()
    authors = re.search(r"AUTHORS' FIT.*?: (.*)", text)[1]
    names = [n for n in figures if n not in ("pooled", "tried")]
    expect(f"four resins, not {names}", len(names) == 4)
    for name in names:
        ha, tc = (float(v) for v in re.search(name.split()[0] + r" ([\d.]+) um ([\d.]+) s", authors).groups())
        # To their last digit.
        near(f"{name}: h", figures[name]["jacobs"]["h_um"], ha, 0.0051)
        near(f"{name}: time of gel", figures[name]["jacobs"]["dc_mj_cm2"] / 1.93824, tc, 0.00051)
        rows = [line.split(",") for line in text.splitlines() if line.startswith(name)]
        fitted = [(math.log(float(r[4])), float(r[6])) for r in rows if r[1] == "fit"]
        squares = 0
        for k, (x, z) in enumerate(fitted):
            slope, at = straight(fitted[:k] + fitted[k + 1:])
            squares += (at + slope * x - z) ** 2
        # The roofs are told to four digits after the point.
        near(f"{name}: left out", figures[name]["jacobs"]["left_out_rms_um"], math.sqrt(squares / len(fitted)), 1e-4)
        others = [(math.log(float(r[4])), float(r[6])) for r in rows if r[1] == "validation"]
        if others:
            slope, at = straight(fitted)
            # The resin's file has six digits.
            near(f"{name}: the other print", figures[name]["jacobs"]["others_bias_um"],
                 sum(at + slope * x - z for x, z in others) / len(others), 0.01)
    near("Siraya: longer roofs by shorter ones", figures["Siraya Tech Sculpt Clear"]["jacobs"]["upper_rms_um"], 8.28, 0.01)


def oxygen_front(share, spread, time):
    """Gelled height with oxygen from the resin beyond, sealed at the window: implicit steps, places at edges, not in the middle of cells."""
    n, dx, steps = 160, 5.0 / 160, 300
    dt, r = time / steps, spread * time / steps / (5.0 / 160) ** 2
    u, gel = [share] * n, [0.0] * n
    for _ in range(steps):
        above, below = [0.0] * n, [0.0] * n
        for i in range(n):
            left, right = (0, 2 * r) if i == 0 else (2 * r, 0) if i == n - 1 else (r, r)
            under = 1 + 2 * r - left * (above[i - 1] if i else 0)
            above[i], below[i] = right / under, (u[i] - math.exp(-i * dx) * dt + left * (below[i - 1] if i else 0)) / under
        for i in reversed(range(n)):
            u[i] = below[i] + (above[i] * u[i + 1] if i < n - 1 else 0)
        gel, u = [g - min(v, 0) for g, v in zip(gel, u)], [max(v, 0) for v in u]
    last = max(i for i, g in enumerate(gel) if g >= 1 - share)
    return (last + (gel[last] - (1 - share)) / (gel[last] - gel[last + 1])) * dx


def laws_tried(sets):
    """Laws of roofs that are not built in: without diffusion Jacobs' law, with it the heights of another scheme; figures of Jacobs' law."""
    sys.path.insert(0, str(SOURCE / "scripts/validation"))
    import tried
    for time in (1.3, 2.0, 4.0):
        # Cells of 1/32 h, linear between: 1e-3 h in the mean of 1/8 cell² and more.
        near(f"no diffusion, {time}", tried.front(time, 0.8, 0.0, False), math.log(time), 1e-3)
        # 0.01 h is a um.
        near(f"oxygen from beyond, {time}", tried.front(time, 0.8, 0.04, False), oxygen_front(0.8, 0.04, time), 0.01)
    jacobs = sets["roofs"]["tried"]["Jacobs' law"]
    near("tried: Jacobs' law, left out", jacobs["left_out_rms_um"], sets["roofs"]["pooled"]["jacobs"]["left_out_rms_um"], 1e-3)
    near("tried: Jacobs' law, the other print", jacobs["others_rms_um"], sets["roofs"]["Anycubic Standard Clear"]["jacobs"]["others_rms_um"], 0.01)


def oxygen_first(figures):
    """A and B of the law that explains times under two lights, by the normal equations of all four; beta where the misfit is flat."""
    text = (SOURCE.parent / "shared/data/measured/02_pegda_dual_wavelength_times.csv").read_text()
    lines = [line.split(",") for line in text.splitlines() if line and line[0] != "#"]
    times = [[(float(c[0]), float(c[1]), float(c[lines[0].index(column)] or 0)) for c in lines[1:]] for column in ("time_a01_s", "time_a03_s", "time_a05_s")]
    rows = [[1 / i / t, *(i ** -0.5 / t * (n == k) for n in range(3)), 1] for k, of in enumerate(times) for i, u, t in of if u == 0 and t]
    square = [[sum(r[j] * r[k] for r in rows) for k in range(5)] for j in range(4)]
    for j in range(4):
        square = [[a - row[j] / square[j][j] * b if n != j else a for a, b in zip(row, square[j])] for n, row in enumerate(square)]
    a, *b = (square[j][4] / square[j][j] for j in range(4))
    for k, amplitude in enumerate(("0.1", "0.3", "0.5")):
        found = figures[amplitude]["oxygen first"]
        # A valley's place by golden section is good to the root of a double's digits.
        near("two lights: A", found["a"], a, 1e-5 * a)
        near("two lights: B", found["b"], b[k], 1e-5 * b[k])

    def misfit(beta):
        told = [(a / 20 + b[k] / math.sqrt(20 - beta * u), t) for k, of in enumerate(times) for i, u, t in of if i == 20 and u > 0 and (t or beta * u < 20)]
        return sum(math.log(s / t) ** 2 if t else math.log(min(1, s / 2)) ** 2 for s, t in told)
    beta = figures["0.1"]["oxygen first"]["beta"]
    expect(f"two lights: beta {beta} is not where the misfit is least", misfit(beta) < min(misfit(0.999 * beta), misfit(1.001 * beta)))


def promises(sets):
    """docs/how-sure.md promises what the figures say."""
    page = (SOURCE / "docs/how-sure.md").read_text()
    roofs_ = [r for n, r in sets["roofs"].items() if n not in ("pooled", "tried")]
    upper = sorted(r["jacobs"]["upper_rms_um"] for r in roofs_)
    left = sets["roofs"]["pooled"]["jacobs"]["left_out_rms_um"]
    said = [f"{left:.0f} um rms at exposures that were left out ({sum(r['n'] for r in roofs_)} roofs",
            f"{upper[0]:.0f} to {upper[-1]:.0f} um where exposures lie beyond"]
    if "two-lights" in sets:
        lights = [amplitude["subtraction"] for amplitude in sets["two-lights"].values()]
        times = sorted(100 * f["ln_time_rms"] for f in lights)
        said += [f"{min(f['right'] for f in lights)} of {lights[0]['asked']} pairs", f"times to {times[0]:.0f} to {times[-1]:.0f} %"]
        held = [sum(f[key] for f in lights) for key in ("in_band", "timed")]
        said.append(f"{held[0]} of {held[1]} times under two lights")
        bias = sorted(100 * f["ln_time_bias"] for f in lights)
        said.append(f"told {bias[0]:.0f} to {bias[-1]:.0f} % too long in the mean")
        near("doses of laboratories, as drawn", sets["laboratories"]["Ec"]["factor95"], 8.5, 0.05)
    if "bis-ema" in sets:
        off = sorted(-100 * e for e in sets["bis-ema"]["absolute_errors"])
        rest = sorted(100 * e for e in sets["bis-ema"]["after_one_time_errors"])
        said += [f"{off[0]:.0f} to {off[-1]:.0f} % too short", f"the rest was {rest[0]:.0f} to {rest[-1]:.0f} % off"]
    for words in said:
        expect(f"docs/how-sure.md does not say '{words}'", words in page)


def document(told):
    """The page says what the script says now, of the sets that are there."""
    page = (SOURCE / "docs/measured.md").read_text()
    for section in re.split(r"^(?=### )", told.strip() + "\n", flags=re.M):
        section = re.sub(r"\]\(([\w-]+)\.svg\)", r"](measured-\1.svg)", section.strip())
        expect(f"docs/measured.md is not what scripts/validate tells now (scripts/validate --write): {section[:60]}", section in page)
        for picture in re.findall(r"\]\((measured-[\w-]+\.svg)\)", section):
            xml.etree.ElementTree.parse(SOURCE / "docs" / picture)


def before_and_after(sets):
    """The table of the page says what the sets tell now."""
    sys.path.insert(0, str(SOURCE / "scripts/validation"))
    from before import SETS
    page = (SOURCE / "docs/measured.md").read_text()
    expect("before and after: no set is held against its row", any(s[0] in sets for s in SETS))
    for key, _, built, now in SETS:
        if key in sets:
            expect(f"docs/measured.md: before and after, {key}: not '{now(sets[key])}'", f"| {built} | {now(sets[key])} |" in page)


TABLES = {
    # h 100 um, Dc 10 mJ/cm²: every error is 0.
    "heights.csv": "dose_mj_cm2,cured_height_um,role\n" + "".join(
        f"{d},{100 * math.log(d / 10):.9f},{'validation' if d == 50 else 'fit'}\n" for d in (15, 20, 30, 40, 50, 60, 80)),
    # A 5, B 3.
    "times.csv": "intensity_mw_cm2,time_s\n" + "".join(f"{i},{5 / i + 3 / math.sqrt(i):.9f}\n" for i in (0.1, 0.5, 2, 10, 40)),
    "forces.csv": "series,speed_mm_s,force_n\n" + "".join(f"film,{v},{2 * v ** 0.5:.9f}\n" for v in (0.5, 1, 2, 4)),
    # ln(5 / (1 - 1/e)) is 2.068 heights: three layers of one height.
    "channels.csv": "layer_um,absorbance_height_um,far_edge_dose,open_um\n80,80,5,240\n",
    # By the closed form of the widths that a Gaussian of 30 um and a dose of 3 give, without black.
    "lines.csv": None,
    "zones.csv": "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n50,100,10,21.934\n",
}


def printed(kind, designed, sigma=30.0, dose=3.0):
    def light(x):
        inside = 0.5 * (math.erf((designed / 2 - x) / sigma / 2 ** 0.5) + math.erf((designed / 2 + x) / sigma / 2 ** 0.5))
        return dose * (inside if kind == "line" else 1 - inside)
    coarse = next(x for x in range(400) if (light(x) < 1) == (kind == "line"))
    return 2 * next(coarse - 1 + k * 1e-4 for k in range(10001) if (light(coarse - 1 + k * 1e-4) < 1) == (kind == "line"))


def tables(folder):
    TABLES["lines.csv"] = "kind,designed_um,printed_um,role\n" + "".join(
        f"{kind},{w},{printed(kind, w):.4f},{'validation' if w == 200 else 'fit'}\n" for kind in ("line", "gap") for w in (60, 80, 100, 200, 300))
    for name, text in TABLES.items():
        (folder / name).write_text(text)

    def sets(name, *more):
        figures = json.loads(validate(folder / name, "--json", "-", *more, folder=folder).stdout)["sets"]
        html = folder / (pathlib.Path(name).stem + ".html")
        expect(f"{html} holds its table", "<table>" in html.read_text())
        return figures

    heights = sets("heights.csv")["heights"]["all"]["jacobs"]
    near("made heights: h", heights["h_um"], 100, 1e-5)
    near("made heights: predicted", heights["others_rms_um"], 0, 1e-3)
    # Dp 39.2 um, Ec 12.3 mJ/cm².
    (folder / "one.csv").write_text((folder / "heights.csv").read_text())
    file = sets("one.csv", "--resin", "nist-interlaboratory-385nm")["heights"]["file"]
    wanted = [max(0.0, 39.2 * math.log(d / 12.3)) - 100 * math.log(d / 10) for d in (15, 20, 30, 40, 50, 60, 80)]
    near("a file's heights", file["bias_um"], sum(wanted) / len(wanted), 0.001)
    times = sets("times.csv")["times-0"]
    near("made times, left out", times["left_out_rms_error"], 0, 1e-6)
    near("made forces", sets("forces.csv")["forces"]["film"]["exponent"], 0.5, 1e-8)
    near("a channel", sets("channels.csv")["channels"]["bias_um"], 0, 1e-9)
    lines = sets("lines.csv")["lines"]
    near("made lines: spread", lines["sigma_um"], 30, 0.01)
    near("made lines: predicted", lines["others"]["rms_um"], 0, 0.05)
    # L 40 um, beta 0.7.
    (folder / "steady.csv").write_text("blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um,role\n" + "".join(
        f"{blue},200,30,{40 * math.log(0.7 * 200 / blue):.9f},{'validation' if blue == 25 else 'fit'}\n" for blue in (8, 12, 18, 25, 40, 60)))
    steady = sets("steady.csv")["dead-zones"]
    near("steady dead zones: length", steady["length_um"], 40, 1e-6)
    near("steady dead zones: beta", steady["beta"], 0.7, 1e-8)
    near("steady dead zones: predicted", steady["others"]["rms_um"], 0, 1e-6)
    # What `resinctl predict` told of custom-resin-1, held against tests of the front elsewhere.
    near("a dead zone", sets("zones.csv", "--resin", "custom-resin-1")["dead-zones"]["bias_um"], 0, 0.001)


def bad_input(folder):
    script = load()
    wrong = {
        "no such kind": ("a,b\n1,2\n", "header: has a, b; expected the columns of one kind"),
        "text for a number": ("dose_mj_cm2,cured_height_um\n1,2\nten,3\n", "line 3: dose_mj_cm2: is 'ten'"),
        "infinite": ("dose_mj_cm2,cured_height_um\n1,inf\n", "line 2: cured_height_um"),
        "zero": ("speed_mm_s,force_n\n0,1\n", "line 2: speed_mm_s: is 0"),
        "a field too many": ("dose_mj_cm2,cured_height_um\n1,2,3\n", "line 2: has 3 fields; expected 2"),
        "twice": ("dose_mj_cm2,dose_mj_cm2,cured_height_um\n1,2,3\n", "'dose_mj_cm2' is there twice"),
        "nothing": ("", "expected a header row"),
        "no rows": ("dose_mj_cm2,cured_height_um\n", "has no measurements"),
        "few": ("dose_mj_cm2,cured_height_um\n1,2\n2,3\n", "expected 4 or more"),
        "role": ("dose_mj_cm2,cured_height_um,role\n1,2,maybe\n", "role: is 'maybe'"),
        "no dose": ("cured_height_um\n1\n", "expected dose_mj_cm2, or intensity_mw_cm2 and exposure_s"),
        "no resin": (TABLES["zones.csv"], "has 1 ratios of lights to fit to"),
        "semicolons": ("dose_mj_cm2;cured_height_um\n1,5;2\n", "line 1: columns are divided by semicolons or tabs; expected commas"),
        "falling": ("dose_mj_cm2,cured_height_um\n10,100\n20,90\n30,80\n40,70\n", "bad.csv: resinctl: the jacobs model can't be fitted"),
        "one light": ("intensity_mw_cm2,time_s\n1,2\n1,3\n", "one intensity"),
    }
    for what, (text, message) in wrong.items():
        (folder / "bad.csv").write_text(text)
        said = refused(script, folder / "bad.csv", "-o", folder)
        expect(f"{what}: {said.strip()} does not say '{message}'", message in said)
        expect(f"{what}: {said.strip()} names a file that is not the user's", "slicecorr-validate" not in said)
    (folder / "bad.csv").write_text(TABLES["forces.csv"])
    expect("a resin of forces", "expected no --resin" in refused(script, folder / "bad.csv", "-o", folder, "--resin", "custom-resin-1"))
    (folder / "bad.csv").write_bytes(b"dose_mj_cm2\xff,cured_height_um\n")
    expect("bytes that are no text", "is no text" in refused(script, folder / "bad.csv", "-o", folder))
    expect("no file", "No such file" in refused(script, folder / "none.csv", "-o", folder))
    expect("no programs", "has no resinctl" in validate("--only", "roofs", code=2, programs=folder).stderr)
    (folder / "empty").mkdir()
    absent = validate("--only", "roofs", "--data", folder / "empty")
    expect("a set that is not there is told", "roofs: left out" in absent.stderr)


def a_wrong_program(folder):
    """A resinctl that tells 1 % too much is found out."""
    lies = folder / "lies"
    lies.mkdir()
    for program in BIN.iterdir():
        if program.name != "resinctl":
            (lies / program.name).symlink_to(program)
    (lies / "resinctl").write_text(f"""#!/usr/bin/python3
import re, subprocess, sys
out = subprocess.run(["{BIN / 'resinctl'}", *sys.argv[1:]], stdout=subprocess.PIPE, text=True, check=True).stdout
print(re.sub(r'("h_um": {{\\s*"value": )([\\d.]+)', lambda m: m[1] + repr(1.01 * float(m[2])), out))
""")
    os.chmod(lies / "resinctl", stat.S_IRWXU)
    done = validate("--only", "roofs", code=1, programs=lies)
    expect("the lie is named", "absorbance height: the program says" in done.stderr)


def main():
    arguments = sys.argv[:]
    shared = (SOURCE.parent / "shared/data/measured/README.md").is_file()
    names = [*QUICK, "forces", "channels", "cylinders"] if shared and "--all" in arguments else QUICK if shared else ["roofs"]
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        told = validate("--only", *names, "--json", folder / "figures.json").stdout
        sets = json.loads((folder / "figures.json").read_text())["sets"]
        roofs(sets["roofs"])
        laws_tried(sets)
        if "two-lights" in sets:
            oxygen_first(sets["two-lights"])
        promises(sets)
        document(told)
        before_and_after(sets)
        tables(folder)
        bad_input(folder)
        a_wrong_program(folder)
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
