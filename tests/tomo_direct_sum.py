# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Dose of a tomographic job by a direct sum over its frames, with nothing of the project's own code.

Usage: tomo_direct_sum.py JOB.frames OUT.npy
Telecentric light; matched bath or a dry vial; with inserts, axes that lean and wobble, and uneven light. One slice in every ten, to save time: others are 0.
"""
import json, struct, sys, zipfile, zlib

import numpy as np


DIRECTIONS = 10  # of a frame's step
POINTS = (np.arange(8) + 0.5) / 8 - 0.5  # of a voxel, along x and y


def png(data):
    """8-bit grey without filters, as this project writes it."""
    at, idat = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 0)
        if kind == b"IDAT":
            idat += body
        at += 12 + size
    rows = np.frombuffer(zlib.decompress(idat), np.uint8).reshape(height, width + 1)
    assert not rows[:, 0].any()
    return rows[:, 1:]


def hidden(opaque, x, y, th, size):
    """Which points lie in a square of this size about an opaque place, or see one against the light.

    Squares are smaller by 1e-6, so that lines along their edges and through their corners pass."""
    half = size * (0.5 - 1e-6)
    dark = np.zeros(x.shape, bool)
    for ox, oy in opaque:
        near, far = np.zeros(x.shape), np.full(x.shape, np.inf)
        for offset, d in ((ox - x, np.sin(th)), (oy - y, -np.cos(th))):
            if abs(d) < 1e-12:
                far = np.where(np.abs(offset) < half, far, -1)
                continue
            a, b = (offset - half) / d, (offset + half) / d
            near, far = np.maximum(near, np.minimum(a, b)), np.minimum(far, np.maximum(a, b))
        dark |= near < far
    return dark


def main(job, out):
    with zipfile.ZipFile(job) as z:
        c = json.loads(z.read("config.json"))
        inserts = [png(z.read("insert/%08d.png" % k)) for k in range(c["voxels"][0])] if c.get("insert") else None
        frames = np.array([png(z.read("frame/%08d.png" % k)) for k in range(c["angles"])])
        flat = c["printer"].get("flat_field")
        share = png(z.read(flat["file"])) / flat["reference"] if flat else np.ones(frames.shape[1:])
    levels, mw = zip(*c["calibration"])
    light = np.interp(np.arange(256) * levels[-1] / 255, levels, mw)[frames] * share  # frame, row, column
    vial, optics, resin = c["printer"]["vial"], c["printer"]["optics"], c["resin"]
    n1, n3, ri, ro, n2 = vial["n_outside"], resin["n"], vial["inner_mm"], vial["outer_mm"], vial["n_wall"]
    alpha = 1e3 * np.log(10) / resin["absorbance_height10_um"]  # 1/mm
    active = resin.get("active_absorption_per_cm", 10 * alpha) or 10 * alpha
    p, m = c["pitch_mm"], c["angles"]
    nz, n, _ = c["voxels"]
    middle = c.get("middle_z_mm", 0)
    axis = c["voxel_mm"] * (np.arange(n) - (n - 1) / 2)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= axis[-1]
    height, width = frames.shape[1:]
    # Where the axis is while each frame is shown.
    tilt = np.radians(optics.get("tilt_deg", 0))
    wobble = np.array(c["printer"]["rotation"].get("wobble", [[0, 0, 0]])).T
    stage = 360 * np.arange(m) / m
    right, up = (np.interp(stage, wobble[0], w, period=360) for w in wobble[1:])
    up = np.floor(np.abs(up) + 0.5) * np.sign(up)

    def face(na, nb, sin_a):
        sin_b = na * sin_a / nb
        ca, cb = np.sqrt(1 - sin_a ** 2), np.sqrt(1 - sin_b ** 2)
        ts = 4 * na * ca * nb * cb / (na * ca + nb * cb) ** 2
        tp = 4 * na * ca * nb * cb / (na * cb + nb * ca) ** 2
        return ts, tp

    def point(xp, yp, th, s_mm, of_slice):
        t, u = xp * np.cos(th) + yp * np.sin(th), -xp * np.sin(th) + yp * np.cos(th)
        q = t * n3 / n1
        ok = (np.abs(q) < ro) & (np.abs(n1 * q) < n2 * ri) & (np.abs(t) < ri)
        q = np.where(ok, q, 0)
        delta = (np.arcsin(q / ro) - np.arcsin(n1 * q / (n2 * ro)) + np.arcsin(n1 * q / (n2 * ri))
                 - np.arcsin(n1 * q / (n3 * ri)))
        s1, p1 = face(n1, n2, q / ro)
        s2, p2 = face(n2, n3, n1 * q / (n2 * ri))
        through = (s1 * s2 + p1 * p2) / 2 * n3 / n1
        axis_column = (q * np.cos(tilt) + s_mm * np.sin(tilt)) / p + (width - 1) / 2 + optics["axis_right_px"]
        f = np.floor((th - delta) / (2 * np.pi) * m + 0.5).astype(int) % m
        if c["direction"] != "clockwise":
            f = (m - f) % m
        column = np.floor(axis_column + right[f] + 0.5).astype(int)
        lit = of_slice[f, np.clip(column, 0, width - 1)] * ((column >= 0) & (column < width))
        chord = np.sqrt(np.maximum(0, ri ** 2 - t ** 2)) + u
        return np.where(ok, lit * through * np.exp(-alpha * chord), 0)

    across, along = (a.reshape(-1, 1, 1) * c["voxel_mm"] for a in np.meshgrid(POINTS, POINTS))
    dose = np.zeros((nz, n, n), np.float32)
    for s in range(0, nz, 10):
        # A pixel lights the slice that its middle lies in; a slice gets the mean of its rows.
        of_slice = np.zeros((m, width))
        for f in range(m):
            x_mm = (np.arange(width) - (width - 1) / 2 - optics["axis_right_px"] - right[f])[None, :] * p
            z_mm = ((height - 1) / 2 - np.arange(height) - up[f] - optics["axis_up_px"])[:, None] * p
            height_mm = z_mm * np.cos(tilt) + x_mm * np.sin(tilt)
            here = np.floor((height_mm - middle) / c["voxel_mm"] + (nz - 1) / 2 + 0.5) == s
            of_slice[f] = (light[f] * here).sum(0) / np.maximum(1, here.sum(0))
        s_mm = middle + (s - (nz - 1) / 2) * c["voxel_mm"]
        total = np.zeros((n, n))
        opaque = [] if inserts is None else [(axis[i], axis[j]) for j, i in zip(*np.nonzero(inserts[s]))]
        # Directions within the step of a frame, and points of a voxel: each gets the light of the pixel and of the frame
        # that it sees, and of no other.
        for k in range(m * DIRECTIONS):
            th = 2 * np.pi * ((k + 0.5) / DIRECTIONS - 0.5) / m
            lit = point(x + across, y + along, th, s_mm, of_slice).mean(0)
            ok = inside & ~hidden(opaque, x, y, th, c["voxel_mm"])
            total += np.where(ok, lit / DIRECTIONS, 0)
        dose[s] = total * active * c["turn_s"] / m * c["turns"]
    np.save(out, dose)


main(*sys.argv[1:])
