# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Counting the instructions of small fixed jobs, and comparing the counts of two programs."""

import json
import os
import pathlib
import re
import shutil
import subprocess

from . import parts

JOBS = ("slice", "slice centres", "decode", "convert", "correct", "verify", "run", "run uv")


class Wrong(Exception):
    """A job that can't be run or counts that can't be read."""


def run(command, environment):
    answer = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if answer.returncode != 0:
        raise Wrong(f"{' '.join(map(str, command))}: exit code {answer.returncode}: {answer.stderr[-2000:]}")
    return answer


def perf_counts():
    """Whether this machine lets us count instructions in the processor."""
    if not shutil.which("perf"):
        return False
    answer = subprocess.run(
        ["perf", "stat", "-x", ",", "-e", "instructions:u", "true"], capture_output=True, text=True, check=False
    )
    return re.match(r"\d+,", answer.stderr) is not None


def count(counter, command, environment, profile):
    """Instructions of one run; callgrind leaves its profile in the file `profile`."""
    if counter == "perf":
        answer = run(["perf", "stat", "-x", ",", "-e", "instructions:u", *command], environment)
        match = re.search(r"^(\d+),[^,]*,instructions", answer.stderr, re.MULTILINE)
    else:
        run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}", "--quiet", *command],
            environment,
        )
        match = re.search(r"^(?:summary|totals): (\d+)", profile.read_text(), re.MULTILINE)
    if not match:
        raise Wrong(f"{counter} gave no count for {' '.join(map(str, command))}")
    return int(match[1])


UV_LAMP = """[uv]
wavelength_nm = 365
kind = "flood"
calibration = [[0, 0.0], [255, 275.0]]
"""


def jobs(program, mesh, folder, resin):
    """Name, command and inputs (made beforehand, not counted) of each job."""
    display = parts.Display("guard", 640, 400, 40)
    printer = folder / "printer.toml"
    printer.write_text(display.printer_toml())
    # A lattice has columns of all kinds: a coarser display for the solve under UV light.
    uv_printer = folder / "uv-printer.toml"
    uv_printer.write_text(parts.Display("guard-uv", 160, 100, 160).printer_toml() + UV_LAMP)
    uv_resin = resin.parent / "custom-resin-1.toml"
    start = [str(program), "--threads", "1", "--quiet"]
    slicing = ["--printer", str(printer), "--layer-um", "50"]
    how = ["--resin", str(resin), "--speed-mm-h", "400"]
    target, corrected, out = (str(folder / f"{n}.uvj") for n in ("target", "corrected", "out"))
    inputs = [
        [*start, "slice", mesh, "-o", target, *slicing],
        [*start, "correct", target, "-o", corrected, *slicing[:2], *how],
    ]
    return inputs, {
        "slice": [*start, "slice", mesh, "-o", out, *slicing],
        "slice centres": [*start, "slice", mesh, "-o", out, "--antialias", "off", *slicing],
        "decode": [*start, "info", corrected],
        "convert": [*start, "convert", corrected, "-o", out],
        "correct": [*start, "correct", target, "-o", out, *slicing[:2], *how],
        "verify": [*start, "verify", corrected, "--target", target],
        "run": [*start, "run", mesh, "-o", out, *slicing, *how],
        "run uv": [
            *[*start, "run", mesh, "-o", out, "--printer", str(uv_printer), "--layer-um", "50"],
            *["--resin", str(uv_resin), "--speed-mm-h", "200", "--uv-mw-cm2", "200"],
        ],
    }


def measure(program, make_part, resin, folder, counter, repeats, only, say):
    """Counts of all jobs of one program, each `repeats` times: {"job": [count, ...]}."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True)
    environment = {**os.environ, "HOME": str(folder), "TMPDIR": str(folder)}
    environment.pop("SLICECORR_DB", None)
    mesh = str(folder / "part.stl")
    run([make_part, "gyroid", mesh, "8", "8", "4", "4", "0.4"], environment)
    inputs, commands = jobs(program, mesh, folder, resin)
    for command in inputs:
        run(command, environment)
    found = {}
    for name, command in commands.items():
        if only and name not in only:
            continue
        found[name] = [
            count(counter, command, environment, folder / f"{name.replace(' ', '-')}.callgrind")
            for _ in range(repeats)
        ]
        say(f"  {name}: {found[name][0] / 1e6:.1f} M instructions")
    return found


def built_with(program):
    """What decides, beside our sources, how many instructions a built program takes in callgrind."""
    cache = pathlib.Path(program).resolve().parent.parent / "CMakeCache.txt"
    match = re.search(r"^CMAKE_CXX_COMPILER:\w+=(.+)$", cache.read_text(), re.MULTILINE) if cache.exists() else None
    if not match:
        raise Wrong(f"{program}: no compiler in {cache}")
    flags = pathlib.Path("/proc/cpuinfo").read_text()
    return {
        "compiler": run([match[1], "--version"], None).stdout.splitlines()[0],
        "valgrind": run(["valgrind", "--version"], None).stdout.strip(),
        "avx2": re.search(r"^flags.* avx2( |$)", flags, re.MULTILINE) is not None,
    }


def read_kept(path):
    """Counts kept in a file with what they were built with: (counts, built with)."""
    try:
        kept = json.loads(pathlib.Path(path).read_text())
    except (OSError, ValueError) as error:
        raise Wrong(f"{path}: {error}") from error
    if not isinstance(kept, dict) or set(kept) != {"built_with", "counts"} or not isinstance(kept["built_with"], dict):
        raise Wrong(f'{path}: expected {{"built_with": {{...}}, "counts": {{"job": [count, ...], ...}}}}')
    return checked(kept["counts"], path), kept["built_with"]


def read(path):
    """Counts as `measure` gives them, from JSON."""
    try:
        counts = json.loads(pathlib.Path(path).read_text())
    except (OSError, ValueError) as error:
        raise Wrong(f"{path}: {error}") from error
    return checked(counts, path)


def checked(counts, path):
    """The counts, if they are such."""
    good = isinstance(counts, dict) and counts
    for name, runs in counts.items() if good else ():
        if not isinstance(runs, list) or not runs or not all(type(n) is int and n > 0 for n in runs):
            raise Wrong(f"{path}: '{name}': expected a list of counts above 0")
    if not good:
        raise Wrong(f'{path}: expected {{"job": [count, ...], ...}}')
    return counts


def compare(base, head, tolerance_percent):
    """Rows (job, base, head, growth in percent, grown) and the noise between equal runs in percent."""
    missing = [name for name in base if name not in head]
    if missing:
        raise Wrong(f"the newer program has no count for: {', '.join(missing)}")
    rows, noise = [], 0.0
    for name, runs in head.items():
        noise = max(noise, 100 * (max(runs) / min(runs) - 1))
        if name not in base:
            rows.append((name, None, min(runs), None, False))
            continue
        noise = max(noise, 100 * (max(base[name]) / min(base[name]) - 1))
        old, new = min(base[name]), min(runs)
        grown = 100 * new > (100 + tolerance_percent) * old
        rows.append((name, old, new, 100 * (new / old - 1), grown))
    return rows, noise


def table(rows):
    lines = ["| job | base, M instructions | head | ratio | |", "|---|---|---|---|---|"]
    for name, base, head, growth, grown in rows:
        if base is None:
            lines.append(f"| {name} | - | {head / 1e6:.2f} | - | new |")
        else:
            lines.append(
                f"| {name} | {base / 1e6:.2f} | {head / 1e6:.2f} | {head / base:.4f} |"
                f" {'GROWN' if grown else ''} |"
            )
    return "\n".join(lines)


def functions(profile):
    """Instructions of each function itself, from a profile of callgrind."""
    answer = subprocess.run(
        ["callgrind_annotate", "--threshold=100", "--auto=no", str(profile)],
        capture_output=True,
        text=True,
        check=False,
    )
    found = {}
    for line in answer.stdout.splitlines():
        match = re.match(r"\s*([\d,]+) \([ \d.]+%\)  (.*?)(?: \[[^\]]*\])?$", line)
        if match and match[2] != "PROGRAM TOTALS":
            name = match[2].split(":", 1)[-1].lstrip(":")
            found[name] = found.get(name, 0) + int(match[1].replace(",", ""))
    return found


def grown_functions(base_profile, head_profile, most=5):
    """The functions that grew most: (more instructions, name)."""
    if not base_profile.exists() or not head_profile.exists():
        return []
    base, head = functions(base_profile), functions(head_profile)
    more = [(n - base.get(name, 0), name) for name, n in head.items()]
    worth_telling = sum(base.values()) / 1000
    return [m for m in sorted(more, reverse=True)[:most] if m[0] > worth_telling]
