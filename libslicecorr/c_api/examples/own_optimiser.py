#!/usr/bin/python3
"""Frames from an optimiser of one's own: own_optimiser.py OUT.frames PRINTER RESIN. Needs SciPy."""
import sys

import numpy as np
from scipy.optimize import minimize

from slicecorr import tomo


def find_light(projector, part, contrast=1.25):
    """Light, in any unit, by SciPy's L-BFGS-B: dose of at least 1 in the part, at most 1/contrast in void."""
    gel = (part == 255) & projector.inside
    void = (part == 0) & projector.inside

    def loss(values):
        dose = projector.adjoint(values.reshape(projector.light_shape))
        short = np.where(gel, np.maximum(1 - dose, 0), 0)
        over = np.where(void, np.maximum(dose - 1 / contrast, 0), 0)
        # The transpose of the operator in the dose: an exact gradient.
        return np.sum(short**2) + np.sum(over**2), 2 * projector.forward(over - short).ravel()

    start = projector.filtered_start(part).astype(np.float64)
    start /= projector.adjoint(start)[gel].mean()
    found = minimize(loss, start.ravel(), jac=True, method="L-BFGS-B", bounds=[(0, None)] * start.size,
                     options={"maxiter": 100})
    return found.x.reshape(projector.light_shape)


def main(path, printer, resin):
    voxel_mm = 0.5
    y, x = np.mgrid[-15:16, -15:16] * voxel_mm
    ring = (np.hypot(x, y) < 6) & (np.hypot(x, y) > 3)
    projector = tomo.Projector.for_printer(printer, resin, voxel_mm, slices=2, angles=90)
    part = np.zeros(projector.volume_shape, np.uint8)
    beside = (projector.voxels - ring.shape[0]) // 2
    part[:, beside:-beside, beside:-beside][:, ring] = 255

    light = find_light(projector, part)
    # As bright as the projector gets, for as many turns as the weakest voxel needs; then as bright as they need.
    light *= projector.most_mw_cm2 / light.max()
    turn = projector.turn_mj_cm3 * projector.adjoint(light)[part == 255].min()
    turns = int(np.ceil(projector.to_gel_mj_cm3 / turn))
    light *= 1.01 * projector.to_gel_mj_cm3 / (turns * turn)

    job = tomo.job_of_light(light, part, voxel_mm, printer, resin, turns=turns)
    job.save(path)
    print(f"{turns} turns, contrast {job.figures['contrast']:.2f}, void that gels {job.figures['ver']:.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
