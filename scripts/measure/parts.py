# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Parts and displays that are measured."""

import dataclasses
import pathlib
import subprocess


UV_LAMP = """[uv]
wavelength_nm = 365
kind = "patterned"
calibration = [[0, 0.0], [255, 275.0]]
"""


@dataclasses.dataclass(frozen=True)
class Display:
    name: str
    width_px: int
    height_px: int
    pixel_um: float

    @property
    def width_mm(self):
        return self.width_px * self.pixel_um / 1000

    @property
    def height_mm(self):
        return self.height_px * self.pixel_um / 1000

    @property
    def words(self):
        return f"{self.width_px} x {self.height_px}"

    def printer_toml(self, uv=False):
        """With `uv` it has a lamp of inhibiting light that shows images, as dual-wavelength printers have."""
        return f"""name = "bench-{self.name}"
[display]
width_px = {self.width_px}
height_px = {self.height_px}
pixel_um = {self.pixel_um}
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 150
[provenance]
source = "a model display"
measurements = "none: a model printer"
""" + (UV_LAMP if uv else "")


DISPLAYS = {
    "2k": Display("2k", 2560, 1440, 47.25),
    "12k": Display("12k", 11520, 5120, 19.0),
    "16k": Display("16k", 15360, 8640, 14.0),
}


@dataclasses.dataclass(frozen=True)
class Part:
    name: str
    words: str
    layers_um: tuple  # the first is the one that all displays are measured with
    make: tuple = ()  # program that makes it and what it is told: OUT stands for the file
    triangles: int = 0  # that make_part must have made; 0: some
    file: str = ""  # under the folder of real data
    closed: bool = True  # its slices' areas follow from its triangles
    lattice: bool = False  # all of it is edges: other figures are promised
    under_uv: bool = False  # measured under inhibiting light, too


PARTS = {
    p.name: p
    for p in (
        Part("gyroid", "gyroid lattice", (50, 25, 10), ("make_part", "gyroid", "OUT", "60", "60", "38.47", "10", "1.42"), 317084, lattice=True),
        Part("bumpy", "bumpy sphere", (50,), ("make_part", "sphere", "OUT", "37", "289"), 12 * 289 * 289),
        Part(
            "struts", "lattice of struts", (50,), ("make_lattice", "OUT", "5", "5", "4", "8", "0.7"),
            closed=False, lattice=True,
        ),
        Part("benchy", "3DBenchy", (50,), file="meshes/clean/3DBenchy.stl", under_uv=True),
        Part(
            "channels",
            "microfluidic channels",
            (5,),
            file="meshes/dirty/pymfcad_microfluidic_void_channels.stl",
            closed=False,
        ),
    )
}


# Name, words, part, display, height of layers: what scripts/bench --scaling measures.
SCALING = (
    ("gyroid", "gyroid lattice", PARTS["gyroid"], DISPLAYS["2k"], 50),
    ("bumpy", "bumpy sphere", PARTS["bumpy"], DISPLAYS["2k"], 50),
    ("16k", "gyroid lattice", PARTS["gyroid"], DISPLAYS["16k"], 50),
    (
        "triangles",
        "bumpy sphere of 10 million triangles",
        Part("ten-million", "bumpy sphere", (50,), ("make_part", "sphere", "OUT", "37", "913"), 12 * 913 * 913),
        DISPLAYS["2k"],
        50,
    ),
    (
        "slices",
        "gyroid column of 100 mm",
        Part("column", "gyroid column", (1,), ("make_part", "gyroid", "OUT", "10", "10", "100", "10", "1.42"), 0),
        DISPLAYS["2k"],
        1,
    ),
)


class Missing(Exception):
    """A part that is not on this machine."""


class NotMade(Exception):
    """A part that make_part did not make."""


def fetch(part, binaries, data, folder):
    """The part's mesh; made in `folder` where it is a made one."""
    if part.file:
        path = pathlib.Path(data) / part.file
        if not path.is_file():
            raise Missing(f"{part.words}: no {path}")
        return str(path)
    path = pathlib.Path(folder) / f"{part.name}.stl"
    program, *told = part.make
    command = [f"{binaries}/{program}", *(str(path) if word == "OUT" else word for word in told)]
    try:
        made = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise NotMade(f"{command[0]}: can't be started: {error.strerror}") from error
    size = path.stat().st_size if path.is_file() else 0
    if made.returncode != 0 or size <= 84 or (part.triangles and size != 84 + 50 * part.triangles):
        expected = f"{part.triangles} triangles" if part.triangles else "a mesh"
        raise NotMade(f"{' '.join(part.make)}: did not write {expected}: {made.stderr.strip()}")
    return str(path)
