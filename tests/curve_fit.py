#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Least squares of the cure models by scipy's curve_fit: what our fits are compared with.

Reads JSON on stdin: a list of fits, each with "model", the measurements' columns, "start" (values in the order of the
model's parameters), for dead zones "hb_um" and "critical_dose_prime", and "repeat" (how often to fit, for timing).
Prints a list of {"values", "covariance", "seconds"}; seconds are those of one fit, the fastest of all repeats.

The models are written as in the dissertation (3.1, 3.15, 3.25, 3.22), not as in our library.
"""
import json
import sys
import time

import numpy as np
from scipy.optimize import curve_fit


def jacobs(x, h, dc):
    return h * np.log(x["dose"] / dc)


def kinetic(x, h, m, prime):
    return h / m * np.log(x["blue"] ** m * x["time"] / prime)


def steady(x, beta, huv):
    return np.log(beta * x["uv"] / x["blue"]) / (1 / huv - 1 / x["hb"])


def transient(x, beta, huv, m):
    """Newton's method from the steady front, where the dose is 0; it rises to the root from there."""
    level = (x["prime"] / x["time"]) ** (1 / m)
    z = steady(x, beta, huv)
    for _ in range(200):
        blue = x["blue"] * np.exp(-z / x["hb"])
        uv = beta * x["uv"] * np.exp(-z / huv)
        step = (level - blue + uv) / (uv / huv - blue / x["hb"])
        z = z + step
        if np.max(np.abs(step)) < 1e-12 * np.max(np.abs(z)):
            break
    return z


MODELS = {"jacobs": jacobs, "kinetic": kinetic, "deadzone-steady": steady, "deadzone-transient": transient}


def fit(task):
    x = {name: np.array(task[name]) for name in ("dose", "blue", "uv", "time")}
    x["hb"] = task["hb_um"]
    x["prime"] = task["critical_dose_prime"]
    y = np.array(task["height_um"])
    law = MODELS[task["model"]]
    seconds = float("inf")
    for _ in range(task["repeat"]):
        begin = time.perf_counter()
        values, covariance = curve_fit(law, x, y, p0=task["start"], method="lm", maxfev=100000,
                                       xtol=1e-12, ftol=1e-12, gtol=1e-12)
        seconds = min(seconds, time.perf_counter() - begin)
    return {"values": values.tolist(), "covariance": covariance.tolist(), "seconds": seconds}


json.dump([fit(task) for task in json.load(sys.stdin)], sys.stdout)
