# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""PrusaSlicer on the same pixel grid as ours: the traps are in docs/slicing.md and here."""

import shutil
import subprocess


def find():
    return shutil.which("prusa-slicer")


def version(program):
    answer = subprocess.run([program, "--help"], capture_output=True, text=True, check=False).stdout
    for line in answer.splitlines():
        if line.startswith("PrusaSlicer"):
            return line.split(" based on")[0].split("+")[0].strip()
    return "PrusaSlicer"


def command(program, mesh, out, display, layer_um, antialias):
    width, height = f"{display.width_mm:.6g}", f"{display.height_mm:.6g}"
    layer = f"{layer_um / 1000:g}"
    return [
        program,
        "--export-sla",
        # Both heights, else the first layer is 0.3 mm. Supports and pads are on unless told.
        "--layer-height", layer,
        "--initial-layer-height", layer,
        "--supports-enable=0",
        "--pad-enable=0",
        "--display-width", width,
        "--display-height", height,
        "--display-pixels-x", str(display.width_px),
        "--display-pixels-y", str(display.height_px),
        # The bed must lie as the display does, else the part is cropped without a word.
        "--bed-shape", f"0x0,{width}x0,{width}x{height},0x{height}",
        "--display-orientation", "landscape",
        "--display-mirror-x=0",
        # Widening outlines and taking that back again would cost it time and change its areas.
        "--slice-closing-radius", "0",
        # 1: 256 grey levels; 0: no antialiasing.
        "--gamma-correction", "1" if antialias else "0",
        "--output", out,
        mesh,
    ]  # fmt: skip
