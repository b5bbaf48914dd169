#!/usr/bin/env python3
"""Real print files through the program, read by a second reader before and after.

print_programs.py SLICECORR FOLDER: the program, and the folder with slices/binary. Ends with 1 where the two readers see
different pixels, times or sizes, with 77 where there are no real files.
"""
import gzip
import pathlib
import subprocess
import sys
import tempfile

import print_files

PROGRAM, DATA = sys.argv[1], pathlib.Path(sys.argv[2]) / "slices/binary"
FILES = [("mariner_pyramid.v3.ctb", range(50)), ("msla_photon_mono.v515.pwmo.gz", (0, 6, 200, 425))]
if not (DATA / FILES[0][0]).exists():
    sys.exit(77)


def run(*arguments):
    subprocess.run([PROGRAM, "--quiet", *map(str, arguments)], check=True)


def read(path, layers):
    return print_files.read(path.read_bytes(), set(layers))


def same(a, b, *keys):
    for key in keys:
        if a[key] != b[key]:
            sys.exit(f"{key}: {str(a[key])[:200]} and {str(b[key])[:200]}")


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    for file, layers in FILES:
        data = (DATA / file).read_bytes()
        data = gzip.decompress(data) if file.endswith(".gz") else data
        original = folder / file.removesuffix(".gz")
        original.write_bytes(data)
        before = read(original, layers)
        # Their pixels in a new file of another format.
        goo = folder / "made.goo"
        run("convert", original, "-o", goo)
        after = read(goo, layers)
        same(before, after, "size", "count", "layers", "times", "exposure_s", "bottom_s", "bottom_layers")
        # And from there into the first one again, as a template: the same file.
        back = folder / ("back" + original.suffix)
        run("convert", goo, "-o", back, "--template", original)
        same(before, read(back, layers), "size", "count", "layers", "times", "heights", "exposure_s", "bottom_s")
        if back.read_bytes() != data:
            sys.exit(f"{file}: other bytes by way of GOO")
        print(f"{file}: {len(after['layers'])} layers compared")
    # A new CTB with the pixels of a CTB.
    original, new = folder / FILES[0][0], folder / "new.ctb"
    run("convert", folder / "made.goo", "-o", new)
    same(read(folder / "made.goo", FILES[1][1]), read(new, FILES[1][1]), "size", "count", "layers", "times")
