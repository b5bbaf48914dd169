# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""The fewest features lost and gaps filled by any light of a column's slices, by a mixed integer programme (HiGHS in SciPy).

Usage: robust_milp.py COLUMNS SLICES SAID WEAK STRONG [layers]: COLUMNS has a column a line, a digit a layer (0, 1); each case is
BLACK,FULL,A, light of a slice over what gels and what a slice leaves of a dose. With inputs as said each feature has a node
at 1 or above and each gap one below; in the weak case features are to have one, in the strong one gaps. Prints the sum.
"""
import itertools
import sys

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_matrix

PASS = 2e-4  # doses are to pass 1 by so much


def doses(slices, a, scale, own):
    """Dose at each node as a sum over slices of their light with inputs as said; `own`: what a slice gives its own."""
    k, j = np.indices((slices + 1, slices))
    return np.where(j >= k, scale * own * a ** np.maximum(0.0, j - k), 0.0)


def fewest(column, slices, cases, layers):
    black, full, _ = cases[0]
    # Layer by layer what a slice gives its own layer is at the window's side all of it, at the other what is left.
    of_feature, of_gap = ([doses(slices, a, most / full, (1, a)[side] if layers else 1 - a) for _, most, a in cases]
                          for side in range(2))
    items, first = [], 0
    for kind, run in itertools.groupby(column):
        count = len(list(run))
        if kind == "1" or first + count < len(column):
            items.append((kind == "1", range(first, first + count + (0 if layers else 1))))
        first += count
    nodes = sum(len(n) for _, n in items)
    size = slices + 2 * nodes + len(items)
    rows = 2 * (nodes + len(items))
    a, low, high = lil_matrix((rows, size)), np.full(rows, -np.inf), np.full(rows, np.inf)
    row, said, case = 0, slices, slices + nodes
    for i, (feature, run) in enumerate(items):
        of_case = of_feature if feature else of_gap
        for which, at in ((of_case[0], said), (of_case[1 if feature else 2], case)):
            for n, node in enumerate(run):
                a[row, :slices] = which[node]
                if feature:  # the dose is at least 1 where this node is chosen
                    a[row, at + n], low[row] = -(1 + PASS), 0
                else:
                    most = 2 * full / (1 - cases[2][2] if layers else 1)
                    a[row, at + n], high[row] = most, most + 1 - PASS
                row += 1
            a[row, at:at + len(run)] = 1
            if at == case:
                a[row, slices + 2 * nodes + i] = 1  # or it fails
            low[row] = 1
            row += 1
        said, case = said + len(run), case + len(run)
    cost = np.zeros(size)
    cost[slices + 2 * nodes:] = 1
    least, most, whole = np.zeros(size), np.ones(size), np.ones(size)
    least[:slices], most[:slices], whole[:slices] = black, full, 0
    found = milp(cost, constraints=LinearConstraint(a.tocsr(), low, high), bounds=Bounds(least, most), integrality=whole)
    return round(found.fun) if found.status == 0 else len(items)


def main():
    cases = [tuple(map(float, c.split(","))) for c in sys.argv[3:6]]
    layers = sys.argv[6:] == ["layers"]
    with open(sys.argv[1]) as file:
        print(sum(fewest(line.strip(), int(sys.argv[2]), cases, layers) for line in file))


main()
