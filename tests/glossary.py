#!/usr/bin/env python3
"""Holds docs/glossary.md against the code: each term is defined once, its home is there, and retired words stand
nowhere that they may not. Usage: glossary.py ROOT. Prints what is wrong and ends with 1, else 0."""

import collections
import pathlib
import re
import sys

ROOT = pathlib.Path(sys.argv[1])
UNREADABLE = {".png", ".json", ".stl", ".svg", ".gz", ".zip", ".uvj", ".sl1"}
wrong = []


def rows(text):
    for line in text.splitlines():
        if line.startswith("|"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if len(cells) != 3:
                wrong.append(f"docs/glossary.md: a row without three cells: {line}")
            elif cells[0] not in ("term", "word") and not set(cells[0]) <= set("-:"):
                yield cells


def files_of(place):
    path = ROOT / place
    if not path.exists():
        wrong.append(f"docs/glossary.md: {place} is not there")
    for file in [path] if path.is_file() else sorted(path.rglob("*")):
        if file.is_file() and file.suffix not in UNREADABLE and file.name != "glossary.md":
            yield file


def main():
    text = (ROOT / "docs/glossary.md").read_text()
    terms, retired = text.split("## Retired words")
    defined = collections.Counter()
    for term, _, home in rows(terms):
        defined[term.lower()] += 1
        path = re.fullmatch(r"`([^`]+)`", home)
        if path is None or not (ROOT / path.group(1)).exists():
            wrong.append(f"docs/glossary.md: {term}: its home {home} is not there")
    wrong.extend(f"docs/glossary.md: {term} is defined {n} times" for term, n in defined.items() if n > 1)
    words = 0
    for word, _, places in rows(retired):
        words += 1
        pattern = re.compile(r"\b" + re.escape(word) + r"s?\b")
        for place in re.findall(r"`([^`]+)`", places):
            for file in files_of(place):
                try:
                    lines = file.read_text().splitlines()
                except UnicodeDecodeError:
                    continue
                wrong.extend(f"{file.relative_to(ROOT)}:{n}: '{word}' is retired: {line.strip()[:90]}"
                             for n, line in enumerate(lines, 1) if pattern.search(line))
    if len(defined) < 100 or words < 10:
        wrong.append(f"docs/glossary.md: {len(defined)} terms and {words} retired words; were its tables read?")
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong" if wrong else f"glossary: {len(defined)} terms, {words} retired words")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
