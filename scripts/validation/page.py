# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What a page consists of, and the page as Markdown and as HTML that needs no other file."""
import dataclasses
import html


@dataclasses.dataclass
class Table:
    head: list
    rows: list


@dataclasses.dataclass
class Section:
    """A set of measurements. Texts are plain sentences; `figures` go into the JSON by name."""
    key: str
    title: str
    source: str
    known: str
    fitted: str
    predicted: str
    proves: str
    proves_not: str
    tables: list = dataclasses.field(default_factory=list)
    pictures: list = dataclasses.field(default_factory=list)
    notes: list = dataclasses.field(default_factory=list)
    figures: dict = dataclasses.field(default_factory=dict)

    def says(self):
        return [(name, text) for name, text in (
            ("Measured by", self.source), ("Known", self.known), ("Fitted", self.fitted), ("Predicted", self.predicted),
            ("What it proves", self.proves), ("What it does not", self.proves_not)) if text]


def figure(value, digits=3):
    """A number with so many digits that count; whole where it is large."""
    if value is None or value != value:
        return "-"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    return f"{value:.0f}" if 1e-4 < abs(value) < 1e9 else text


def signed(value, digits=2):
    text = figure(value, digits)
    return text if text in ("-", "0") or text.startswith("-") else "+" + text


def percent(share, digits=2):
    return "-" if share is None or share != share else f"{signed(100 * share, digits)} %"


def table_lines(table):
    rows = [" | ".join(str(c) for c in row) for row in (table.head, *table.rows)]
    return [f"| {rows[0]} |", "|" + "---|" * len(table.head), *(f"| {row} |" for row in rows[1:])]


def markdown(sections, picture_prefix):
    out = []
    for s in sections:
        out += [f"### {s.title}", ""]
        out += [f"- **{name}**: {text}" for name, text in s.says()] + [""]
        out += [line for t in s.tables for line in (*table_lines(t), "")]
        out += [line for p in s.pictures for line in (f"![{p.alt}]({picture_prefix}{p.name}.svg)", "")]
        out += [line for n in s.notes for line in (n, "")]
    return "\n".join(out)


def page(title, introduction, sections):
    text = html.escape
    out = ["<!DOCTYPE html>", '<html lang="en"><head><meta charset="utf-8">',
           '<meta name="viewport" content="width=device-width, initial-scale=1">', f"<title>{text(title)}</title>",
           "<style>body{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}"
           "table{border-collapse:collapse;margin:1rem 0;display:block;overflow-x:auto}td,th{border:1px solid #ccc;padding:.3rem .6rem;"
           "text-align:left}th{background:#f3f3f3}svg{max-width:100%;height:auto}dt{font-weight:bold}</style></head><body>",
           f"<h1>{text(title)}</h1>"]
    out += [f"<p>{text(p)}</p>" for p in introduction]
    for s in sections:
        out += [f"<h2>{text(s.title)}</h2>", "<dl>"]
        out += [f"<dt>{text(name)}</dt><dd>{text(words)}</dd>" for name, words in s.says()] + ["</dl>"]
        for t in s.tables:
            out += ["<table><tr>" + "".join(f"<th>{text(c)}</th>" for c in t.head) + "</tr>"]
            out += ["<tr>" + "".join(f"<td>{text(str(c))}</td>" for c in row) + "</tr>" for row in t.rows] + ["</table>"]
        out += [p.svg() for p in s.pictures] + [f"<p>{text(n)}</p>" for n in s.notes]
    return "\n".join(out + ["</body></html>"]) + "\n"
