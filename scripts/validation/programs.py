# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the programs of this project, in a folder of its own, without definitions of whoever runs it."""
import json
import os
import pathlib
import subprocess
import tempfile

from reckon import BadInput, Disagrees, Refused

ROOT = pathlib.Path(__file__).resolve().parents[2]


class Programs:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder).resolve()
        if not (self.folder / "resinctl").is_file():
            raise BadInput(f"{self.folder}: has no resinctl; expected the folder of the programs (--bin), build/bin after a build")
        self._temporary = tempfile.TemporaryDirectory(prefix="slicecorr-validate-")
        self.work = pathlib.Path(self._temporary.name)
        self.environment = dict(os.environ, XDG_CONFIG_HOME=str(self.work / "none"))
        self.environment.pop("SLICECORR_DB", None)
        self.runs = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._temporary.cleanup()

    def run(self, program, *arguments, expected=(0,)):
        """What a program prints; an exit code that is not expected is told with what it said."""
        self.runs += 1
        call = [str(self.folder / program), "--quiet", *map(str, arguments)]
        done = subprocess.run(call, capture_output=True, text=True, cwd=self.work, env=self.environment, timeout=600, check=False)
        if done.returncode not in expected:
            told = done.stderr.strip()[-600:]
            called = f"{program} {' '.join(map(str, arguments))}"
            raise Refused(called, told) if done.returncode == 2 else Disagrees(f"{called}: {told}")
        return done.stdout

    def json(self, program, *arguments):
        return json.loads(self.run(program, *arguments, "--json", "-"))

    def write(self, name, text):
        path = self.work / name
        path.write_text(text)
        return path

    def resin(self, name, **changes):
        """A shipped resin, with figures of its first table added or put in place of others."""
        lines = (ROOT / "resins/db" / f"{name}.toml").read_text().splitlines()
        lines = [line for line in lines if line.split("=")[0].strip() not in changes]
        at = next(k for k, line in enumerate(lines) if line.startswith("name ="))
        lines[at] = f'name = "{name}-here"'
        lines[at + 1:at + 1] = [f"{key} = {value}" for key, value in changes.items()]
        return self.write(f"{name}-here.toml", "\n".join(lines) + "\n")

    def printer(self, name, full_mw_cm2, pixels=(64, 32)):
        """A printer of 50 um pixels and even levels, black 0."""
        return self.write(f"{name}.toml", f"""name = "{name}"
[display]
width_px = {pixels[0]}
height_px = {pixels[1]}
pixel_um = 50.0
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 0.0], [255, {full_mw_cm2}]]
[uv]
wavelength_nm = 365
kind = "flood"
calibration = [[0, 0.0], [255, 275.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 100
""")


def facets(triangles):
    corner = "vertex {:.6f} {:.6f} {:.6f}\n"
    for t in triangles:
        yield "facet normal 0 0 0\nouter loop\n" + "".join(corner.format(*v) for v in t) + "endloop\nendfacet\n"


def prism(outline, height_mm):
    """Triangles of an upright prism over an outline that can be seen whole from its middle."""
    n = len(outline)
    x, y = sum(p[0] for p in outline) / n, sum(p[1] for p in outline) / n
    for (ax, ay), (bx, by) in zip(outline, outline[1:] + outline[:1]):
        a, b, high_a, high_b = (ax, ay, 0), (bx, by, 0), (ax, ay, height_mm), (bx, by, height_mm)
        yield (x, y, height_mm), high_a, high_b
        yield (x, y, 0), b, a
        yield a, b, high_b
        yield a, high_b, high_a


def box(x, y, z):
    """Triangles of a box from x[0] to x[1] and so on."""
    outline = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    for t in prism(outline, z[1] - z[0]):
        yield tuple((px, py, pz + z[0]) for px, py, pz in t)


def write_stl(path, triangles):
    with open(path, "w") as out:
        out.write("solid part\n")
        out.writelines(facets(triangles))
        out.write("endsolid part\n")
    return path
