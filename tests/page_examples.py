#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Holds each page of docs/ to its beginning: an example that runs as it stands, and its picture where the page has one.
Pages of kernels/ and howto/ are for programmers and have none. Paragraphs of architecture.md have ten lines at most.
Usage: page_examples.py ROOT BIN [PAGE...]. Runs the first block of commands of each page in a folder in which the files
lie that examples name. Prints what is wrong and ends with 1, else 0."""

import math
import os
import pathlib
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import textwrap
import zlib

ROOT, BIN = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
PROGRAMS = r"(?:\([^()]*\) *)?(?:slicecorr|slicecorr-post|slicefarm|resinctl|printbridge|printer-sim)\b"
# So many words may come before the example.
MOST_WORDS = 150

# Pages that begin with no command, and why.
NONE = {
    "README": "is made of ten examples; each stands on its page, or in the README, which a test runs",
    "architecture": "is a map of folders",
    "c-api": "is about C; its program is compiled and run by the tests of the C interface",
    "dependencies": "is a list of packages and licences",
    "farm-backup": "its commands are run by the tests of a damaged farm",
    "farm-design": "says how the farm is made inside",
    "farm-tried": "is a record of what was tried",
    "flow-chapter-iv": "holds figures against those of a book",
    "formats-details": "is a list of formats; formats.md has the commands",
    "glossary": "is a list of words",
    "glossary-code": "is a list of words",
    "install": "its commands need an empty machine and root",
    "measured": "its commands take hours; a test runs one set of them",
    "performance": "its commands take hours",
    "python": "begins with the lines that install it; its programs are run by the tests of Python",
    "safety": "is a list of hazards with the tests that try them",
    "threats": "is a list of threats with the tests that try them",
}
# Pages whose commands other tests run, all of them; here is looked at how they begin.
ELSEWHERE = {
    "beams": "BeamsProgram.CommandsOfThePageRun",
    "bridge-displays": "BridgeWindow, BridgeDrm: they need displays",
    "calipers": "CalibrateProgram.CommandsOfItsPageRun",
    "chemistry": "ChemistryProgram.CommandsOfItsPageRun",
    "farm-api": "Serve.CommandsOfItsPageRun",
    "farm-slurm": "Slurm: they need a cluster",
    "flow": "Docs.CommandsOfFlowRun",
    "gel-time": "GelTimeProgram.CommandsOfItsPageRun",
    "print-files": "DocsLcd",
    "sharing": "DocsLcd",
    "slicer-plugin": "DocsLcd",
    "spread-fits": "Docs.CommandsOfSpreadFitsRun",
    "tomography-calibration": "Docs.CommandsOfCalibrationRun",
    "tuning": "Docs.CommandsOfTuningRun",
}
# Commands that go on until they are ended.
SERVERS = re.compile(r"^(slicefarm (serve|run$|watch$)|printer-sim|slicecorr-post .*--watch(?!.*--once))")

wrong = []


def words_before(lines):
    return sum(len(line.split()) for line in lines)


def example_of(text):
    """The commands of the first block, and what is wrong with where it stands."""
    head = text.split("\n## ")[0].split("\n")[1:]
    first = next((n for n, line in enumerate(head) if re.match("    " + PROGRAMS, line)), None)
    if first is None:
        return [], "has no example before its first heading"
    if any(line.startswith("|") for line in head[:first]):
        return [], "has a table before its example"
    if words_before(head[:first]) > MOST_WORDS:
        return [], f"has {words_before(head[:first])} words before its example"
    commands, joined = [], False
    for line in head[first:]:
        if not line.startswith("    "):
            break
        line = line[4:]
        if joined:
            commands[-1] = commands[-1][:-1] + line.strip()
        elif re.match(PROGRAMS, line):
            # What stands far to the right is said about the command.
            commands.append(re.split(r"\s{3,}|\s+# ", line)[0] if not line.endswith("\\") else line)
        joined = line.endswith("\\") and (joined or bool(re.match(PROGRAMS, line)))
    return commands, None


def long_paragraphs(text):
    """Paragraphs and points of more than ten lines of 120 characters; tables and drawings are none."""
    for paragraph in text.split("\n\n"):
        if paragraph.startswith(("    ", "|")):
            continue
        for point in re.split(r"\n(?=\s*(?:[-*]|\d+\.) )", paragraph):
            if len(textwrap.wrap(" ".join(point.split()), 120)) > 10:
                yield point


def picture_is_late(text):
    return "![" in text and "![" not in text.split("\n## ")[0]


def box(low, high):
    """Twelve triangles."""
    corner = [[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return [[corner[q[i]] for i in three] for q in quads for three in ((0, 1, 2), (0, 2, 3))]


def write_stl(path, triangles):
    data = b"".join(struct.pack("<12fH", 0, 0, 0, *t[0], *t[1], *t[2], 0) for t in triangles)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + data)


def write_png(path, width, height, square, grey):
    """A square of one grey on black."""
    x0, y0, x1, y1 = square
    lit = b"\0" + b"\0" * x0 + bytes([grey]) * (x1 - x0) + b"\0" * (width - x1)
    rows = b"".join(lit if y0 <= y < y1 else b"\0" * (width + 1) for y in range(height))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def bleached_heights():
    """Cured heights of a resin that bleaches: dE/dz = -(E / h1 + (1/h0 - 1/h1) Eb (1 - e^(-E/Eb))) down to Dc."""
    h0, h1, bleach, gel = 100.0, 400.0, 150.0, 10.0
    rows = ["dose_mj_cm2,cured_height_um"]
    for step in range(18):
        dose = first = 15 * 1.4**step
        height = 0.0
        while dose > gel:
            dose -= 0.05 * (dose / h1 + (1 / h0 - 1 / h1) * bleach * (1 - math.exp(-dose / bleach)))
            height += 0.05
        rows.append(f"{first:.3f},{height + (-0.2, 0.3, -0.1)[step % 3]:.2f}")
    return "\n".join(rows) + "\n"


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def environment(folder):
    return {"HOME": str(folder), "PATH": f"{BIN}:/usr/bin:/bin", "XDG_STATE_HOME": str(folder / "state"),
            "TMPDIR": str(folder), "LANG": "C.UTF-8"}


def run(folder, commands):
    """What the shell said, and its exit code."""
    port = free_port()
    script = ["set -e"]
    for command in commands:
        command = re.sub(r"\bprinter-sim ", f"printer-sim --listen 127.0.0.1:{port} ", re.sub(r" --listen \S+", "", command))
        command = re.sub(r"printbridge print ", f"printbridge print --modbus tcp:127.0.0.1:{port} ", command)
        command = re.sub(r"slicefarm serve", "slicefarm serve --listen 127.0.0.1:0", command)
        if SERVERS.match(command) and "$!" not in command:
            script.append(command.rstrip("& ") + " > /dev/null &\nsleep 0.5; kill -0 $!")
        else:
            script.append(command)
    with subprocess.Popen(["/bin/sh", "-c", "\n".join(script)], cwd=folder, env=environment(folder), text=True,
                          stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=open(folder / "said", "w"),
                          start_new_session=True) as shell:
        try:
            code = shell.wait(timeout=100)
        except subprocess.TimeoutExpired:
            code = "none within 100 s"
        try:
            os.killpg(shell.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
    return (folder / "said").read_text(errors="replace"), code


# What a page's example needs beside the files of all.
PRINTED = [
    "printer-sim --printer dual-wavelength-dlp --lockstep --frames unix:before -o shown.uvj & sim=$!\nsleep 0.3",
    "printbridge print part.uvj --printer dual-wavelength-dlp --sink unix:before --lockstep",
    "kill $sim; wait $sim || true",
]
BEFORE = {
    "bleaching": ["resinctl add my-printer.toml", "rm my-resin.toml", "cp bleaching/heights.csv ."],
    "bridge-vial": ["slicecorr tomo solve hook.stl -o part.frames --voxel-mm 0.5 --printer model-tomography-bench "
                    "--resin model-tomography-resin --method fbp"],
    "bridge-watching": PRINTED,
    "browser": ["echo submit sam 0123456789abcdef0123456789abcdef > accounts; chmod 600 accounts"],
    "farm-watching": ["slicefarm submit part.stl --printer dual-wavelength-dlp --resin benchy-resin --layer-um 50 --speed-mm-h 800",
                      "slicefarm run --until-empty"],
    "flat-field": ["resinctl add my-printer.toml",
                   "printf 'x_mm,y_mm,light\\n5,5,8.1\\n32,5,9.6\\n59,5,8.3\\n5,35,7.9\\n32,35,9.9\\n59,35,8.4\\n' > readings.csv"],
    "even-dead-zone": ["cp flow/*.toml ."],
    "fits": ["rm my-resin.toml"],
    "graded-dose": ["cp target.uvj doses.uvj"],
    "lamps": ["printf 'slice,lamp_share\\n0,1\\n10,0.97\\n' > lamp.csv"],
    "recording": PRINTED,
    "resin-import": ["printf '[sla_material:Grey @0.05]\\nexposure_time = 4\\n[sla_material:Grey @0.1]\\nexposure_time = 9\\n' > bundle.ini",
                     "printf 'grey,light\\n0,0.01\\n128,0.3\\n255,1\\n' > curve.csv"],
    "resins": ["rm my-resin.toml"],
    "scan": ["slicecorr solid part.uvj -o scan.ply"],
    "spread": ["sed '/^\\[blue\\]/a spread = [[40.0, 1.0]]' my-printer.toml > blurred.toml"],
    "supports": ["slicecorr slice part.stl -o part.sl1 --printer prusa-sl1s --layer-um 50"],
}


# Coarser here than on the page, which takes ten times as long.
COARSER = {name: ("--voxel-mm 0.2", "--voxel-mm 0.5") for name in ("tomography", "farm-tomography")}


def stage(folder):
    """The files that examples name."""
    rails = box((-2, -1, 0), (-1, 1, 1.25)) + box((1, -1, 0), (2, 1, 1.25)) + box((-1, -1, 0.55), (1, 1, 1.05))
    write_stl(folder / "part.stl", rails)
    for name, high in (("cup", (3, 2, 1)), ("lid", (2, 2, 0.5)), ("hook", (1, 1, 1)), ("rim", (0.5, 2, 1))):
        write_stl(folder / f"{name}.stl", box((0, 0, 0), high))
    (folder / "docs").symlink_to(ROOT / "docs")
    for kind, name, to in (("printers", "dual-wavelength-dlp", "my-printer"), ("db", "benchy-resin", "my-resin")):
        text = (ROOT / "resins" / kind / f"{name}.toml").read_text()
        (folder / f"{to}.toml").write_text(text.replace(f'name = "{name}"', f'name = "{to}"'))
    shutil.copy(ROOT / "docs" / "heights.csv", folder)
    (folder / "flow").mkdir()
    (folder / "flow" / "my-printer.toml").write_text(
        'name = "my-printer"\nsuction_limit_pa = 20000\n[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n'
        '[blue]\ncalibration = [[0, 1.0], [255, 200.0]]\n[uv]\nkind = "flood"\ncalibration = [[0, 0.0], [255, 275.0]]\n')
    (folder / "flow" / "my-resin.toml").write_text(
        'name = "my-resin"\nviscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n[cure]\nabsorbance_height_um = 408.0\n'
        'absorbance_base = "e"\ncritical_dose_mj_cm3 = 1600.0\n[inhibition]\nbeta = 0.8\nabsorbance_height_um = 38.0\n'
        'absorbance_base = "e"\n')
    (folder / "bleaching").mkdir()
    (folder / "bleaching" / "heights.csv").write_text(bleached_heights())
    write_png(folder / "target.png", 64, 64, (20, 20, 40, 40), 255)
    for name, grey in (("heights", 128), ("roof", 255), ("channel", 128)):
        write_png(folder / f"{name}.png", 1280, 800, (600, 380, 680, 420), grey)
    with_both = "--printer dual-wavelength-dlp --resin benchy-resin"
    said, code = run(folder, [
        f"slicecorr run part.stl -o part.uvj {with_both} --layer-um 50 --speed-mm-h 800",
        "cp part-target.uvj target.uvj",
        "cp target.uvj export.uvj",
    ])
    if code != 0:
        wrong.append(f"the files of all examples: {code}\n{said}")


def main(names):
    pages = {path.stem: path.read_text() for path in sorted((ROOT / "docs").glob("*.md"))}
    for name in [*NONE, *ELSEWHERE]:
        if name not in pages:
            wrong.append(f"{name}.md is not there, and need not be named")
    for point in long_paragraphs(pages["architecture"]):
        wrong.append(f"architecture.md has a paragraph of more than ten lines: {point[:80]}")
    with tempfile.TemporaryDirectory() as work:
        first = pathlib.Path(work) / "first"
        first.mkdir()
        stage(first)
        ran = 0
        for name, text in pages.items():
            if names and name not in names:
                continue
            if name in NONE:
                continue
            if picture_is_late(text):
                wrong.append(f"{name}.md has its first picture below its first heading")
            commands, problem = example_of(text)
            if problem:
                wrong.append(f"{name}.md {problem}")
                continue
            if name in ELSEWHERE:
                continue
            if name in COARSER:
                commands = [command.replace(*COARSER[name]) for command in commands]
            folder = pathlib.Path(work) / "page"
            shutil.copytree(first, folder, symlinks=True)
            said, code = run(folder, BEFORE.get(name, []) + commands)
            if code != 0:
                wrong.append(f"{name}.md: {code}\n    " + "\n    ".join(commands) + "\n" + said[-600:])
            ran += 1
            shutil.rmtree(folder)
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong" if wrong else f"page examples: {ran} run, {len(NONE)} pages need none")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[3:]))
