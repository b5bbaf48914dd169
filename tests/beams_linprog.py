# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""The best contrast that any images of some beams have, by a linear programme (HiGHS in SciPy).

Usage: beams_linprog.py PART.npy ALPHA_PER_CELL BEAMS...: for each number of beams greatest t with A x >= t in the part,
A x <= 1 outside, x >= 0.
"""
import sys

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, hstack, vstack

part = np.load(sys.argv[1])
alpha = float(sys.argv[2])
nz, ny, nx = part.shape
z, y, x = np.indices(part.shape).reshape(3, -1)
for beams in map(int, sys.argv[3:]):
    ways = [(0, 1), (1, 1), (2, 1), (0, -1), (1, -1), (2, -1)]
    ways = {2: ways[:2], 3: ways[:3], 4: [ways[i] for i in (0, 1, 3, 4)], 6: ways}[beams]
    columns = []
    for axis, sign in ways:
        at, n = ((x, nx), (y, ny), (z, nz))[axis]
        pixel, count = ((z * ny + y, nz * ny), (z * nx + x, nz * nx), (y * nx + x, ny * nx))[axis]
        left = np.exp(-alpha * ((at if sign > 0 else n - 1 - at) + 0.5))
        columns.append(coo_matrix((left, (np.arange(part.size), pixel)), (part.size, count)))
    a = hstack(columns).tocsr()
    flat = part.reshape(-1)
    inside, outside = a[flat == 255], a[flat == 0]
    rows = vstack([hstack([-inside, coo_matrix(np.ones((inside.shape[0], 1)))]),
                   hstack([outside, coo_matrix((outside.shape[0], 1))])]).tocsr()
    limits = np.concatenate([np.zeros(inside.shape[0]), np.ones(outside.shape[0])])
    cost = np.zeros(rows.shape[1])
    cost[-1] = -1
    found = linprog(cost, A_ub=rows, b_ub=limits, bounds=(0, None), method="highs")
    print(-found.fun if found.status == 0 else "inf")
