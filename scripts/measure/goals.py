# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers that are promised, and whether a run reached them."""

import statistics

from . import parts


# What `run` of 3DBenchy under UV light may take, on two cores.
UNDER_UV_S = {"run under UV": 15, "run under UV, layer by layer": 25, "run with an even dead zone, 100 um": 60}


def median(record, what):
    return statistics.median(run[what] for run in record["runs"])


def peak(record):
    return max(run["peak_mib"] for run in record["runs"])


def find(result, **wanted):
    """The measurement with these properties, or None."""
    for record in result["measurements"]:
        if all(record[k] == v for k, v in wanted.items()):
            return record
    return None


def cases(result):
    """Part, display, height of layers: in the order in which they were measured."""
    seen = []
    for r in result["measurements"]:
        key = {"part": r["part"], "display": r["display"], "layer_um": r["layer_um"]}
        if key not in seen:
            seen.append(key)
    return seen


def words(case):
    return f"{parts.PARTS[case['part']].words}, {parts.DISPLAYS[case['display']].words}, {case['layer_um']:g} um"


def ratio(a, b):
    """How many times as long `a` takes as `b`: the median over pairs of runs made in turn."""
    if not a or not b:
        return None
    left = [run["wall_s"] for run in a["runs"]]
    right = [run["wall_s"] for run in b["runs"]]
    if len(left) == len(right):
        return statistics.median(x / y for x, y in zip(left, right))
    return statistics.median(left) / statistics.median(right)


def output_of(result, case):
    for output in result["outputs"]:
        if all(output[k] == case[k] for k in case):
            return output
    return None


def slices(result, case):
    """Of the design; what was corrected may have more."""
    output = output_of(result, case)
    if not output:
        return None
    return output["on"]["slices"] if "on" in output else output["verified"]["layers"]


def judge(result):
    cores = result["machine"]["cores"]
    rows = []

    def goal(number, what, value, target, unit, at_most=False):
        if value is None:
            return
        reached = value <= target if at_most else value >= target
        rows.append(
            {
                "goal": number,
                "what": what,
                "value": round(value, 4),
                "target": target,
                "unit": unit,
                "at_most": at_most,
                "reached": bool(reached),
            }
        )

    for case in cases(result):
        place = words(case)
        lattice = parts.PARTS[case["part"]].lattice

        def job(name, threads=cores, antialias=True):
            return find(result, **case, job=name, antialias=antialias, threads=threads)

        for antialias, target in ((True, 12), (False, 15)):
            peer = job("prusaslicer", antialias=antialias)
            name = "antialiased" if antialias else "pixel centres"
            times = ratio(peer, job("slice", antialias=antialias))
            goal(1, f"slice, {name}: {place}", times, target, "times as fast as PrusaSlicer")
        convert, run = job("convert"), job("run")
        most = 2 if lattice else 1.4
        goal(2, f"correct: {place}", ratio(job("correct"), convert), most, "times decode plus encode", at_most=True)
        goal(2, f"verify: {place}", ratio(job("verify"), convert), 1, "times decode plus encode", at_most=True)
        goal(3, f"run: {place}", ratio(job("prusaslicer"), run), 2 if lattice else 4, "times as fast as PrusaSlicer slices")
        plain = job("slice without heights")
        for name in ("correct", "run"):
            if plain and job(name):
                more = peak(job(name)) - peak(plain)
                goal(5, f"{name}: {place}", more, 100, "MiB more than slices without heights", at_most=True)
        for name, limit_s in UNDER_UV_S.items():
            if job(name):
                goal(6, f"{name}: {place}", median(job(name), "wall_s"), limit_s, "s", at_most=True)
    if cores >= 2:
        for name, one, two in pairs_of_stages(result):
            goal(4, f"stage {name}", two / one, 1.85, "times one thread")
        if cores == 2:
            for case in cases(result):
                for program in ("slice", "convert", "correct", "run", "verify"):
                    for antialias in (True, False):
                        one = find(result, **case, job=program, antialias=antialias, threads=1)
                        two = find(result, **case, job=program, antialias=antialias, threads=2)
                        name = program if antialias else f"{program}, pixel centres"
                        goal(4, f"program {name}: {words(case)}", ratio(one, two), 1.85, "times one thread")
    for record in result["measurements"]:
        if record["job"] == "prusaslicer" or record["part"] != "gyroid" or record["layer_um"] != 10:
            continue
        what = f"{record['job']}{'' if record['antialias'] else ', pixel centres'}, {record['threads']} threads"
        limit = 300 if record["display"] == "2k" else 1024
        goal(5, f"{what}: {words(record)}", peak(record), limit, "MiB", at_most=True)
    return rows


def pairs_of_stages(result):
    """Name and rate with one thread and with two, of stages measured with both."""
    rates = {}
    for stage in result["stages"]:
        if stage["program"] != "stages" or "threads:" not in stage["name"]:
            continue
        name, rest = stage["name"].split("/threads:", 1)
        threads = int(rest.split("/")[0])
        rates[name, threads] = statistics.median(run["Mvoxel/s"] for run in stage["runs"])
    return [(name, rate, rates[name, 2]) for (name, threads), rate in rates.items() if threads == 1 and (name, 2) in rates]
