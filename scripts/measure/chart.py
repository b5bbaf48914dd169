# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a run: bars of seconds and of memory, as SVG that needs nothing else."""

import html
import math

from . import goals, page, parts

WIDTH, LEFT, RIGHT = 960, 250, 96
BAR, GAP, GROUP = 15, 3, 16
TITLE = 20

STYLE = """
.slc-bench{max-width:100%;height:auto}
.slc-bench .ground{fill:#fff}
.slc-bench text{font-family:system-ui,sans-serif;font-size:14px;fill:#1b1f24}
.slc-bench .head{font-size:19px;font-weight:600}
.slc-bench .panel{font-size:16px;font-weight:600}
.slc-bench .tick{fill:#4a545e;font-size:13px}
.slc-bench .ratio{font-weight:600}
.slc-bench .halo{paint-order:stroke;stroke:#fff;stroke-width:4px;stroke-linejoin:round}
.slc-bench .grid{stroke:#d5dae0;stroke-width:1}
.slc-bench .limit{stroke:#b3003c;stroke-width:1.5;stroke-dasharray:6 4}
.slc-bench .peer{fill:#80868c}
.slc-bench .slice{fill:#0b57d0}
.slc-bench .run{fill:#c2410c}
@media screen and (prefers-color-scheme:dark){
.slc-bench .ground{fill:#1d2126}
.slc-bench text{fill:#e6e9ec}
.slc-bench .tick{fill:#b4bdc6}
.slc-bench .halo{stroke:#1d2126}
.slc-bench .grid{stroke:#343a41}
.slc-bench .limit{stroke:#ff7a9c}
.slc-bench .peer{fill:#7d8894}
.slc-bench .slice{fill:#8ab4f8}
.slc-bench .run{fill:#fb923c}
}
""".replace("\n", "")


def ticks(low, high):
    """1, 2, 5 per decade while they fit, else decades."""
    steps = (1, 2, 5) if high / low < 2000 else (1,)
    return [
        s * 10.0**e
        for e in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        for s in steps
        if low <= s * 10.0**e <= high
    ]


def bounds(values):
    """Round ends of a logarithmic axis with room for words behind the longest bar."""
    low = 10 ** math.floor(math.log10(min(values)))
    if min(values) / low < 1.3:
        low /= 2
    return low, max(values) * 1.1


class Panel:
    """Groups of bars under a title, on one logarithmic axis."""

    def __init__(self, title, unit, value, limits=()):
        self.title, self.unit, self.value, self.limits = title, unit, value, limits
        self.groups = []  # words, [(class, value, words behind the bar)]

    def height(self):
        bars = sum(len(bars) * (BAR + GAP) for _, bars in self.groups)
        return 30 + bars + GROUP * len(self.groups) + 34

    def draw(self, top, out):
        values = [v for _, bars in self.groups for _, v, _ in bars]
        low, high = bounds(values)
        high = max([high] + [limit * 1.05 for limit, _ in self.limits if limit < high * 4])
        scale = (WIDTH - LEFT - RIGHT) / math.log(high / low)

        def x(v):
            return LEFT + scale * math.log(max(v, low) / low)

        out.append(f'<text class="panel" x="16" y="{top + 16}">{html.escape(self.title)}</text>')
        first, bottom = top + 30, top + self.height() - 34
        for tick in ticks(low, high):
            out.append(f'<path class="grid" d="M{x(tick):.1f} {first}V{bottom}"/>')
            out.append(f'<text class="tick" x="{x(tick):.1f}" y="{bottom + 17}" text-anchor="middle">{tick:g}</text>')
        out.append(f'<text class="tick" x="{WIDTH - 16}" y="{bottom + 17}" text-anchor="end">{self.unit}</text>')
        for limit, words in self.limits:
            if low < limit < high:
                out.append(f'<path class="limit" d="M{x(limit):.1f} {first}V{bottom}"/>')
                out.append(
                    f'<text class="tick" x="{x(limit) + 4:.1f}" y="{first - 4}">{html.escape(words)}</text>'
                )
        y = first
        for words, bars in self.groups:
            middle = y + GROUP / 2 + len(bars) * (BAR + GAP) / 2 + 4
            for k, line in enumerate(words):
                at = middle + (k - (len(words) - 1) / 2) * 16
                tone = "" if k == 0 else ' class="tick"'
                out.append(f'<text{tone} x="{LEFT - 10}" y="{at:.1f}" text-anchor="end">{html.escape(line)}</text>')
            y += GROUP / 2
            for kind, value, behind in bars:
                out.append(
                    f'<rect class="{kind}" x="{LEFT}" y="{y:.1f}" width="{max(1.5, x(value) - LEFT):.1f}" height="{BAR}"/>'
                )
                out.append(
                    f'<text class="halo" x="{x(value) + 5:.1f}" y="{y + BAR - 2.5:.1f}">{behind}</text>'
                )
                y += BAR + GAP
            y += GROUP / 2


def draw(result):
    cores = result["machine"]["cores"]
    panels = []
    memory = Panel("Peak memory, antialiased", "MiB", "peak", ((300, "300 MiB"), (1024, "1 GiB")))
    for name, display in parts.DISPLAYS.items():
        panel = Panel(f"{display.words}, pixels of {display.pixel_um:g} um", "seconds", "wall")
        for case in goals.cases(result):
            if case["display"] != name:
                continue
            run = goals.find(result, **case, job="run", antialias=True, threads=cores)
            for antialias in (True, False):
                ours = goals.find(result, **case, job="slice", antialias=antialias, threads=cores)
                peer = goals.find(result, **case, job="prusaslicer", antialias=antialias)
                if not ours:
                    continue
                bars, sizes = [], []

                def bar(kind, record, times):
                    value = goals.median(record, "wall_s")
                    words = f"{page.figure(value)} s"
                    if times:
                        words += f' · <tspan class="ratio">{page.figure(times)} ×</tspan>'
                    bars.append((kind, value, words))
                    sizes.append((kind, goals.peak(record), page.figure(goals.peak(record))))

                if peer:
                    bar("peer", peer, None)
                bar("slice", ours, goals.ratio(peer, ours))
                if antialias and run:
                    bar("run", run, goals.ratio(peer, run))
                part = f"{parts.PARTS[case['part']].words}, {case['layer_um']:g} um"
                panel.groups.append(((part, "antialiased" if antialias else "pixel centres"), bars))
                if antialias:
                    memory.groups.append(((part, display.words), sizes))
        if panel.groups:
            panels.append(panel)
    if memory.groups:
        panels.append(memory)

    out = []
    y = 98
    for panel in panels:
        panel.draw(y, out)
        y += panel.height() + TITLE
    label = "Seconds and peak memory of PrusaSlicer and slicecorr, part by part"
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="slc-bench" viewBox="0 0 {WIDTH} {y:.0f}" width="{WIDTH}"'
        f' height="{y:.0f}" role="img" aria-label="{label}"><style>{STYLE}</style>',
        f'<rect class="ground" width="{WIDTH}" height="{y:.0f}"/>',
        '<text class="head" x="16" y="30">Whole programs, wall time and peak memory</text>',
        f'<text class="tick" x="16" y="52">{html.escape(result["machine"]["cpu"])}, {cores} cores; logarithmic;'
        " × as fast as PrusaSlicer slices the part</text>",
    ]
    x = 16
    for kind, words in (
        ("peer", result["peer"] or "PrusaSlicer"),
        ("slice", "slicecorr slice"),
        ("run", "slicecorr run: slice, correct, verify, report"),
    ):
        head.append(f'<rect class="{kind}" x="{x}" y="65" width="14" height="14"/>')
        head.append(f'<text x="{x + 20}" y="77">{html.escape(words)}</text>')
        x += 44 + 7.4 * len(words)
    return "\n".join(head + out + ["</svg>"]) + "\n"
