# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Tables about a run, as Markdown."""

import statistics

from . import goals, parts

BEGIN = "<!-- made by scripts/bench -->"
END = "<!-- end of scripts/bench -->"
TITLES = {
    1: "slicing beside PrusaSlicer",
    2: "`correct` and `verify` beside decoding and encoding",
    3: "`run`",
    4: "two threads beside one",
    5: "peak memory",
    6: "under UV light",
}


def figure(value):
    if value is None:
        return "-"
    if value >= 100:
        return f"{value:.0f}"
    if value >= 10:
        return f"{value:.1f}"
    return f"{value:.2f}"


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def machine_words(result):
    m = result["machine"]
    changed = ", with changes" if m["changed_since_commit"] else ""
    return (
        f"{m['cpu']}, {m['cores']} cores, {m['memory_gib']} GiB of memory, {m['system']}, {m['compiler']},"
        f" {m['build_type']}; commit {m['commit'][:12]}{changed}, {m['date']};"
        f" {result['peer'] or 'without PrusaSlicer'}."
    )


def slicing(result):
    cores = result["machine"]["cores"]
    rows = []
    for case in goals.cases(result):
        count = goals.slices(result, case)
        for antialias in (True, False):
            ours = goals.find(result, **case, job="slice", antialias=antialias, threads=cores)
            if not ours:
                continue
            one = goals.find(result, **case, job="slice", antialias=antialias, threads=1) if cores > 1 else None
            peer = goals.find(result, **case, job="prusaslicer", antialias=antialias)
            ratio = goals.ratio(peer, ours)
            rows.append(
                [
                    goals.words(case) if antialias else "",
                    str(count) if count and antialias else "",
                    "256 levels" if antialias else "centres",
                    figure(goals.median(peer, "wall_s") if peer else None),
                    figure(goals.median(ours, "wall_s")),
                    f"**{figure(ratio)}**" if ratio else "-",
                    figure(goals.median(one, "wall_s") if one else None),
                    figure(goals.peak(peer) if peer else None),
                    figure(goals.peak(ours)),
                ]
            )
    head = ["part", "slices", "rule", "PrusaSlicer, s", "ours, s", "ratio", "ours, one thread, s", "PrusaSlicer, MiB", "ours, MiB"]
    return table(head, rows)


def jobs(result):
    cores = result["machine"]["cores"]
    rows = []
    for case in goals.cases(result):
        found = {
            job: goals.find(result, **case, job=job, antialias=True, threads=cores)
            for job in ("convert", "correct", "verify", "run")
        }
        if not found["run"]:
            continue
        peer = goals.find(result, **case, job="prusaslicer", antialias=True)
        row = [goals.words(case)]
        row += [
            f"{figure(goals.median(found[job], 'wall_s'))} ({figure(goals.peak(found[job]))})" if found[job] else "-"
            for job in found
        ]
        row += [figure(goals.ratio(found[job], found["convert"])) for job in ("correct", "verify")]
        row.append(figure(goals.ratio(peer, found["run"])))
        rows.append(row)
    head = ["part", "`convert`, s (MiB)", "`correct`, s (MiB)", "`verify`, s (MiB)", "`run`, s (MiB)", "correct / convert", "verify / convert", "PrusaSlicer / run"]
    return table(head, rows)


def under_uv(result):
    """Empty where nothing was measured under UV light."""
    rows = []
    for case in goals.cases(result):
        for job in goals.UNDER_UV_S:
            found = goals.find(result, **case, job=job, antialias=True, threads=result["machine"]["cores"])
            if not found:
                continue
            processor_s = goals.median(found, "user_s") + goals.median(found, "system_s")
            rows.append([goals.words(case), job, figure(goals.median(found, "wall_s")), figure(processor_s), figure(goals.peak(found))])
    return table(["part", "", "s", "processor, s", "peak, MiB"], rows) if rows else ""


def stages(result):
    rows, copy = {}, {}
    for stage in result["stages"]:
        if stage["program"] != "stages":
            continue
        name, _, rest = stage["name"].partition("/threads:")
        threads = int(rest.split("/")[0]) if rest else 1
        rate = statistics.median(run["Mvoxel/s"] for run in stage["runs"])
        (copy if name == "copy" else rows.setdefault(name, {}))[threads] = rate
    lines = []
    for name, rates in rows.items():
        one, two = rates.get(1), rates.get(2)
        limit = copy.get(1)
        lines.append(
            [
                name.replace("_", " "),
                figure(one / 1000) if one else "-",
                f"{100 * one / limit:.2g} %" if one and limit else "-",
                figure(two / 1000) if two else "-",
                figure(two / one) if one and two else "-",
            ]
        )
    copied = f"Copying memory in the same process: {figure(copy[1] / 1000)} G bytes/s" if 1 in copy else ""
    if 2 in copy:
        copied += f" with one thread, {figure(copy[2] / 1000)} with two"
    head = ["stage", "G voxels/s", "of a copy of memory", "with two threads", "ratio"]
    return table(head, lines) + (f"\n{copied}.\n" if copied else "")


def promised(result):
    rows = []
    for number, title in TITLES.items():
        of = [g for g in result["goals"] if g["goal"] == number]
        if not of:
            continue
        for unit in dict.fromkeys(g["unit"] for g in of):
            same = [g for g in of if g["unit"] == unit]
            for target in dict.fromkeys(g["target"] for g in same):
                group = [g for g in same if g["target"] == target]
                missed = [g for g in group if not g["reached"]]
                pick = max if group[0]["at_most"] else min
                worst = pick(group, key=lambda g: g["value"])
                rows.append(
                    [
                        f"{number}. {title}",
                        f"{'at most' if worst['at_most'] else 'at least'} {target:g} {unit}",
                        f"{len(group) - len(missed)} of {len(group)}",
                        f"{figure(worst['value'])} ({worst['what']})",
                    ]
                )
    return table(["promise", "figure", "reached", "the worst"], rows)


def how_far(goal):
    share = goal["value"] / goal["target"]
    return f"{figure(share)} of the figure" if not goal["at_most"] else f"{figure(share)} times the limit"


def verdict(result):
    """Every promise, for the terminal."""
    lines = [machine_words(result)]
    for g in result["goals"]:
        word = "reached" if g["reached"] else "MISSED "
        bound = "at most" if g["at_most"] else "at least"
        lines.append(
            f"{g['goal']} {word} {g['what']}: {figure(g['value'])} {g['unit']} ({bound} {g['target']:g};"
            f" {how_far(g)})"
        )
    reached = sum(g["reached"] for g in result["goals"])
    lines.append(f"{reached} of {len(result['goals'])} reached")
    return "\n".join(lines)


def tables(result):
    parts_of = [
        machine_words(result),
        "![Seconds and memory of PrusaSlicer and of ours, part by part](performance.svg)",
        "### What is promised\n\n" + promised(result),
        "### Slicing\n\n" + slicing(result),
        "### Correcting\n\n" + jobs(result),
    ]
    if under_uv(result):
        parts_of.append("### Under UV light\n\n" + under_uv(result))
    if result["stages"]:
        parts_of.append("### Stages\n\n" + stages(result))
    compared = [s for o in result["outputs"] for w in ("on", "off") for s in o.get(w, {}).get("samples", [])]
    with_peer = [s for s in compared if "bound_px" in s]
    if with_peer:
        worst = max(s["apart_px"] / s["bound_px"] for s in with_peer)
        parts_of.append(
            f"Proof: {len(compared)} slices read back by libpng; those of PrusaSlicer are apart by at most"
            f" {100 * worst:.0f} % of what its rounding allows."
        )
    if result["skipped"]:
        parts_of.append("Left out: " + "; ".join(result["skipped"]) + ".")
    if result["wrong"]:
        parts_of.append("**Wrong:** " + "; ".join(result["wrong"]))
    return "\n\n".join(p.rstrip("\n") for p in parts_of) + "\n"


def scaling(result):
    """Serial shares, predictions and the large ones."""
    rows, shares = [], []
    for r in result["scaling"]:
        rows.append(
            [
                r["words"], parts.DISPLAYS[r["display"]].words, f"{r['triangles']:,}", f"{r['slices']:,}", f"`{r['job']}`",
                figure(r["wall_s"]), figure(r["user_s"] + r["system_s"]), figure(r["peak_mib"]),
            ]
        )  # fmt: skip
        if "predicted" in r:
            p = r["predicted"]
            shares.append(
                [f"{r['words']}, `{r['job']}`", f"{100 * p['serial_share']:.1f} %", str(p["bands"])]
                + [figure(p["speed"][n]) for n in ("2", "8", "16", "64")]
            )
    return (
        machine_words(result)
        + "\n\n"
        + table(["part", "display", "triangles", "slices", "job", "wall, s", "processor, s", "peak, MiB"], rows)
        + "\n"
        + table(["job", "one thread alone", "bands", "2 cores", "8", "16", "64 cores"], shares)
    )


def put(path, text):
    """In place of what is between the marks."""
    old = path.read_text()
    if old.count(BEGIN) != 1 or old.count(END) != 1:
        raise SystemExit(f"bench: {path} must have '{BEGIN}' and '{END}' once each")
    head, rest = old.split(BEGIN)
    tail = rest.split(END)[1]
    path.write_text(f"{head}{BEGIN}\n\n{text}\n{END}{tail}")
