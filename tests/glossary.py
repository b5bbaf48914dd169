#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Holds docs/glossary.md and docs/glossary-code.md against the code: each term is defined once, its home is there,
and retired words stand nowhere that they may not. Usage: glossary.py ROOT. Prints what is wrong and ends with 1, else 0."""

import collections
import functools
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
                wrong.append(f"glossary: a row without three cells: {line}")
            elif cells[0] not in ("term", "word") and not set(cells[0]) <= set("-:"):
                yield cells


@functools.lru_cache(None)
def text_of(file):
    try:
        return file.read_text()
    except UnicodeDecodeError:
        return ""


@functools.lru_cache(None)
def files_of(place):
    path = ROOT / place
    if not path.exists():
        wrong.append(f"glossary: {place} is not there")
    return [file for file in ([path] if path.is_file() else sorted(path.rglob("*")))
            if file.is_file() and file.suffix not in UNREADABLE and file.name not in ("glossary.md", "glossary-code.md")]


def main():
    pages = [(ROOT / "docs" / name).read_text() for name in ("glossary.md", "glossary-code.md")]
    terms, retired = "\n".join(pages).split("## Retired words")
    defined = collections.Counter()
    for term, _, home in rows(terms):
        defined[term.lower()] += 1
        path = re.fullmatch(r"`([^`]+)`", home)
        if path is None or not (ROOT / path.group(1)).exists():
            wrong.append(f"glossary: {term}: its home {home} is not there")
    wrong.extend(f"glossary: {term} is defined {n} times" for term, n in defined.items() if n > 1)
    words = 0
    for word, _, places in rows(retired):
        words += 1
        pattern = re.compile(r"\b" + re.escape(word) + r"s?\b")
        for place in re.findall(r"`([^`]+)`", places):
            for file in files_of(place):
                if word in text_of(file) and pattern.search(text_of(file)):
                    wrong.extend(f"{file.relative_to(ROOT)}:{n}: '{word}' is retired: {line.strip()[:90]}"
                                 for n, line in enumerate(text_of(file).splitlines(), 1) if pattern.search(line))
    if len(defined) < 100 or words < 10:
        wrong.append(f"glossary: {len(defined)} terms and {words} retired words; were its tables read?")
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong" if wrong else f"glossary: {len(defined)} terms, {words} retired words")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
