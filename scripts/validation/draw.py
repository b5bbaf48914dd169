# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures as SVG: measured points with bars, our line and our band."""
import html
import math

COLOURS = ("#1b5e91", "#b4481e", "#3f7d3a", "#7a4a97", "#8a6d00")
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 430, 300, 62, 14, 34, 50


def ticks(low, high, log):
    if log:
        marks = [m * 10.0 ** e for e in range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1) for m in (1, 2, 5)]
        marks = [m for m in marks if low <= m <= high]
        few = [m for m in marks if abs(math.log10(m) - round(math.log10(m))) < 1e-9]
        return few if len(few) > 3 else marks
    step = 10.0 ** math.floor(math.log10((high - low) / 4))
    step = next(step * m for m in (1, 2, 5, 10) if (high - low) / (step * m) <= 6)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


class Panel:
    """One drawing: axes, and what is drawn in the order in which it was added."""

    def __init__(self, title, x, y, log_x=False, log_y=False):
        self.title, self.x, self.y, self.log = title, x, y, (log_x, log_y)
        self.items, self.legend = [], []

    def _add(self, kind, points, label, colour, **more):
        points = [p for p in points if all(v is None or math.isfinite(v) for v in p)]
        self.items.append((kind, points, COLOURS[colour % len(COLOURS)], more))
        if label:
            self.legend.append((label, kind, COLOURS[colour % len(COLOURS)], more))
        return self

    def dots(self, points, label="", colour=0, hollow=False):
        """(x, y) or (x, y, bar): the bar reaches as far to either side."""
        return self._add("dots", points, label, colour, hollow=hollow)

    def line(self, points, label="", colour=0, dashed=False):
        return self._add("line", points, label, colour, dashed=dashed)

    def band(self, points, label="", colour=0):
        """(x, low, high)."""
        return self._add("band", points, label, colour)

    def _range(self, axis):
        values = []
        for kind, points, _, _ in self.items:
            for p in points:
                if axis == 0:
                    values.append(p[0])
                elif kind == "dots" and len(p) > 2:
                    values += [p[1] - p[2], p[1] + p[2]]
                else:
                    values += p[1:]
        if self.log[axis]:
            values = [v for v in values if v > 0]
            low, high = min(values), max(values)
            return low / 1.15, high * 1.15
        low, high = min(values), max(values)
        room = 0.05 * ((high - low) or abs(high) or 1)
        return (0 if 0 <= low < 0.35 * high else low - room), high + room

    def svg(self, left, top):
        (x0, x1), (y0, y1) = self._range(0), self._range(1)
        inner_w, inner_h = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

        def place(v, low, high, log):
            return math.log(max(v, low * 1e-6) / low) / math.log(high / low) if log else (v - low) / (high - low)

        def px(x):
            return left + LEFT + inner_w * min(max(place(x, x0, x1, self.log[0]), 0), 1)

        def py(y):
            return top + TOP + inner_h * (1 - min(max(place(y, y0, y1, self.log[1]), 0), 1))

        out = [f'<text x="{left + LEFT}" y="{top + 20}" class="title">{html.escape(self.title)}</text>']
        for v in ticks(x0, x1, self.log[0]):
            out.append(f'<line x1="{px(v):.1f}" y1="{py(y0):.1f}" x2="{px(v):.1f}" y2="{py(y1):.1f}" class="grid"/>')
            out.append(f'<text x="{px(v):.1f}" y="{py(y0) + 15:.1f}" text-anchor="middle">{v:g}</text>')
        for v in ticks(y0, y1, self.log[1]):
            out.append(f'<line x1="{px(x0):.1f}" y1="{py(v):.1f}" x2="{px(x1):.1f}" y2="{py(v):.1f}" class="grid"/>')
            out.append(f'<text x="{px(x0) - 6:.1f}" y="{py(v) + 4:.1f}" text-anchor="end">{v:g}</text>')
        out.append(f'<text x="{left + LEFT + inner_w / 2}" y="{top + HEIGHT - 14}" text-anchor="middle">{html.escape(self.x)}</text>')
        at = f"{left + 15},{top + TOP + inner_h / 2}"
        out.append(f'<text transform="translate({at}) rotate(-90)" text-anchor="middle">{html.escape(self.y)}</text>')
        for kind, points, colour, more in self.items:
            if kind == "band" and points:
                edge = [(p[0], p[1]) for p in points] + [(p[0], p[2]) for p in reversed(points)]
                path = " ".join(f"{px(x):.1f},{py(y):.1f}" for x, y in edge)
                out.append(f'<polygon points="{path}" fill="{colour}" opacity="0.16"/>')
            elif kind == "line":
                path = " ".join(f"{px(p[0]):.1f},{py(p[1]):.1f}" for p in points)
                dash = ' stroke-dasharray="6 4"' if more["dashed"] else ""
                out.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.8"{dash}/>')
            elif kind == "dots":
                for p in points:
                    if len(p) > 2:
                        ends = f'y1="{py(p[1] - p[2]):.1f}" x2="{px(p[0]):.1f}" y2="{py(p[1] + p[2]):.1f}"'
                        out.append(f'<line x1="{px(p[0]):.1f}" {ends} stroke="{colour}" stroke-width="1.5"/>')
                    fill = "#ffffff" if more["hollow"] else colour
                    out.append(f'<circle cx="{px(p[0]):.1f}" cy="{py(p[1]):.1f}" r="4" fill="{fill}" stroke="{colour}" stroke-width="1.6"/>')
        return out


class Picture:
    """Panels side by side, two in a row, with one legend below."""

    def __init__(self, name, alt, panels):
        self.name, self.alt, self.panels = name, alt, panels

    def svg(self):
        columns = min(2, len(self.panels))
        rows = -(-len(self.panels) // columns)
        entries = list(dict.fromkeys((label, kind, colour, tuple(more.items()))
                                     for p in self.panels for label, kind, colour, more in p.legend))
        width = max(columns * WIDTH, LEFT + 60 + 7 * max((len(e[0]) for e in entries), default=0))
        height = rows * HEIGHT + 22 * len(entries) + 14
        out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img">',
               f"<title>{html.escape(self.alt)}</title>",
               "<style>text{font:12px sans-serif;fill:#222}.title{font-weight:bold;font-size:13px}"
               ".grid{stroke:#d9d9d9;stroke-width:1}</style>",
               f'<rect width="{width}" height="{height}" fill="#ffffff"/>']
        for k, panel in enumerate(self.panels):
            out += panel.svg((k % columns) * WIDTH, (k // columns) * HEIGHT)
        for k, (label, kind, colour, more) in enumerate(entries):
            y = rows * HEIGHT + 14 + 22 * k
            more = dict(more)
            if kind == "dots":
                fill = "#ffffff" if more["hollow"] else colour
                out.append(f'<circle cx="{LEFT + 14}" cy="{y}" r="4" fill="{fill}" stroke="{colour}" stroke-width="1.6"/>')
            elif kind == "band":
                out.append(f'<rect x="{LEFT}" y="{y - 6}" width="28" height="12" fill="{colour}" opacity="0.16"/>')
            else:
                dash = ' stroke-dasharray="6 4"' if more["dashed"] else ""
                out.append(f'<line x1="{LEFT}" y1="{y}" x2="{LEFT + 28}" y2="{y}" stroke="{colour}" stroke-width="1.8"{dash}/>')
            out.append(f'<text x="{LEFT + 38}" y="{y + 4}">{html.escape(label)}</text>')
        return "\n".join(out + ["</svg>"]) + "\n"
