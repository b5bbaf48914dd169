#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What a call from Python costs: milliseconds of one thread for the operators of 256 x 256 voxels and 360 angles, the
least of several; beside them stand those of build/bin/tomo_bench, which calls the kernels alone.
Run with PYTHONPATH=build/python."""

import time

import numpy as np

from slicecorr import tomo


def least_ms(call, runs):
    least = float("inf")
    for _ in range(runs):
        start = time.process_time()
        call()
        least = min(least, time.process_time() - start)
    return 1e3 * least


for slices in (1, 32):
    for absorption in (0, 10):
        projector = tomo.Projector(256, 360, slices=slices, absorption_per_cm=absorption, threads=1)
        volume, light = np.ones(projector.volume_shape, np.float32), np.ones(projector.light_shape, np.float32)
        wide = light.astype(np.float64)
        to_light, to_volume = np.empty_like(light), np.empty_like(volume)
        runs = 60 if slices == 1 else 10
        print(f"{slices:2} slices, absorption times radius {absorption / 10:g}:",
              f"A {least_ms(lambda: projector.forward(volume, out=to_light), runs):.2f}",
              f"(new array {least_ms(lambda: projector.forward(volume), runs):.2f}),",
              f"A^T {least_ms(lambda: projector.adjoint(light, out=to_volume), runs):.2f}",
              f"(new array {least_ms(lambda: projector.adjoint(light), runs):.2f},",
              f"float64 {least_ms(lambda: projector.adjoint(wide), runs):.2f}) ms")

least = tomo.Projector(2, 3)
volume, light = np.ones((1, 2, 2), np.float32), np.empty((1, 3, 2), np.float32)
start = time.process_time()
for _ in range(20000):
    least.forward(volume, out=light)
print(f"a call of next to no voxels: {(time.process_time() - start) / 20000 * 1e6:.1f} us")
